"""What a comparison is, and taking turns."""

from collections.abc import Callable
from dataclasses import dataclass, field

from processes import Failure


class Disagreement(Exception):
    """Programs that should say the same do not: their times mean nothing."""


@dataclass
class Contender:
    """A program with one piece of work."""

    program: str
    # One sentence: what it does differently from this program.
    differs: str
    # Does the work once and returns at least {"seconds": …}; the rest are facts about the answer.
    measure: Callable[[], dict]
    # Key of its version, and of the reason why it is not there.
    package: str = "mcl-eval"


@dataclass
class Comparison:
    """The same work by several programs, this one first."""

    name: str
    title: str
    size: str
    unit: str
    # What "seconds" are divided by to give the unit.
    seconds_per_unit: float
    contenders: list[Contender]
    # Takes the answers of a round by program, and may add facts to them; raises Disagreement.
    check: Callable[[dict[str, dict]], None] = lambda answers: None


@dataclass
class Row:
    benchmark: str
    program: str
    version: str
    round: int
    size: str
    seconds: float
    unit: str
    value: float
    facts: dict = field(default_factory=dict)


def take_turns(comparisons, environment, rounds: int, say):
    """Measures every contender once per round; returns rows, and reasons by (name, size, program)."""
    rows, lost = [], {}
    for comparison in comparisons:
        running = []
        for contender in comparison.contenders:
            if contender.package in environment.missing:
                key = (comparison.name, comparison.size, contender.program)
                lost[key] = environment.missing[contender.package]
            else:
                running.append(contender)
        for number in range(rounds):
            say(f"{comparison.name}, {comparison.size}: round {number + 1} of {rounds}")
            answers = {}
            for contender in list(running):
                try:
                    answer = contender.measure()
                except Failure as failure:
                    if contender.package == "mcl-eval":
                        raise
                    lost[comparison.name, comparison.size, contender.program] = str(failure)
                    running.remove(contender)
                    continue
                answers[contender.program] = answer
            comparison.check(answers)
            rows += [row(comparison, c, number, answers, environment) for c in running]
    return rows, lost


def row(comparison, contender, number: int, answers: dict, environment) -> Row:
    answer = answers[contender.program]
    return Row(
        benchmark=comparison.name,
        program=contender.program,
        version=environment.versions[contender.package],
        round=number,
        size=comparison.size,
        seconds=answer["seconds"],
        unit=comparison.unit,
        value=answer["seconds"] / comparison.seconds_per_unit,
        facts={key: answer[key] for key in answer if key != "seconds"},
    )

#!/usr/bin/env python3
"""Compares mcl-eval with other programs: installs them, takes turns, writes results.

Exit codes: 0 done; 1 failed, or programs that should agree do not; 3 done, but a peer is missing
(which the table says, with the reason).
"""

import argparse
import sys
from pathlib import Path

import data
import em
import localize
import nearest
import report
import sampling
from compare import Disagreement, take_turns
from environment import prepare, target_folder
from processes import ROOT, Failure, Runner

# The data set of each; the simulated office stands in where it is not at hand.
BENCHMARKS = {
    "em": (em, "intel-lab"),
    "sampling": (sampling, "freiburg-079"),
    "nearest": (nearest, "intel-lab"),
    "filter": (localize, "intel-lab"),
}


def say(text: str):
    print(text, file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "results" / "benchmarks")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", choices=BENCHMARKS, action="append", help="may be given several times")
    parser.add_argument("--install-localizers", action="store_true", help="install only the localizers, then exit")
    arguments = parser.parse_args()
    if arguments.rounds < 1:
        parser.error("--rounds: at least 1")

    runner = Runner(target_folder())
    if arguments.install_localizers:
        environment = prepare(runner, say, modules={"amcl": "amcl"}, build=False)
    else:
        environment = prepare(runner, say)
    for peer, reason in environment.missing.items():
        say(f"warning: {peer} cannot be installed: {reason}")
    if arguments.install_localizers:
        say(f"PATH begins with {environment.folder / 'bin'}:{environment.python.parent} for these")
        return 3 if environment.missing else 0

    loaded, comparisons = {}, []
    for name in arguments.only or BENCHMARKS:
        module, wanted = BENCHMARKS[name]
        if wanted not in loaded:
            loaded[wanted] = data.load(environment, wanted, say)
        comparisons += module.comparisons(loaded[wanted])
    used = {wanted: found.name for wanted, found in loaded.items()}
    about = report.about(environment, arguments.rounds, used)

    rows, lost = take_turns(comparisons, environment, arguments.rounds, say)
    report.write(arguments.output, comparisons, rows, lost, about, runner.commands)
    say(f"written: {runner.text(arguments.output)}/ratios.md")
    for (name, size, program), reason in lost.items():
        if reason not in environment.missing.values():
            say(f"warning: {name}, {size}, {program}: {reason}")
    return 3 if lost else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Failure, Disagreement) as error:
        say(f"error: {error}")
        sys.exit(1)

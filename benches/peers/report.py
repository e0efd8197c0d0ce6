"""Writes results: rows, versions, commands and the table of ratios."""

import csv
import dataclasses
import datetime
import json
import os
import platform
import statistics
from pathlib import Path

from compare import Comparison, Row
from environment import Environment, all_python_packages
from processes import Failure


def write(folder: Path, comparisons, rows: list[Row], lost: dict, about: dict, commands):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "versions.json").write_text(json.dumps(about, indent=2) + "\n")
    (folder / "commands.txt").write_text("\n".join(commands) + "\n")
    with open(folder / "rows.csv", "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(field.name for field in dataclasses.fields(Row))
        for row in rows:
            facts = ";".join(f"{name}={value}" for name, value in row.facts.items())
            table.writerow([*dataclasses.astuple(row)[:-1], facts])
    (folder / "ratios.md").write_text(ratios(comparisons, rows, lost, about))


def about(environment: Environment, rounds: int, data: dict) -> dict:
    """Versions, machine and circumstances."""
    run = environment.runner.run
    try:
        commit = run(["git", "describe", "--always", "--abbrev=40", "--dirty"], setup=True).strip()
    except Failure:
        commit = None
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "commit": commit,
        "cpu": cpu(),
        "cores": len(os.sched_getaffinity(0)),
        "load_average_before": os.getloadavg(),
        "system": platform.platform(),
        "rustc": run(["rustc", "--version"], setup=True).strip(),
        "python": platform.python_version(),
        "rounds": rounds,
        "data": data,
        "versions": environment.versions,
        "missing": environment.missing,
        "python_packages": all_python_packages(environment),
    }


def cpu() -> str:
    """Model and vector instructions, where the system reports them."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor() or "unknown"
    facts = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    facts = {name.strip(): value.strip() for name, value in facts.items()}
    wide = [name for name in ("avx2", "avx512f") if name in facts.get("flags", "").split()]
    return " ".join([facts.get("model name", "unknown"), *wide])


def ratios(comparisons: list[Comparison], rows: list[Row], lost: dict, about: dict) -> str:
    lines = [
        "# mcl-eval beside other programs",
        "",
        f"Made by `make peers` on {about['date']}, commit {about['commit']}, {about['cpu']}, processor time on one core, "
        f"{about['rounds']} rounds in turns. Ratios are a peer's time over mcl-eval's of the same round: "
        "the median, and the smallest and largest of the rounds. Rows: `rows.csv`; versions: "
        "`versions.json`; commands: `commands.txt`.",
    ]
    titles = dict.fromkeys(comparison.title for comparison in comparisons)
    for title in titles:
        group = [comparison for comparison in comparisons if comparison.title == title]
        lines += ["", f"## {title}", ""]
        columns = ["size", "program", group[0].unit, "min – max", "ratio", "min – max"]
        lines += [f"| {' | '.join([*columns, 'answer in the last round'])} |"]
        lines += ["|---|---|---|---|---|---|---|"]
        for comparison in group:
            for contender in comparison.contenders:
                lines.append(line(comparison, contender, rows, lost))
        lines.append("")
        sentences = {c.program: c for comparison in group for c in comparison.contenders}
        for program, contender in sentences.items():
            version = about["versions"].get(contender.package, "not there")
            lines.append(f"- **{program}** ({contender.package} {version}): {contender.differs}.")
    return "\n".join(lines) + "\n"


def line(comparison: Comparison, contender, rows: list[Row], lost: dict) -> str:
    def of(program):
        same = (comparison.name, comparison.size, program)
        return {row.round: row for row in rows if (row.benchmark, row.size, row.program) == same}

    start = f"| {comparison.size} | {contender.program} |"
    reason = lost.get((comparison.name, comparison.size, contender.program))
    if reason is not None:
        return f"{start} not measured: {reason.replace('|', '/')} | | | | |"
    ours, theirs = of(comparison.contenders[0].program), of(contender.program)
    values = [row.value for row in theirs.values()]
    paired = [theirs[round].value / ours[round].value for round in theirs]
    last = theirs[max(theirs)].facts
    facts = ", ".join(f"{name.replace('_', ' ')} {fact(value)}" for name, value in last.items())
    ratio = (
        " – | – |"
        if contender is comparison.contenders[0]
        else f" {digits(statistics.median(paired))} | {digits(min(paired))} – {digits(max(paired))} |"
    )
    spread = f"{digits(min(values))} – {digits(max(values))}"
    return f"{start} {digits(statistics.median(values))} | {spread} |{ratio} {facts} |"


def digits(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:#.3g}".rstrip(".")


def fact(value) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:.6g}"

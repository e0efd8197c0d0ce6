"""Running programs: on one core, under a memory limit, and with a record of what was run."""

import json
import os
import re
import resource
import shlex
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

ONE_THREAD = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "RAYON_NUM_THREADS",
    )
}


class Failure(Exception):
    """A program could not be run to its end; says which and why."""


class Runner:
    """Runs programs from the repository's root, and remembers commands, each once."""

    def __init__(self, target: Path):
        self.target = target
        self.commands: dict[str, None] = {}

    def text(self, argument) -> str:
        """An argument as the record shows it: without the places of this machine."""
        shown = str(argument).replace(str(self.target), "target")
        return shown.replace(str(ROOT) + os.sep, "").replace(str(ROOT), ".")

    def run(self, argv, *, libraries=(), memory=None, cwd=ROOT, setup=False):
        """Runs a program and returns its standard output.

        libraries: folders to look for shared libraries in; memory: limit in bytes; setup: not part
        of the comparison, so neither remembered nor pinned to one core, where no thread pool of a
        program's own helps it.
        """
        argv = [str(argument) for argument in argv]
        shown = shlex.join(map(self.text, argv))
        if cwd != ROOT:
            shown = f"cd {shlex.quote(self.text(cwd))} && {shown}"
        if not setup:
            self.commands[shown] = None
        environment = os.environ | ({} if setup else ONE_THREAD)
        if libraries:
            environment["LD_LIBRARY_PATH"] = os.pathsep.join(map(str, libraries))
        core = max(os.sched_getaffinity(0))

        def limit():
            if not setup:
                os.sched_setaffinity(0, {core})
            if memory:
                resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

        try:
            done = subprocess.run(
                argv,
                cwd=cwd,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                preexec_fn=limit,
                timeout=1800,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise Failure(f"{shortened(shown)}: {self.text(error)}") from error
        if done.returncode != 0:
            reason = self.text(reason_in(done.stderr.strip() or done.stdout.strip()))
            raise Failure(f"{shortened(shown)}: exit code {done.returncode}: {reason}")
        return done.stdout

    def json(self, argv, **options):
        """Runs a program that prints one JSON object."""
        output = self.run(argv, **options)
        try:
            return json.loads(output)
        except ValueError as error:
            raise Failure(f"{self.text(argv[0])}: no JSON on stdout: {output[:200]!r}") from error


def shortened(command: str) -> str:
    return command if len(command) <= 60 else f"{command[:60]}…"


def reason_in(output: str) -> str:
    """The line of a program's output that says what went wrong, as far as that is known."""
    lines = output.splitlines() or ["nothing said"]
    telling = (line for line in lines if re.search(r"^(E|ERROR|[Ee]rror|Message):", line))
    return next(telling, lines[-1])


def processor_seconds() -> float:
    """Processor time of all programs that were run so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime

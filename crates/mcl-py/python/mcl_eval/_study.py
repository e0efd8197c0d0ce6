"""Studies, run by the command in a process of its own: its rows are safe whatever happens to this one."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Union

from ._native import DataWarning, Error
from ._table import Table, read_results

Name = Union[str, "os.PathLike[str]"]

# How long the command is waited for after Ctrl-C; what it writes is whole or not there.
_PATIENCE_S = 1.0


@dataclass(frozen=True)
class StudyRun:
    """How a study ended."""

    trials: int
    """Trials that the study asks for."""
    done: int
    """Trials that have rows."""
    failed: int
    """Trials that failed in this run."""
    folders: list[Path]
    """Folders of results, one per data set."""

    def tables(self) -> list[Table]:
        """The rows of each folder."""
        return [read_results(folder) for folder in self.folders]


def run(
    study: Name,
    *,
    dataset: Name | Iterable[Name] | None = None,
    output: Name = "results",
    fresh: bool = False,
    max_range: float | None = None,
    quiet: bool = False,
) -> StudyRun:
    """Run a study (a TOML file, or the name of one of the program's own), and go on where an earlier run ended.

    dataset names data sets or logs, by default those of the study that are at hand; results go into
    output/<study>/<data set>. fresh removes the rows of earlier runs first. Progress is written to sys.stderr, unless
    quiet. After Ctrl-C the rows of finished trials are safe, and the same call goes on from there.
    """
    datasets = [dataset] if isinstance(dataset, (str, os.PathLike)) else list(dataset or [])
    options = [f"--dataset={os.fspath(name)}" for name in datasets]
    if fresh:
        options.append("--fresh")
    if max_range is not None:
        options.append(f"--max-range={max_range!r}")
    if quiet:
        options.append("--quiet")
    command = [sys.executable, "-m", "mcl_eval", "run", "--json", *options]
    command += ["--output", os.fspath(output), "--", os.fspath(study)]
    # What this process imports the package from, its own is to find, too.
    path = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        env={**os.environ, "PYTHONPATH": path},
    )
    errors: list[str] = []
    losses: list[str] = []
    try:
        assert process.stderr is not None and process.stdout is not None
        for line in process.stderr:
            if line.startswith("warning: "):
                losses.append(line.removeprefix("warning: ").rstrip())
            elif line.startswith("error: "):
                errors.append(line.removeprefix("error: ").rstrip())
            elif not quiet:
                sys.stderr.write(line)
        found = process.stdout.read()
        code = process.wait()
    except BaseException:
        process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        raise
    finally:
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()
    for loss in losses + (errors if code == 3 else []):
        warnings.warn(loss, DataWarning, stacklevel=2)
    if code not in (0, 3):
        message = "; ".join(errors) or f"the command ended with exit code {code}"
        raise (FileNotFoundError if _is_missing(study, message) else Error)(message)
    result = json.loads(found)
    folders = [Path(folder) for folder in result["folders"]]
    return StudyRun(result["trials"], result["done"], result["failed"], folders)


def _is_missing(study: Name, message: str) -> bool:
    """Whether an error is that the file of the study is not there."""
    name = os.fspath(study)
    return name.endswith(".toml") and not os.path.exists(name) and name in message

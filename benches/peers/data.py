"""What all programs work on: points, queries, scans and maps of a data set, in files."""

import array
import csv
import json
from dataclasses import dataclass
from pathlib import Path

from environment import Environment
from processes import Failure

SIMULATED = "simulated-office"


@dataclass
class Data:
    name: str
    folder: Path
    points: int
    max_range: float
    scans: list[dict]
    environment: Environment

    def file(self, name: str) -> Path:
        return self.folder / name

    def map(self, percent: str, refine: bool = False) -> tuple[Path, Path]:
        """A grid-sampled map of that many percent, refined by fuzzy k-means if asked: the same
        points as CSV and as little-endian doubles."""
        name = f"map-{percent}{'-fkm' if refine else ''}"
        text, binary = self.file(f"{name}.csv"), self.file(f"{name}.f64")
        size = ["--init", "all"] if percent == "100" else ["--init", "grid", "--size", f"{percent}%"]
        argv = [self.environment.mcl_eval, "map", self.name, *size, "--quiet", "-o", text]
        self.environment.runner.run([*argv, *(["--refine", "fkm"] if refine else [])])
        with open(text, newline="") as rows:
            table = csv.reader(rows)
            next(table)
            coordinates = array.array("d", (float(value) for row in table for value in row))
        binary.write_bytes(coordinates.tobytes())
        return text, binary


def load(environment: Environment, wanted: str, say) -> Data:
    """A data set, or the simulated office where it is not at hand (with a note)."""
    try:
        return export(environment, wanted)
    except Failure as failure:
        say(f"{wanted} is not at hand ({failure}): taking the simulated office")
        return export(environment, SIMULATED)


def export(environment: Environment, name: str) -> Data:
    folder = environment.folder / "data" / name
    folder.mkdir(parents=True, exist_ok=True)
    told = environment.runner.json([environment.peers, "export", name, folder])
    with open(folder / "scans.jsonl") as lines:
        scans = [json.loads(line) for line in lines]
    return Data(name, folder, told["points"], told["max_range"], scans, environment)


def doubles(path: Path) -> array.array:
    numbers = array.array("d")
    numbers.frombytes(path.read_bytes())
    return numbers

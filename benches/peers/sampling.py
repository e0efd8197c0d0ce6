"""Grid-based sampling beside voxel-grid filters."""

import time

from compare import Comparison, Contender, Disagreement
from data import Data
from processes import processor_seconds

CELL = "0.5"
# Points on cell borders may round into the neighbouring cell.
BORDER_FRACTION = 1e-3


def comparisons(data: Data) -> list[Comparison]:
    return [filters(data), command(data)]


def filters(data: Data) -> Comparison:
    environment = data.environment
    points = data.file("points.f64")

    def peer(program):
        return lambda: environment.worker("sampling.py", program, points, CELL, peer=program)

    return Comparison(
        name="sampling",
        title=f"Grid-based sampling itself, {data.name}, {data.points:,} points, cells of {CELL} m",
        size=f"{data.points}",
        unit="ms",
        seconds_per_unit=1e-3,
        contenders=[
            Contender(
                "mcl-eval",
                "keeps per cell the data point nearest to the mean of its points (two passes over them)",
                lambda: environment.runner.json([environment.peers, "sample", points, CELL]),
            ),
            Contender(
                "small_gicp",
                "`voxelgrid_sampling` in 3-D (z = 0): returns the mean of each cell, which is not a data "
                "point, so it needs no second pass; sorts the points by cell",
                peer("small_gicp"),
                "small_gicp",
            ),
            Contender(
                "open3d",
                "`voxel_down_sample` in 3-D (z = 0): returns the mean of each cell; its grid begins half a "
                "cell before the smallest coordinates, hence another number of cells",
                peer("open3d"),
                "open3d",
            ),
        ],
        check=check,
    )


def check(answers: dict[str, dict]):
    """small_gicp has the same grid, so as many cells."""
    if "small_gicp" not in answers:
        return
    expected, found = answers["mcl-eval"]["points"], answers["small_gicp"]["points"]
    if abs(found - expected) > BORDER_FRACTION * expected:
        raise Disagreement(f"sampling: small_gicp returns {found} points, mcl-eval {expected}")


def command(data: Data) -> Comparison:
    """The whole command, which has no peer: reading the log, sampling and writing the map."""
    environment = data.environment
    argv = [environment.mcl_eval, "map", data.name, "--init", "grid", "--cell", CELL]
    argv += ["--threads", "1", "--quiet", "-o", data.file("command.csv")]

    def measure():
        start = time.perf_counter(), processor_seconds()
        environment.runner.run(argv)
        wall, processor = time.perf_counter() - start[0], processor_seconds() - start[1]
        return {"seconds": wall, "processor_ms": 1e3 * processor}

    return Comparison(
        name="map command",
        title=f"`mcl-eval map {data.name} --init grid --cell {CELL} --threads 1`, wall time of the whole",
        size=f"{data.points}",
        unit="ms",
        seconds_per_unit=1e-3,
        contenders=[Contender("mcl-eval", "no peer does the whole of it", measure)],
    )

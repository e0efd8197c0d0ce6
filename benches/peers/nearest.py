"""Distances to the nearest map point, as a likelihood field asks for them."""

from compare import Comparison, Contender, Disagreement
from data import Data, doubles

MAX_DISTANCE = "2"
QUERIES = 100_000
# mcl-eval's fast path promises this (m); the others compute in doubles.
FIELD_TOLERANCE, TOLERANCE = 1e-5, 1e-9


def comparisons(data: Data) -> list[Comparison]:
    return [comparison(data, percent) for percent in ("0.1", "1", "10", "100")]


def comparison(data: Data, percent: str) -> Comparison:
    environment = data.environment
    _, points = data.map(percent)
    queries = data.file("queries.f64")

    def arguments(program):
        return [points, queries, MAX_DISTANCE, data.file(f"distances-{program}.f64")]

    def ours(program):
        return lambda: environment.runner.json([environment.peers, program, *arguments(program)])

    def peer(program):
        return lambda: environment.worker(
            "nearest.py", program, *arguments(program), peer=program
        )

    def check(answers):
        exact = doubles(data.file("distances-kiddo.f64"))
        for program in answers:
            file = "field" if program == "mcl-eval" else program
            found = doubles(data.file(f"distances-{file}.f64"))
            worst = max(abs(a - b) for a, b in zip(found, exact, strict=True))
            tolerance = FIELD_TOLERANCE if program == "mcl-eval" else TOLERANCE
            answers[program]["largest_difference_m"] = worst
            if not worst <= tolerance:
                raise Disagreement(
                    f"nearest, {percent} %: {program} is up to {worst} m off, allowed {tolerance}"
                )

    return Comparison(
        name="nearest",
        title=f"Distance to the nearest map point, {data.name}, {QUERIES:,} endpoints of scans",
        size=f"{percent} %",
        unit="ns per query",
        seconds_per_unit=1e-9 * QUERIES,
        contenders=[
            Contender(
                "mcl-eval",
                "`DistanceField::distances_squared`: squared distances cut at 2 m, within 1e-5 m, without "
                "the index of the point; building it (not timed) costs more than a tree",
                ours("field"),
            ),
            Contender(
                "kiddo",
                "the kd-tree in Rust that mcl-eval uses as its reference: exact doubles, gives the index "
                "as well, no cut",
                ours("kiddo"),
            ),
            Contender(
                "scipy",
                "`cKDTree.query`, one batch: gives index and distance (a root more), no cut",
                peer("scipy"),
                "scipy",
            ),
            Contender(
                "small_gicp",
                "`KdTree.batch_nearest_neighbor_search` in 3-D (z = 0): gives index and squared distance "
                "as Python lists, whose making is timed with it",
                peer("small_gicp"),
                "small_gicp",
            ),
            Contender(
                "open3d",
                "`NearestNeighborSearch.knn_search` with k = 1 in 3-D (z = 0), one batch: gives index and "
                "squared distance",
                peer("open3d"),
                "open3d",
            ),
        ],
        check=check,
    )

"""What a call from Python costs, beside the same work in Rust and by SciPy and scikit-learn.

The points are those of the Intel log (155,648; the simulated office stands in where it is not at hand). Rounds are
interleaved and medians count. "Rust" is crates/mcl-eval/examples/speed.rs: the same functions, called without Python.

    python speed.py --rust target/release/examples/speed [--rounds 7]
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import mcl_eval


def seconds(work, repetitions):
    best = []
    for _ in range(repetitions):
        since = time.perf_counter()
        work()
        best.append(time.perf_counter() - since)
    return statistics.median(best)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rust", type=Path, help="the example that does the same in Rust")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    try:
        log = mcl_eval.read_log("intel-lab")
    except (mcl_eval.Error, OSError):
        log = mcl_eval.read_log("simulated-office")
    points = log.points
    map = mcl_eval.build_map(points, init="grid", size="1%")
    mcl_eval.distances(map, points[:1])
    work = {
        "distances": lambda: mcl_eval.distances(map, points),
        "likelihood": lambda: mcl_eval.log_likelihood(map, points),
        "map: grid": lambda: mcl_eval.build_map(points, init="grid", cell=0.5),
        "map: fkm": lambda: mcl_eval.build_map(
            points, init="grid", cell=0.5, refine="fkm", tolerance=0, max_iterations=5
        ),
        "one distance": lambda: mcl_eval.distances(map, points[:1]),
    }
    peers = {}
    try:
        from scipy.spatial import cKDTree

        tree = cKDTree(map.points)
        peers["distances", "SciPy cKDTree"] = lambda: tree.query(points, workers=-1)
        np.testing.assert_allclose(tree.query(points)[0], mcl_eval.distances(map, points), atol=1e-12)
    except ImportError:
        print("SciPy is not installed", file=sys.stderr)
    try:
        from sklearn.mixture import GaussianMixture
        from sklearn.neighbors import KDTree

        neighbors = KDTree(map.points)
        peers["distances", "scikit-learn KDTree"] = lambda: neighbors.query(points)
        mixture = GaussianMixture(len(map), covariance_type="spherical")
        mixture.weights_ = np.full(len(map), 1 / len(map))
        mixture.means_ = map.points
        mixture.covariances_ = np.full(len(map), 0.05**2)
        mixture.precisions_cholesky_ = np.full(len(map), 1 / 0.05)
        # Every component of every point: in parts, or it takes 2 GB.
        parts = np.array_split(points, 100)
        score = lambda: sum(mixture.score_samples(part).sum() for part in parts)  # noqa: E731
        assert abs(score() / mcl_eval.log_likelihood(map, points).total - 1) < 1e-9
        peers["likelihood", "scikit-learn GaussianMixture"] = score
    except ImportError:
        print("scikit-learn is not installed", file=sys.stderr)

    measured = {}

    def note(name, by, value):
        measured.setdefault((name, by), []).append(value)

    with tempfile.TemporaryDirectory() as folder:
        for name, array in [("points", points), ("map", map.points)]:
            Path(folder, name).write_bytes(array.tobytes())
        for _ in range(arguments.rounds):
            for name, call in work.items():
                note(name, "Python", seconds(call, 200 if name == "one distance" else 5))
            if arguments.rust:
                printed = subprocess.run([arguments.rust, folder], check=True, capture_output=True, text=True).stdout
                for name, value in json.loads(printed).items():
                    note(name, "Rust", value)
            for (name, by), call in peers.items():
                # The mixture takes seconds a call.
                note(name, by, seconds(call, 1))
    medians = {key: statistics.median(values) for key, values in measured.items()}
    if arguments.json:
        print(json.dumps([{"work": name, "by": by, "seconds": value} for (name, by), value in medians.items()]))
        return
    print(f"{log.name}: {len(points)} points, map of {len(map)}; median of {arguments.rounds} rounds\n")
    print("| work | by | ms | to Python |\n|---|---|---|---|")
    for (name, by), value in sorted(medians.items()):
        print(f"| {name} | {by} | {1e3 * value:.3f} | {value / medians[name, 'Python']:.3f} |")


if __name__ == "__main__":
    main()

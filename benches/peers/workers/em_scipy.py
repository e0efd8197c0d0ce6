"""One iteration of fuzzy k-means with SciPy's kd-tree: POINTS MEANS SIGMA RADIUS.

RADIUS in σ: components farther from a point are left out of its sum, and a point without any within
it takes its nearest one. RADIUS "bound": per point, what is left out is below 10⁻¹² of the sum, as
in mcl-eval.
"""

import sys

import numpy as np
from scipy.spatial import cKDTree
from timing import read, tell, timed

EPSILON = 1e-12


def within_radius(points_tree, tree, distance, nearest, radius):
    """Pairs as (point, component, squared distance)."""
    pairs = points_tree.sparse_distance_matrix(tree, radius, output_type="ndarray")
    far = np.flatnonzero(distance > radius)
    point = np.concatenate([pairs["i"], far])
    component = np.concatenate([pairs["j"], nearest[far]])
    return point, component, np.concatenate([pairs["v"], distance[far]]) ** 2


def within_bound(points, means, tree, distance, sigma):
    reach = np.sqrt(distance**2 + 2 * sigma**2 * np.log(len(means) / EPSILON))
    lists = tree.query_ball_point(points, reach, return_sorted=False)
    count = np.fromiter(map(len, lists), dtype=np.intp, count=len(points))
    point = np.repeat(np.arange(len(points)), count)
    component = np.concatenate(lists).astype(np.intp)
    return point, component, ((points[point] - means[component]) ** 2).sum(axis=1)


def iteration(points, points_tree, means, sigma, radius):
    """Returns the log-likelihood per point, the new means and the number of pairs."""
    tree = cKDTree(means)
    distance, nearest = tree.query(points)
    if radius is None:
        point, component, squared = within_bound(points, means, tree, distance, sigma)
    else:
        pairs = within_radius(points_tree, tree, distance, nearest, radius * sigma)
        point, component, squared = pairs
    # Relative to the nearest component, so that no sum underflows.
    weight = np.exp((distance[point] ** 2 - squared) / (2 * sigma**2))
    total = np.bincount(point, weight, len(points))
    log_sum = np.mean(np.log(total) - distance**2 / (2 * sigma**2))
    per_point = log_sum - np.log(len(means)) - np.log(2 * np.pi * sigma**2)

    responsibility = weight / total[point]
    mass = np.bincount(component, responsibility, len(means))
    moved = mass >= EPSILON
    updated = means.copy()
    for axis in range(2):
        pull = np.bincount(component, responsibility * points[point, axis], len(means))
        updated[moved, axis] = pull[moved] / mass[moved]
    return per_point, updated, len(point)


def main():
    points, means = read(sys.argv[1]), read(sys.argv[2])
    sigma = float(sys.argv[3])
    radius = None if sys.argv[4] == "bound" else float(sys.argv[4])
    # Once for all the maps of the data, like mcl-eval's arrangement of the points.
    points_tree = cKDTree(points)
    seconds, (per_point, _, pairs) = timed(
        lambda: iteration(points, points_tree, means, sigma, radius)
    )
    tell(seconds, log_likelihood_per_point=per_point, pairs=pairs)


main()

"""Distances to the nearest map point: PROGRAM MAP QUERIES MAX_DISTANCE ANSWERS.

Building the tree is not timed. Writes the distances, cut, as little-endian doubles.
"""

import sys

import numpy as np
from timing import read, tell, timed, with_zero


def scipy(points, queries):
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    seconds, (distances, _) = timed(lambda: tree.query(queries, workers=1))
    return seconds, distances


def small_gicp(points, queries):
    from small_gicp import KdTree

    tree, queries = KdTree(with_zero(points)), with_zero(queries)
    seconds, (_, squared) = timed(lambda: tree.batch_nearest_neighbor_search(queries, num_threads=1))
    return seconds, np.sqrt(squared)


def open3d(points, queries):
    from open3d.core import Tensor
    from open3d.core.nns import NearestNeighborSearch

    search = NearestNeighborSearch(Tensor(with_zero(points)))
    search.knn_index()
    queries = Tensor(with_zero(queries))
    seconds, (_, squared) = timed(lambda: search.knn_search(queries, 1))
    return seconds, np.sqrt(squared.numpy().reshape(-1))


def main():
    program = {"scipy": scipy, "small_gicp": small_gicp, "open3d": open3d}[sys.argv[1]]
    seconds, distances = program(read(sys.argv[2]), read(sys.argv[3]))
    np.minimum(distances, float(sys.argv[4])).astype("<f8").tofile(sys.argv[5])
    tell(seconds)


main()

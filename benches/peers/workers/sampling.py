"""Voxel-grid filters: PROGRAM POINTS CELL. Conversion to the program's own type is not timed."""

import sys

from timing import read, tell, timed, with_zero


def small_gicp(points, cell):
    from small_gicp import PointCloud, voxelgrid_sampling

    cloud = PointCloud(points)
    seconds, sampled = timed(lambda: voxelgrid_sampling(cloud, cell, num_threads=1))
    return seconds, sampled.size()


def open3d(points, cell):
    from open3d.geometry import PointCloud
    from open3d.utility import Vector3dVector

    cloud = PointCloud(Vector3dVector(points))
    seconds, sampled = timed(lambda: cloud.voxel_down_sample(cell))
    return seconds, len(sampled.points)


def main():
    program = {"small_gicp": small_gicp, "open3d": open3d}[sys.argv[1]]
    seconds, kept = program(with_zero(read(sys.argv[2])), float(sys.argv[3]))
    tell(seconds, points=kept)


main()

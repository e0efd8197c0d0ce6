"""Reads a CARMEN log on its own, to say what a bag made of it must hold."""

import gzip
import math
from decimal import Decimal


def wrap(angle):
    """To (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def compose(a, b):
    """Pose of c in a, from b in a and c in b."""
    sin, cos = math.sin(a[2]), math.cos(a[2])
    return (a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], wrap(a[2] + b[2]))


def between(a, b):
    """Pose of b in the frame of a."""
    sin, cos = math.sin(a[2]), math.cos(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return (cos * x + sin * y, cos * y - sin * x, wrap(b[2] - a[2]))


def inverse(a):
    return between(a, (0.0, 0.0, 0.0))


def read(path):
    """Scans of a corrected log: (nanoseconds, readings, reference pose, odometry pose).

    Odometry restarts at each scan's pose and is raw in between (see mcl_datasets::carmen); here its
    steps are put together from the origin. The laser is at the robot's origin in these logs.
    """
    opener = gzip.open if str(path).endswith(".gz") else open
    scans, last, odometry = [], None, (0.0, 0.0, 0.0)
    with opener(path, "rt", encoding="latin-1") as lines:
        for line in lines:
            fields = line.split()
            if not fields:
                continue
            if fields[0] == "ODOM":
                last = tuple(map(float, fields[1:4]))
            elif fields[0] == "FLASER":
                count = int(fields[1])
                readings = list(map(float, fields[2 : 2 + count]))
                pose = tuple(map(float, fields[2 + count : 5 + count]))
                stamp = int(Decimal(fields[8 + count]) * 10**9)
                if scans:
                    odometry = compose(odometry, between(scans[-1][2], last))
                scans.append((stamp, readings, pose, odometry))
    return scans

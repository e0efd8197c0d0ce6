"""The same rule of timing as in examples/peers.rs, and files."""

import json
import time

import numpy as np

MEASURED_SECONDS = 0.3
# The first call is not measured, unless it takes longer than this; then it is the only one.
LONG_SECONDS = 2.0


def timed(work):
    """The median processor time of a call in seconds, and its last answer."""
    start = time.process_time()
    answer = work()
    first = time.process_time() - start
    if first > LONG_SECONDS:
        return first, answer
    times = []
    start = time.process_time()
    while not times or time.process_time() - start < MEASURED_SECONDS:
        before = time.process_time()
        answer = work()
        times.append(time.process_time() - before)
    return sorted(times)[len(times) // 2], answer


def read(path):
    """Points from a file of little-endian doubles, x and y in turns: n × 2."""
    return np.fromfile(path, dtype="<f8").reshape(-1, 2)


def with_zero(points):
    """The same points in a plane of space: n × 3."""
    return np.column_stack([points, np.zeros(len(points))])


def tell(seconds, **facts):
    print(json.dumps({"seconds": seconds} | facts))

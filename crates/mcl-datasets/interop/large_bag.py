"""Times the reading of a large ROS 1 bag: `make large-bag`.

Writes a bag with `rosbags` (40 Hz LaserScans of 720 beams with intensities, 50 Hz Odometry and TF, chunks as
they are; with --images, most of it camera images), reads its scans, odometry and transforms by `rosbags`
and all of it by `mcl-eval inspect`, in turns, and prints wall time, processor time and peak memory of each.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS1_NOETIC)
STORE.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
READ = {"sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"}
BEAMS = 720
SPEED = 0.5  # m/s
HALF_LENGTH, HALF_WIDTH = 12.0, 4.0  # of the corridor, in metres


def ranges_at(x):
    """Distances to the walls of a corridor, seen from a place on its axis."""
    angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    with np.errstate(divide="ignore"):
        ahead = np.where(np.cos(angles) > 0, HALF_LENGTH - x, HALF_LENGTH + x) / abs(np.cos(angles))
        aside = HALF_WIDTH / abs(np.sin(angles))
    return np.minimum(ahead, aside).astype(np.float32)


def write(path, size, images):
    """A bag of about `size` bytes; with `images` all but a hundredth of it is camera images."""
    # `std_msgs` has a Time of its own.
    packages = ("builtin_interfaces/", "geometry_msgs/", "nav_msgs/", "sensor_msgs/", "tf2_msgs/", "std_msgs/msg/Header")
    make = {name.rsplit("/", 1)[1]: kind for name, kind in STORE.types.items() if name.startswith(packages)}
    covariance = np.zeros(36)
    picture = np.random.default_rng(1).integers(0, 255, 640 * 480 * 3, dtype=np.uint8)

    def header(stamp, frame):
        return make["Header"](0, make["Time"](stamp // 10**9, stamp % 10**9), frame)

    def transform(stamp, parent, child, x):
        vector, turn = make["Vector3"](x, 0.0, 0.0), make["Quaternion"](0.0, 0.0, 0.0, 1.0)
        return make["TransformStamped"](header(stamp, parent), child, make["Transform"](vector, turn))

    def messages(step):
        """Topics and messages of 5 ms."""
        stamp = 10**9 + step * 5_000_000
        x = HALF_LENGTH / 2 * np.sin(SPEED * step * 0.005 / HALF_LENGTH)
        if step == 0:
            yield "/tf_static", stamp, make["TFMessage"]([transform(stamp, "base_link", "laser", 0.0)])
        if step % 4 == 0:
            pose = make["Pose"](make["Point"](x, 0.0, 0.0), make["Quaternion"](0.0, 0.0, 0.0, 1.0))
            twist = make["Twist"](make["Vector3"](SPEED, 0.0, 0.0), make["Vector3"](0.0, 0.0, 0.0))
            yield "/odom", stamp, make["Odometry"](
                header(stamp, "odom"), "base_link",
                make["PoseWithCovariance"](pose, covariance), make["TwistWithCovariance"](twist, covariance),
            )
            yield "/tf", stamp, make["TFMessage"]([transform(stamp, "odom", "base_link", x)])
        if step % (200 if images else 5) == 0:
            ranges = ranges_at(x)
            step_angle = 2 * np.pi / BEAMS
            yield "/scan", stamp, make["LaserScan"](
                header(stamp, "laser"), -np.pi, np.pi - step_angle, step_angle, 0.0, 0.025, 0.1, 30.0,
                ranges, (100 / ranges).astype(np.float32),
            )
        if images and step % 7 == 0:
            yield "/camera/image_raw", stamp, make["Image"](
                header(stamp, "camera"), 480, 640, "rgb8", 0, 3 * 640, picture
            )

    with Writer(path) as bag:
        connections, written, step = {}, 0, 0
        while written < size:
            for topic, stamp, message in messages(step):
                name = message.__msgtype__
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, name, typestore=STORE)
                data = STORE.serialize_ros1(message, name)
                bag.write(connections[topic], stamp, data)
                written += len(data)
            step += 1


def read(path):
    """Deserializes what `mcl-eval` uses, and prints the number of scans."""
    scans = 0
    with AnyReader([path]) as bag:
        wanted = [connection for connection in bag.connections if connection.msgtype in READ]
        for connection, _, data in bag.messages(connections=wanted):
            bag.deserialize(data, connection.msgtype)
            scans += connection.msgtype == "sensor_msgs/msg/LaserScan"
    print(scans)


def timed(command):
    """Output of a command; its wall and processor time in seconds, and its peak memory in bytes."""
    start = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as child:
        output = child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode in (0, 3), f"{command}: exit code {child.returncode}"
    return output, (time.monotonic() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)


def compare(program, path, rounds):
    programs = {
        "rosbags": [sys.executable, __file__, "--read", str(path)],
        "mcl-eval inspect": [program, "inspect", "--json", str(path)],
    }
    best = {}
    for _ in range(rounds):
        scans = set()
        for name, command in programs.items():
            output, figures = timed(command)
            scans.add(int(output) if name == "rosbags" else json.loads(output)["scans"])
            best[name] = min(best.get(name, figures), figures)
        assert len(scans) == 1, f"they found different numbers of scans: {scans}"
    print(f"{path}: {path.stat().st_size / 1e9:.2f} GB, {scans.pop()} scans; best of {rounds}")
    for name, (wall, processor, memory) in best.items():
        print(f"  {name:<18}{wall:8.2f} s, {processor:8.2f} s of processor time, {memory / 1e6:8.0f} MB")
    first, second = best.values()
    print(f"  ratio             {first[0] / second[0]:8.1f},   {first[1] / second[1]:8.1f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", default="target/release/mcl-eval", help="the mcl-eval to time")
    parser.add_argument("--size", type=float, default=1.0, help="size of the bag in GB (default 1)")
    parser.add_argument("--images", action="store_true", help="most of the bag is camera images")
    parser.add_argument("--rounds", type=int, default=3, help="times each program reads the bag (default 3)")
    parser.add_argument("--bag", type=Path, help="the bag, made if it is not there and kept")
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.read:
        read(options.read)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = options.bag or Path(folder) / "large.bag"
        if not path.exists():
            write(path, options.size * 1e9, options.images)
        compare(options.program, path, options.rounds)


if __name__ == "__main__":
    main()

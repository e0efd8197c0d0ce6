"""Holds our bags against programs we did not write: `make interop`.

1. Bags that `mcl-eval convert` writes are read by `rosbags` and by `mcap` + `mcap-ros2-support`: every
   field of every message as the CARMEN log says, which is read here on its own.
2. Bags that `rosbags` and the `mcap` writer write, in every way they can, are read by `mcl-eval`; what
   `rosbags-convert` makes of a log, ROS 1 bags and SQLite databases, is the same recording bit for bit.
3. Replays that `mcl-eval localize` writes are read by both, and say what the run's files say.
4. `evo_ape` and `evo_rpe` give the ATE and RPE of `mcl-eval evaluate` (evo_check.py).

Prints a line for each check, PASS or FAIL; exit code 1 when any failed.
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

import carmen_log
import evo_check
import replay

PROGRAM = "mcl-eval"
failures = 0


def check(name, function, *args):
    """Runs a check and prints how it went."""
    global failures
    try:
        result = function(*args)
        print(f"PASS  {name}" + (f": {result}" if result else ""), flush=True)
    except Exception as error:  # A failed check is reported, and the others still run.
        failures += 1
        print(f"FAIL  {name}: {type(error).__name__}: {error}", flush=True)
        if not isinstance(error, AssertionError):
            traceback.print_exc()


def call(*args, code=0):
    done = subprocess.run([PROGRAM, *map(str, args)], capture_output=True, text=True, check=False)
    assert done.returncode == code, f"{args}: exit code {done.returncode}\n{done.stderr}"
    return done.stdout


def equal(what, found, expected):
    assert found == expected, f"{what} is {found!r}, expected {expected!r}"


def near(what, found, expected, tolerance):
    error = max(abs(a - b) for a, b in zip(found, expected, strict=True))
    assert error <= tolerance, f"{what} is {found}, expected {expected} (off by {error})"


# --- 1. Reading what we write ---------------------------------------------------------------------


def expectation(scans):
    """Messages by topic, in order: (stamp in ns, frame, child frame, value)."""
    expected = {topic: [] for topic in ("/scan", "/odom", "/reference", "/tf", "/tf_static")}
    zero = (0.0, 0.0, 0.0)
    expected["/tf_static"].append([(scans[0][0], "base_link", "laser", zero)])
    for stamp, readings, pose, odometry in scans:
        expected["/scan"].append((stamp, "laser", None, readings))
        expected["/odom"].append((stamp, "odom", "base_link", odometry))
        expected["/reference"].append((stamp, "map", None, pose))
        map_from_odom = carmen_log.compose(pose, carmen_log.inverse(odometry))
        expected["/tf"].append(
            [(stamp, "map", "odom", map_from_odom), (stamp, "odom", "base_link", odometry)]
        )
    return expected


def check_header(header, expected):
    equal("stamp", header.stamp.sec * 10**9 + header.stamp.nanosec, expected[0])
    equal("frame_id", header.frame_id, expected[1])


def check_pose(position, rotation, expected):
    near("position", (position.x, position.y, position.z), (*expected[:2], 0.0), 1e-9)
    equal("rotation about x and y", (rotation.x, rotation.y), (0.0, 0.0))
    heading = 2.0 * math.atan2(rotation.z, rotation.w)
    near("heading", (carmen_log.wrap(heading - expected[2]),), (0.0,), 1e-9)


def check_scan(message, expected, limits):
    check_header(message.header, expected)
    readings = np.array(expected[3], dtype=np.float32)
    equal("number of readings", len(message.ranges), len(readings))
    assert np.array_equal(np.array(message.ranges, dtype=np.float32), readings), "ranges differ"
    step = math.radians(0.5 if len(readings) >= 360 else 1.0)
    start = -0.5 * math.pi
    angles = [start, start + (len(readings) - 1) * step, step]
    found = [message.angle_min, message.angle_max, message.angle_increment]
    equal("angles", [np.float32(a) for a in found], [np.float32(a) for a in angles])
    equal("times", (message.time_increment, message.scan_time), (0.0, 0.0))
    near("limits", (message.range_min, message.range_max), limits, 1e-6 * limits[1])
    equal("intensities", len(message.intensities), 0)


def check_message(topic, message, expected, limits):
    if topic == "/scan":
        check_scan(message, expected, limits)
    elif topic == "/odom":
        check_header(message.header, expected)
        equal("child_frame_id", message.child_frame_id, expected[2])
        check_pose(message.pose.pose.position, message.pose.pose.orientation, expected[3])
        equal("covariances", [*message.pose.covariance, *message.twist.covariance], [0.0] * 72)
        twist = message.twist.twist
        speeds = [twist.linear.x, twist.linear.y, twist.linear.z]
        equal("speeds", [*speeds, twist.angular.x, twist.angular.y, twist.angular.z], [0.0] * 6)
    elif topic == "/reference":
        check_header(message.header, expected)
        check_pose(message.pose.position, message.pose.orientation, expected[3])
    else:
        equal("number of transforms", len(message.transforms), len(expected))
        for found, one in zip(message.transforms, expected, strict=True):
            check_header(found.header, one)
            equal("child_frame_id", found.child_frame_id, one[2])
            check_pose(found.transform.translation, found.transform.rotation, one[3])


def check_messages(messages, scans):
    """All messages (topic, log time, message) against the expectation."""
    expected = expectation(scans)
    narrow = [float(np.float32(reading)) for scan in scans for reading in scan[1]]
    # Readers take a reading that is equal to range_max for none, so it is a little larger.
    limits = (min(0.0, *narrow), 1.001 * max(narrow))
    seen = dict.fromkeys(expected, 0)
    before = 0
    for topic, log_time, message in messages:
        assert log_time >= before, f"{topic}: logged at {log_time}, after {before}"
        before = log_time
        check_message(topic, message, expected[topic][seen[topic]], limits)
        seen[topic] += 1
    equal("messages", seen, {topic: len(messages) for topic, messages in expected.items()})
    return f"{sum(seen.values())} messages"


def by_mcap(path, scans):
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        equal("profile", reader.get_header().profile, "ros2")
        messages = reader.iter_decoded_messages()
        return check_messages(((c.topic, m.log_time, d) for _, c, m, d in messages), scans)


def by_rosbags(path, scans):
    with AnyReader([Path(path)]) as reader:
        messages = (
            (connection.topic, log_time, reader.deserialize(data, connection.msgtype))
            for connection, log_time, data in reader.messages()
        )
        return check_messages(messages, scans)


def back_to_carmen(log, bag, folder):
    """CARMEN to bag to CARMEN: equal but for the bag's narrower floats."""
    copy = folder / "copy.log"
    call("convert", bag, copy)
    original = json.loads(call("inspect", log, "--json"))
    found = json.loads(call("inspect", copy, "--json"))
    for key in ("scans", "readings", "points", "backward_stamps", "has_reference", "has_odometry"):
        equal(key, found[key], original[key])
    near("path", (found["path_length_m"],), (original["path_length_m"],), 1e-9)
    return f"{found['scans']} scans, {found['points']} points"


def ours(name, log, folder):
    bag = folder / f"{name}.mcap"
    call("convert", log, bag)
    scans = carmen_log.read(log)
    check(f"{name}: mcap + mcap-ros2-support read our bag", by_mcap, bag, scans)
    check(f"{name}: rosbags reads our bag", by_rosbags, bag, scans)
    check(f"{name}: CARMEN -> bag -> CARMEN", back_to_carmen, log, bag, folder)


# --- 2. Reading what others write -----------------------------------------------------------------

STORE = get_typestore(Stores.ROS2_JAZZY)
COUNT = 50


def messages():
    """A walk of COUNT scans: (topic, type, log time, message) in order of time."""
    kind = STORE.types

    def header(stamp, frame):
        time = kind["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return kind["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    def rotation(angle):
        quaternion = kind["geometry_msgs/msg/Quaternion"]
        return quaternion(x=0.0, y=0.0, z=math.sin(angle / 2), w=math.cos(angle / 2))

    def pose(x, angle):
        position = kind["geometry_msgs/msg/Point"](x=x, y=0.5 * x, z=0.0)
        return kind["geometry_msgs/msg/Pose"](position=position, orientation=rotation(angle))

    start = 1_700_000_000 * 10**9
    vector = kind["geometry_msgs/msg/Vector3"]
    transform = kind["geometry_msgs/msg/TransformStamped"](
        header=header(start, "base_link"),
        child_frame_id="laser",
        transform=kind["geometry_msgs/msg/Transform"](
            translation=vector(x=0.25, y=0.0, z=0.3), rotation=rotation(math.pi / 2)
        ),
    )
    static = kind["tf2_msgs/msg/TFMessage"](transforms=[transform])
    yield "/tf_static", "tf2_msgs/msg/TFMessage", start, static
    still = vector(x=0.0, y=0.0, z=0.0)
    for k in range(COUNT):
        stamp = start + k * 10**8
        odometry = kind["nav_msgs/msg/Odometry"](
            header=header(stamp, "odom"),
            child_frame_id="base_link",
            pose=kind["geometry_msgs/msg/PoseWithCovariance"](
                pose=pose(0.1 * k, 0.01 * k), covariance=np.zeros(36)
            ),
            twist=kind["geometry_msgs/msg/TwistWithCovariance"](
                twist=kind["geometry_msgs/msg/Twist"](linear=still, angular=still),
                covariance=np.zeros(36),
            ),
        )
        yield "/odom", "nav_msgs/msg/Odometry", stamp, odometry
        truth = kind["geometry_msgs/msg/PoseStamped"](
            header=header(stamp, "map"), pose=pose(0.1 * k, 0.02 * k)
        )
        yield "/ground_truth", "geometry_msgs/msg/PoseStamped", stamp, truth
        yield "/scan", "sensor_msgs/msg/LaserScan", stamp, kind["sensor_msgs/msg/LaserScan"](
            header=header(stamp, "laser"),
            angle_min=-1.0,
            angle_max=1.0,
            angle_increment=0.02,
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=12.0,
            ranges=readings(k),
            intensities=np.zeros(101, dtype=np.float32),
        )


def readings(k):
    """Of scan k: 99 within the limits, one too long and one infinite."""
    ranges = np.linspace(0.5, 5.0 + 0.01 * k, 101, dtype=np.float32)
    ranges[7], ranges[9] = np.inf, 30.0
    return ranges


def write_rosbags(folder, **options):
    writer = RosbagsWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    if options:
        writer.set_compression(**options)
    with writer:
        connections = {}
        for topic, kind, log_time, message in messages():
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], log_time, STORE.serialize_cdr(message, kind))
    return folder


def write_mcap(path, big_endian=False, **options):
    with open(path, "wb") as stream:
        writer = Writer(stream, **options)
        writer.start(profile="ros2")
        channels = {}
        for topic, kind, log_time, message in messages():
            if topic not in channels:
                text, _ = STORE.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(STORE.serialize_cdr(message, kind, little_endian=not big_endian))
            writer.add_message(channels[topic], log_time, data, log_time)
        writer.finish()
    return path


def read_by_us(bag, folder):
    found = json.loads(call("inspect", bag, "--max-range", 12, "--json"))
    equal("scans", found["scans"], COUNT)
    equal("readings", found["readings"], 101 * COUNT)
    equal("points", found["points"], 99 * COUNT)
    equal("has_reference", found["has_reference"], True)
    equal("has_odometry", found["has_odometry"], True)
    copy = folder / "copy.log"
    call("convert", bag, copy)
    scans = robot_laser(copy)
    equal("scans converted", len(scans), COUNT)
    for k, (stamp, ranges, pose) in enumerate(scans):
        equal("stamp", stamp, 1_700_000_000 * 10**9 + k * 10**8)
        expected = [float(r) if r <= 12.0 else 10_000.0 for r in readings(k)]
        equal("readings", ranges, expected)
        robot = (0.1 * k, 0.05 * k, 0.02 * k)
        laser = carmen_log.compose(robot, (0.25, 0.0, math.pi / 2))
        near("pose", pose, laser, 1e-12)
    return f"{COUNT} scans"


def robot_laser(path):
    """Stamp (ns), readings and laser pose of each ROBOTLASER1 record."""
    scans = []
    for line in open(path, encoding="utf-8"):
        fields = line.split()
        if fields and fields[0] == "ROBOTLASER1":
            count = int(fields[8])
            rest = fields[9 + count :]
            whole, part = rest[12].split(".")
            stamp = int(whole) * 10**9 + int(part.ljust(9, "0"))
            pose = tuple(map(float, rest[1:4]))
            scans.append((stamp, list(map(float, fields[9 : 9 + count])), pose))
    return scans


def others(folder):
    zstd = CompressionFormat.ZSTD
    check("rosbags, plain", lambda: read_by_us(write_rosbags(folder / "r0"), folder))
    storage = {"mode": CompressionMode.STORAGE, "fmt": zstd}
    check("rosbags, zstd chunks", lambda: read_by_us(write_rosbags(folder / "r1", **storage), folder))

    storage = {"mode": CompressionMode.MESSAGE, "fmt": zstd}
    check("rosbags, each message zstd", lambda: read_by_us(write_rosbags(folder / "r2", **storage), folder))
    for name, options in {
        "no compression": {"compression": CompressionType.NONE},
        "lz4": {"compression": CompressionType.LZ4},
        "zstd": {"compression": CompressionType.ZSTD},
        "small chunks": {"compression": CompressionType.LZ4, "chunk_size": 1000},
        "unchunked": {"use_chunking": False},
        "unchunked, no index": {"use_chunking": False, "index_types": IndexType.NONE},
        "no index": {"index_types": IndexType.NONE, "use_statistics": False},
        "checksums": {"enable_crcs": True, "enable_data_crcs": True},
        "big-endian": {"big_endian": True},
    }.items():
        path = folder / (name.replace(" ", "_").replace(",", "") + ".mcap")
        check(f"mcap, {name}", lambda p=path, o=options: read_by_us(write_mcap(p, **o), folder))


# --- 3. Replays -----------------------------------------------------------------------------------


# --- ROS 1 bags and SQLite databases --------------------------------------------------------------

VARIANTS = {
    "none.bag": [],
    "bz2.bag": ["--compress", "bz2"],
    "lz4.bag": ["--compress", "lz4"],
    "db3": ["--dst-storage", "sqlite3"],
    "db3-file": ["--dst-storage", "sqlite3", "--compress", "zstd", "--compress-mode", "file"],
    "db3-message": ["--dst-storage", "sqlite3", "--compress", "zstd", "--compress-mode", "message"],
    "mcap-message": ["--dst-storage", "mcap", "--compress", "zstd", "--compress-mode", "message"],
}


def as_bag(source, target):
    """What is read of a file, as the bytes of the bag that we write: equal for equal recordings."""
    target.unlink(missing_ok=True)
    done = subprocess.run([PROGRAM, "convert", source, target], capture_output=True, text=True, check=False)
    # Exit code 3: something is in doubt, the same for all.
    assert done.returncode in (0, 3), f"{source}: {done.stderr}"
    return target.read_bytes()


def other_bags(name, bag, folder):
    """A bag through `rosbags-convert` into every other format is the same recording."""
    expected = as_bag(bag, folder / "expected.mcap")
    program = shutil.which("rosbags-convert") or str(Path(sys.executable).with_name("rosbags-convert"))

    def same(variant, options):
        other = folder / f"{name.replace(' ', '-')}-{variant}"
        command = [program, "--src", bag, "--dst", other, *options]
        subprocess.run(list(map(str, command)), check=True, capture_output=True)
        assert as_bag(other, folder / "found.mcap") == expected, "another recording"
        if variant != "none.bag":
            return
        for packer in ("gzip", "bzip2", "xz", "zstd"):
            if shutil.which(packer):
                with open(packed := folder / f"packed-by-{packer}", "wb") as stream:
                    subprocess.run([packer, "-c", other], check=True, stdout=stream)
                assert as_bag(packed, folder / "found.mcap") == expected, packer

    for variant, options in VARIANTS.items():
        check(f"{name}: rosbags-convert to {variant}", same, variant, options)


def every_log(data, folder):
    """The logs of the registry that are at hand, one below each folder of `data`."""
    for log in sorted(p for end in ("log", "log.gz", "mcap") for p in Path(data).glob(f"*/*.{end}")):
        name, bag = log.parent.name, folder / f"{log.parent.name}.mcap"
        done = subprocess.run([PROGRAM, "convert", log, bag], capture_output=True, text=True, check=False)
        if done.returncode in (0, 3):
            other_bags(name, bag, folder)
        else:
            print(f"skipped: {name} as a bag: {done.stderr.splitlines()[-1]}", flush=True)


def replays(name, log, folder):
    scans = carmen_log.read(log)
    for what, function in replay.checks(call, name, log, scans, folder):
        check(what, function)


def mounted_replay(log, folder):
    """A laser beside the middle of the robot, and turned."""
    scans = carmen_log.read(log)[:200]
    bag = replay.write_mounted(folder / "mounted.mcap", scans, (0.25, -0.1, 0.5 * math.pi))
    for what, function in replay.checks(call, "mounted laser", bag, scans, folder):
        check(what, function)


def main():
    global PROGRAM
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", default="target/release/mcl-eval")
    args = parser.parse_args()
    PROGRAM = shutil.which(args.program) or str(Path(args.program).resolve())
    data = os.environ.get("MCL_DATA_DIR")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        office = folder / "office.log"
        call("simulate", "-o", office)
        ours("simulated office", office, folder)
        replays("simulated office", office, folder)
        mounted_replay(office, folder)
        evo_check.checks(check, call, "simulated office", office, folder)
        intel = Path(data, "intel-lab", "intel.gfs.log") if data else None
        if intel and intel.is_file():
            ours("Intel Research Lab", intel, folder)
            replays("Intel Research Lab", intel, folder)
            evo_check.checks(check, call, "Intel Research Lab", intel, folder)
        else:
            print("skipped: no intel-lab/intel.gfs.log in MCL_DATA_DIR")
        others(folder)
        call("convert", office, folder / "office.mcap")
        other_bags("simulated office", folder / "office.mcap", folder)
        if data:
            every_log(data, folder)
    print(f"{failures} failed" if failures else "all passed")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()

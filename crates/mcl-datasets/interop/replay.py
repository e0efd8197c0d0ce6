"""Holds the bags of `mcl-eval localize --replay` against what else the run says: its error rows, its
trajectories, its map and its log."""

import csv
import math
from decimal import Decimal
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import carmen_log

PARTICLES = 100
ONCE = ["/map", "/tf_static"]
ROWS = {
    "/error/weighted": "weighted",
    "/error/translation": "translation",
    "/error/heading": "heading",
    "/error/nees": "nees",
    "/effective_sample_size": "effective_sample_size",
    "/log_evidence": "log_evidence",
    "/explained_beams": "explained_beams",
}
EACH_SCAN = ["/tf", "/scan", "/particles", "/estimate", "/reference", *ROWS]


def checks(call, name, log, scans, folder):
    """Checks by name of a replay of this log, whose scans `carmen_log` has read."""
    map_file, out, bag = folder / "map.csv", folder / f"{name}-run", folder / f"{name}-run.mcap"
    call("map", log, "--init", "grid", "--cell", 0.2, "-o", map_file)
    call("localize", log, "--map", map_file, "--particles", PARTICLES, "-o", out, "--replay", bag)
    points = np.loadtxt(map_file, delimiter=",", skiprows=1)
    yield (
        f"{name}: mcap + mcap-ros2-support read the replay",
        lambda: compare(*by_mcap(bag), points, out, scans),
    )
    yield (
        f"{name}: rosbags reads the replay",
        lambda: compare(*by_rosbags(bag), points, out, scans),
    )


def by_mcap(path):
    """Messages (topic, log time, message) and the quality of service of each topic."""
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        channels = reader.get_summary().channels.values()
        qos = {channel.topic: channel.metadata["offered_qos_profiles"] for channel in channels}
        latched = {topic for topic, text in qos.items() if "durability: 1\n" in text}
        decoded = reader.iter_decoded_messages()
        return [(c.topic, m.log_time, d) for _, c, m, d in decoded], latched


def by_rosbags(path):
    with AnyReader([Path(path)]) as reader:
        latched = {
            connection.topic
            for connection in reader.connections
            for qos in connection.ext.offered_qos_profiles
            if qos.durability.name == "TRANSIENT_LOCAL"
        }
        messages = [
            (connection.topic, log_time, reader.deserialize(data, connection.msgtype))
            for connection, log_time, data in reader.messages()
        ]
        return messages, latched


def compare(messages, latched, points, out, scans):
    assert latched == set(ONCE), f"latched: {latched}"
    topics = {}
    before = -1
    for topic, log_time, message in messages:
        assert log_time >= before, f"{topic}: logged at {log_time}, after {before}"
        before = log_time
        topics.setdefault(topic, []).append((log_time, message))
    counts = {topic: len(found) for topic, found in topics.items()}
    expected = dict.fromkeys(ONCE, 1) | dict.fromkeys(EACH_SCAN, len(scans))
    assert counts == expected, f"messages: {counts}, expected {expected}"
    for topic in EACH_SCAN:
        times = np.array([log_time for log_time, _ in topics[topic]])
        assert (np.diff(times) > 0).all(), f"{topic}: two scans are logged at one time"

    check_map(topics["/map"][0][1], points)
    check_frames(topics)
    mount = pose_of(topics["/tf_static"][0][1].transforms[0].transform)
    with open(out / "run-000.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    estimates, references = tum(out / "run-000.tum"), tum(out / "reference.tum")
    off_map = []
    for k, (stamp, readings, _, _) in enumerate(scans):
        at = {topic: topics[topic][k][1] for topic in EACH_SCAN}
        for topic in ("/scan", "/particles", "/estimate", "/reference"):
            found = at[topic].header.stamp
            assert found.sec * 10**9 + found.nanosec == stamp, f"{topic} {k}: stamp {found}"
        assert int(Decimal(rows[k]["stamp"]) * 10**9) == stamp, f"row {k}: {rows[k]['stamp']}"
        for topic, column in ROWS.items():
            near(f"{topic} {k}", at[topic].data, float(rows[k][column]))
        assert len(at["/particles"].poses) == PARTICLES, f"{len(at['/particles'].poses)} particles"
        transform = pose_of(at["/tf"].transforms[0].transform)
        estimate = pose_of(at["/estimate"].pose.pose)
        assert transform == estimate, f"scan {k}: /tf {transform}, /estimate {estimate}"
        laser = carmen_log.compose(estimate, mount)
        near_pose(f"estimate {k}", laser, estimates[k])
        reference = pose_of(at["/reference"].pose)
        near_pose(f"reference {k}", carmen_log.compose(reference, mount), references[k])
        check_covariance(np.array(at["/estimate"].pose.covariance).reshape(6, 6))
        ranges = np.array(at["/scan"].ranges, dtype=np.float32)
        assert np.array_equal(ranges, np.array(readings, dtype=np.float32)), f"scan {k}: ranges"
        if k % 50 == 0:
            off_map.extend(distances(at["/scan"], laser, points))
    # A map point every 0.2 m: half of the endpoints are nearer to one than a cell is wide.
    median = float(np.median(off_map))
    assert median < 0.2, f"scans lie {median:.3f} m off the map (median)"
    return f"{len(messages)} messages; scans lie {median:.3f} m from map points (median)"


def check_map(cloud, points):
    fields = [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)], f"fields: {fields}"
    shape = (cloud.height, cloud.width, cloud.point_step, cloud.row_step)
    assert shape == (1, len(points), 12, 12 * len(points)), f"height, width and steps: {shape}"
    assert (cloud.is_bigendian, cloud.is_dense) == (False, True), "big-endian or not dense"
    data = np.frombuffer(bytes(cloud.data), dtype="<f4").reshape(-1, 3)
    expected = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
    assert np.array_equal(data, expected), "the points differ from those of the map file"


def check_frames(topics):
    """All frames that messages are in hang from `map`."""
    parents = {}
    for topic in ("/tf", "/tf_static"):
        for _, message in topics[topic]:
            for transform in message.transforms:
                parent = parents.setdefault(transform.child_frame_id, transform.header.frame_id)
                assert parent == transform.header.frame_id, f"two parents: {transform}"
    used = {
        message.header.frame_id
        for topic in ("/map", "/scan", "/particles", "/estimate", "/reference")
        for _, message in topics[topic]
    }
    for frame in used | set(parents):
        while frame in parents:
            frame = parents[frame]
        assert frame == "map", f"{frame} is a root"


def check_covariance(covariance):
    plane = [0, 1, 5]
    rest = covariance.copy()
    rest[np.ix_(plane, plane)] = 0.0
    assert not rest.any(), "covariance out of the plane"
    inner = covariance[np.ix_(plane, plane)]
    assert np.allclose(inner, inner.T, rtol=1e-9, atol=1e-15), f"not symmetric: {inner}"
    assert np.linalg.eigvalsh(inner).min() > -1e-12, f"no covariance: {inner}"


def distances(scan, laser, points):
    """From each endpoint that a player draws to the nearest map point."""
    ranges = np.array(scan.ranges)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges)) + laser[2]
    drawn = (ranges >= scan.range_min) & (ranges <= scan.range_max)
    steps = np.column_stack([np.cos(angles), np.sin(angles)]) * ranges[:, None]
    ends = np.array(laser[:2]) + steps[drawn]
    return [float(np.hypot(*(points - end).T).min()) for end in ends]


def pose_of(pose):
    """(x, y, heading) of a planar Pose or Transform."""
    position = getattr(pose, "position", None) or pose.translation
    rotation = getattr(pose, "orientation", None) or pose.rotation
    assert (position.z, rotation.x, rotation.y) == (0.0, 0.0, 0.0), "not in the plane"
    return (position.x, position.y, 2.0 * math.atan2(rotation.z, rotation.w))


def tum(path):
    poses = np.loadtxt(path)
    return [(row[1], row[2], 2.0 * math.atan2(row[6], row[7])) for row in poses]


def near(what, found, expected):
    assert abs(found - expected) <= 1e-12, f"{what} is {found}, expected {expected}"


def near_pose(what, found, expected):
    near(what + ", x", found[0], expected[0])
    near(what + ", y", found[1], expected[1])
    near(what + ", heading", carmen_log.wrap(found[2] - expected[2]), 0.0)


def write_mounted(path, scans, mount):
    """The same scans, of a robot that carries its laser elsewhere: poses are the robot's."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = store.types

    def header(stamp, frame):
        time = kind["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return kind["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    def rotation(angle):
        quaternion = kind["geometry_msgs/msg/Quaternion"]
        return quaternion(x=0.0, y=0.0, z=math.sin(angle / 2), w=math.cos(angle / 2))

    def pose(x, y, angle):
        position = kind["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
        return kind["geometry_msgs/msg/Pose"](position=position, orientation=rotation(angle))

    def robot(laser):
        return carmen_log.compose(laser, carmen_log.inverse(mount))

    vector = kind["geometry_msgs/msg/Vector3"]
    still = vector(x=0.0, y=0.0, z=0.0)
    twist = kind["geometry_msgs/msg/TwistWithCovariance"](
        twist=kind["geometry_msgs/msg/Twist"](linear=still, angular=still), covariance=np.zeros(36)
    )
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channels = {}

        def write(topic, name, stamp, message):
            if topic not in channels:
                text, _ = store.generate_msgdef(name, ros_version=2)
                schema = writer.register_schema(name, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, name))
            writer.add_message(channels[topic], stamp, data, stamp)

        transform = kind["geometry_msgs/msg/TransformStamped"](
            header=header(scans[0][0], "base_link"),
            child_frame_id="laser",
            transform=kind["geometry_msgs/msg/Transform"](
                translation=vector(x=mount[0], y=mount[1], z=0.0), rotation=rotation(mount[2])
            ),
        )
        static = kind["tf2_msgs/msg/TFMessage"](transforms=[transform])
        write("/tf_static", "tf2_msgs/msg/TFMessage", scans[0][0], static)
        for stamp, readings, reference, odometry in scans:
            truth = kind["geometry_msgs/msg/PoseStamped"](
                header=header(stamp, "map"), pose=pose(*robot(reference))
            )
            write("/reference", "geometry_msgs/msg/PoseStamped", stamp, truth)
            moved = kind["nav_msgs/msg/Odometry"](
                header=header(stamp, "odom"),
                child_frame_id="base_link",
                pose=kind["geometry_msgs/msg/PoseWithCovariance"](
                    pose=pose(*robot(odometry)), covariance=np.zeros(36)
                ),
                twist=twist,
            )
            write("/odom", "nav_msgs/msg/Odometry", stamp, moved)
            step = math.radians(0.5 if len(readings) >= 360 else 1.0)
            scan = kind["sensor_msgs/msg/LaserScan"](
                header=header(stamp, "laser"),
                angle_min=-0.5 * math.pi,
                angle_max=-0.5 * math.pi + (len(readings) - 1) * step,
                angle_increment=step,
                time_increment=0.0,
                scan_time=0.0,
                range_min=0.0,
                range_max=100.0,
                ranges=np.array(readings, dtype=np.float32),
                intensities=np.zeros(0, dtype=np.float32),
            )
            write("/scan", "sensor_msgs/msg/LaserScan", stamp, scan)
        writer.finish()
    return path

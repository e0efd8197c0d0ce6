"""Prints evo's figures for the trajectories of tests/evo.rs, which runs this script.

usage: reference.py FOLDER [DATA]   (FOLDER holds CASE.reference.tum and CASE.estimate.tum)
prints: CASE METRIC rmse mean median max min std sse pairs

DATA is the folder test/data of evo's source archive: its trajectories are written into FOLDER as further
cases, seen from above, at stamps that floats hold exactly.
"""

import copy
import math
import pathlib
import sys

import evo
from evo import main_ape, main_rpe
from evo.core import sync
from evo.core.filters import FilterException
from evo.core.metrics import PoseRelation, Unit
from evo.core.sync_method import SyncMethod
from evo.tools import file_interface

STATISTICS = ["rmse", "mean", "median", "max", "min", "std", "sse"]
RELATIONS = {
    "translation": PoseRelation.translation_part,
    "rotation_deg": PoseRelation.rotation_angle_deg,
    "full": PoseRelation.full_transformation,
}
DELTAS = {
    "1m": dict(delta=1.0, delta_unit=Unit.meters),
    "5f": dict(delta=5, delta_unit=Unit.frames),
    "0.3rad": dict(delta=0.3, delta_unit=Unit.radians),
    "25deg": dict(delta=25.0, delta_unit=Unit.degrees),
}
RPE = {
    f"rpe-{delta}{'-all' * all_pairs}{'-reference' * reference}": dict(
        **settings, all_pairs=all_pairs, pairs_from_reference=reference
    )
    for delta, settings in DELTAS.items()
    for all_pairs in (False, True)
    for reference in (False, True)
}
MOST_POSES = 300
# Name, reference, estimate: of evo's test data, with their readers.
DATA = [
    ("freiburg1", "freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam_drift.txt"),
    ("freiburg2", "fr2_desk_groundtruth.txt", "fr2_desk_ORB.txt"),
    ("vicon", "V102_groundtruth.csv", "V102.txt"),
]


def from_above(path, begin):
    """Lines of a planar trajectory, in units of 1/512 s since `begin`."""
    read = file_interface.read_tum_trajectory_file
    if path.suffix == ".csv":
        read = file_interface.read_euroc_csv_trajectory
    trajectory = read(str(path))
    begin = trajectory.timestamps[0] if begin is None else begin
    lines = []
    for stamp, pose in zip(trajectory.timestamps, trajectory.poses_se3):
        half = 0.5 * math.atan2(pose[1, 0], pose[0, 0])
        units = round((stamp - begin) * 512)
        numbers = [pose[0, 3], pose[1, 3], 0.0, 0.0, 0.0, math.sin(half), math.cos(half)]
        lines.append(f"{units / 512:.9f} " + " ".join(repr(float(n)) for n in numbers))
    return begin, lines


def write_data(data, folder):
    for name, *files in DATA:
        begin = None
        for role, file in zip(("reference", "estimate"), files):
            begin, lines = from_above(data / file, begin)
            if role == "estimate":  # all pairs by angle take evo minutes for thousands of poses
                lines = lines[:: math.ceil(len(lines) / MOST_POSES)]
            (folder / f"{name}.{role}.tum").write_text("\n".join(lines) + "\n")


def row(case, metric, result):
    numbers = [repr(float(result.stats[name])) for name in STATISTICS]
    print(case, metric, *numbers, len(result.np_arrays["error_array"]))


def rows(case, pair):
    for name, relation in RELATIONS.items():
        row(case, f"ape-{name}", main_ape.ape(*copy.deepcopy(pair), relation))
        origin = main_ape.ape(*copy.deepcopy(pair), relation, align_origin=True)
        row(case, f"ape-origin-{name}", origin)
        if case != "straight":  # evo refuses to align positions on a line
            aligned = main_ape.ape(*copy.deepcopy(pair), relation, align=True)
            row(case, f"ape-aligned-{name}", aligned)
        for settings_name, settings in RPE.items():
            try:
                result = main_rpe.rpe(*copy.deepcopy(pair), relation, **settings)
            except FilterException:  # no pairs
                continue
            row(case, f"{settings_name}-{name}", result)


folder = pathlib.Path(sys.argv[1])
if len(sys.argv) > 2:
    write_data(pathlib.Path(sys.argv[2]), folder)
print(f"# evo {evo.__version__}, python {sys.version.split()[0]}: reference.py")
print("# case metric", *STATISTICS, "pairs")
for reference_path in sorted(folder.glob("*.reference.tum")):
    case = reference_path.name.split(".")[0]
    reference = file_interface.read_tum_trajectory_file(str(reference_path))
    estimate = file_interface.read_tum_trajectory_file(
        str(reference_path).replace(".reference.", ".estimate.")
    )
    if not case.startswith("between"):
        rows(case, sync.associate_trajectories(reference, estimate, max_diff=0.01))
    # At stamps of today, floats have tenths of microseconds. freiburg2: see tests/evo.rs.
    if reference.timestamps[0] < 1e6 and case != "freiburg2":
        pair = sync.associate_trajectories(
            reference, estimate, sync_method=SyncMethod.interpolation, max_diff=0.05
        )
        rows(f"{case}-interpolated", pair)

"""Prints evo's figures for the trajectories of tests/evo.rs, which runs this script.

usage: reference.py FOLDER   (FOLDER holds CASE.reference.tum and CASE.estimate.tum)
prints: CASE METRIC rmse mean median max min std sse pairs
"""

import copy
import pathlib
import sys

import evo
from evo import main_ape, main_rpe
from evo.core import sync
from evo.core.metrics import PoseRelation, Unit
from evo.tools import file_interface

STATISTICS = ["rmse", "mean", "median", "max", "min", "std", "sse"]
RELATIONS = {
    "translation": PoseRelation.translation_part,
    "rotation_deg": PoseRelation.rotation_angle_deg,
    "full": PoseRelation.full_transformation,
}
RPE = {
    "rpe-1m": dict(delta=1.0, delta_unit=Unit.meters),
    "rpe-1m-all": dict(delta=1.0, delta_unit=Unit.meters, all_pairs=True),
    "rpe-1m-reference": dict(delta=1.0, delta_unit=Unit.meters, pairs_from_reference=True),
    "rpe-5f": dict(delta=5, delta_unit=Unit.frames),
    "rpe-5f-all": dict(delta=5, delta_unit=Unit.frames, all_pairs=True),
}


def row(case, metric, result):
    numbers = [repr(float(result.stats[name])) for name in STATISTICS]
    print(case, metric, *numbers, len(result.np_arrays["error_array"]))


print(f"# evo {evo.__version__}, python {sys.version.split()[0]}: reference.py")
print("# case metric", *STATISTICS, "pairs")
for reference_path in sorted(pathlib.Path(sys.argv[1]).glob("*.reference.tum")):
    case = reference_path.name.split(".")[0]
    reference = file_interface.read_tum_trajectory_file(str(reference_path))
    estimate = file_interface.read_tum_trajectory_file(
        str(reference_path).replace(".reference.", ".estimate.")
    )
    pair = sync.associate_trajectories(reference, estimate, max_diff=0.01)
    for name, relation in RELATIONS.items():
        row(case, f"ape-{name}", main_ape.ape(*copy.deepcopy(pair), relation))
        origin = main_ape.ape(*copy.deepcopy(pair), relation, align_origin=True)
        row(case, f"ape-origin-{name}", origin)
        if case != "straight":  # evo refuses to align positions on a line
            aligned = main_ape.ape(*copy.deepcopy(pair), relation, align=True)
            row(case, f"ape-aligned-{name}", aligned)
        for settings_name, settings in RPE.items():
            result = main_rpe.rpe(*copy.deepcopy(pair), relation, **settings)
            row(case, f"{settings_name}-{name}", result)

"""Holds our trajectory errors against evo's: `make interop`.

Trajectories that `mcl-eval localize` wrote (TUM files) are given to `mcl-eval evaluate` and to the
programs `evo_ape` and `evo_rpe`; ATE and RPE agree to 1e-9.
"""

import json
import math
import os
import subprocess
import sys
import zipfile
from pathlib import Path

STATISTICS = ("rmse", "mean", "median", "max")
TOLERANCE = 1e-9
DISTANCES = (1, 5, 10)


def evo(command, reference, estimate, *options):
    """Statistics that a program of evo saves."""
    result = Path(estimate).with_suffix(f".{command}.zip")
    result.unlink(missing_ok=True)
    # Settings in a folder of their own, so that the user's do not decide.
    environment = dict(os.environ, HOME=str(result.parent))
    program = Path(sys.executable).with_name(command)
    arguments = [program, "tum", reference, estimate, "--save_results", result, *options]
    arguments = [str(argument) for argument in arguments]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, f"{arguments}: {done.stdout}{done.stderr}"
    with zipfile.ZipFile(result) as archive:
        return json.loads(archive.read("stats.json"))


def agree(what, found, stats):
    """Largest difference of the four statistics that both programs compute."""
    off = max(abs(found[name] - stats[name]) for name in STATISTICS)
    assert off <= TOLERANCE, f"{what}: ours {found}, evo's {stats} (off by {off})"
    return off


def compare(call, reference, estimate):
    """All figures of one estimate; reports the largest difference."""
    distances = [f"--rpe-distance={distance}" for distance in DISTANCES]
    base = ("evaluate", "--quiet", "--json", *distances, "--reference", reference, estimate)
    row = json.loads(call(*base))["estimates"][0]
    off = []

    def ape(*options):
        return evo("evo_ape", reference, estimate, *options)

    off.append(agree("ATE", row["ate"], ape()))
    angle = ("--pose_relation", "angle_rad")
    off.append(agree("heading error", row["heading"], ape(*angle)))
    for how, option in (("rigid", "--align"), ("origin", "--align_origin")):
        aligned = json.loads(call(*base, f"--align={how}"))["estimates"][0]
        off.append(agree(f"ATE, {how}", aligned["ate"], ape(option)))
    for ours in row["rpe"]:
        delta = ("--delta", ours["distance_m"], "--delta_unit", "m", "--pairs_from_reference")
        for part, options in (("translation", ()), ("heading", angle)):
            stats = evo("evo_rpe", reference, estimate, *delta, *options)
            off.append(agree(f"RPE {part}, {ours['distance_m']} m", ours[part], stats))
    return f"{row['pairs']} pairs, {len(off)} metrics, off by {max(off):.1e} at most"


def bent(reference, path):
    """An estimate that no filter made: drifting, turning, stamped 3 ms late, every 7th pose missing."""
    lines = [line.split() for line in open(reference, encoding="utf-8") if line[0] != "#"]
    with open(path, "w", encoding="utf-8") as out:
        for k, (stamp, x, y, *_, qz, qw) in enumerate(lines):
            if k % 7 == 3:
                continue
            seconds, nanoseconds = map(int, stamp.split("."))
            late = seconds * 10**9 + nanoseconds + 3_000_000
            angle = 2.0 * math.atan2(float(qz), float(qw)) + 0.002 * k + 0.1 * math.sin(0.7 * k)
            x, y = float(x) + 0.01 * k, float(y) - 0.3 * math.cos(0.2 * k)
            rotation = f"0 0 {math.sin(angle / 2)!r} {math.cos(angle / 2)!r}"
            out.write(f"{late // 10**9}.{late % 10**9:09d} {x!r} {y!r} 0 {rotation}\n")
    return path


def checks(check, call, name, log, folder):
    """Localizes the robot of a log, and compares the figures reported for it."""
    folder = Path(folder) / name.replace(" ", "-")
    folder.mkdir()
    map_file = folder / "map.ply"
    call("map", log, "--init", "grid", "--cell", "0.2", "--output", map_file)
    call("localize", log, "--map", map_file, "--particles", 200, "--output", folder, "--quiet")
    reference, estimate = folder / "reference.tum", folder / "run-000.tum"
    check(f"{name}: evo_ape and evo_rpe give our ATE and RPE", compare, call, reference, estimate)
    estimate = bent(reference, folder / "bent.tum")
    check(f"{name}: the same of a bent trajectory", compare, call, reference, estimate)

"""MRPT's particle filter, `pf-localization` of Debian's mrpt-apps: mrpt_localization.py RUN.json OUTPUT [settings].

Programs of MRPT make its inputs: `carmen2rawlog` the log, `carmen2simplemap` the map of points, as a scan for each.
The settings that are not given are the defaults of MRPT 2.5. Log: carmen, map: csv.
"""
import argparse, math, os, re, subprocess
from run_folder import Run, compose, tum

parser = argparse.ArgumentParser()
parser.add_argument("run")
parser.add_argument("output")
parser.add_argument("--particles", type=int, default=500)
parser.add_argument("--std-xy", type=float, default=0.04, help="m per step")
parser.add_argument("--std-turn", type=float, default=2.0, help="degrees per step")
parser.add_argument("--fitted", help="file of noise fitted to logs, in place of these two")
parser.add_argument("--sigma", type=float, help="m, of a product of Gaussians over the beams, in place of --sigma-dist")
parser.add_argument("--sigma-dist", type=float, default=0.0025, help="m², of the mean squared distance")
parser.add_argument("--max-distance", type=float, default=1.0, help="m, where distances are cut")
parser.add_argument("--decimation", type=int, default=10, help="of how many beams one counts")
parser.add_argument("--resampling", type=int, default=0, help="0 multinomial, 1 residual, 2 stratified, 3 systematic")
parser.add_argument("--resample-below", type=float, default=0.5, help="share of the effective sample size")
a = parser.parse_args()
run = Run(a.run)
scans = list(run.scans())
beams, mount = run.about["beams"], [run.mount[k] for k in ("x", "y", "theta")]
if any(len(readings) != beams["beams"] for _, _, readings in scans):
    raise SystemExit("carmen2rawlog takes scans of one number of beams")

def flaser(readings, laser, robot):
    poses = " ".join(f"{value:.9f}" for value in (*laser, *robot))
    return f"FLASER {len(readings)} {' '.join(readings)} {poses} 0 host 0\n"

def parameters(step_deg):
    # A reading of just the largest range counts.
    return f"PARAM laser_front_laser_resolution {step_deg:.12f}\nPARAM robot_front_laser_max {run.max_range + 1e-3}\n"

def tool(name, source, made):
    subprocess.run([name, "-q", "-w", "-i", source, "-o", made], check=True, stdout=subprocess.DEVNULL)
    if not os.path.isfile(made):
        raise SystemExit(f"{name}: wrote no {made}")

# MRPT spreads the beams of a line evenly over its resolution times their number, about straight ahead. The
# resolution is such that their distances are right, the pose of the laser such that their directions are.
middle = beams["start_angle"] + beams["angle_step"] * (beams["beams"] - 1) / 2
resolution = math.degrees(beams["angle_step"]) * (beams["beams"] - 1) / beams["beams"]
with open("scans.log", "w") as log:
    log.write(parameters(resolution))
    for _, robot, readings in scans:
        usable = [str(r) if 0 < r <= run.max_range else "10000" for r in readings]
        log.write(flaser(usable, compose(compose(robot, mount), [0, 0, middle]), robot))
# Of the two beams of such a scan, 2 degrees apart, the right one hits the point from 1 m and the left one nothing.
with open("points.log", "w") as log:
    log.write(parameters(1))
    points = [list(map(float, line.split(","))) for line in open(run.file(run.about["map"])) if line[0] != "x"]
    for x, y in points:
        pose = [x - math.cos(math.radians(1)), y + math.sin(math.radians(1)), 0]
        log.write(flaser(["1", "10000"], pose, pose))
tool("carmen2rawlog", "scans.log", "scans.rawlog")
tool("carmen2simplemap", "points.log", "points.simplemap")

if a.fitted:
    # Its model of logs like these has a part per step alone: the fitted one of a median step.
    noise = run.fitted(a.fitted)
    steps = [(math.dist(p[:2], q[:2]), abs(math.remainder(q[2] - p[2], math.tau))) for (_, p, _), (_, q, _) in zip(scans, scans[1:])]
    metres, radians = (sorted(values)[len(steps) // 2] for values in zip(*steps))
    a.std_xy, std_turn = (math.hypot(p, q * metres, r * radians) for p, q, r in (noise["position"], noise["heading"]))
    a.std_turn = math.degrees(std_turn)
if a.sigma:
    # It takes exp(-mean d² / sigma_dist) over the beams that count: this makes it a product of Gaussians.
    usable = sum(1 for _, _, readings in scans for r in readings if 0 < r <= run.max_range)
    a.sigma_dist = 2 * a.sigma**2 * a.decimation * len(scans) / usable
start = run.about["start"]
if start["kind"] == "known":
    # Uniform, as it has no other, of the same standard deviation.
    robot, half = start["robot"], {k: math.sqrt(3) * s for k, s in start["std"].items()}
    low, high = ([robot[k] + sign * half[k] for k in ("x", "y", "theta")] for sign in (-1, 1))
else:
    low, high = ([*map(end, zip(*points)), sign * math.pi] for end, sign in ((min, -1), (max, 1)))
settings = {
    "PF_options": {
        "PF_algorithm": 0, "resamplingMethod": a.resampling, "adaptiveSampleSize": 0, "BETA": a.resample_below,
        "sampleSize": a.particles,
    },
    "KLD_options": {
        "KLD_binSize_PHI_deg": 10, "KLD_binSize_XY": 0.1, "KLD_delta": 0.01, "KLD_epsilon": 0.01,
        "KLD_maxSampleSize": a.particles, "KLD_minSampleSize": a.particles, "KLD_minSamplesPerBin": 0,
    },
    "DummyOdometryParams": {"minStdXY": a.std_xy, "minStdPHI": a.std_turn},
    "LocalizationExperiment": {
        "use_3D_poses": "false", "map_file": "points.simplemap", "rawlog_file": "scans.rawlog", "logOutput_dir": "out",
        "3DSceneFrequency": -1, "experimentRepetitions": 1, "particles_count": a.particles, "init_PDF_mode": 1,
        "init_PDF_min_x": low[0], "init_PDF_max_x": high[0], "init_PDF_min_y": low[1], "init_PDF_max_y": high[1],
        "init_PDF_min_yaw_deg": math.degrees(low[2]), "init_PDF_max_yaw_deg": math.degrees(high[2]),
        "SHOW_PROGRESS_3D_REAL_TIME": "false",
    },
    "MetricMap": {"occupancyGrid_count": 0, "pointsMap_count": 1},
    "MetricMap_pointsMap_00_insertOpts": {
        "minDistBetweenLaserPoints": 0, "addToExistingPointsMap": "true", "also_interpolate": "false",
        "disableDeletion": "true", "fuseWithExisting": "false",
    },
    "MetricMap_pointsMap_00_likelihoodOpts": {
        "sigma_dist": a.sigma_dist, "max_corr_distance": a.max_distance, "decimation": a.decimation,
    },
}
with open("pf.ini", "w") as ini:
    for section, values in settings.items():
        ini.write(f"[{section}]\n" + "".join(f"{key}={value}\n" for key, value in values.items()))
done = subprocess.run(["pf-localization", "pf.ini"], check=True, capture_output=True, text=True, errors="replace")
number = r"([-+.\deE]+)"
estimates = re.findall(rf"PDF estimation: \({number},{number},{number}deg\)", done.stdout)
saved = next(name for name in os.listdir(f"out_000_{a.particles:07}") if re.match(r"map.*PointsMap.*\.txt", name))
kept = sum(1 for line in open(f"out_000_{a.particles:07}/{saved}") if line.strip() and line[0] not in "#%")
if (len(estimates), kept) != (len(scans), len(points)):
    raise SystemExit(f"pf-localization: {len(estimates)} estimates of {len(scans)} scans, {kept} of {len(points)} points of the map")
with open(a.output, "w") as output:
    for (stamp, _, _), (x, y, degrees) in zip(scans, estimates):
        output.write(tum(stamp, [float(x), float(y), math.radians(float(degrees))]))

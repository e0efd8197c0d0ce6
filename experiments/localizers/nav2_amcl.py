"""AMCL of nav2 as the Python package `amcl` binds it: nav2_amcl.py RUN.json OUTPUT [settings].

The package has nav2's particle filter and its beam model (rays through the grid); the likelihood field is not in it.
A ray ends at the first cell that is not free, be it occupied or unknown. So what this filter knows of a grid is its free
space, and that comes from all scans that built a map, however few points the map has: --unknown-is-free lets rays end
at occupied cells alone. The settings that are not given are nav2's defaults.
"""
import argparse, ctypes
import amcl
from run_folder import Run, compose, step, tum

parser = argparse.ArgumentParser()
parser.add_argument("run")
parser.add_argument("output")
parser.add_argument("--fitted", help="file of noise fitted to logs, in place of --alpha")
parser.add_argument("--alpha", type=float, nargs="+", default=[0.2], help="one for all, or alpha1 ... alpha4")
for name, default in dict(z_hit=0.5, z_short=0.05, z_max=0.05, z_rand=0.5, sigma_hit=0.2, lambda_short=0.1).items():
    parser.add_argument("--" + name.replace("_", "-"), type=float, default=default)
parser.add_argument("--beams", type=int, default=60)
parser.add_argument("--min-particles", type=int, default=500)
parser.add_argument("--max-particles", type=int, default=2000)
parser.add_argument("--update-min", type=float, nargs=2, default=[0.25, 0.2], help="m and rad between updates")
parser.add_argument("--shift", type=float, default=0.0, help="cells by which the grid is moved: nav2 puts the middle of the first cell where its corner is")
parser.add_argument("--unknown-is-free", action="store_true", help="rays end at occupied cells alone")
a = parser.parse_args()

def read_grid(run):
    """The map_server grid as rows from the lower edge: 100 occupied, 0 free, -1 unknown."""
    yaml = dict(line.strip().split(": ", 1) for line in open(run.file(run.about["map"])) if ": " in line)
    magic, size, limit, pixels = open(run.file(yaml["image"]), "rb").read().split(b"\n", 3)
    width, height = map(int, size.split())
    if magic != b"P5" or int(limit) != 255 or len(pixels) != width * height or yaml["negate"] != "0":
        raise SystemExit("map: expected a plain PGM of 8 bits")
    occupied, free = float(yaml["occupied_thresh"]), float(yaml["free_thresh"])
    x, y, yaw = (float(v) for v in yaml["origin"].strip("[]").split(","))
    if yaw:
        raise SystemExit("map: a turned grid is not for AMCL")
    kinds = []
    for value in range(256):
        p = (255 - value) / 255
        kinds.append(100 if p > occupied else 0 if p < free or a.unknown_is_free else -1)
    rows = [[kinds[v] for v in pixels[i * width:(i + 1) * width]] for i in reversed(range(height))]
    cell = float(yaml["resolution"])
    return amcl.create_occupancy_grid_from_list(rows, cell, x + a.shift * cell, y + a.shift * cell)

run = Run(a.run)
start, beams = run.about["start"], run.about["beams"]
if start["kind"] != "known":
    raise SystemExit("the package amcl has no call that spreads particles over the map")
alpha = run.fitted(a.fitted)["alpha"] if a.fitted else a.alpha
alpha = alpha * 4 if len(alpha) == 1 else alpha
# alpha5 belongs to the omnidirectional model alone. Recovery is off, as in nav2 unless asked for.
laser = amcl.LaserParameters(a.z_hit, a.z_short, a.z_max, a.z_rand, a.sigma_hit, a.lambda_short, 0.0, a.beams)
motion = amcl.MotionParameters(*alpha, 0.2)
localizer = amcl.AMCL(a.min_particles, a.max_particles, 0.0, 0.0, motion, laser, "differential")
localizer.set_map(read_grid(run))
# It draws from the C library's generator, which it seeds by the clock.
ctypes.CDLL(None).srand48(run.about["seed"])
robot, std = start["robot"], start["std"]
localizer.set_initial_pose(
    amcl.Vector3D(robot["x"], robot["y"], robot["theta"]),
    amcl.create_diagonal_covariance(*(std[k] ** 2 for k in ("x", "y", "theta"))),
)
localizer.set_laser_pose(amcl.Vector3D(*(run.mount[k] for k in ("x", "y", "theta"))))
bearings = [beams["start_angle"] + i * beams["angle_step"] for i in range(beams["beams"])]
used = mean = None
with open(a.output, "w") as output:
    for stamp, odometry, readings in run.scans():
        moved = step(used, odometry) if used else None
        if moved is None or abs(moved[0]) > a.update_min[0] or abs(moved[1]) > a.update_min[0] or abs(moved[2]) > a.update_min[1]:
            # As nav2 does, what is no reading is one of the largest range.
            pairs = [[r if 0 < r < run.max_range else run.max_range, b] for r, b in zip(readings, bearings)]
            localizer.update(amcl.create_laser_scan_from_list(pairs, run.max_range), amcl.Vector3D(*odometry))
            pose = localizer.get_pose_mean()
            used, mean, moved = odometry, [pose.x, pose.y, pose.theta], [0, 0, 0]
        output.write(tum(stamp, compose(mean, moved)))

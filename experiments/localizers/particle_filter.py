"""A particle filter of a page, as an example of a localizer of one's own: particle_filter.py RUN.json OUTPUT"""
import json, math, os, random, sys

def scans(path):
    """Stamp, pose by odometry and readings of each scan of a CARMEN log."""
    for fields in map(str.split, open(path)):
        if fields[0] in ("FLASER", "ROBOTLASER1"):
            at = 1 if fields[0] == "FLASER" else 8
            n = int(fields[at])
            rest = fields[at + 1 + n + (at == 8):]  # the laser's pose, the robot's, ...
            yield rest[6 if at == 1 else 11], [float(v) for v in rest[3:6]], [float(v) for v in fields[at + 1:at + 1 + n]]

run = json.load(open(sys.argv[1]))
folder = os.path.dirname(sys.argv[1])
random.seed(run["seed"])
gauss, cell = random.gauss, 0.1
points = [[float(v) for v in line.split(",")] for line in open(os.path.join(folder, run["map"])) if line[0] != "x"]
near = {}  # cells near a point of the map, with their distance from it
for x, y in points:
    for i in range(-5, 6):
        for j in range(-5, 6):
            key, d = (round(x / cell) + i, round(y / cell) + j), cell * math.hypot(i, j)
            near[key] = min(d, near.get(key, d))
score = {key: math.log(0.1 + 0.9 * math.exp(-0.5 * (d / 0.2) ** 2)) for key, d in near.items()}
if run["start"]["kind"] == "known":
    robot, std = run["start"]["robot"], run["start"]["std"]
    particles = [[gauss(robot[k], std[k]) for k in ("x", "y", "theta")] for _ in range(200)]
else:
    (left, right), (low, high) = [(min(axis), max(axis)) for axis in zip(*points)]
    particles = [[random.uniform(left, right), random.uniform(low, high), random.uniform(-math.pi, math.pi)] for _ in range(2000)]
mount, beams, last = run["robot_from_laser"], run["beams"], None
with open(sys.argv[2], "w") as output:
    for stamp, odometry, ranges in scans(os.path.join(folder, run["log"])):
        used = [(i, r) for i, r in enumerate(ranges) if 0 < r <= run["max_range_m"]][::6]
        ends = []  # of beams, as the robot sees them
        for i, r in used:
            angle = mount["theta"] + beams["start_angle"] + i * beams["angle_step"]
            ends.append((mount["x"] + r * math.cos(angle), mount["y"] + r * math.sin(angle)))
        last = last or odometry
        dx, dy, turn = [now - before for now, before in zip(odometry, last)]
        turn = math.remainder(turn, 2 * math.pi)
        c, s, last = math.cos(last[2]), math.sin(last[2]), odometry
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        noise = 0.01 + 0.1 * math.hypot(ahead, aside) + 0.02 * abs(turn)
        weights = []
        for p in particles:
            a, b, c, s = ahead + gauss(0, noise), aside + gauss(0, noise), math.cos(p[2]), math.sin(p[2])
            p[:] = p[0] + c * a - s * b, p[1] + s * a + c * b, p[2] + turn + gauss(0, noise + 0.05 * abs(turn))
            c, s = math.cos(p[2]), math.sin(p[2])
            cells = ((round((p[0] + c * x - s * y) / cell), round((p[1] + s * x + c * y) / cell)) for x, y in ends)
            weights.append(sum(score.get(key, math.log(0.1)) for key in cells))
        best = max(weights)
        weights = [math.exp(w - best) for w in weights]
        x, y = [sum(w * p[k] for w, p in zip(weights, particles)) / sum(weights) for k in (0, 1)]
        theta = math.atan2(*[sum(w * f(p[2]) for w, p in zip(weights, particles)) for f in (math.sin, math.cos)])
        print(stamp, x, y, 0, 0, 0, math.sin(theta / 2), math.cos(theta / 2), file=output)
        particles = [list(p) for p in random.choices(particles, weights, k=200)]

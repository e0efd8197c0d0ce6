"""What wrappers of localizers share: the folder of a run (docs/localizers.md) and poses in the TUM format."""
import json, math, os

class Run:
    """A run's description, its scans from the CARMEN log, and the noise that was fitted to its log."""

    def __init__(self, path):
        self.about = json.load(open(path))
        self.folder = os.path.dirname(os.path.abspath(path))
        self.mount, self.max_range = self.about["robot_from_laser"], self.about["max_range_m"]

    def file(self, name):
        return os.path.join(self.folder, name)

    def scans(self):
        """Stamp (text), robot's pose by odometry and readings of each scan."""
        for fields in map(str.split, open(self.file(self.about["log"]))):
            if fields and fields[0] in ("FLASER", "ROBOTLASER1"):
                at = 1 if fields[0] == "FLASER" else 8
                n = int(fields[at])
                rest = fields[at + 1 + n + (at == 8):]  # laser's pose, robot's, ...
                stamp = rest[6 if at == 1 else 11]
                yield stamp, [float(v) for v in rest[3:6]], [float(v) for v in fields[at + 1:at + 1 + n]]

    def fitted(self, path):
        """The noise of this run's data set in a file of fitted noise."""
        noise = json.load(open(path))
        if self.about["dataset"] not in noise:
            raise SystemExit(f"{path}: has no noise for {self.about['dataset']}: mcl-eval inspect LOG --fit-motion")
        return noise[self.about["dataset"]]

def turn(angle):
    return math.remainder(angle, math.tau)

def compose(a, b):
    """The pose b, given in the frame a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return [a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], turn(a[2] + b[2])]

def step(before, now):
    """The pose now in the frame of the pose before."""
    dx, dy, c, s = now[0] - before[0], now[1] - before[1], math.cos(before[2]), math.sin(before[2])
    return [c * dx + s * dy, c * dy - s * dx, turn(now[2] - before[2])]

def tum(stamp, pose):
    x, y, theta = pose
    return f"{stamp} {x:.9g} {y:.9g} 0 0 0 {math.sin(theta / 2):.12g} {math.cos(theta / 2):.12g}\n"

"""MRPT's particle filter, `pf-localization`: its input files, and what it prints.

It takes a log in a format of its own, which `carmen2rawlog` makes of a CARMEN log, and a map as
posed scans, which `carmen2simplemap` makes of another. A map of points is therefore written as one
scan of a single reading per point.
"""

import math
import re
import shutil
import time
from pathlib import Path

from data import Data
from environment import Environment
from processes import Failure, processor_seconds

# One process per run under this limit: repeated runs inside one process take memory without bound.
MEMORY = 8 << 30
PARTICLES = 500
# As mcl-eval's: standard deviation about the nearest point (m), random part, cut (m).
SIGMA_HIT, Z_RAND, MAX_DISTANCE = 0.3, 0.5, 2.0
# Odometry noise per step (m, degrees): the one with the smallest pose error on the Intel log of the
# six pairs of 0.02, 0.05 m and 0.5, 1, 2 degrees.
STD_XY, STD_TURN = 0.05, 2.0
NO_RETURN = 10_000

SETTINGS = """\
[PF_options]
PF_algorithm=0
resamplingMethod=3
adaptiveSampleSize=0
BETA=0.5
sampleSize={particles}
[KLD_options]
KLD_binSize_PHI_deg=10
KLD_binSize_XY=0.10
KLD_delta=0.01
KLD_epsilon=0.01
KLD_maxSampleSize={particles}
KLD_minSampleSize={particles}
KLD_minSamplesPerBin=0
[DummyOdometryParams]
minStdXY={std_xy}
minStdPHI={std_turn}
[LocalizationExperiment]
use_3D_poses=false
map_file={map_file}
rawlog_file=scans.rawlog
logOutput_dir={output}
3DSceneFrequency=-1
experimentRepetitions=1
particles_count={particles}
init_PDF_mode=1
init_PDF_min_x={x[0]}
init_PDF_max_x={x[1]}
init_PDF_min_y={y[0]}
init_PDF_max_y={y[1]}
init_PDF_min_yaw_deg={yaw[0]}
init_PDF_max_yaw_deg={yaw[1]}
SHOW_PROGRESS_3D_REAL_TIME=false
[MetricMap]
occupancyGrid_count={grids}
pointsMap_count={points}
[MetricMap_pointsMap_00_insertOpts]
minDistBetweenLaserPoints=0
addToExistingPointsMap=true
also_interpolate=false
disableDeletion=true
fuseWithExisting=false
[MetricMap_pointsMap_00_likelihoodOpts]
sigma_dist={sigma_dist}
max_corr_distance={max_distance}
decimation=1
[MetricMap_occupancyGrid_00_creationOpts]
resolution=0.05
[MetricMap_occupancyGrid_00_insertOpts]
maxDistanceInsertion={max_range}
maxOccupancyUpdateCertainty=0.65
considerInvalidRangesAsFreeSpace=0
[MetricMap_occupancyGrid_00_likelihoodOpts]
likelihoodMethod=4
LF_decimation=1
LF_stdHit={sigma_hit}
LF_maxCorrsDistance={max_distance}
LF_zHit={z_hit}
LF_zRandom={z_rand}
LF_maxRange={max_range}
LF_alternateAverageMethod=0
enableLikelihoodCache=1
"""


class Localization:
    """Runs of `pf-localization` on a data set, on a map of points or on a grid of 5 cm."""

    def __init__(self, data: Data, points: Path):
        self.environment: Environment = data.environment
        self.data = data
        self.folder = data.folder / "mrpt"
        self.points = points
        self.beams = sum(
            1
            for scan in data.scans
            for reading in scan["ranges"]
            if reading is not None and 0 < reading <= data.max_range
        )
        self.prepared = False

    def prepare(self):
        """Writes the inputs, once."""
        if self.prepared:
            return
        self.folder.mkdir(exist_ok=True)
        scans = self.data.scans
        odometry = [scan["odometry"] for scan in scans]
        self.write_scans("scans.log", odometry)
        self.tool("carmen2rawlog", "scans.log", "scans.rawlog")
        self.write_scans("grid.log", [scan["reference"] for scan in scans])
        self.tool("carmen2simplemap", "grid.log", "grid.simplemap")
        self.write_points("points.log")
        self.tool("carmen2simplemap", "points.log", "points.simplemap")
        for kind in ("points", "grid"):
            (self.folder / f"{kind}.ini").write_text(self.settings(kind))
        self.prepared = True

    def write_scans(self, name: str, poses: list):
        """A CARMEN log of the scans with these poses of the robot.

        MRPT spreads the beams of a FLASER line evenly over its resolution times their number, about
        straight ahead. The resolution is chosen so that their distances are right, and the pose of
        the laser on the robot so that their directions are.
        """
        beams, step = len(self.data.scans[0]["ranges"]), self.data.scans[0]["angle_step"]
        resolution = math.degrees(step) * (beams - 1) / beams
        middle = self.data.scans[0]["start_angle"] + step * (beams - 1) / 2
        lines = self.parameters(resolution)
        for scan, (x, y, theta) in zip(self.data.scans, poses, strict=True):
            if len(scan["ranges"]) != beams or scan["angle_step"] != step:
                raise Failure("pf-localization: the log's scans differ in their beams")
            laser = f"{x:.9f} {y:.9f} {theta + middle:.9f}"
            lines.append(flaser(scan["ranges"], laser, f"{x:.9f} {y:.9f} {theta:.9f}"))
        self.file(name).write_text("\n".join(lines) + "\n")

    def write_points(self, name: str):
        """A CARMEN log with a scan for each point: two beams 2° apart, of which the right one hits the
        point from 1 m and the left one nothing."""
        lines = self.parameters(1)
        for row in self.points.read_text().split()[1:]:
            x, y = map(float, row.split(","))
            pose = f"{x - math.cos(math.radians(1)):.9f} {y + math.sin(math.radians(1)):.9f} 0"
            lines.append(flaser([1, None], pose, pose))
        self.file(name).write_text("\n".join(lines) + "\n")

    def parameters(self, resolution: float) -> list[str]:
        # A reading of just the limit counts, as in mcl-eval.
        limit = self.data.max_range + 1e-3
        return [
            f"PARAM laser_front_laser_resolution {resolution:.12f}",
            f"PARAM robot_front_laser_max {limit}",
        ]

    def settings(self, kind: str) -> str:
        x, y, theta = self.data.scans[0]["reference"]
        per_scan = self.beams / len(self.data.scans)
        # Uniform with mcl-eval's standard deviations of 0.1 m and 0.05 rad.
        half, half_turn = 0.1 * math.sqrt(3), math.degrees(0.05 * math.sqrt(3))
        yaw = math.degrees(theta)
        return SETTINGS.format(
            std_xy=STD_XY,
            std_turn=STD_TURN,
            map_file=f"{kind}.simplemap",
            output=f"out-{kind}",
            particles=PARTICLES,
            x=(x - half, x + half),
            y=(y - half, y + half),
            yaw=(yaw - half_turn, yaw + half_turn),
            grids=int(kind == "grid"),
            points=int(kind == "points"),
            # It takes exp(-mean d²/sigma_dist): so it is a product of Gaussians.
            sigma_dist=2 * SIGMA_HIT**2 / per_scan,
            max_distance=MAX_DISTANCE,
            max_range=self.data.max_range,
            sigma_hit=SIGMA_HIT,
            z_hit=1 - Z_RAND,
            z_rand=Z_RAND,
        )

    def measure(self, kind: str) -> dict:
        """One run. Seconds are its own wall time of the filter's steps, per particle and used beam,
        times the share of a processor that the process had: mcl-eval's are processor time."""
        self.prepare()
        for old in self.folder.glob(f"out-{kind}*"):
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        start = time.perf_counter(), processor_seconds()
        printed = self.run("pf-localization", f"{kind}.ini")
        wall, processor = time.perf_counter() - start[0], processor_seconds() - start[1]
        share = processor / wall
        times = self.file(f"out-{kind}_000_{PARTICLES:07}") / "exec_times.txt"
        seconds = [float(value) for value in times.read_text().split()]
        number = r"([-+.\deE]+)"
        estimates = re.findall(rf"PDF estimation: \({number},{number},{number}deg\)", printed)
        if not len(seconds) == len(estimates) == len(self.data.scans):
            raise Failure(
                f"pf-localization: {len(seconds)} times and {len(estimates)} estimates for "
                f"{len(self.data.scans)} scans"
            )
        errors = [
            weighted_error([float(x), float(y), math.radians(float(turn))], scan["reference"])
            for (x, y, turn), scan in zip(estimates, self.data.scans, strict=True)
        ]
        facts = {"weighted_error": sum(errors) / len(errors), "processor_share": share}
        if kind == "points":
            facts["map_points"] = self.map_points()
        return {"seconds": share * sum(seconds) / (PARTICLES * self.beams)} | facts

    def map_points(self) -> int:
        """The points of its map: as many as it was given, or the comparison is void."""
        saved = next(self.file(f"out-points_000_{PARTICLES:07}").glob("map*PointsMap*.txt"))
        found = sum(1 for line in saved.read_text().splitlines() if line and line[0] not in "#%")
        given = len(self.points.read_text().split()) - 1
        if found != given:
            raise Failure(f"pf-localization: made a map of {found} points of {given} given")
        return found

    def file(self, name: str) -> Path:
        return self.folder / name

    def tool(self, name: str, log: str, output: str):
        self.run(name, "-q", "-w", "-i", log, "-o", output)
        if not self.file(output).is_file():
            raise Failure(f"{name}: wrote no {output}")

    def run(self, program: str, *arguments) -> str:
        path = self.environment.folder / "mrpt" / "root" / "usr" / "bin" / program
        return self.environment.runner.run(
            [path, *arguments],
            cwd=self.folder,
            libraries=self.environment.library_folders["mrpt"],
            memory=MEMORY,
        )


def flaser(readings: list, laser: str, robot: str) -> str:
    texts = (str(NO_RETURN if reading is None else reading) for reading in readings)
    return f"FLASER {len(readings)} {' '.join(texts)} {laser} {robot} 0 host 0"


def weighted_error(estimate, reference, xi=0.8) -> float:
    """Equation 7 of the paper: metres and radians."""
    turn = math.remainder(estimate[2] - reference[2], math.tau)
    squared = sum((a - b) ** 2 for a, b in zip(estimate[:2], reference[:2]))
    return math.sqrt(xi * turn**2 + (1 - xi) * squared)

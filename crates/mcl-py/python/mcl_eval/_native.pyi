"""What is written in Rust; mcl_eval re-exports it."""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, Union, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = Union[str, PathLike[str]]
_Doubles = NDArray[np.float64]
_Counts = NDArray[np.int64]
_Auto = Literal["auto"]
_Refinement = Literal[
    "fkm", "fkm-accelerated", "restarts", "annealed", "split-merge", "exchange", "best"
]
_Preset = Literal["default", "book", "carmen"]
_Initial = Literal["known", "uniform", "scan"]

__version__: str

class Error(ValueError): ...
class DataWarning(UserWarning): ...

@final
class Scan:
    def __init__(self, ranges: ArrayLike, start_angle: float, angle_step: float) -> None: ...
    @property
    def ranges(self) -> _Doubles: ...
    @property
    def angles(self) -> _Doubles: ...
    @property
    def stamp(self) -> int | None: ...
    @property
    def reference(self) -> _Doubles | None: ...
    @property
    def odometry(self) -> _Doubles | None: ...

@final
class Recording:
    @property
    def name(self) -> str: ...
    @property
    def max_range(self) -> float: ...
    @property
    def reference_source(self) -> str | None: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def assumptions(self) -> list[str]: ...
    @property
    def robot_from_laser(self) -> _Doubles: ...
    @property
    def points(self) -> _Doubles: ...
    @property
    def stamps(self) -> np.ma.MaskedArray[Any, np.dtype[np.int64]]: ...
    @property
    def reference(self) -> _Doubles: ...
    @property
    def odometry(self) -> _Doubles: ...
    @property
    def ranges(self) -> list[_Doubles]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Scan: ...

def read_log(
    name: _Path,
    /,
    *,
    max_range: float | None = None,
    reference: _Path | None = None,
    reference_topic: str | None = None,
    reference_frame: str | None = None,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    slice: Sequence[float] | None = None,
    base_frame: str | None = None,
    odom_frame: str | None = None,
    laser_pose: Sequence[float] | None = None,
    no_deskew: bool = False,
    longest_gap: float | None = None,
) -> Recording: ...
def read_points(
    name: _Path,
    /,
    *,
    max_range: float | None = None,
    reference: _Path | None = None,
    reference_topic: str | None = None,
    reference_frame: str | None = None,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    slice: Sequence[float] | None = None,
    base_frame: str | None = None,
    odom_frame: str | None = None,
    laser_pose: Sequence[float] | None = None,
    no_deskew: bool = False,
    longest_gap: float | None = None,
    cloud_topic: str | None = None,
    dimensions: Literal[2, 3] | None = None,
) -> _Doubles: ...
@final
class Map:
    def __init__(self, points: ArrayLike) -> None: ...
    @staticmethod
    def read(path: _Path) -> Map: ...
    def write(self, path: _Path, *, ascii: bool = False) -> None: ...
    @property
    def points(self) -> _Doubles: ...
    @property
    def dimensions(self) -> int: ...
    @property
    def report(self) -> dict[str, Any] | None: ...
    def __len__(self) -> int: ...

def build_map(
    points: Recording | ArrayLike,
    /,
    *,
    init: Literal["grid", "random", "all"],
    size: int | str | None = None,
    cell: float | None = None,
    offset: Sequence[float] | Literal["random"] | None = None,
    seed: int = 1,
    refine: _Refinement | None = None,
    rounds: int | None = None,
    restarts: int | None = None,
    refine_seconds: float | None = None,
    sigma: float | _Auto = 0.05,
    tolerance: float = 1e-4,
    max_iterations: int = 1000,
    no_snap: bool = False,
    auto_by: Literal["held-out", "bic", "mdl", "likelihood"] = "held-out",
) -> Map: ...
@final
class LogLikelihood:
    @property
    def total(self) -> float: ...
    @property
    def per_point(self) -> float: ...

def log_likelihood(map: Map | ArrayLike, points: ArrayLike, sigma: float = 0.05) -> LogLikelihood: ...
def point_log_likelihoods(
    map: Map | ArrayLike, points: ArrayLike, sigma: float = 0.05
) -> _Doubles: ...
def distances(map: Map | ArrayLike, points: ArrayLike) -> _Doubles: ...
def nearest(map: Map | ArrayLike, points: ArrayLike) -> tuple[_Doubles, _Counts]: ...
@final
class Step:
    @property
    def pose(self) -> _Doubles: ...
    @property
    def covariance(self) -> _Doubles: ...
    @property
    def effective_sample_size(self) -> float: ...
    @property
    def resampled(self) -> bool: ...
    @property
    def used_beams(self) -> int: ...
    @property
    def particles(self) -> int: ...
    @property
    def log_evidence(self) -> float: ...
    @property
    def explained_beams(self) -> float | None: ...

@final
class ParticleFilter:
    def __init__(
        self,
        map: Map,
        *,
        name: str = "",
        run: int = 0,
        robot_from_laser: ArrayLike = (0.0, 0.0, 0.0),
        max_range: float = 10.0,
        preset: _Preset = "default",
        particles: int | str | None = None,
        seed: int = 1,
        initial: _Initial = "known",
        initial_pose: ArrayLike | None = None,
        initial_std: Sequence[float] | None = None,
        beams: int | str | None = None,
        sigma_hit: float | _Auto | None = None,
        z_rand: float | None = None,
        beam_floor: float | None = None,
        outlier_fraction: float | None = None,
        max_distance: float | None = None,
        motion: Literal["gaussian", "book"] | None = None,
        position_noise: Sequence[float] | None = None,
        heading_noise: Sequence[float] | None = None,
        alpha: Sequence[float] | None = None,
        proposal: Literal["motion", "adaptive"] | None = None,
        resampling: Literal["systematic", "stratified", "residual", "multinomial"] | None = None,
        ess_fraction: float | None = None,
        resample_after: Sequence[float] | None = None,
        likelihood_exponent: float | None = None,
        update_min: Sequence[float] | None = None,
        recover: bool = False,
    ) -> None: ...
    def step(self, odometry: ArrayLike, scan: Scan) -> Step: ...
    def update(self, scan: Scan) -> Step: ...
    def bridge(self, scan: Scan, position: float, heading: float) -> Step: ...
    @property
    def particles(self) -> _Doubles: ...
    @property
    def weights(self) -> _Doubles: ...

@final
class Run:
    @property
    def poses(self) -> _Doubles: ...
    @property
    def covariances(self) -> _Doubles: ...
    @property
    def translation(self) -> _Doubles: ...
    @property
    def heading(self) -> _Doubles: ...
    @property
    def weighted(self) -> _Doubles: ...
    @property
    def effective_sample_size(self) -> _Doubles: ...
    @property
    def log_evidence(self) -> _Doubles: ...
    @property
    def used_beams(self) -> _Counts: ...
    @property
    def particles(self) -> _Counts: ...
    @property
    def resampled(self) -> NDArray[np.bool_]: ...

@final
class Localization:
    @property
    def runs(self) -> list[Run]: ...
    @property
    def figures(self) -> dict[str, Any]: ...

def localize(
    recording: Recording,
    map: Map,
    /,
    *,
    runs: int = 1,
    odometry_noise: Sequence[float] | None = None,
    max_range: float | None = None,
    preset: _Preset = "default",
    particles: int | str | None = None,
    seed: int = 1,
    initial: _Initial = "known",
    initial_pose: ArrayLike | None = None,
    initial_std: Sequence[float] | None = None,
    beams: int | str | None = None,
    sigma_hit: float | _Auto | None = None,
    z_rand: float | None = None,
    beam_floor: float | None = None,
    outlier_fraction: float | None = None,
    max_distance: float | None = None,
    motion: Literal["gaussian", "book"] | None = None,
    position_noise: Sequence[float] | None = None,
    heading_noise: Sequence[float] | None = None,
    alpha: Sequence[float] | None = None,
    proposal: Literal["motion", "adaptive"] | None = None,
    resampling: Literal["systematic", "stratified", "residual", "multinomial"] | None = None,
    ess_fraction: float | None = None,
    resample_after: Sequence[float] | None = None,
    likelihood_exponent: float | None = None,
    update_min: Sequence[float] | None = None,
    recover: bool = False,
) -> Localization: ...
def read_trajectory(path: _Path) -> tuple[_Counts, _Doubles]: ...
def write_trajectory(path: _Path, stamps: ArrayLike, poses: ArrayLike) -> None: ...
def associate(
    reference_stamps: ArrayLike, estimate_stamps: ArrayLike, tolerance: float = ...
) -> tuple[_Counts, _Counts]: ...
@final
class PoseErrors:
    @property
    def translation(self) -> _Doubles: ...
    @property
    def heading(self) -> _Doubles: ...
    @property
    def weighted(self) -> _Doubles: ...

def pose_errors(reference: ArrayLike, estimate: ArrayLike, xi: float = 0.8) -> PoseErrors: ...
@final
class Ate:
    @property
    def translation(self) -> _Doubles: ...
    @property
    def rotation(self) -> _Doubles: ...
    @property
    def full(self) -> _Doubles: ...
    @property
    def reference_from_estimate(self) -> _Doubles: ...

def ate(
    reference: ArrayLike,
    estimate: ArrayLike,
    alignment: Literal["none", "origin", "rigid"] = "none",
) -> Ate: ...
@final
class Rpe:
    @property
    def first(self) -> _Counts: ...
    @property
    def second(self) -> _Counts: ...
    @property
    def translation(self) -> _Doubles: ...
    @property
    def rotation(self) -> _Doubles: ...

def rpe(
    reference: ArrayLike,
    estimate: ArrayLike,
    delta: float,
    unit: Literal["m", "frames", "s", "rad"] = "m",
    *,
    stamps: ArrayLike | None = None,
    all_pairs: bool = False,
    pairs_from: Literal["reference", "estimate"] = "reference",
) -> Rpe: ...
def summary(samples: ArrayLike) -> dict[str, float]: ...
def mean_interval(
    values: ArrayLike, blocks: ArrayLike | None = None
) -> tuple[float, float, float]: ...
@final
class Effect:
    @property
    def mean_difference(self) -> float: ...
    @property
    def standard_error(self) -> float: ...
    @property
    def t(self) -> float: ...
    @property
    def degrees_of_freedom(self) -> float: ...
    @property
    def p_two_sided(self) -> float: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...
    @property
    def blocks(self) -> tuple[int, int]: ...

def paired_test(
    a: ArrayLike, b: ArrayLike, blocks_a: ArrayLike | None = None, blocks_b: ArrayLike | None = None
) -> Effect: ...
def two_sample_test(
    a: ArrayLike, b: ArrayLike, blocks_a: ArrayLike | None = None, blocks_b: ArrayLike | None = None
) -> Effect: ...
def holm(p_values: ArrayLike) -> _Doubles: ...
def read_results(folder: _Path) -> dict[str, NDArray[Any]]: ...
def main(arguments: list[str]) -> int: ...

use mcl_core::{CoreError, OutOfMemory, Pose2};

/// An error in the settings or a run of the filter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// A setting has an invalid value.
    #[error("setting {field} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting, as written in a settings file.
        field: &'static str,
        /// The value found.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// A text is not a value of a setting.
    #[error("{field} is {found:?}, expected {expected}")]
    Parse {
        /// The setting.
        field: &'static str,
        /// The text found.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// The map could not be indexed.
    #[error("cannot use the map: {0}")]
    Map(#[from] CoreError),
    /// Distances were prepared for another `max_distance` than that of the settings.
    #[error(
        "the map's distances are truncated at {found} m, but setting max_distance is {expected} m: \
         build the distances again with the settings' max_distance"
    )]
    MaxDistanceMismatch {
        /// Distance at which the distances are truncated, in metres.
        found: f64,
        /// `max_distance` of the settings in metres.
        expected: f64,
    },
    /// Distances of an NDT map were prepared for another σ_hit than that of the settings.
    #[error(
        "the NDT map's distances are for a sigma_hit of {found} m, but setting sigma_hit is {expected} m: \
         build the distances again with the settings' sigma_hit"
    )]
    SigmaHitMismatch {
        /// σ_hit of the distances in metres.
        found: f64,
        /// σ_hit of the settings in metres.
        expected: f64,
    },
    /// An occupancy grid has no cells, or their number is not a multiple of its width.
    #[error("{cells} cells in rows of {width}, expected one or more whole rows")]
    GridShape {
        /// Number of cells.
        cells: usize,
        /// Number of cells in a row.
        width: usize,
    },
    /// An NDT map has too large an extent for a lookup table of its cells.
    #[error("{columns} × {rows} cells of {cell} m are more than 16,777,216; use larger cells")]
    TableSize {
        /// Number of columns.
        columns: f64,
        /// Number of rows.
        rows: f64,
        /// Edge length of a cell in metres.
        cell: f64,
    },
    /// The settings require a known initial pose, but none was given.
    #[error(
        "no initial pose: initial_pose is \"known\", but neither the log nor the user gives one; \
         pass a pose, or set initial_pose to \"uniform\""
    )]
    NoInitialPose,
    /// An initial pose or sensor pose has a component that is NaN or infinite.
    #[error("{what} is {pose:?}, expected finite metres and radians")]
    NonFinitePose {
        /// Which pose.
        what: &'static str,
        /// The pose found.
        pose: Pose2,
    },
    /// An odometry increment has a component that is NaN or infinite.
    #[error("scan {scan}: the odometry increment is {increment:?}, expected finite numbers")]
    NonFiniteOdometry {
        /// Index of the scan the increment leads to, from 0 (for a filter driven step by step, the index of the
        /// step).
        scan: usize,
        /// The increment found.
        increment: Pose2,
    },
    /// Odometry is missing on too many steps to bridge them.
    #[error(
        "scan {scan} has no odometry increment, nor do {unknown} of {steps} steps in all: the filter cannot \
         follow the robot (this log has no odometry, or lost most of it; at most a quarter of the steps \
         may lack it)"
    )]
    MissingOdometry {
        /// Index of the first scan without odometry, in log order, from 0.
        scan: usize,
        /// Number of steps without odometry.
        unknown: usize,
        /// Number of all steps.
        steps: usize,
    },
    /// The number of increments is not that of the scans.
    #[error("{increments} odometry increments for {scans} scans, expected one per scan")]
    IncrementCount {
        /// Number of increments.
        increments: usize,
        /// Number of scans of the recording.
        scans: usize,
    },
    /// The list of scans to use is not strictly increasing, or has scans that the recording does not have.
    #[error(
        "scan list entry {entry} is {scan}, expected increasing scan numbers below {scans} \
         (entries and scans count from 0)"
    )]
    ScanList {
        /// Position in the list.
        entry: usize,
        /// The scan number found there.
        scan: usize,
        /// Number of scans of the recording.
        scans: usize,
    },
    /// The beam directions of a scan are not finite.
    #[error(
        "scan geometry starts at {start_angle} rad and steps by {angle_step} rad, expected finite \
         angles"
    )]
    ScanGeometry {
        /// Direction of beam 0 in radians.
        start_angle: f64,
        /// Angle between beams in radians.
        angle_step: f64,
    },
    /// The pose of a particle is not finite, or farther from the origin than [`mcl_core::MAX_COORDINATE`].
    #[error(
        "particle {particle} is at {pose:?}, expected finite numbers of at most 1e12 m: are the initial \
         pose, the alpha settings or the odometry far too large?"
    )]
    NonFiniteParticle {
        /// Index of the particle, from 0.
        particle: usize,
        /// The pose found.
        pose: Pose2,
    },
    /// The weights of all particles are 0, or one is NaN.
    #[error("the logarithm of the sum of all weights is {log_sum}, expected a finite number")]
    DegenerateWeights {
        /// The logarithm found.
        log_sum: f64,
    },
    /// There are too few steps to fit a motion model.
    #[error(
        "found {steps} steps with odometry and a reference on which the robot moves, expected at least {least} to fit \
         a motion model"
    )]
    FewSteps {
        /// Number of steps found.
        steps: usize,
        /// Number of steps needed.
        least: usize,
    },
    /// The odometry equals the reference.
    #[error(
        "the odometry equals the reference on all {steps} steps, so its errors cannot be estimated: use another \
         reference, from SLAM or motion capture"
    )]
    ExactOdometry {
        /// Number of steps.
        steps: usize,
    },
    /// There was not enough memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

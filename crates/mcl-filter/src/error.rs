use mcl_core::{CoreError, OutOfMemory, Pose2};

/// What can go wrong between settings and an estimated trajectory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// A setting has a value that means nothing.
    #[error("setting {field} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting, as written in a settings file.
        field: &'static str,
        /// The value found.
        found: String,
        /// What would be accepted.
        expected: &'static str,
    },
    /// A text that names no value of a setting.
    #[error("{field} is {found:?}, expected {expected}")]
    Parse {
        /// What the text should name.
        field: &'static str,
        /// The text found.
        found: String,
        /// What would be accepted.
        expected: &'static str,
    },
    /// The map could not be indexed.
    #[error("cannot use the map: {0}")]
    Map(#[from] CoreError),
    /// Distances were prepared for another cut than the settings ask for.
    #[error(
        "the map's distances are cut at {found} m, but setting max_distance is {expected} m: \
         build the distances again with the settings' max_distance"
    )]
    MaxDistanceMismatch {
        /// Cut of the distances in metres.
        found: f64,
        /// Cut of the settings in metres.
        expected: f64,
    },
    /// Distances of an NDT map were prepared for another σ_hit than the settings ask for.
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
    /// The cells of an occupancy grid are none, or no whole number of rows.
    #[error("{cells} cells in rows of {width}, expected one or more whole rows")]
    GridShape {
        /// Number of cells.
        cells: usize,
        /// Cells in a row.
        width: usize,
    },
    /// An NDT map too wide for its cells to be looked up in a table.
    #[error("{columns} × {rows} cells of {cell} m are more than 16,777,216; use larger cells")]
    TableSize {
        /// Columns.
        columns: f64,
        /// Rows.
        rows: f64,
        /// Edge length of a cell in metres.
        cell: f64,
    },
    /// The settings know the spread of the initial pose but nobody said where it is.
    #[error(
        "no initial pose: initial_pose is \"known\", but neither the log nor the user gives one; \
         pass a pose, or set initial_pose to \"uniform\""
    )]
    NoInitialPose,
    /// An initial pose or a mount with a component that is NaN or infinite.
    #[error("{what} is {pose:?}, expected finite metres and radians")]
    NonFinitePose {
        /// Which pose.
        what: &'static str,
        /// The pose found.
        pose: Pose2,
    },
    /// An odometry increment with a component that is NaN or infinite.
    #[error("scan {scan}: the odometry increment is {increment:?}, expected finite numbers")]
    NonFiniteOdometry {
        /// Index of the scan the increment leads to, from 0 (a step of the filter when stepped by
        /// hand).
        scan: usize,
        /// The increment found.
        increment: Pose2,
    },
    /// The motion of the robot is not known on so many steps that they cannot be bridged.
    #[error(
        "scan {scan} has no odometry increment, nor have {unknown} of {steps} steps: the filter cannot \
         follow the robot (this log has no odometry, or lost most of it; a quarter of the steps may be \
         without)"
    )]
    MissingOdometry {
        /// Index of the first scan without, in log order, from 0.
        scan: usize,
        /// Number of steps without.
        unknown: usize,
        /// Number of all steps.
        steps: usize,
    },
    /// As many increments as scans are needed.
    #[error("{increments} odometry increments for {scans} scans, expected one per scan")]
    IncrementCount {
        /// Number of increments.
        increments: usize,
        /// Number of scans of the recording.
        scans: usize,
    },
    /// The list of scans to use is not a strictly increasing list of scans of the recording.
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
    /// A scan whose beams have no direction.
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
    /// A particle left the plane, or went farther than [`mcl_core::MAX_COORDINATE`].
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
    /// The weights of all particles vanished or one was NaN.
    #[error("the logarithm of the sum of all weights is {log_sum}, expected a finite number")]
    DegenerateWeights {
        /// The logarithm found.
        log_sum: f64,
    },
    /// Too few steps to fit a motion model to.
    #[error(
        "{steps} steps with odometry and a reference on which the robot moves, expected at least {least} to fit a \
         motion model to"
    )]
    FewSteps {
        /// Number of steps found.
        steps: usize,
        /// Number of steps needed.
        least: usize,
    },
    /// Odometry without errors.
    #[error(
        "the odometry is the reference on all of {steps} steps, so nothing can be learned of its errors: give \
         another reference, of SLAM or motion capture"
    )]
    ExactOdometry {
        /// Number of steps.
        steps: usize,
    },
    /// There was not enough memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

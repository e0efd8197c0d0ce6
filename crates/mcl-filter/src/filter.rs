use mcl_core::{LaserScan, Pose2, Seed};

use crate::motion::OdometryModel;
use crate::particles::effective_sample_size;
use crate::sensor::{LikelihoodField, MapDistances, Poses, ScanEndpoints, Scratch};
use crate::{CheckedSettings, Estimate, FilterError, Particles};

/// What one step of the filter found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Weighted mean of the particles and their covariance, before resampling.
    pub estimate: Estimate,
    /// Effective sample size 1/Σw², before resampling.
    pub effective_sample_size: f64,
    /// ln Σ w·p(scan | particle), w the weights before this scan: how well the particles explain the
    /// scan, the likelihood tempered as the settings say. 0 without used beams.
    pub log_evidence: f64,
    /// Whether the particles were drawn anew after the estimate.
    pub resampled: bool,
    /// Number of beams that were used: chosen by the settings and with a usable reading. With none,
    /// the weights are those of the step before.
    pub used_beams: usize,
}

/// Monte Carlo localization (*Probabilistic Robotics*, table 8.2) with selective resampling.
///
/// The particles are poses of the *robot*, whose wheels the motion model describes; the scanner's
/// mount is taken into account when a scan comes in. All draws come from the seed, what they are for
/// and the step, so a filter is the same to the last bit on every machine that computes IEEE doubles
/// with the same mathematical library.
///
/// # Example
/// ```
/// use mcl_core::{LaserScan, PointMap, Pose2, ScanGeometry, Seed};
/// use mcl_filter::{FilterSettings, MapDistances, ParticleFilter};
///
/// // A wall 2 m ahead of where the robot starts, and one 3 m to its left.
/// let ahead = (-20..=30).map(|i| [2.0, 0.1 * f64::from(i)]);
/// let left = (-20..=20).map(|i| [0.1 * f64::from(i), 3.0]);
/// let map = PointMap::new(ahead.chain(left).collect())?;
///
/// let settings = FilterSettings { particles: 2000, ..FilterSettings::default() }.check()?;
/// let distances = MapDistances::grid(&map, settings.values().max_distance)?;
/// let start = Some(Pose2::IDENTITY);
/// let mut filter =
///     ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, start, Seed::new(1))?;
///
/// // The odometry says half a metre; beams ahead and to the left say 0.4 m.
/// let scan = LaserScan {
///     stamp: None,
///     geometry: ScanGeometry { start_angle: 0.0, angle_step: std::f64::consts::FRAC_PI_2, beams: 2 },
///     ranges: vec![1.6, 3.0],
///     map_from_laser: None,
///     odometry: None,
/// };
/// let mut report = filter.step(&Pose2::new(0.5, 0.0, 0.0), &scan)?;
/// for _ in 0..20 {
///     report = filter.update(&scan)?;
/// }
/// assert!((report.estimate.map_from_robot.x - 0.4).abs() < 0.05);
/// assert_eq!(report.used_beams, 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ParticleFilter<'a> {
    settings: CheckedSettings,
    field: LikelihoodField<'a>,
    motion: OdometryModel,
    robot_from_laser: Pose2,
    seed: Seed,
    particles: Particles,
    predictions: u64,
    updates: u64,
    buffers: Buffers,
}

/// Reused from step to step.
#[derive(Default)]
struct Buffers {
    endpoints: ScanEndpoints,
    sin: Vec<f64>,
    cos: Vec<f64>,
    weights: Vec<f64>,
    chosen: Vec<usize>,
    scratch: Vec<f64>,
    likelihoods: Scratch,
}

impl<'a> ParticleFilter<'a> {
    /// A filter whose particles are drawn about `map_from_robot`, or over the map, as
    /// [`initial_pose`](crate::FilterSettings::initial_pose) says.
    ///
    /// # Errors
    /// [`FilterError::MaxDistanceMismatch`], [`FilterError::NoInitialPose`] or
    /// [`FilterError::NonFinitePose`].
    pub fn new(
        settings: &CheckedSettings,
        distances: &'a MapDistances,
        robot_from_laser: Pose2,
        map_from_robot: Option<Pose2>,
        seed: Seed,
    ) -> Result<Self, FilterError> {
        if !robot_from_laser.is_finite() {
            let what = "mount of the laser";
            return Err(FilterError::NonFinitePose { what, pose: robot_from_laser });
        }
        let values = settings.values();
        let particles = Particles::draw(
            values.particles,
            values.initial_pose,
            map_from_robot,
            &distances.bounds(),
            &mut seed.derive("initial-pose").rng(),
        )?;
        Ok(ParticleFilter {
            field: LikelihoodField::new(distances, settings)?,
            motion: OdometryModel::new(values.alpha),
            settings: settings.clone(),
            robot_from_laser,
            seed,
            particles,
            predictions: 0,
            updates: 0,
            buffers: Buffers::default(),
        })
    }

    /// The particles as they are now.
    pub fn particles(&self) -> &Particles {
        &self.particles
    }

    /// A motion and the scan at its end: [`predict`](Self::predict), then
    /// [`update`](Self::update). For the first scan, which no motion leads to, call `update` alone.
    ///
    /// # Errors
    /// Those of both.
    pub fn step(&mut self, increment: &Pose2, scan: &LaserScan) -> Result<StepReport, FilterError> {
        self.predict(increment)?;
        self.update(scan)
    }

    /// Moves every particle by an odometry increment, the robot's pose in the frame of the robot
    /// before, with noise of its own.
    ///
    /// # Errors
    /// [`FilterError::NonFiniteOdometry`], or [`FilterError::NonFiniteParticle`] when the motion
    /// overflows.
    pub fn predict(&mut self, increment: &Pose2) -> Result<(), FilterError> {
        if !increment.is_finite() {
            let scan = self.updates as usize;
            return Err(FilterError::NonFiniteOdometry { scan, increment: *increment });
        }
        let mut rng = self.seed.derive("motion").derive_index(self.predictions).rng();
        self.predictions += 1;
        let Particles { x, y, theta, .. } = &mut self.particles;
        self.motion.motion(increment).sample(x, y, theta, &mut rng);
        self.particles.check_finite()
    }

    /// Weighs every particle by a scan, estimates the pose, and draws the particles anew when their
    /// effective sample size has become too small.
    ///
    /// # Errors
    /// [`FilterError::ScanGeometry`]; [`FilterError::DegenerateWeights`] would be a bug.
    pub fn update(&mut self, scan: &LaserScan) -> Result<StepReport, FilterError> {
        let settings = self.settings.values();
        let Buffers { endpoints, sin, cos, weights, chosen, scratch, likelihoods } =
            &mut self.buffers;
        let particles = &mut self.particles;
        endpoints.load(scan, &self.robot_from_laser, settings.beams, settings.max_range)?;
        sin.clear();
        cos.clear();
        for theta in &particles.theta {
            let (s, c) = theta.sin_cos();
            sin.push(s);
            cos.push(c);
        }
        if !endpoints.is_empty() {
            let poses = Poses { x: &particles.x, y: &particles.y, sin, cos };
            let log_weights = &mut particles.log_weight;
            self.field.add_log_likelihoods(endpoints, poses, likelihoods, log_weights);
        }
        let log_sum = particles.normalize(weights)?;
        let estimate =
            Estimate::of((&particles.x, &particles.y), &particles.theta, (sin, cos), weights);
        let ess = effective_sample_size(weights);
        let resampled = ess < settings.ess_fraction * particles.len() as f64;
        if resampled {
            let mut rng = self.seed.derive("resampling").derive_index(self.updates).rng();
            settings.resampling.draw(weights, &mut rng, scratch, chosen);
            particles.choose(chosen, scratch);
        }
        self.updates += 1;
        Ok(StepReport {
            estimate,
            effective_sample_size: ess,
            log_evidence: if endpoints.is_empty() { 0.0 } else { log_sum },
            resampled,
            used_beams: endpoints.len(),
        })
    }
}

use std::f64::consts::TAU;
use std::ops::Range;

use mcl_core::memory::with_room;
use mcl_core::{
    Bounds, LaserScan, OutOfMemory, Pose2, Rng, Seed, StandardNormal, math, wrap_angle,
};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_distr::Distribution;

use crate::motion::{Motion, MotionModel};
use crate::particles::{PARTICLES, effective_sample_size};
use crate::proposal::{FOLDS, FitBuffers, Noise, NoiseProposal, Pilots};
use crate::recovery::Averages;
use crate::sensor::{LikelihoodField, MapDistances, Poses, ScanEndpoints, Scratch};
use crate::start::LikelyPoses;
use crate::{
    CheckedSettings, Estimate, FilterError, FilterSettings, InitialPose, Particles, Proposal,
    Resampling,
};

/// After unknown motion the robot is searched within this many standard deviations along each axis, and the scan
/// counts as this many independent beams.
const BRIDGE_DEVIATIONS: f64 = 4.0;
const BRIDGE_BEAMS: f64 = 8.0;

/// Result of one step of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct StepReport {
    /// Weighted mean of the particles and their covariance, before resampling.
    pub estimate: Estimate,
    /// Effective sample size 1/Σw², before resampling.
    pub effective_sample_size: f64,
    /// ln Σ w·p(scan | particle), with w the weights before this scan: the log evidence of the
    /// scan, with the likelihood tempered according to the settings. 0 without used beams.
    pub log_evidence: f64,
    /// Whether the particles were resampled after the estimate.
    pub resampled: bool,
    /// Number of beams that were used: selected by the settings, with a usable reading, and not left out as
    /// ending at something unknown. With none, the weights are those of the step before. 0 as well for a scan that was
    /// not used because the robot had hardly moved: then the estimate is predicted.
    pub used_beams: usize,
    /// Number of particles from which the estimate was computed.
    pub particles: usize,
    /// Exponent on the likelihood of the scan: that of the settings, or less until particles that were initialized
    /// from a scan agree.
    pub likelihood_exponent: f64,
    /// Fraction of the beams with a usable reading that the map explains: beams for which the Gaussian term of the
    /// likelihood at the estimate exceeds z_rand/z_max. Beams left out as ending at something unknown do not count as
    /// explained. `None` if no scan or none of its beams was used.
    pub explained_beams: Option<f64>,
}

/// Monte Carlo localization (*Probabilistic Robotics*, table 8.2) with selective resampling.
///
/// The particles are poses of the *robot*, to which the motion model applies; the pose of the scanner on the robot is
/// applied to the scans. Each random draw depends only on the seed, its purpose and the step, so the results are the
/// same bit for bit on every machine with IEEE doubles.
///
/// # Example
/// ```
/// use mcl_core::{LaserScan, PointMap, Pose2, ScanGeometry, Seed};
/// use mcl_filter::{FilterSettings, MapDistances, ParticleFilter};
///
/// // A wall 2 m ahead of the robot's initial pose, and one 3 m to its left.
/// let ahead = (-20..=30).map(|i| [2.0, 0.1 * f64::from(i)]);
/// let left = (-20..=20).map(|i| [0.1 * f64::from(i), 3.0]);
/// let map = PointMap::new(ahead.chain(left).collect())?;
///
/// let settings = FilterSettings { particles: 2000.into(), ..FilterSettings::default() }.check()?;
/// let distances = MapDistances::grid(&map, settings.values().max_distance)?;
/// let start = Some(Pose2::IDENTITY);
/// let mut filter =
///     ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, start, Seed::new(1))?;
///
/// // The odometry reports half a metre; the beams ahead and to the left indicate 0.4 m.
/// let scan = LaserScan {
///     stamp: None,
///     geometry: ScanGeometry { start_angle: 0.0, angle_step: std::f64::consts::FRAC_PI_2, beams: 2 },
///     ranges: vec![1.6, 3.0],
///     map_from_laser: None,
///     odometry: None,
///     sweep: Default::default(),
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
    motion: MotionModel,
    robot_from_laser: Pose2,
    seed: Seed,
    particles: Particles,
    /// The last motion, until the next scan.
    moved: Option<Motion>,
    /// Path (m) and rotation (rad) by the odometry since the particles were last resampled.
    travelled: f64,
    turned: f64,
    predictions: u64,
    updates: u64,
    /// Motion since the last used scan, while scans are skipped.
    pending: Option<Pose2>,
    /// Whether the next scan is used however little the robot has moved.
    is_due: bool,
    predicted: u64,
    start: GlobalLocalization,
    averages: Averages,
    buffers: Buffers,
}

/// State of global localization.
#[derive(Debug, Clone, Copy, PartialEq)]
enum GlobalLocalization {
    /// No scan has been used yet.
    Waiting {
        beams: f64,
        agreement: f64,
    },
    /// Particles are at different positions.
    Searching {
        beams: f64,
        agreement: f64,
    },
    Done,
}

impl GlobalLocalization {
    /// The exponent for a scan of this many beams.
    fn exponent(self, exponent: f64, used_beams: usize) -> f64 {
        match self {
            GlobalLocalization::Done => exponent,
            GlobalLocalization::Waiting { beams, .. }
            | GlobalLocalization::Searching { beams, .. } => {
                exponent.min(beams / used_beams as f64)
            }
        }
    }
}

/// Buffers that are reused in every step.
#[derive(Default)]
struct Buffers {
    endpoints: ScanEndpoints,
    sin: Vec<f64>,
    cos: Vec<f64>,
    weights: Vec<f64>,
    chosen: Vec<usize>,
    scratch: Vec<f64>,
    log_likelihoods: Vec<f64>,
    likelihoods: Scratch,
    /// For an adaptive proposal: the poses before the last motion, and its noise.
    before: [Vec<f64>; 3],
    noise: Vec<Noise>,
    weighing: FitBuffers,
}

impl Buffers {
    /// Allocates everything that depends on the number of particles, so that no step allocates more.
    fn for_particles(settings: &FilterSettings) -> Result<Self, OutOfMemory> {
        let number = settings.particles.most;
        let room = || with_room(number, PARTICLES);
        let mut buffers = Buffers {
            sin: room()?,
            cos: room()?,
            weights: room()?,
            chosen: with_room(number, PARTICLES)?,
            scratch: room()?,
            log_likelihoods: room()?,
            ..Buffers::default()
        };
        if settings.proposal == Proposal::Adaptive {
            buffers.before = [room()?, room()?, room()?];
            buffers.noise = with_room(number, PARTICLES)?;
            buffers.weighing = FitBuffers::with_room(number)?;
        }
        Ok(buffers)
    }

    /// Computes the estimate from the current weights, which are left in the buffers.
    fn estimate(&mut self, particles: &Particles) -> Estimate {
        let Particles { x, y, theta, log_weight } = particles;
        let Buffers { sin, cos, weights, .. } = self;
        weights.clear();
        weights.extend(log_weight.iter().map(|log_weight| math::exp(*log_weight)));
        (*sin, *cos) = theta.iter().map(|theta| math::sin_cos(*theta)).unzip();
        Estimate::of((x, y), theta, (sin, cos), weights)
    }
}

impl<'a> ParticleFilter<'a> {
    /// Creates a filter with particles drawn around `map_from_robot` or over the map, according to
    /// [`initial_pose`](crate::FilterSettings::initial_pose).
    ///
    /// # Errors
    /// [`FilterError::MaxDistanceMismatch`], [`FilterError::NoInitialPose`],
    /// [`FilterError::NonFinitePose`], [`FilterError::NonFiniteParticle`] or [`FilterError::Memory`].
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
            values.particles.most,
            values.initial_pose,
            map_from_robot,
            &distances.bounds(),
            distances.free_space(),
            &mut seed.derive("initial-pose").rng(),
        )?;
        let start = match values.initial_pose {
            InitialPose::Scan { beams, agreement } => {
                GlobalLocalization::Waiting { beams, agreement }
            }
            InitialPose::Known { .. } | InitialPose::Uniform {} => GlobalLocalization::Done,
        };
        Ok(ParticleFilter {
            field: LikelihoodField::new(distances, settings)?,
            motion: MotionModel::of(values),
            settings: settings.clone(),
            robot_from_laser,
            seed,
            particles,
            moved: None,
            travelled: 0.0,
            turned: 0.0,
            predictions: 0,
            updates: 0,
            pending: None,
            is_due: true,
            predicted: 0,
            start,
            averages: Averages::default(),
            buffers: Buffers::for_particles(values)?,
        })
    }

    /// The current particles.
    pub fn particles(&self) -> &Particles {
        &self.particles
    }

    /// Processes a motion and the scan at its end: [`predict`](Self::predict), then [`update`](Self::update). For the
    /// first scan, which has no motion before it, call only `update`.
    ///
    /// # Errors
    /// Those of both.
    pub fn step(&mut self, increment: &Pose2, scan: &LaserScan) -> Result<StepReport, FilterError> {
        self.predict(increment)?;
        self.update(scan)
    }

    /// Moves every particle by an odometry increment (the pose of the robot in its previous frame) with independent
    /// noise. The order of the particles may change.
    ///
    /// # Errors
    /// [`FilterError::NonFiniteOdometry`], or [`FilterError::NonFiniteParticle`] if the motion
    /// overflows.
    pub fn predict(&mut self, increment: &Pose2) -> Result<(), FilterError> {
        if !increment.is_finite() {
            let scan = self.updates as usize;
            return Err(FilterError::NonFiniteOdometry { scan, increment: *increment });
        }
        self.travelled += math::hypot(increment.x, increment.y);
        self.turned += increment.theta.abs();
        let settings = self.settings.values();
        if !settings.leaves_out_scans() {
            return self.apply(increment);
        }
        let FilterSettings { update_distance, update_angle, .. } = *settings;
        let pending = self.pending.unwrap_or(Pose2::IDENTITY).compose(increment);
        self.pending = Some(pending);
        self.is_due |= math::hypot(pending.x, pending.y) >= update_distance
            && update_distance > 0.0
            || pending.theta.abs() >= update_angle && update_angle > 0.0;
        Ok(())
    }

    /// Moves every particle by an increment.
    fn apply(&mut self, increment: &Pose2) -> Result<(), FilterError> {
        let mut rng = self.seed.derive("motion").derive_index(self.predictions).rng();
        self.predictions += 1;
        let motion = self.motion.motion(increment);
        match self.settings.values().proposal {
            Proposal::Motion => {
                let Particles { x, y, theta, .. } = &mut self.particles;
                motion.sample(x, y, theta, &mut rng);
            }
            Proposal::Adaptive => self.predict_for_adaptation(motion, &mut rng),
        }
        self.particles.check_places()
    }

    /// Processes a step whose motion is unknown, and the scan at its end. The motion is modelled as independent
    /// Gaussian noise with these standard deviations on x and y (m) and on the heading (rad). Particles spread so
    /// widely would rarely be near the robot. They are therefore drawn from poses where the scan is likely, as in
    /// global localization, and reweighted by the Gaussian.
    ///
    /// # Errors
    /// [`FilterError::NonFiniteParticle`], and those of [`update`](Self::update).
    pub fn bridge(
        &mut self,
        scan: &LaserScan,
        position: f64,
        heading: f64,
    ) -> Result<(), FilterError> {
        if let Some(pending) = self.pending.take() {
            self.apply(&pending)?;
        }
        // The last motion is no longer relevant for the proposal.
        self.moved = None;
        self.is_due = true;
        self.load(scan)?;
        let mut rng = self.seed.derive("unknown-motion").derive_index(self.predictions).rng();
        self.predictions += 1;
        if self.buffers.endpoints.is_empty() {
            let Particles { x, y, theta, .. } = &mut self.particles;
            for ((x, y), theta) in x.iter_mut().zip(y).zip(theta) {
                let [along, across, turn]: Noise =
                    std::array::from_fn(|_| StandardNormal.sample(&mut rng));
                *x += position * along;
                *y += position * across;
                *theta = wrap_angle(*theta + heading * turn);
            }
            return self.particles.check_places();
        }
        if let GlobalLocalization::Waiting { beams, agreement }
        | GlobalLocalization::Searching { beams, agreement } = self.start
        {
            // This scan is searched for on the whole map.
            self.start = GlobalLocalization::Waiting { beams, agreement };
            return Ok(());
        }
        let Estimate { map_from_robot: mean, covariance } = self.buffers.estimate(&self.particles);
        let spread = [position, position, heading];
        let std =
            [0, 1, 2].map(|axis| (covariance[(axis, axis)] + math::square(spread[axis])).sqrt());
        let reach = [0, 1].map(|axis| BRIDGE_DEVIATIONS * std[axis]);
        let window = Bounds {
            min: [mean.x - reach[0], mean.y - reach[1]],
            max: [mean.x + reach[0], mean.y + reach[1]],
        };
        self.draw_likely(Some(window), BRIDGE_BEAMS, &mut rng, |pose, _| {
            let off = [pose.x - mean.x, pose.y - mean.y, wrap_angle(pose.theta - mean.theta)];
            let of_axes = off.iter().zip(std);
            of_axes
                .map(|(off, std)| -0.5 * math::square(off / std) - math::ln(std * TAU.sqrt()))
                .sum()
        })
    }

    /// Moves the particles and keeps what is needed to move some of them again. They are shuffled first,
    /// so that pilots and others, and the folds of both, are selected at random.
    fn predict_for_adaptation(&mut self, motion: Motion, rng: &mut Rng) {
        let Buffers { chosen, scratch, before, noise, .. } = &mut self.buffers;
        chosen.clear();
        chosen.extend(0..self.particles.len());
        chosen.shuffle(rng);
        self.particles.reorder(chosen, scratch);
        let Particles { x, y, theta, .. } = &mut self.particles;
        for (before, now) in before.iter_mut().zip([&*x, &*y, &*theta]) {
            before.clone_from(now);
        }
        noise.clear();
        motion.apply(x, y, theta, || {
            let drawn: Noise = std::array::from_fn(|_| StandardNormal.sample(rng));
            noise.push(drawn);
            drawn
        });
        self.moved = Some(motion);
    }

    /// Weights every particle by the likelihood of a scan, estimates the pose, and resamples the particles if the
    /// settings require it.
    ///
    /// # Errors
    /// [`FilterError::ScanGeometry`], or [`FilterError::NonFiniteParticle`] if the adapted motion
    /// overflows; [`FilterError::DegenerateWeights`] would be a bug.
    pub fn update(&mut self, scan: &LaserScan) -> Result<StepReport, FilterError> {
        if self.settings.values().leaves_out_scans() {
            if !std::mem::take(&mut self.is_due) {
                return Ok(self.report_prediction());
            }
            if let Some(pending) = self.pending.take() {
                self.apply(&pending)?;
            }
        }
        self.load(scan)?;
        let readings = self.buffers.endpoints.len();
        self.draw_from_scan()?;
        let outlier_fraction = self.settings.values().outlier_fraction;
        let number = self.particles.len();
        match self.moved.take().filter(|_| !self.buffers.endpoints.is_empty()) {
            None => self.weigh(0..number, outlier_fraction),
            Some(motion) => {
                let pilots = number / 2;
                self.weigh(0..pilots, outlier_fraction);
                let proposals = self.redraw(&motion, pilots);
                self.particles.check_places()?;
                // Uses the beams that were not left out by the pilots.
                self.weigh(pilots..number, 1.0);
                self.correct(&proposals, pilots);
            }
        }

        let settings = self.settings.values();
        let Buffers { endpoints, sin, cos, weights, log_likelihoods, likelihoods, .. } =
            &mut self.buffers;
        let particles = &mut self.particles;
        for (log_weight, likelihood) in particles.log_weight.iter_mut().zip(&*log_likelihoods) {
            *log_weight += likelihood;
        }
        let log_sum = particles.normalize(weights)?;
        let estimate =
            Estimate::of((&particles.x, &particles.y), &particles.theta, (sin, cos), weights);
        let ess = effective_sample_size(weights);
        let is_due =
            self.travelled >= settings.resample_distance || self.turned >= settings.resample_angle;
        let used_beams = endpoints.len();
        let explained_beams = (used_beams > 0).then(|| {
            let explained = self.field.explained(endpoints, estimate.map_from_robot, likelihoods);
            explained as f64 / readings as f64
        });
        let exponent = self.start.exponent(settings.likelihood_exponent, used_beams);
        let mut injected = 0.0;
        if let GlobalLocalization::Searching { agreement, .. } = self.start {
            let covariance = &estimate.covariance;
            if covariance[(0, 0)] + covariance[(1, 1)] < agreement * agreement {
                self.start = GlobalLocalization::Done;
            }
        } else if let (Some(recovery), true) = (&settings.recover, used_beams > 0) {
            let beam = math::exp(log_sum / (exponent * used_beams as f64));
            injected = self.averages.add(beam, recovery);
        }
        let resampled =
            is_due && (injected > 0.0 || ess < settings.ess_fraction * particles.len() as f64);
        let report = StepReport {
            estimate,
            effective_sample_size: ess,
            log_evidence: if used_beams == 0 { 0.0 } else { log_sum },
            resampled,
            used_beams,
            particles: particles.len(),
            likelihood_exponent: exponent,
            explained_beams,
        };
        if resampled {
            self.resample(injected)?;
        }
        self.updates += 1;
        Ok(report)
    }

    /// Resamples the particles to the number required by the settings, with a fraction injected where the scan is
    /// likely.
    fn resample(&mut self, injected: f64) -> Result<(), FilterError> {
        (self.travelled, self.turned) = (0.0, 0.0);
        let seed = |purpose| self.seed.derive(purpose).derive_index(self.updates);
        let FilterSettings { particles: number, kld, resampling, recover, .. } =
            self.settings.values();
        let Buffers { endpoints, weights, chosen, scratch, .. } = &mut self.buffers;
        let particles = &mut self.particles;
        let wanted = if number.is_fixed() {
            number.most
        } else {
            let mut rng = seed("particle-number").rng();
            Resampling::Multinomial.draw(weights, number.most, &mut rng, scratch, chosen);
            kld.enough(number.least, number.most, chosen.iter().map(|&i| particles.pose(i)))
        };
        let mut rng = seed("injection").rng();
        let random = match injected > 0.0 {
            true => (injected * wanted as f64 + rng.random::<f64>()) as usize,
            false => 0,
        };
        resampling.draw(weights, wanted - random, &mut seed("resampling").rng(), scratch, chosen);
        particles.choose(chosen, scratch);
        if let (Some(recovery), true) = (recover, random > 0) {
            let exponent = recovery.beams / endpoints.len() as f64;
            let places = LikelyPoses::search(&self.field, endpoints, None, exponent.min(1.0))?;
            places.draw(random, |_, uniform| uniform, &mut rng, particles);
            particles.make_equal();
            particles.check_places()?;
        }
        Ok(())
    }

    /// Replaces the particles by poses drawn where the first scan with readings is likely.
    fn draw_from_scan(&mut self) -> Result<(), FilterError> {
        let GlobalLocalization::Waiting { beams, agreement } = self.start else { return Ok(()) };
        let endpoints = &self.buffers.endpoints;
        if endpoints.is_empty() {
            return Ok(());
        }
        let mut rng = self.seed.derive("start").rng();
        self.draw_likely(None, beams, &mut rng, |_, uniform| uniform)?;
        self.moved = None;
        self.start = GlobalLocalization::Searching { beams, agreement };
        Ok(())
    }

    /// Replaces the particles by poses drawn where the loaded scan is likely, counting as this many independent beams,
    /// and weights them by a prior density ([`LikelyPoses::draw`]).
    fn draw_likely(
        &mut self,
        window: Option<Bounds<2>>,
        beams: f64,
        rng: &mut Rng,
        log_prior: impl Fn(&Pose2, f64) -> f64,
    ) -> Result<(), FilterError> {
        let endpoints = &self.buffers.endpoints;
        let FilterSettings { likelihood_exponent, particles, .. } = *self.settings.values();
        let exponent = likelihood_exponent.min(beams / endpoints.len() as f64);
        let places = LikelyPoses::search(&self.field, endpoints, window, exponent)?;
        self.particles.clear();
        places.draw(particles.most, log_prior, rng, &mut self.particles);
        self.make_room();
        self.particles.check_places()
    }

    /// Predicts the estimate by the motion since the last used scan.
    fn report_prediction(&mut self) -> StepReport {
        let mut rng = self.seed.derive("prediction").derive_index(self.predicted).rng();
        self.predicted += 1;
        let mut moved = self.particles.clone();
        let Particles { x, y, theta, .. } = &mut moved;
        if let Some(pending) = &self.pending {
            self.motion.motion(pending).sample(x, y, theta, &mut rng);
        }
        StepReport {
            estimate: self.buffers.estimate(&moved),
            effective_sample_size: effective_sample_size(&self.buffers.weights),
            log_evidence: 0.0,
            resampled: false,
            used_beams: 0,
            particles: moved.len(),
            likelihood_exponent: self.settings.values().likelihood_exponent,
            explained_beams: None,
        }
    }

    /// Loads the beams of a scan, and allocates room for the results.
    fn load(&mut self, scan: &LaserScan) -> Result<(), FilterError> {
        let FilterSettings { beams, max_range, .. } = *self.settings.values();
        self.buffers.endpoints.load(scan, &self.robot_from_laser, beams, max_range)?;
        self.make_room();
        Ok(())
    }

    /// Resizes the buffers with one entry per particle.
    fn make_room(&mut self) {
        let Buffers { log_likelihoods, sin, cos, .. } = &mut self.buffers;
        for buffer in [log_likelihoods, sin, cos] {
            buffer.resize(self.particles.len(), 0.0);
        }
    }

    /// Computes log-likelihoods of the scan, sines and cosines for a range of the particles, without the beams that
    /// end at something unknown for more than the given fraction of them.
    fn weigh(&mut self, range: Range<usize>, outlier_fraction: f64) {
        let Buffers { endpoints, sin, cos, log_likelihoods, likelihoods, .. } = &mut self.buffers;
        let Particles { x, y, theta, .. } = &self.particles;
        for i in range.clone() {
            (sin[i], cos[i]) = math::sin_cos(theta[i]);
        }
        let log_likelihoods = &mut log_likelihoods[range.clone()];
        log_likelihoods.fill(0.0);
        let poses = Poses {
            x: &x[range.clone()],
            y: &y[range.clone()],
            sin: &sin[range.clone()],
            cos: &cos[range],
        };
        if outlier_fraction < 1.0 {
            let laser = [self.robot_from_laser.x, self.robot_from_laser.y];
            self.field.leave_out_unknown(endpoints, laser, poses, outlier_fraction, likelihoods);
        }
        if !endpoints.is_empty() {
            self.field.add_log_likelihoods(endpoints, poses, likelihoods, log_likelihoods);
        }
        if self.start != GlobalLocalization::Done {
            let exponent = self.settings.values().likelihood_exponent;
            let tempering = self.start.exponent(exponent, endpoints.len()) / exponent;
            log_likelihoods.iter_mut().for_each(|likelihood| *likelihood *= tempering);
        }
    }

    /// Moves the particles from index `pilots` on again, those of each fold with noise from a proposal fitted to the
    /// pilots of the other folds. Without a proposal they keep their poses.
    fn redraw(&mut self, motion: &Motion, pilots: usize) -> [Option<NoiseProposal>; FOLDS] {
        let Buffers { log_likelihoods, before, noise, weighing, .. } = &mut self.buffers;
        let Particles { x, y, theta, log_weight } = &mut self.particles;
        let (of_pilots, of_others) = noise.split_at_mut(pilots);
        let known = Pilots {
            noise: of_pilots,
            log_weights: &log_weight[..pilots],
            log_likelihoods: &log_likelihoods[..pilots],
        };
        let mut rng = self.seed.derive("adaptation").derive_index(self.updates).rng();
        std::array::from_fn(|fold| {
            let proposal = NoiseProposal::fit(known, part(fold, pilots), weighing)?;
            let drawn = part(fold, of_others.len());
            let moved = pilots + drawn.start..pilots + drawn.end;
            for (component, before) in [&mut *x, y, theta].into_iter().zip(&*before) {
                component[moved.clone()].copy_from_slice(&before[moved.clone()]);
            }
            let mut noise = of_others[drawn].iter_mut();
            motion.apply(&mut x[moved.clone()], &mut y[moved.clone()], &mut theta[moved], || {
                let drawn = proposal.draw(&mut rng);
                if let Some(noise) = noise.next() {
                    *noise = drawn;
                }
                drawn
            });
            Some(proposal)
        })
    }

    /// Reweights the particles of each fold by the mixture from which their noise was drawn.
    fn correct(&mut self, proposals: &[Option<NoiseProposal>; FOLDS], pilots: usize) {
        let others = self.particles.len() - pilots;
        for (fold, proposal) in proposals.iter().enumerate() {
            let Some(proposal) = proposal else { continue };
            let (pilot, drawn) = (part(fold, pilots), part(fold, others));
            let share = drawn.len() as f64 / (pilot.len() + drawn.len()) as f64;
            for i in pilot.chain(pilots + drawn.start..pilots + drawn.end) {
                self.particles.log_weight[i] +=
                    proposal.log_correction(&self.buffers.noise[i], share);
            }
        }
    }
}

/// The range of the particles of a fold, of `number` in total.
fn part(fold: usize, number: usize) -> Range<usize> {
    fold * number / FOLDS..(fold + 1) * number / FOLDS
}

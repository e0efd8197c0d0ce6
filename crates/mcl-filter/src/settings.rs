//! Settings of the filter: plain values, and the same values once they have been checked.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::beams::Beams;
use crate::check::{check, check_amount, check_length, check_positive, check_share, check_std};
use crate::kld::Kld;
use crate::number::ParticleNumber;
use crate::recovery::Recovery;
use crate::sigma_hit::SigmaHit;
use crate::words::words;

/// Largest number of particles; more would not fit in the memory of typical machines.
const MAX_PARTICLES: usize = 10_000_000;

/// Settings of Monte Carlo localization, as in a settings file; [`check`](Self::check) them before use.
///
/// Lengths are in metres, angles in radians. The symbols are those of *Probabilistic Robotics* (Thrun,
/// Burgard, Fox 2005).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilterSettings {
    /// M: number of particles, fixed or adapted within a range.
    pub particles: ParticleNumber,
    /// How the number of particles adapts within the range.
    pub kld: Kld,
    /// How the particles are initialized.
    pub initial_pose: InitialPose,
    /// The motion model.
    pub motion: MotionKind,
    /// Noise of the Gaussian motion model along each of x and y of the robot: standard deviations per step
    /// (m), per metre (m/m) and per radian (m/rad); their squares add up.
    pub position_noise: [f64; 3],
    /// Noise of the heading in the Gaussian motion model: standard deviations per step (rad), per metre
    /// (rad/m) and per radian (rad/rad); their squares add up.
    pub heading_noise: [f64; 3],
    /// α₁…α₄ of the book's motion model (table 5.6), such that α·δ² are variances: rotation noise
    /// from rotation (dimensionless) and from translation (rad²/m²), translation noise from
    /// translation (dimensionless) and from rotation (m²/rad²).
    pub alpha: [f64; 4],
    /// Translations shorter than this (m) count as turning in place in the book's motion model. The default
    /// is that of AMCL's differential drive model (nav2_amcl, `differential_motion_model.cpp`).
    pub turning_in_place: f64,
    /// σ_hit: standard deviation of a measured endpoint around the nearest map point.
    pub sigma_hit: SigmaHit,
    /// z_rand: probability of a random measurement; z_hit is 1 − z_rand. Ignored if `beam_floor` is given.
    pub z_rand: f64,
    /// The same parameter as CARMEN defines it: the smallest likelihood of a beam as a fraction of the largest. A
    /// beam at distance d has likelihood floor + (1 − floor)·exp(−d²/2σ_hit²), times a constant. `None` to use
    /// z_rand.
    pub beam_floor: Option<f64>,
    /// A beam is left out of the scan if, for more than this fraction of the particles, the map has nothing along it
    /// near its end: it then ends at a person or another obstacle that is not in the map. 1 leaves out none; 0.9
    /// suits environments with many people. The name is CARMEN's, whose outliers are beams below the floor.
    pub outlier_fraction: f64,
    /// Distances to the map are truncated at this (m), so that all points off the map are equally unlikely.
    pub max_distance: f64,
    /// z_max: largest reading that is used (m), inclusive; also the range over which random
    /// measurements are uniform.
    pub max_range: f64,
    /// The beams of a scan to use.
    pub beams: Beams,
    /// Exponent on the likelihood of a scan. 1 treats the beams as independent, as in the book; a
    /// smaller value tempers the likelihood, because neighbouring beams see the same surface and the same
    /// map errors.
    pub likelihood_exponent: f64,
    /// The proposal distribution for the noise of a motion.
    pub proposal: Proposal,
    /// The resampling scheme.
    pub resampling: Resampling,
    /// Particles are resampled if the effective sample size is below this fraction of their
    /// number: 0 never, 1 whenever the weights differ.
    pub ess_fraction: f64,
    /// Particles are resampled only after the robot has moved this far by its odometry (m) …
    pub resample_distance: f64,
    /// … or turned by this total angle (rad), whichever comes first; until then the likelihoods of
    /// scans multiply. 0: at every scan.
    pub resample_angle: f64,
    /// Scans are used only after the robot has moved this far by its odometry (m) since the last used one …
    pub update_distance: f64,
    /// … or turned by this angle (rad), whichever comes first; until then the motion is accumulated and the
    /// estimate is predicted. 0: every scan is used.
    pub update_angle: f64,
    /// Recovery from localization failure; `None` for none.
    pub recover: Option<Recovery>,
}

/// The defaults. Motion noise, z_rand and proposal are those that tracked best on ACES,
/// Freiburg 079, Freiburg 101, Seattle, CSAIL and the simulated office (experiments/sensitivity.toml,
/// docs/filter.md).
impl Default for FilterSettings {
    fn default() -> Self {
        FilterSettings {
            particles: 500.into(),
            kld: Kld::default(),
            initial_pose: InitialPose::Known { std_x: 0.1, std_y: 0.1, std_theta: 0.05 },
            motion: MotionKind::Gaussian,
            position_noise: [0.05, 0.1, 0.1],
            heading_noise: [0.05, 0.1, 0.15],
            alpha: [0.05; 4],
            turning_in_place: 0.01,
            sigma_hit: SigmaHit::Auto,
            z_rand: 0.8,
            beam_floor: None,
            outlier_fraction: 1.0,
            max_distance: 2.0,
            max_range: 10.0,
            beams: Beams::All,
            likelihood_exponent: 1.0,
            proposal: Proposal::Adaptive,
            resampling: Resampling::Systematic,
            ess_fraction: 0.5,
            resample_distance: 0.0,
            resample_angle: 0.0,
            update_distance: 0.0,
            update_angle: 0.0,
            recover: None,
        }
    }
}

/// A complete set of settings with a source.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// [`FilterSettings::default`]: this program's own filter.
    #[default]
    Default,
    /// *Probabilistic Robotics*: table 8.2 with the motion model of table 5.6 as the proposal, and the product over
    /// all beams of table 6.3. The book gives no values of σ_hit, z_rand and α; 0.3 m, 0.5 and 0.05 tracked best with
    /// these models on the ACES log, Freiburg 079 and the simulated office.
    Book,
    /// CARMEN's `localize`, the program of the paper's group: σ_hit = 0.3 m (`lmap_std`), floor 0.45
    /// (`tracking_beam_minlikelihood`), one beam per 3° (`integrate_angle`). Likelihoods multiply until the
    /// robot has moved 0.2 m (`update_distance`) or turned 0.2 rad (the angle used by its descendants),
    /// then particles are resampled. Its `outlier_fraction` of 0.9 refers to beams *below*
    /// the floor; since the floor is added, there are none, so no beam is left out. CARMEN learns its own motion
    /// model; this preset uses that of `Book`.
    Carmen,
}

impl Preset {
    /// All presets.
    pub const ALL: [Preset; 3] = [Preset::Default, Preset::Book, Preset::Carmen];

    /// The name of the preset, as in a study.
    pub const fn name(self) -> &'static str {
        match self {
            Preset::Default => "default",
            Preset::Book => "book",
            Preset::Carmen => "carmen",
        }
    }

    /// The settings of the preset.
    pub fn settings(self) -> FilterSettings {
        let book = || FilterSettings {
            motion: MotionKind::Book,
            sigma_hit: SigmaHit::Metres(0.3),
            z_rand: 0.5,
            proposal: Proposal::Motion,
            ..FilterSettings::default()
        };
        match self {
            Preset::Default => FilterSettings::default(),
            Preset::Book => book(),
            Preset::Carmen => FilterSettings {
                beam_floor: Some(0.45),
                beams: Beams::Degrees(3.0),
                ess_fraction: 1.0,
                resample_distance: 0.2,
                resample_angle: 0.2,
                ..book()
            },
        }
    }
}

words!(Preset, "preset", "default, book or carmen");

/// The initial distribution of the particles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum InitialPose {
    /// Position tracking: a Gaussian around a known pose, independent in x, y (the map axes) and θ.
    Known {
        /// Standard deviation in x (m).
        std_x: f64,
        /// Standard deviation in y (m).
        std_y: f64,
        /// Standard deviation of the heading (rad).
        std_theta: f64,
    },
    /// Global localization: uniform over the free space of the map, or over its axis-aligned bounding box if no free
    /// space is known, and over all headings.
    Uniform {},
    /// Global localization: poses at which the first scan with readings is likely, searched over the whole map. A
    /// single scan is similar at many poses, so the likelihoods of the scans are tempered until the particles agree.
    Scan {
        /// Number of independent beams that a scan counts as until then.
        #[serde(default = "start_beams")]
        beams: f64,
        /// Particles agree if the combined standard deviation of x and y is below this (m).
        #[serde(default = "agreement")]
        agreement: f64,
    },
}

impl InitialPose {
    /// [`Scan`](Self::Scan) with its default values.
    pub fn scan() -> Self {
        InitialPose::Scan { beams: start_beams(), agreement: agreement() }
    }
}

fn start_beams() -> f64 {
    8.0
}

fn agreement() -> f64 {
    1.0
}

/// The kind of motion model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotionKind {
    /// Gaussian noise in the robot frame, with a minimum per step: [`GaussianModel`](crate::motion::GaussianModel).
    Gaussian,
    /// *Probabilistic Robotics*, table 5.6: [`OdometryModel`](crate::motion::OdometryModel).
    Book,
}

impl MotionKind {
    /// All kinds.
    pub const ALL: [MotionKind; 2] = [MotionKind::Gaussian, MotionKind::Book];

    /// The name, as in a settings file.
    pub const fn name(self) -> &'static str {
        match self {
            MotionKind::Gaussian => "gaussian",
            MotionKind::Book => "book",
        }
    }
}

words!(MotionKind, "motion", "gaussian or book");

/// The proposal distribution for the noise of a motion. Both represent the same posterior and need the same
/// number of likelihood evaluations; they differ in how many particles are where the scan is likely.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Proposal {
    /// The motion model, as in *Probabilistic Robotics*, table 8.2.
    Motion,
    /// Half of the particles from the motion model, the others from Gaussians fitted to where the scan is likely
    /// among the particles of other folds; all are weighted by the mixture of both (Owen and Zhou 2000). With fewer
    /// than about 50 particles it equals the motion model.
    Adaptive,
}

impl Proposal {
    /// All kinds.
    pub const ALL: [Proposal; 2] = [Proposal::Motion, Proposal::Adaptive];

    /// The name, as in a settings file.
    pub const fn name(self) -> &'static str {
        match self {
            Proposal::Motion => "motion",
            Proposal::Adaptive => "adaptive",
        }
    }
}

words!(Proposal, "proposal", "motion or adaptive");

/// The resampling scheme. All four are unbiased and differ in their variance (Douc, Cappé and
/// Moulines, *Comparison of resampling schemes for particle filtering*, 2005).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resampling {
    /// N equally spaced positions with one random offset (*Probabilistic Robotics*, table 4.4).
    Systematic,
    /// One random number in each of N equal strata.
    Stratified,
    /// ⌊N·w⌋ copies of each particle, the rest multinomial on the remaining weights.
    Residual,
    /// N independent draws.
    Multinomial,
}

impl Resampling {
    /// All schemes.
    pub const ALL: [Resampling; 4] = [
        Resampling::Systematic,
        Resampling::Stratified,
        Resampling::Residual,
        Resampling::Multinomial,
    ];

    /// The name, as in a settings file.
    pub const fn name(self) -> &'static str {
        match self {
            Resampling::Systematic => "systematic",
            Resampling::Stratified => "stratified",
            Resampling::Residual => "residual",
            Resampling::Multinomial => "multinomial",
        }
    }
}

words!(Resampling, "resampling", "systematic, stratified, residual or multinomial");

/// Settings that have passed [`FilterSettings::check`], as required by the filter.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedSettings(FilterSettings);

impl CheckedSettings {
    /// The checked values.
    pub fn values(&self) -> &FilterSettings {
        &self.0
    }
}

impl FilterSettings {
    /// Checks these settings with another `max_range` (m), for data sets with their own limit of readings.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn with_max_range(&self, max_range: f64) -> Result<CheckedSettings, FilterError> {
        FilterSettings { max_range, ..self.clone() }.check()
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`FilterError::Setting`] with the first invalid field, its value, and what is expected.
    pub fn check(self) -> Result<CheckedSettings, FilterError> {
        check("particles", self.particles, ParticleNumber::EXPECTED, |number| {
            number.least <= number.most && number.least >= 1 && number.most <= MAX_PARTICLES
        })?;
        self.kld.check()?;
        self.recover.iter().try_for_each(Recovery::check)?;
        if let InitialPose::Known { std_x, std_y, std_theta } = self.initial_pose {
            check_std("initial_pose.std_x", std_x)?;
            check_std("initial_pose.std_y", std_y)?;
            check_std("initial_pose.std_theta", std_theta)?;
        }
        if let InitialPose::Scan { beams, agreement } = self.initial_pose {
            check_positive("initial_pose.beams", beams)?;
            check_positive("initial_pose.agreement", agreement)?;
        }
        for (field, alpha) in
            ["alpha[0]", "alpha[1]", "alpha[2]", "alpha[3]"].iter().zip(self.alpha)
        {
            check_amount(field, alpha)?;
        }
        for (field, parts) in
            [("position_noise", self.position_noise), ("heading_noise", self.heading_noise)]
        {
            parts.into_iter().try_for_each(|part| check_std(field, part))?;
        }
        check_amount("turning_in_place", self.turning_in_place)?;
        if let SigmaHit::Metres(metres) = self.sigma_hit {
            check_length("sigma_hit", metres)?;
        }
        check("z_rand", self.z_rand, "a probability from 0 to 1", |z| (0.0..=1.0).contains(z))?;
        if let Some(floor) = self.beam_floor {
            check_share("beam_floor", floor)?;
        }
        check_share("outlier_fraction", self.outlier_fraction)?;
        check_length("max_distance", self.max_distance)?;
        check_length("max_range", self.max_range)?;
        check("beams", self.beams, Beams::EXPECTED, Beams::is_some)?;
        check_positive("likelihood_exponent", self.likelihood_exponent)?;
        check_share("ess_fraction", self.ess_fraction)?;
        check_amount("resample_distance", self.resample_distance)?;
        check_amount("resample_angle", self.resample_angle)?;
        check_amount("update_distance", self.update_distance)?;
        check_amount("update_angle", self.update_angle)?;
        Ok(CheckedSettings(self))
    }

    /// Whether scans are skipped until the robot has moved.
    pub(crate) fn leaves_out_scans(&self) -> bool {
        self.update_distance > 0.0 || self.update_angle > 0.0
    }

    /// Smallest likelihood of a beam as a fraction of the largest for this σ_hit (m), from either setting.
    pub fn relative_floor(&self, sigma_hit: f64) -> f64 {
        let [hit, random] = self.mixture(sigma_hit);
        random / (hit + random)
    }

    /// The two terms of the likelihood of a beam that ends on the map (table 6.3): z_hit/(σ_hit·√2π) and
    /// z_rand/z_max.
    pub(crate) fn mixture(&self, sigma_hit: f64) -> [f64; 2] {
        let width = sigma_hit * TAU.sqrt();
        let z_rand = match self.beam_floor {
            None => self.z_rand,
            // floor = (z_rand/z_max) / (z_hit·peak + z_rand/z_max), solved for z_rand.
            Some(floor) => {
                let random = floor * (1.0 / width) * self.max_range;
                random / (random + (1.0 - floor))
            }
        };
        [(1.0 - z_rand) / width, z_rand / self.max_range]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Change = fn(&mut FilterSettings);

    #[test]
    fn every_bad_value_is_refused_by_its_name() {
        let cases: [(&str, Change); 35] = [
            ("particles", |s| s.particles = 0.into()),
            ("particles", |s| s.particles = usize::MAX.into()),
            ("particles", |s| s.particles = ParticleNumber { least: 2, most: 1 }),
            ("kld.epsilon", |s| s.kld.epsilon = 0.0),
            ("kld.position", |s| s.kld.position = f64::NAN),
            ("recover.slow", |s| s.recover = Some(Recovery { slow: 1.5, ..Recovery::default() })),
            ("recover.tolerance", |s| {
                s.recover = Some(Recovery { tolerance: 0.0, ..Recovery::default() });
            }),
            ("update_distance", |s| s.update_distance = -0.1),
            ("update_angle", |s| s.update_angle = f64::NAN),
            ("initial_pose.beams", |s| {
                s.initial_pose = InitialPose::Scan { beams: 0.0, agreement: 1.0 };
            }),
            ("initial_pose.agreement", |s| {
                s.initial_pose = InitialPose::Scan { beams: 8.0, agreement: f64::NAN };
            }),
            ("initial_pose.std_y", |s| {
                s.initial_pose = InitialPose::Known { std_x: 0.0, std_y: -1.0, std_theta: 0.0 };
            }),
            ("alpha[2]", |s| s.alpha[2] = -0.1),
            ("alpha[3]", |s| s.alpha[3] = f64::INFINITY),
            ("position_noise", |s| s.position_noise[1] = -0.1),
            ("heading_noise", |s| s.heading_noise[0] = f64::INFINITY),
            ("turning_in_place", |s| s.turning_in_place = f64::NAN),
            ("sigma_hit", |s| s.sigma_hit = SigmaHit::Metres(0.0)),
            ("sigma_hit", |s| s.sigma_hit = SigmaHit::Metres(f64::NAN)),
            ("z_rand", |s| s.z_rand = 1.1),
            ("z_rand", |s| s.z_rand = f64::NAN),
            ("max_distance", |s| s.max_distance = f64::INFINITY),
            ("max_range", |s| s.max_range = -10.0),
            ("beams", |s| s.beams = Beams::Spread(0)),
            ("beams", |s| s.beams = Beams::Degrees(0.0)),
            ("beams", |s| s.beams = Beams::Degrees(f64::INFINITY)),
            ("beam_floor", |s| s.beam_floor = Some(1.5)),
            ("outlier_fraction", |s| s.outlier_fraction = -0.5),
            ("outlier_fraction", |s| s.outlier_fraction = f64::NAN),
            ("resample_distance", |s| s.resample_distance = -0.1),
            ("resample_angle", |s| s.resample_angle = f64::INFINITY),
            ("likelihood_exponent", |s| s.likelihood_exponent = 0.0),
            ("likelihood_exponent", |s| s.likelihood_exponent = f64::INFINITY),
            ("ess_fraction", |s| s.ess_fraction = -0.5),
            ("ess_fraction", |s| s.ess_fraction = f64::NAN),
        ];
        assert!(FilterSettings::default().check().is_ok());
        for (expected, change) in cases {
            let mut settings = FilterSettings::default();
            change(&mut settings);
            match settings.clone().check() {
                Err(FilterError::Setting { field, .. }) => assert_eq!(field, expected),
                other => panic!("{settings:?}: {other:?}"),
            }
        }
    }

    #[test]
    fn settings_survive_toml() {
        let settings = FilterSettings {
            beams: Beams::Spread(45),
            resampling: Resampling::Residual,
            initial_pose: InitialPose::Uniform {},
            ..FilterSettings::default()
        };
        let adapted = FilterSettings {
            particles: ParticleNumber { least: 100, most: 20_000 },
            initial_pose: InitialPose::scan(),
            recover: Some(Recovery::default()),
            ..FilterSettings::default()
        };
        let short = "particles = \"100..20000\"\ninitial_pose = { kind = \"scan\" }\nrecover = {}";
        assert_eq!(toml::from_str::<FilterSettings>(short).unwrap(), adapted);
        let presets = Preset::ALL.map(Preset::settings);
        for settings in presets.into_iter().chain([settings, adapted]) {
            assert!(settings.clone().check().is_ok(), "{settings:?}");
            let text = toml::to_string(&settings).unwrap();
            assert_eq!(toml::from_str::<FilterSettings>(&text).unwrap(), settings, "{text}");
        }
        assert_eq!(toml::from_str::<FilterSettings>("").unwrap(), FilterSettings::default());
    }

    #[test]
    fn unknown_keys_and_words_are_errors() {
        for text in [
            "particels = 3",
            "beams = \"some\"",
            "beams = -1",
            "resampling = \"wheel\"",
            "initial_pose = { kind = \"uniform\", std_x = 1.0 }",
            "initial_pose = { kind = \"known\", std_x = 1.0, std_y = 1.0, std_theta = 1.0, z = 1 }",
            "alpha = [0.1, 0.1, 0.1]",
            "sigma_hit = \"wide\"",
            "motion = \"table\"",
        ] {
            assert!(toml::from_str::<FilterSettings>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn words_read_back() {
        for kind in Resampling::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        for kind in Proposal::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        for preset in Preset::ALL {
            assert_eq!(preset.to_string().parse(), Ok(preset));
        }
        for kind in MotionKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        for sigma_hit in [SigmaHit::Auto, SigmaHit::Metres(0.25)] {
            assert_eq!(sigma_hit.to_string().parse(), Ok(sigma_hit));
        }
        for beams in [Beams::All, Beams::Spread(7), Beams::Degrees(0.5)] {
            assert_eq!(beams.to_string().parse(), Ok(beams));
        }
        assert!("0".parse::<Beams>().is_err() && "wheel".parse::<Resampling>().is_err());
        assert!("-3deg".parse::<Beams>().is_err() && "deg".parse::<Beams>().is_err());
    }

    #[test]
    fn sigma_hit_follows_the_spacing_of_the_map() {
        assert_eq!(SigmaHit::Metres(0.3).metres(1.0), 0.3);
        assert_eq!(SigmaHit::Auto.metres(0.0), 0.18);
        // 0.18² + (0.55·0.4)²
        assert!((SigmaHit::Auto.metres(0.4) - 0.0808_f64.sqrt()).abs() < 1e-15);
    }

    /// Both parameters for the smallest likelihood of a beam: CARMEN's 0.45 of the peak is close to z_rand = 0.9.
    #[test]
    fn the_floor_of_a_beam_by_hand() {
        assert!((Preset::Carmen.settings().relative_floor(0.3) - 0.45).abs() < 1e-12);
        let mixture = FilterSettings { z_rand: 0.9, ..FilterSettings::default() };
        // 0.9/10 over 0.1/(0.3·2.506628) + 0.9/10.
        let floor = 0.09 / (0.132_980_8 + 0.09);
        assert!((mixture.relative_floor(0.3) - floor).abs() < 1e-6);
        let floored = FilterSettings { beam_floor: Some(floor), ..mixture };
        let [hit, random] = floored.mixture(0.3);
        assert!((hit - 0.132_980_8).abs() < 1e-6 && (random - 0.09).abs() < 1e-6);
        for floor in [0.0, 1.0] {
            let extreme = FilterSettings { beam_floor: Some(floor), ..FilterSettings::default() };
            assert_eq!(extreme.relative_floor(0.3), floor);
        }
    }
}

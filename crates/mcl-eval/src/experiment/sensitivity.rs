use std::collections::BTreeSet;

use anyhow::{Context, Result, bail};
use mcl_filter::{FilterSettings, OdometryNoise, Proposal};
use mcl_maps::FkmSettings;
use serde::{Deserialize, Serialize};

use super::definition::{Definition, check_name, check_percent, check_rows};
use super::{Kind, LocalizationExperiment, MapStrategy, Split, TrajectoryFigure};

/// Settings of a sensitivity study: how the localization error depends on what the paper leaves open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensitivityExperiment {
    /// [`Kind::Sensitivity`].
    pub kind: Kind,
    /// Root of every seed of the experiment.
    pub seed: u64,
    /// Runs per setting, strategy and size, each on a map of its own (run r on map r).
    pub runs: u32,
    /// Gaussian noise added to the odometry, where a sweep does not say otherwise.
    pub odometry_noise: OdometryNoise,
    /// σ of the mixture in metres, for fuzzy k-means.
    pub sigma: f64,
    /// Fuzzy k-means stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// Fuzzy k-means stops after this many updates.
    pub max_iterations: usize,
    /// The particle filter where a sweep does not say otherwise. Its `max_range` is the data set's.
    #[serde(default)]
    pub filter: FilterSettings,
    /// What is varied.
    #[serde(rename = "sweep")]
    pub sweeps: Vec<Sweep>,
    /// The data sets to run on, as far as they are at hand.
    #[serde(rename = "dataset", default)]
    pub datasets: Vec<SensitivityDataset>,
}

/// All combinations of the values listed; a setting without values is not varied.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Names the figure's file: letters, digits and hyphens.
    pub name: String,
    /// The maps that are localized on.
    pub maps: Vec<SweptMap>,
    /// Only on these data sets; on all when empty.
    #[serde(default)]
    pub datasets: Vec<String>,
    /// Runs for this sweep instead of the experiment's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub runs: Option<u32>,
    /// σ_hit (m).
    #[serde(default)]
    pub sigma_hit: Vec<f64>,
    /// z_rand.
    #[serde(default)]
    pub z_rand: Vec<f64>,
    /// α₁…α₄.
    #[serde(default)]
    pub alpha: Vec<[f64; 4]>,
    /// Exponent on the likelihood of a scan.
    #[serde(default)]
    pub likelihood_exponent: Vec<f64>,
    /// Where the noise of a motion is drawn from.
    #[serde(default)]
    pub proposal: Vec<Proposal>,
    /// Noise added to the odometry.
    #[serde(default)]
    pub odometry_noise: Vec<OdometryNoise>,
}

/// A map of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweptMap {
    /// How its points are chosen.
    pub strategy: MapStrategy,
    /// Size in percent of the data set's points.
    pub percent: f64,
}

/// A data set of a sensitivity study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensitivityDataset {
    /// Name in the registry.
    pub name: String,
    /// Only this many scans, from the first: map and runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scans: Option<usize>,
    /// Measured, but without a say in the ranking of the settings: nothing may be tuned to a log that
    /// results are reported on.
    #[serde(default)]
    pub reported_only: bool,
}

/// One combination of the settings that a study varies, flat as in its files: α₁…α₄ and the noise that
/// is added to the odometry (m, rad) are columns of their own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[allow(missing_docs)] // The names are columns, described in docs/results.md.
pub struct Setting {
    pub sigma_hit: f64,
    pub z_rand: f64,
    pub alpha1: f64,
    pub alpha2: f64,
    pub alpha3: f64,
    pub alpha4: f64,
    pub likelihood_exponent: f64,
    pub proposal: Proposal,
    pub noise_xy: f64,
    pub noise_theta: f64,
}

impl Setting {
    pub(super) fn new(
        sigma_hit: f64,
        z_rand: f64,
        [alpha1, alpha2, alpha3, alpha4]: [f64; 4],
        likelihood_exponent: f64,
        proposal: Proposal,
        OdometryNoise { xy: noise_xy, theta: noise_theta }: OdometryNoise,
    ) -> Self {
        Setting {
            sigma_hit,
            z_rand,
            alpha1,
            alpha2,
            alpha3,
            alpha4,
            likelihood_exponent,
            proposal,
            noise_xy,
            noise_theta,
        }
    }

    /// α₁…α₄.
    pub fn alpha(&self) -> [f64; 4] {
        [self.alpha1, self.alpha2, self.alpha3, self.alpha4]
    }

    /// The noise added to the odometry.
    pub fn odometry_noise(&self) -> OdometryNoise {
        OdometryNoise { xy: self.noise_xy, theta: self.noise_theta }
    }

    /// What tells settings apart; floats by their bits, which are in the order of the values, for none
    /// is negative.
    pub fn key(&self) -> SettingKey {
        let [a1, a2, a3, a4] = self.alpha();
        let Setting { sigma_hit, z_rand, likelihood_exponent, noise_xy, noise_theta, .. } = *self;
        let values =
            [sigma_hit, z_rand, a1, a2, a3, a4, likelihood_exponent, noise_xy, noise_theta];
        (values.map(f64::to_bits), self.proposal.name())
    }
}

/// See [`Setting::key`].
pub type SettingKey = ([u64; 9], &'static str);

impl Sweep {
    /// Every combination, in the order listed, the last setting varying fastest.
    pub fn settings(&self, experiment: &SensitivityExperiment) -> Vec<Setting> {
        fn or<T: Copy>(values: &[T], base: T) -> Vec<T> {
            if values.is_empty() { vec![base] } else { values.to_vec() }
        }
        let base = &experiment.filter;
        let mut settings = Vec::new();
        for sigma_hit in or(&self.sigma_hit, base.sigma_hit) {
            for z_rand in or(&self.z_rand, base.z_rand) {
                for alpha in or(&self.alpha, base.alpha) {
                    for exponent in or(&self.likelihood_exponent, base.likelihood_exponent) {
                        for proposal in or(&self.proposal, base.proposal) {
                            for noise in or(&self.odometry_noise, experiment.odometry_noise) {
                                settings.push(Setting::new(
                                    sigma_hit, z_rand, alpha, exponent, proposal, noise,
                                ));
                            }
                        }
                    }
                }
            }
        }
        settings
    }

    /// The number of [`Sweep::settings`], without listing them.
    fn combinations(&self) -> usize {
        [
            self.sigma_hit.len(),
            self.z_rand.len(),
            self.alpha.len(),
            self.likelihood_exponent.len(),
            self.proposal.len(),
            self.odometry_noise.len(),
        ]
        .into_iter()
        .fold(1, |product, length| product.saturating_mul(length.max(1)))
    }

    /// Whether the sweep is made on a data set.
    pub fn covers(&self, dataset: &str) -> bool {
        self.datasets.is_empty() || self.datasets.iter().any(|name| name == dataset)
    }
}

impl SensitivityExperiment {
    /// Settings of fuzzy k-means.
    fn fkm(&self) -> FkmSettings {
        FkmSettings {
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
        }
    }

    /// The data set as listed here, if it is.
    pub fn of_dataset(&self, name: &str) -> Option<&SensitivityDataset> {
        self.datasets.iter().find(|dataset| dataset.name == name)
    }

    /// The filter under a setting.
    fn filter_under(&self, setting: &Setting) -> FilterSettings {
        FilterSettings {
            sigma_hit: setting.sigma_hit,
            z_rand: setting.z_rand,
            alpha: setting.alpha(),
            likelihood_exponent: setting.likelihood_exponent,
            proposal: setting.proposal,
            ..self.filter.clone()
        }
    }

    /// The localization experiment that a setting stands for, with maps of one size.
    pub(super) fn localization(
        &self,
        setting: &Setting,
        runs: u32,
        percent: f64,
    ) -> LocalizationExperiment {
        LocalizationExperiment {
            best: false,
            kind: Kind::Localization,
            seed: self.seed,
            runs,
            maps: runs,
            splits: vec![Split::Same],
            sizes: vec![percent],
            odometry_noise: setting.odometry_noise(),
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
            filter: self.filter_under(setting),
            figures: TrajectoryFigure { trajectory: percent },
            datasets: Vec::new(),
        }
    }
}

impl Definition for SensitivityExperiment {
    fn check(&self) -> Result<()> {
        self.datasets.iter().try_for_each(|dataset| check_name(&dataset.name))?;
        self.fkm().check()?;
        if self.sweeps.is_empty() {
            bail!("no [[sweep]] is listed, expected at least one");
        }
        let mut names = BTreeSet::new();
        for sweep in &self.sweeps {
            let place = format!("sweep {:?}", sweep.name);
            let is_file_name = |c: char| c.is_ascii_alphanumeric() || c == '-';
            if sweep.name.is_empty() || !sweep.name.chars().all(is_file_name) {
                bail!("{place}: the name holds other than letters, digits and hyphens");
            }
            if !names.insert(&sweep.name) {
                bail!("{place} is listed twice");
            }
            if sweep.maps.is_empty() {
                bail!("{place}: maps is empty, expected at least one");
            }
            if sweep.runs.unwrap_or(self.runs) == 0 {
                bail!("{place}: runs is 0, expected at least 1");
            }
            for map in &sweep.maps {
                check_percent(map.percent, &format!("{place}: maps.percent"))?;
            }
            let runs = sweep.runs.unwrap_or(self.runs) as usize;
            check_rows(&[sweep.combinations(), sweep.maps.len(), runs], &place)?;
            for setting in sweep.settings(self) {
                let filter = self.filter_under(&setting);
                filter.check().with_context(|| place.clone())?;
            }
            if let Some(name) =
                sweep.datasets.iter().find(|name| self.of_dataset(name.as_str()).is_none())
            {
                bail!("{place}: data set {name:?} is not listed as a [[dataset]]");
            }
        }
        for dataset in &self.datasets {
            if dataset.scans.is_some_and(|scans| scans < 2) {
                bail!("data set {:?}: scans is below 2", dataset.name);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{Experiment, sensitivity_trials};

    const STUDY: &str = r#"
        kind = "sensitivity"
        seed = 1
        runs = 3
        odometry_noise = { xy = 0.0, theta = 0.0 }
        sigma = 0.05
        tolerance = 1e-4
        max_iterations = 100
        filter = { sigma_hit = 0.3, z_rand = 0.25 }
        [[sweep]]
        name = "sensor"
        maps = [{ strategy = "rnd", percent = 1 }]
        sigma_hit = [0.1, 0.2]
        z_rand = [0.1, 0.5]
        [[sweep]]
        name = "tempering"
        maps = [{ strategy = "rnd", percent = 1 }]
        datasets = ["a"]
        likelihood_exponent = [1, 0.5]
        runs = 2
        [[dataset]]
        name = "a"
        [[dataset]]
        name = "b"
        reported_only = true
    "#;

    fn parse(text: &str) -> Result<SensitivityExperiment> {
        match Experiment::parse(text)? {
            Experiment::Sensitivity(study) => Ok(study),
            _ => bail!("of another kind"),
        }
    }

    #[test]
    fn sweeps_are_products_about_the_base() {
        let study = parse(STUDY).unwrap();
        let sensor: Vec<_> =
            study.sweeps[0].settings(&study).iter().map(|s| (s.sigma_hit, s.z_rand)).collect();
        assert_eq!(sensor, [(0.1, 0.1), (0.1, 0.5), (0.2, 0.1), (0.2, 0.5)]);
        let tempering = study.sweeps[1].settings(&study);
        assert_eq!(tempering.len(), 2);
        assert!(tempering.iter().all(|s| (s.sigma_hit, s.z_rand) == (0.3, 0.25)));
        let rows = |dataset| -> usize {
            sensitivity_trials(&study, dataset).iter().map(|trial| trial.keys().len()).sum()
        };
        assert_eq!(rows("a"), 4 * 3 + 2 * 2);
        assert_eq!(rows("b"), 4 * 3);
        // Run r is on map r: three maps, whatever the sweep.
        assert_eq!(sensitivity_trials(&study, "a").len(), 3);
    }

    #[test]
    fn mistakes_are_named() {
        for (right, wrong, named) in [
            ("[0.1, 0.2]", "[0.1, -0.2]", "sigma_hit"),
            ("\"tempering\"", "\"sensor\"", "twice"),
            ("\"tempering\"", "\"../x\"", "letters"),
            ("datasets = [\"a\"]", "datasets = [\"c\"]", "\"c\""),
            ("runs = 2", "runs = 0", "runs"),
            // Found while writing its fuzz target: the product was listed before it was checked.
            ("runs = 2", "runs = 1000000", "sweep \"tempering\" asks for 2000000 rows"),
            ("percent = 1 }", "percent = 101 }", "percent"),
            ("reported_only", "report_only", "report_only"),
        ] {
            let error = parse(&STUDY.replace(right, wrong)).unwrap_err();
            assert!(format!("{error:#}").contains(named), "{error:#}");
        }
    }
}

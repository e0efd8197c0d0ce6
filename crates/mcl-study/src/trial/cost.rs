//! What a trial will take, before it runs.

use std::collections::HashMap;

use mcl_filter::InitialPose;
use mcl_maps::Refinement;

use crate::data::facts::DataFacts;
use crate::recipe::kind::MapKind;
use crate::recipe::map::Size;
use crate::recipe::run::RunRecipe;
use crate::store::parts::Parts;
use crate::trial::run::Trial;

/// Seconds of processor time that trials will take: measured ones of the same kind of map where there
/// are some, else built-in ones, which are right within a factor of three or so on machines of 2025.
pub struct Costs {
    /// Points of the data.
    points: f64,
    /// Scans of the data.
    scans: f64,
    /// By name of the kind of map: measured seconds over built-in ones.
    measured: HashMap<String, f64>,
}

/// Seconds per point and percent of size of fuzzy k-means.
const FKM: f64 = 5e-7;
/// Seconds per particle and beam of the filter on points.
const BEAM: f64 = 3e-9;
/// Seconds per point of choosing an initial map, and of building distances from a map.
const INITIAL: f64 = 1e-6;
const FIELD: f64 = 3e-6;
/// Seconds of looking for the robot by its first scan.
const SEARCH: f64 = 0.3;

impl Costs {
    /// On this data, as they are built in: the same for every process of a study.
    pub fn built_in(data: &DataFacts) -> Self {
        let (points, scans) = (data.points as f64, data.scans as f64);
        Costs { points, scans, measured: HashMap::new() }
    }

    /// On this data, scaled by what trials of a study took that are done.
    pub fn measured(data: &DataFacts, trials: &[Trial], parts: &Parts) -> Self {
        let costs = Costs::built_in(data);
        let of_names: HashMap<String, &Trial> =
            trials.iter().map(|trial| (trial.to_string(), trial)).collect();
        let mut sums: HashMap<String, [f64; 2]> = HashMap::new();
        for (name, seconds) in &parts.seconds {
            // A trial that was run in parts took less than a whole one: it is no measurement of it.
            let Some(trial) = of_names.get(name) else { continue };
            let sum = sums.entry(trial.map.kind.name.clone()).or_default();
            sum[0] += seconds.iter().map(|(_, seconds)| seconds).sum::<f64>();
            sum[1] += costs.of(trial);
        }
        let ratios = sums.into_iter().filter(|(_, [_, built_in])| *built_in > 0.0);
        let measured =
            ratios.map(|(kind, [seconds, built_in])| (kind, seconds / built_in)).collect();
        Costs { measured, ..costs }
    }

    /// Whether anything was measured.
    pub fn are_measured(&self) -> bool {
        !self.measured.is_empty()
    }

    /// Seconds of a trial.
    pub fn of(&self, trial: &Trial) -> f64 {
        let percent = match trial.map.size {
            Some(Size::Percent(percent)) => percent,
            Some(Size::Points(points)) => 100.0 * points as f64 / self.points,
            // The search tries dozens of maps, most of them small.
            Some(Size::Chosen(_)) => 50.0,
            Some(Size::Resolution(_)) => 0.5,
            None => 100.0,
        };
        let (map, per_beam) = match &trial.map.kind.kind {
            MapKind::All => (0.0, BEAM),
            MapKind::Sampled { refinement, .. } => {
                let fkm = FKM * self.points * (2.0 + 2.0 * percent);
                let refined = match refinement {
                    None => 0.0,
                    Some(Refinement::Fkm {} | Refinement::FkmAccelerated {}) => fkm,
                    Some(Refinement::Restarts { restarts }) => fkm * (1 + restarts) as f64,
                    Some(_) => 2.5 * fkm,
                };
                (INITIAL * self.points + refined, BEAM)
            }
            MapKind::Occupancy => (INITIAL * self.points, 6.0 * BEAM),
            MapKind::Ndt { .. } => (INITIAL * self.points, 12.0 * BEAM),
            MapKind::Segments => (INITIAL * self.points, 12.0 * BEAM),
        };
        let field = match trial.runs.is_empty() {
            true => 0.0,
            false => FIELD * self.points * percent / 100.0,
        };
        let runs: f64 = trial.runs.iter().map(|run| self.of_run(run, per_beam)).sum();
        let factor = self.measured.get(&trial.map.kind.name).copied().unwrap_or(1.0);
        factor * (map + field + runs)
    }

    fn of_run(&self, run: &RunRecipe, per_beam: f64) -> f64 {
        let share = run.length.map_or(1.0, |scans| (scans as f64 / self.scans).min(1.0));
        // Most of a run takes few of the particles that it may take.
        let particles = run.filter.particles;
        let particles = (particles.least as f64 * particles.most as f64).sqrt();
        let search = match run.filter.initial_pose {
            InitialPose::Scan { .. } => SEARCH,
            InitialPose::Known { .. } | InitialPose::Uniform {} => 0.0,
        };
        // Every point of the data is a beam of some scan.
        per_beam * share * self.points * particles + search
    }
}

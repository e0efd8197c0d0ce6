//! `inspect --fit-motion`: the errors of a log's odometry, as settings of the filter.

use anyhow::{Context, Result, bail};
use mcl_core::Seed;
use mcl_core::text::{counted, thousands};
use mcl_filter::FilterSettings;
use mcl_filter::motion::{Fitted, MotionFit, MotionStep};
use mcl_study::data::source::LogSource;
use serde::Serialize;

/// Options are rounded to multiples of these: standard deviations, and variances.
const OF_STD: f64 = 1e-4;
const OF_VARIANCE: f64 = 1e-5;

/// A parameter with its 95 % interval.
#[derive(Serialize)]
struct Parameter {
    value: f64,
    ci95: [f64; 2],
}

impl Parameter {
    fn of(fitted: Fitted, step: f64) -> Self {
        // As a multiple of 1/step, which is an integer: 0.05 stays 0.05.
        let rounded = |value: f64| (value / step).round() / (1.0 / step).round();
        let Fitted { value, low, high } = fitted;
        Parameter { value: rounded(value), ci95: [low, high].map(rounded) }
    }

    fn text(&self) -> String {
        let Parameter { value, ci95: [low, high] } = self;
        format!("{value} ({low} … {high})")
    }
}

/// Both motion models, fitted to a log.
#[derive(Serialize)]
pub struct FittedMotion {
    steps: usize,
    /// Left out: the robot stands still by odometry and reference, or one of them is not known.
    still_steps: usize,
    unknown_steps: usize,
    position_noise: [Parameter; 3],
    heading_noise: [Parameter; 3],
    alpha: [Parameter; 4],
    turning_in_place_m: f64,
    /// Options of `localize`.
    gaussian_options: String,
    book_options: String,
}

impl FittedMotion {
    /// For a log with odometry and a reference; `no_reference` is the advice on how to get one.
    pub fn of(source: &LogSource, no_reference: &str) -> Result<Self> {
        let name = &source.name;
        let scans = &source.recording.scans;
        if scans.iter().all(|scan| scan.map_from_laser.is_none()) {
            bail!("{name}: nothing to compare the odometry with: {no_reference}");
        }
        if scans.iter().all(|scan| scan.odometry.is_none()) {
            bail!(
                "{name}: there is no odometry that a motion model could be fitted to (--odom-topic names \
                 the topic of a bag)"
            );
        }
        let steps = MotionStep::of(&source.recording);
        let turning_in_place = FilterSettings::default().turning_in_place;
        let fit = MotionFit::of(&steps, turning_in_place, Seed::new(1))
            .with_context(|| name.to_owned())?;
        let position_noise = fit.position_noise.map(|part| Parameter::of(part, OF_STD));
        let heading_noise = fit.heading_noise.map(|part| Parameter::of(part, OF_STD));
        let alpha = fit.alpha.map(|part| Parameter::of(part, OF_VARIANCE));
        Ok(FittedMotion {
            steps: fit.steps,
            still_steps: fit.still,
            unknown_steps: scans.len() - 1 - steps.len(),
            gaussian_options: format!(
                "--motion gaussian --position-noise {} --heading-noise {}",
                joined(&position_noise),
                joined(&heading_noise)
            ),
            book_options: format!("--motion book --alpha {}", joined(&alpha)),
            position_noise,
            heading_noise,
            alpha,
            turning_in_place_m: turning_in_place,
        })
    }

    pub fn lines(&self, line: &mut impl FnMut(&str, String)) {
        let noise = |[step, metre, radian]: &[Parameter; 3], unit: &str| {
            let [step, metre, radian] = [step, metre, radian].map(Parameter::text);
            format!("{step} {unit} per step, {metre} {unit} per m, {radian} {unit} per rad")
        };
        line(
            "motion",
            format!(
                "fitted to {} ({} left out as still, {} as unknown) by Student's t; 95 % intervals by a \
                 bootstrap over blocks of time",
                counted(self.steps, "step"),
                thousands(self.still_steps),
                thousands(self.unknown_steps)
            ),
        );
        line("  position", noise(&self.position_noise, "m"));
        line("  heading", noise(&self.heading_noise, "rad"));
        line("  alpha", self.alpha.each_ref().map(Parameter::text).join(", "));
        line("  gaussian", self.gaussian_options.clone());
        line("  book", self.book_options.clone());
    }
}

fn joined(parameters: &[Parameter]) -> String {
    let values: Vec<String> = parameters.iter().map(|part| part.value.to_string()).collect();
    values.join(",")
}

//! `inspect`: the contents of a log, and how the other commands would use it.

mod motion;
mod survey;

use std::collections::BTreeMap;
use std::fmt::Write;

use anyhow::{Result, bail};
use mcl_core::{Bounds, Point, Recording, math};
use mcl_datasets::log::ReadReport;
use mcl_metrics::OdometryError;
use serde::Serialize;

use super::Outcome;
use super::args::InspectArgs;
use super::output::{print, report_data_losses, report_losses};
use crate::progress::error_message;
use mcl_core::text::{counted, printable, thousands};
use mcl_study::data::cloud_source::{CloudSource, Points};
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::trial::tracking::bridge;
use motion::FittedMotion;
use survey::Surveyed;

#[derive(Serialize)]
struct Inspection {
    scans: usize,
    readings: usize,
    points: usize,
    /// Bounds of the points; null without reference poses or usable readings.
    bounds: Option<[f64; 4]>,
    /// Null where fewer than two scans have a stamp.
    duration_s: Option<f64>,
    /// Null without any pose.
    path_length_m: Option<f64>,
    beams_used_per_scan: f64,
    ignored_records: usize,
    /// Ignored records by kind, for a bag by topic.
    ignored: BTreeMap<String, usize>,
    skipped_records: usize,
    backward_stamps: usize,
    /// Whether any scan has a reference pose, and how many do.
    has_reference: bool,
    reference_scans: usize,
    /// Its source, and whose poses it has; null without one.
    reference: Option<String>,
    has_odometry: bool,
    /// Of an odometry increment against the reference; null without either.
    odometry_rmse_m: Option<f64>,
    odometry_rmse_rad: Option<f64>,
    /// Steps on which the odometry points the opposite way, and the length of the reference's path on these.
    odometry_opposed_steps: Option<usize>,
    odometry_opposed_m: Option<f64>,
    /// Steps with unknown odometry, and the longest distance and the largest turn on one of them by the
    /// reference; null without either.
    odometry_unknown_steps: usize,
    odometry_worst_unknown: Option<UnknownStep>,
    /// Settings that other commands would use.
    commands: Commands,
    /// Motion models fitted to the odometry; null unless requested.
    fitted_motion: Option<FittedMotion>,
    /// 2: scans lie in the plane.
    dimensions: usize,
    /// How a bag was read, a line each.
    bag: Vec<String>,
    #[serde(flatten)]
    remarks: Remarks,
    /// Topics of a bag, and what they are used for; null for other logs.
    #[serde(flatten)]
    survey: Option<Surveyed>,
    #[serde(skip)]
    notes: Notes,
}

/// A step of unknown motion, by the reference.
#[derive(Clone, Copy, Serialize)]
struct UnknownStep {
    /// The scan that it leads to.
    scan: usize,
    metres: f64,
    radians: f64,
}

impl UnknownStep {
    /// The worst of the scans without odometry: the largest turn, or else the longest distance.
    fn worst(recording: &Recording) -> Option<Self> {
        let steps = recording.scans.windows(2).enumerate();
        let unknown = steps.filter(|(_, pair)| pair[1].odometry.is_none());
        let step = unknown.filter_map(|(index, pair)| {
            let motion = pair[0].map_from_laser?.between(&pair[1].map_from_laser?);
            let (metres, radians) = (math::hypot(motion.x, motion.y), motion.theta.abs());
            Some(UnknownStep { scan: index + 1, metres, radians })
        });
        step.max_by(|a, b| (a.radians + a.metres).total_cmp(&(b.radians + b.metres)))
    }
}

/// Settings that other commands would use for a log.
#[derive(Serialize)]
struct Commands {
    map: String,
    localize: String,
}

impl Commands {
    fn of(source: &LogSource) -> Self {
        let none = no_reference(source);
        let reference = source.reference.as_deref();
        let localize = match (bridge(source), reference) {
            (Err(error), _) => error_message(&error),
            (Ok(bridge), reference) => {
                let start = match reference.filter(|_| placed(source)) {
                    Some(_) => "from the first reference pose",
                    None => "with --initial-pose or --initial uniform, without errors",
                };
                match bridge.scans.len() {
                    0 => start.to_owned(),
                    unknown => format!(
                        "{start}; {unknown} of {} steps of unknown motion are bridged",
                        bridge.steps
                    ),
                }
            }
        };
        let map = match placed(source) {
            true => reference.map_or(none.to_owned(), |name| format!("by {name}")),
            false => none.to_owned() + &source.reasons("reference"),
        };
        Commands { map, localize }
    }
}

/// Whether any scan has a reference pose.
fn placed(source: &LogSource) -> bool {
    source.recording.scans.iter().any(|scan| scan.map_from_laser.is_some())
}

/// The remark that there is no reference, with advice on how to get one.
fn no_reference(source: &LogSource) -> &'static str {
    match source.survey {
        Some(_) => "no reference (--reference-topic or --reference FILE gives one)",
        None => {
            "no reference (--reference recorded takes the log's poses, --reference FILE those of another file)"
        }
    }
}

/// What was assumed and lost in reading, which the text has on stderr.
#[derive(Serialize)]
struct Remarks {
    assumptions: Vec<String>,
    doubts: Vec<String>,
    /// Why the log ends early; null if it does not.
    truncated: Option<String>,
}

impl Remarks {
    fn of(assumptions: &[String], report: &ReadReport) -> Self {
        Remarks {
            assumptions: assumptions.to_vec(),
            doubts: report.doubts.clone(),
            truncated: report.truncated.clone(),
        }
    }
}

/// Remarks to be read beside the figures.
struct Notes {
    heading: String,
    max_range: f64,
    kind: String,
    unusable_stamps: usize,
    odometry: Option<OdometryError>,
}

pub fn run(args: &InspectArgs) -> Result<Outcome> {
    let name = &args.data.log.log;
    match DataSource::open(name, &args.data.options(), true) {
        Ok(DataSource::Log(log)) => inspect_log(log, args),
        Ok(DataSource::Cloud(_)) if args.fit_motion => {
            bail!("{name}: a point cloud has no odometry that a motion model could be fitted to")
        }
        Ok(DataSource::Cloud(cloud)) => inspect_cloud(cloud, args),
        Err(error) => survey::inspect_unread(error, args),
    }
}

#[derive(Serialize)]
struct CloudInspection {
    dimensions: usize,
    clouds: usize,
    /// Points of the file, usable or not.
    readings: usize,
    points: usize,
    not_finite: usize,
    out_of_range: usize,
    /// The smallest coordinates, then the largest.
    bounds: Vec<f64>,
    ignored_records: usize,
    /// Ignored messages by topic.
    ignored: BTreeMap<String, usize>,
    skipped_records: usize,
    /// How a bag was read, a line each.
    bag: Vec<String>,
    #[serde(flatten)]
    remarks: Remarks,
}

fn inspect_cloud(cloud: CloudSource, args: &InspectArgs) -> Result<Outcome> {
    let points = cloud.points.len();
    let inspection = CloudInspection {
        dimensions: cloud.points.dimensions(),
        clouds: cloud.clouds,
        readings: cloud.readings,
        points,
        not_finite: cloud.not_finite,
        out_of_range: cloud.readings - points - cloud.not_finite,
        bounds: match &cloud.points {
            Points::Planar(points) => bounds_of(points),
            Points::Spatial(points) => bounds_of(points),
        },
        ignored_records: cloud.report.ignored,
        ignored: cloud.report.ignored_kinds.clone(),
        skipped_records: cloud.report.skipped,
        bag: cloud.notes.clone(),
        remarks: Remarks::of(&cloud.assumptions, &cloud.report),
    };
    print(args.json, &inspection, |found| cloud_text(found, &cloud))?;
    Ok(report_data_losses(&args.data.log.log, &DataSource::Cloud(cloud)))
}

fn bounds_of<const D: usize>(points: &[Point<D>]) -> Vec<f64> {
    Bounds::of(points).map_or(Vec::new(), |bounds| [bounds.min, bounds.max].concat())
}

fn cloud_text(found: &CloudInspection, cloud: &CloudSource) -> String {
    let mut text = format!("{}\n", cloud.title);
    let mut line = |name: &str, value: String| {
        writeln!(text, "  {name:<14}{value}").expect("writing to a string does not fail");
    };
    line("kind", format!("{}, {} dimensions", cloud.kind, found.dimensions));
    line("clouds", thousands(found.clouds));
    let range = cloud.max_range.map_or(String::new(), |m| format!(" with 0 < r ≤ {m} m"));
    line("points", format!("{} of {}{range}", thousands(found.points), thousands(found.readings)));
    line(
        "left out",
        format!(
            "{} not finite, {} out of range",
            thousands(found.not_finite),
            thousands(found.out_of_range)
        ),
    );
    let axes = ["x", "y", "z"].iter().zip(&found.bounds).zip(&found.bounds[found.dimensions..]);
    let bounds: Vec<String> =
        axes.map(|((axis, low), high)| format!("{axis} {low:.2} … {high:.2} m")).collect();
    line("bounds", bounds.join(", "));
    for note in &found.bag {
        line("note", printable(note).into_owned());
    }
    text
}

fn inspect_log(whole: LogSource, args: &InspectArgs) -> Result<Outcome> {
    let recording = &whole.recording;
    let scans = recording.scans.len();
    let readings = recording.readings();
    let points: usize = recording.scans.iter().map(|scan| scan.usable_beams(whole.max_range)).sum();
    let stamped = recording.scans.iter().filter(|scan| scan.stamp.is_some()).count();
    let duration_s = (stamped > 1).then(|| recording.duration_s());
    let any_odometry = recording.scans.iter().any(|scan| scan.odometry.is_some());
    // An empty sum is -0.
    let path_length_m =
        (recording.has_reference() || any_odometry).then(|| recording.path_length_m() + 0.0);
    let backward_stamps = recording.backward_stamps();
    let outcome = report_losses(&args.data.log.log, &whole);
    let remarks = Remarks::of(&whole.assumptions, &whole.report);
    // The part of a bag that other commands use.
    let source = whole.covered();
    let covered = &source.recording;
    let placed = || covered.scans.iter().filter_map(|scan| Some((scan, scan.map_from_laser?)));
    let bounds =
        Bounds::around(placed().flat_map(|(scan, pose)| scan.endpoints(pose, source.max_range)));
    let reference_scans = placed().count();
    let odometry = OdometryError::of(covered);
    let unknown = covered.scans.iter().skip(1).filter(|scan| scan.odometry.is_none()).count();
    let fitted_motion = match args.fit_motion {
        true => Some(FittedMotion::of(&source, no_reference(&source))?),
        false => None,
    };
    let inspection = Inspection {
        scans,
        readings,
        points,
        bounds: bounds.map(|Bounds { min, max }| [min[0], min[1], max[0], max[1]]),
        duration_s,
        path_length_m,
        beams_used_per_scan: points as f64 / scans as f64,
        ignored_records: source.report.ignored,
        ignored: source.report.ignored_kinds.clone(),
        skipped_records: source.report.skipped,
        backward_stamps,
        has_reference: reference_scans > 0,
        reference_scans,
        reference: source.reference.clone(),
        has_odometry: covered.has_odometry(),
        odometry_rmse_m: odometry.map(|error| error.translation_rmse),
        odometry_rmse_rad: odometry.map(|error| error.rotation_rmse),
        odometry_opposed_steps: odometry.map(|error| error.opposed_steps),
        odometry_opposed_m: odometry.map(|error| error.opposed_m),
        odometry_unknown_steps: unknown,
        odometry_worst_unknown: UnknownStep::worst(covered),
        commands: Commands::of(&source),
        fitted_motion,
        dimensions: 2,
        remarks,
        survey: source.survey.as_ref().map(Surveyed::of),
        bag: source.notes.clone(),
        notes: Notes {
            heading: source.title.clone(),
            max_range: source.max_range,
            kind: source.kind.map_or("simulation, exact poses".to_owned(), |kind| kind.to_string()),
            unusable_stamps: source.report.unusable_stamps,
            odometry,
        },
    };
    let is_open = inspection.survey.as_ref().is_some_and(Surveyed::is_open);
    print(args.json, &inspection, text)?;
    Ok(if is_open { Outcome::Incomplete } else { outcome })
}

/// A description of the odometry: whether there is any, its errors, and its gaps.
fn odometry(found: &Inspection) -> String {
    let steps = found.scans.saturating_sub(1);
    if found.odometry_unknown_steps >= steps {
        return "no".to_owned();
    }
    let mut text = "yes".to_owned();
    if let Some(error) = found.notes.odometry {
        let (centimetres, degrees) =
            (100.0 * error.translation_rmse, error.rotation_rmse.to_degrees());
        text += &format!(", errs {centimetres:.1} cm and {degrees:.1}° per step (RMS)");
        if error.opposed_steps > 0 {
            text += &format!(
                ", goes the opposite way on {} ({:.2} m)",
                counted(error.opposed_steps, "step"),
                error.opposed_m
            );
        }
    }
    if found.odometry_unknown_steps > 0 {
        text += &format!("; unknown on {} of {steps} steps", found.odometry_unknown_steps);
        if let Some(UnknownStep { scan, metres, radians }) = found.odometry_worst_unknown {
            text += &format!(
                ", at worst {metres:.2} m and {:.0}° (to scan {scan}, by the reference)",
                radians.to_degrees()
            );
        }
    }
    text
}

fn text(found: &Inspection) -> String {
    let mut text = format!("{}\n", found.notes.heading);
    let mut line = |name: &str, value: String| {
        writeln!(text, "  {name:<14}{value}").expect("writing to a string does not fail");
    };
    line("kind", found.notes.kind.clone());
    line("scans", thousands(found.scans));
    line("readings", thousands(found.readings));
    line("points", format!("{} with 0 < r ≤ {} m", thousands(found.points), found.notes.max_range));
    line("beams used", format!("{:.1} per scan", found.beams_used_per_scan));
    if let Some([x_min, y_min, x_max, y_max]) = found.bounds {
        line(
            "bounds",
            format!(
                "x {x_min:.2} … {x_max:.2} m, y {y_min:.2} … {y_max:.2} m ({:.1} m × {:.1} m)",
                x_max - x_min,
                y_max - y_min
            ),
        );
    }
    if let Some(metres) = found.path_length_m {
        line("path", format!("{metres:.1} m"));
    }
    if let Some(seconds) = found.duration_s {
        line("duration", format!("{seconds:.0} s"));
    }
    for note in &found.bag {
        line("note", printable(note).into_owned());
    }
    if let Some(survey) = &found.survey {
        survey.lines(&mut line);
    }
    let reference = match (&found.reference, found.reference_scans) {
        (Some(reference), with) if with < found.scans => {
            format!("{reference}; {with} of {} scans have one", found.scans)
        }
        (Some(reference), _) => reference.clone(),
        (None, _) => "no".to_owned(),
    };
    line("reference", printable(&reference).into_owned());
    line("odometry", odometry(found));
    line(
        "stamps",
        format!(
            "{} step back in time, {} unusable",
            found.backward_stamps, found.notes.unusable_stamps
        ),
    );
    line(
        "records",
        format!(
            "{} of other kinds ignored, {} malformed skipped",
            thousands(found.ignored_records),
            thousands(found.skipped_records)
        ),
    );
    line("map", printable(&found.commands.map).into_owned());
    line("localize", printable(&found.commands.localize).into_owned());
    if let Some(fitted) = &found.fitted_motion {
        fitted.lines(&mut line);
    }
    text
}

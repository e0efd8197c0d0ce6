//! ATE, RPE, association and TUM files give the figures of the Python package evo.
//!
//! `evo/expected.txt` is what `evo/reference.py` printed. To run evo itself, install it into some
//! Python (`pip install evo`), set `MCL_EVO_PYTHON` to that interpreter and run with `-- --ignored` (`make interop` does); with `--nocapture` the
//! test then prints the new text of `expected.txt`.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;
use std::process::Command;

use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_metrics::tum::{self, NonPlanar};
use mcl_metrics::{
    Alignment, DEFAULT_TOLERANCE_S, Delta, PairsFrom, RpeSettings, Summary, associate, ate, rpe,
};

/// A pose every `step_ms` milliseconds from `start_ms` on.
fn sample(
    count: i64,
    start_ms: i64,
    step_ms: i64,
    pose_at_second: impl Fn(f64) -> Pose2,
) -> Trajectory {
    (0..count)
        .map(|i| {
            let milliseconds = 1_000_000_000_000 + start_ms + i * step_ms;
            let seconds = (start_ms + i * step_ms) as f64 / 1e3;
            (Stamp::from_nanoseconds(milliseconds * 1_000_000), pose_at_second(seconds))
        })
        .collect()
}

/// A figure of eight, 20 s a lap, heading through ±π.
fn eight(t: f64) -> Pose2 {
    let phase = TAU * t / 20.0;
    let (vx, vy) = (4.0 * phase.cos(), 4.0 * (2.0 * phase).cos());
    Pose2::new(4.0 * phase.sin(), 2.0 * (2.0 * phase).sin(), vy.atan2(vx))
}

/// The eight with a wobble, a slow drift and a heading that runs away.
fn drifting(t: f64) -> Pose2 {
    let pose = eight(t);
    Pose2::new(
        pose.x + 0.05 * (7.0 * t).sin() + 0.01 * t,
        pose.y + 0.03 * (5.0 * t).cos() - 0.02 * t,
        pose.theta + 0.02 * (3.0 * t).sin() + 0.005 * t,
    )
}

fn straight(t: f64) -> Pose2 {
    Pose2::new(t, 0.0, 0.0)
}

/// Name, reference, estimate.
fn cases() -> Vec<(&'static str, Trajectory, Trajectory)> {
    let moved = |t| Pose2::new(-7.0, 3.0, 2.5).compose(&drifting(t));
    let bent = |t: f64| Pose2::new(t, 0.01 * t * t, 0.02 * t);
    vec![
        // The estimate's stamps are 3 ms off; every pose has a partner.
        ("eight", sample(300, 0, 100, eight), sample(300, 3, 100, drifting)),
        // The estimate begins late, ends late, has 3/4 of the rate and another frame.
        ("moved", sample(400, 0, 75, eight), sample(350, 1500, 100, moved)),
        // Equal steps of 0.1 m: whether ten of them are 1 m is decided by rounding.
        ("straight", sample(100, 0, 100, straight), sample(100, 0, 100, bent)),
    ]
}

/// rmse mean median max min std sse pairs.
type Row = [f64; 8];
type Table = BTreeMap<(String, String), Row>;

fn row(samples: &[f64]) -> Row {
    let s = Summary::of(samples).unwrap();
    [s.rmse, s.mean, s.median, s.max, s.min, s.std, s.sse, s.count as f64]
}

fn our_table() -> Table {
    let mut table = Table::new();
    for (case, reference, estimate) in cases() {
        let matched = associate(&reference, &estimate, DEFAULT_TOLERANCE_S).unwrap();
        let (r, e) = (matched.reference.poses(), matched.estimate.poses());
        let mut add = |metric: &str, translation: &[f64], rotation: &[f64], full: &[f64]| {
            let degrees: Vec<f64> = rotation.iter().map(|angle| angle.to_degrees()).collect();
            for (part, samples) in
                [("translation", translation), ("rotation_deg", &degrees), ("full", full)]
            {
                table.insert((case.to_owned(), format!("{metric}-{part}")), row(samples));
            }
        };
        for (metric, alignment) in [
            ("ape", Alignment::None),
            ("ape-origin", Alignment::Origin),
            ("ape-aligned", Alignment::Rigid),
        ] {
            if case != "straight" || alignment != Alignment::Rigid {
                let errors = ate(r, e, alignment).unwrap();
                add(metric, &errors.translation, &errors.rotation, &errors.full);
            }
        }
        let settings =
            |delta| RpeSettings { pairs_from: PairsFrom::Estimate, ..RpeSettings::new(delta) };
        let (metre, frames) = (settings(Delta::Metres(1.0)), settings(Delta::Frames(5)));
        for (metric, settings) in [
            ("rpe-1m", metre),
            ("rpe-1m-all", RpeSettings { all_pairs: true, ..metre }),
            ("rpe-1m-reference", RpeSettings { pairs_from: PairsFrom::Reference, ..metre }),
            ("rpe-5f", frames),
            ("rpe-5f-all", RpeSettings { all_pairs: true, ..frames }),
        ] {
            let errors = rpe(&matched.reference, &matched.estimate, &settings).unwrap();
            add(metric, &errors.translation, &errors.rotation, &errors.full);
        }
    }
    table
}

fn parse(text: &str) -> Table {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split_whitespace().collect();
            let numbers = fields[2..].iter().map(|field| field.parse().unwrap());
            let numbers: Vec<f64> = numbers.collect();
            ((fields[0].to_owned(), fields[1].to_owned()), numbers.try_into().unwrap())
        })
        .collect()
}

fn assert_equals_evo(evo: &Table) {
    let ours = our_table();
    assert_eq!(ours.keys().collect::<Vec<_>>(), evo.keys().collect::<Vec<_>>());
    for (key, row) in &ours {
        for (ours, evo) in row.iter().zip(evo[key]) {
            // evo computes with 4×4 matrices, and angles in degrees.
            assert!((ours - evo).abs() <= 1e-9 * evo.abs().max(1.0), "{key:?}: {ours}, evo {evo}");
        }
    }
}

#[test]
fn figures_equal_the_recorded_ones_of_evo() {
    let evo = parse(include_str!("evo/expected.txt"));
    assert_eq!(evo.len(), 69);
    assert_equals_evo(&evo);
}

/// evo reads the files that this crate writes.
#[test]
#[ignore = "needs MCL_EVO_PYTHON, a Python with evo; make interop has one"]
fn figures_equal_those_of_an_installed_evo() {
    let python = std::env::var_os("MCL_EVO_PYTHON").expect("MCL_EVO_PYTHON is set");
    let folder = tempfile::tempdir().unwrap();
    for (case, reference, estimate) in cases() {
        for (role, trajectory) in [("reference", reference), ("estimate", estimate)] {
            let path = folder.path().join(format!("{case}.{role}.tum"));
            tum::write_file(&path, &trajectory).unwrap();
            let back = tum::read_file(&path, NonPlanar::Refuse).unwrap();
            assert_eq!(back.trajectory.stamps(), trajectory.stamps());
        }
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/evo/reference.py");
    let output = Command::new(python).arg(script).arg(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{text}");
    assert_equals_evo(&parse(&text));
}

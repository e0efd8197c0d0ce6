//! ATE, RPE, association and TUM files agree with the Python package evo.
//!
//! `evo/expected.txt` is the output of `evo/reference.py`. To run evo itself, install it into some
//! Python (`pip install evo`), set `MCL_EVO_PYTHON` to that interpreter and run with `-- --ignored` (`make interop` does); with `--nocapture` the
//! test then prints the new text of `expected.txt`.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;
use std::process::Command;

use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_metrics::tum::{self, NonPlanar};
use mcl_metrics::{
    Alignment, DEFAULT_TOLERANCE_S, Delta, Matched, MetricsError, PairsFrom, RpeSettings, Summary,
    associate, ate, interpolate, rpe,
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

/// A figure of eight, 20 s per lap, with headings through ±π.
fn eight(t: f64) -> Pose2 {
    let phase = TAU * t / 20.0;
    let (vx, vy) = (4.0 * phase.cos(), 4.0 * (2.0 * phase).cos());
    Pose2::new(4.0 * phase.sin(), 2.0 * (2.0 * phase).sin(), vy.atan2(vx))
}

/// The figure of eight with a wobble, a slow drift and a drifting heading.
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

/// A pose every `step` 512ths of a second, which are exact in floats and nanoseconds.
fn dyadic(count: i64, start: i64, step: i64, pose_at_second: impl Fn(f64) -> Pose2) -> Trajectory {
    (0..count)
        .map(|i| {
            let units = start + i * step;
            (
                Stamp::from_nanoseconds(units * (1_000_000_000 / 512)),
                pose_at_second(units as f64 / 512.0),
            )
        })
        .collect()
}

/// Name, reference, estimate. Those whose name begins with "between" are interpolated only.
fn cases() -> Vec<(&'static str, Trajectory, Trajectory)> {
    let moved = |t| Pose2::new(-7.0, 3.0, 2.5).compose(&drifting(t));
    let bent = |t: f64| Pose2::new(t, 0.01 * t * t, 0.02 * t);
    vec![
        // The estimate's stamps are 3 ms off; every pose has a partner.
        ("eight", sample(300, 0, 100, eight), sample(300, 3, 100, drifting)),
        // The estimate starts late, ends late, has 3/4 of the rate and another frame.
        ("moved", sample(400, 0, 75, eight), sample(350, 1500, 100, moved)),
        // Equal steps of 0.1 m: whether ten of them are 1 m depends on rounding.
        ("straight", sample(100, 0, 100, straight), sample(100, 0, 100, bent)),
        // The estimate is sparser, and half a period off.
        ("between", dyadic(700, 0, 32, eight), dyadic(340, 16, 64, drifting)),
        // The reference is sparser, so the estimate is interpolated.
        ("between-sparse", dyadic(200, 48, 96, eight), dyadic(900, 0, 24, drifting)),
        // Sparser as well, and two poses lie beyond the last one of the reference.
        ("between-beyond", dyadic(699, 0, 32, eight), dyadic(351, 16, 64, drifting)),
    ]
}

/// rmse mean median max min std sse pairs.
type Row = [f64; 8];
type Table = BTreeMap<(String, String), Row>;

fn row(samples: &[f64]) -> Row {
    let s = Summary::of(samples).unwrap();
    [s.rmse, s.mean, s.median, s.max, s.min, s.std, s.sse, s.count as f64]
}

/// The statistics of matched poses, as computed by reference.py.
fn add_rows(table: &mut Table, case: &str, matched: &Matched) {
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
    for (name, delta) in [
        ("1m", Delta::Metres(1.0)),
        ("5f", Delta::Frames(5)),
        ("0.3rad", Delta::Radians(0.3)),
        ("25deg", Delta::Radians(25.0_f64.to_radians())),
    ] {
        for all_pairs in [false, true] {
            for pairs_from in [PairsFrom::Estimate, PairsFrom::Reference] {
                let settings = RpeSettings { all_pairs, pairs_from, ..RpeSettings::new(delta) };
                let all = if all_pairs { "-all" } else { "" };
                let from = if pairs_from == PairsFrom::Reference { "-reference" } else { "" };
                match rpe(&matched.reference, &matched.estimate, &settings) {
                    Ok(errors) => add(
                        &format!("rpe-{name}{all}{from}"),
                        &errors.translation,
                        &errors.rotation,
                        &errors.full,
                    ),
                    // evo has none either, or its table has an additional row.
                    Err(MetricsError::NoPairs { .. }) => {}
                    Err(error) => panic!("{case}: {error}"),
                }
            }
        }
    }
}

fn table_of(cases: &[(String, Trajectory, Trajectory)]) -> Table {
    let mut table = Table::new();
    for (case, reference, estimate) in cases {
        if !case.starts_with("between") {
            let matched = associate(reference, estimate, DEFAULT_TOLERANCE_S).unwrap();
            add_rows(&mut table, case, &matched);
        }
        // The reference of freiburg2 has gaps. evo interpolates over a gap of any length if one of its ends is
        // within the tolerance; here the length of the gap counts.
        if case != "freiburg2"
            && reference.stamps()[0] < Stamp::from_nanoseconds(1_000_000_000_000_000)
        {
            let matched = interpolate(reference, estimate, None).unwrap();
            add_rows(&mut table, &format!("{case}-interpolated"), &matched);
        }
    }
    table
}

fn named(cases: Vec<(&str, Trajectory, Trajectory)>) -> Vec<(String, Trajectory, Trajectory)> {
    cases.into_iter().map(|(case, r, e)| (case.to_owned(), r, e)).collect()
}

fn parse(text: &str) -> Table {
    // evo overwrites its progress in one line, with carriage returns.
    let lines = text.lines().map(|line| line.rsplit('\r').next().unwrap_or(line));
    let lines = lines.filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split_whitespace().collect();
            let numbers = fields[2..].iter().map(|field| field.parse().unwrap());
            let numbers: Vec<f64> = numbers.collect();
            ((fields[0].to_owned(), fields[1].to_owned()), numbers.try_into().unwrap())
        })
        .collect()
}

fn assert_equal(ours: &Table, evo: &Table) {
    assert_eq!(ours.keys().collect::<Vec<_>>(), evo.keys().collect::<Vec<_>>());
    for (key, row) in ours {
        for (ours, evo) in row.iter().zip(evo[key]) {
            // evo computes with 4×4 matrices, and angles in degrees.
            assert!((ours - evo).abs() <= 1e-9 * evo.abs().max(1.0), "{key:?}: {ours}, evo {evo}");
        }
    }
}

/// Removes the rows whose key has a prefix from a table, and returns them.
fn take(table: &mut Table, is_taken: impl Fn(&(String, String)) -> bool) -> Table {
    let (taken, left) = std::mem::take(table).into_iter().partition(|(key, _)| is_taken(key));
    *table = left;
    taken
}

/// All results equal those of evo with one exception: an estimate that continues after the end of the reference. evo
/// compares each pose within the tolerance of the last reference pose with that pose, as if the robot had
/// stopped there. Here there is no extrapolation, and the results are those without these poses.
fn assert_equals_evo(ours: &mut Table, evo: &mut Table) {
    const BEYOND: &str = "between-beyond-interpolated";
    let [our_beyond, evo_beyond] =
        [&mut *ours, &mut *evo].map(|t| take(t, |(case, _)| case == BEYOND));
    assert_equal(ours, evo);
    let ape = (BEYOND.to_owned(), "ape-translation".to_owned());
    let (our_pairs, evo_pairs) = (our_beyond[&ape][7], evo_beyond[&ape][7]);
    assert_eq!((our_pairs, evo_pairs), (349.0, 350.0));
    assert!(evo_beyond[&ape][0] > our_beyond[&ape][0]);
    let (_, reference, estimate) = cases().pop().unwrap();
    let within = interpolate(&reference, &estimate.iter().take(349).collect(), None).unwrap();
    let mut expected = Table::new();
    add_rows(&mut expected, BEYOND, &within);
    assert_eq!(our_beyond, expected);
}

#[test]
fn figures_equal_the_recorded_ones_of_evo() {
    let mut evo = parse(include_str!("evo/expected.txt"));
    assert_eq!(evo.len(), 315);
    // Of 19 combinations of options with three figures each; three cases are matched by the nearest stamp.
    let combinations = |case: &str| evo.keys().filter(|(of, _)| of == case).count();
    assert_eq!((combinations("eight"), combinations("between-interpolated")), (57, 57));
    assert_equals_evo(&mut table_of(&named(cases())), &mut evo);
}

/// evo reads the files that this crate writes, and this crate reads evo's test data, projected to the plane, if
/// MCL_EVO_DATA gives their folder.
#[test]
#[ignore = "needs MCL_EVO_PYTHON, a Python with evo; make interop has one"]
fn figures_equal_those_of_an_installed_evo() {
    let python = std::env::var_os("MCL_EVO_PYTHON").expect("MCL_EVO_PYTHON is set");
    let folder = tempfile::tempdir().unwrap();
    let path = |case: &str, role: &str| folder.path().join(format!("{case}.{role}.tum"));
    let mut cases = named(cases());
    for (case, reference, estimate) in &cases {
        for (role, trajectory) in [("reference", reference), ("estimate", estimate)] {
            tum::write_file(path(case, role), trajectory).unwrap();
            let back = tum::read_file(path(case, role), NonPlanar::Refuse).unwrap();
            assert_eq!(back.trajectory.stamps(), trajectory.stamps());
        }
    }
    let data = std::env::var_os("MCL_EVO_DATA");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/evo/reference.py");
    let output = Command::new(python).arg(script).arg(folder.path()).args(&data).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    println!("{text}");
    if data.is_some() {
        for case in ["freiburg1", "freiburg2", "vicon"] {
            let read =
                |role| tum::read_file(path(case, role), NonPlanar::Refuse).unwrap().trajectory;
            cases.push((case.to_owned(), read("reference"), read("estimate")));
        }
    }
    let (mut ours, mut evo) = (table_of(&cases), parse(&text));
    // evo aligns in 3-D, where a planar trajectory may be flipped over if that fits its positions better, as for
    // freiburg2, whose poses are then all upside down. A planar robot cannot be.
    let is_turned_over = |(case, metric): &(String, String)| {
        case.starts_with("freiburg2") && metric.starts_with("ape-aligned")
    };
    let [in_the_plane, turned_over] = [&mut ours, &mut evo].map(|t| take(t, is_turned_over));
    for (key, [evo_rmse, .., evo_least, _, _, _]) in &turned_over {
        match key.1.as_str() {
            "ape-aligned-rotation_deg" => assert!(*evo_least > 179.9, "{evo_least}"),
            "ape-aligned-translation" => assert!(*evo_rmse < in_the_plane[key][0]),
            _ => {}
        }
    }
    assert_eq!(turned_over.len(), if data.is_some() { 3 } else { 0 });
    assert_equals_evo(&mut ours, &mut evo);
}

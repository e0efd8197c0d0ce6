//! Errors of an estimated trajectory: `cargo run --example compare_trajectories -- truth.tum estimate.tum`. Without
//! arguments it compares two made ones.

use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_metrics::trajectory_file::{ReadSettings, read_file};
use mcl_metrics::{
    Alignment, DEFAULT_TOLERANCE_S, Summary, WeightedPoseError, associate, ate, pose_errors,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (reference, estimate) = match &arguments[..] {
        [reference, estimate] => {
            let read = |path| read_file(path, &ReadSettings::default()).map(|file| file.trajectory);
            (read(reference)?, read(estimate)?)
        }
        [] => (made(0.0), made(0.1)),
        _ => return Err("expected two files of trajectories".into()),
    };
    let matched = associate(&reference, &estimate, DEFAULT_TOLERANCE_S)?;
    let (truth, found) = (matched.reference.poses(), matched.estimate.poses());
    let metric = WeightedPoseError::default();
    let weighted: Vec<f64> =
        pose_errors(truth, found)?.iter().map(|error| metric.of(error)).collect();
    let weighted = Summary::of(&weighted)?;
    println!("{} pairs, d: mean {:.4}, largest {:.4}", truth.len(), weighted.mean, weighted.max);
    for alignment in [Alignment::None, Alignment::Rigid] {
        let errors = Summary::of(&ate(truth, found, alignment)?.translation)?;
        println!("ATE ({alignment:?}): rmse {:.4} m", errors.rmse);
    }
    Ok(())
}

/// A circle of 5 m, driven with an error that grows.
fn made(error: f64) -> Trajectory {
    let pose = |i: i64| {
        let turned = 0.05 * i as f64;
        let radius = 5.0 + error * turned;
        Pose2::new(radius * turned.cos(), radius * turned.sin(), turned)
    };
    (0..100).map(|i| (Stamp::from_nanoseconds(i * 100_000_000), pose(i))).collect()
}

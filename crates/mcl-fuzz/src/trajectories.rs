//! Trajectory files.

use mcl_core::wrap_angle;
use mcl_metrics::trajectory_file::{self, QuaternionOrder, ReadSettings, TrajectoryFormat};
use mcl_metrics::tum::{self, NonPlanar};

use crate::memory::{ANY_INPUT, bounded};

/// A TUM file: what is read is written and read back.
pub fn tum(bytes: &[u8]) {
    let read = |non_planar| {
        bounded(bytes.len(), ANY_INPUT, 32, || tum::read(bytes, "fuzzed.tum", non_planar))
    };
    let (strict, projected) = (read(NonPlanar::Refuse), read(NonPlanar::Project));
    if let Ok(strict) = &strict {
        // Projecting changes nothing about poses that are planar.
        assert_eq!(strict, projected.as_ref().expect("planar poses can be projected"));
    }
    let file = match projected {
        Ok(file) => file,
        Err(error) => {
            assert!(error.to_string().starts_with("fuzzed.tum"), "{error}");
            return;
        }
    };
    let trajectory = file.trajectory;
    assert!(!trajectory.is_empty());
    let mut written = Vec::new();
    tum::write(&mut written, &trajectory).expect("what was read can be written");
    let again = tum::read(written.as_slice(), "written.tum", NonPlanar::Refuse)
        .expect("what was written can be read");
    assert_eq!(again.backward_stamps, file.backward_stamps);
    assert_eq!(again.trajectory.stamps(), trajectory.stamps());
    for (found, expected) in again.trajectory.poses().iter().zip(trajectory.poses()) {
        assert!(expected.is_finite());
        assert_eq!(
            (found.x.to_bits(), found.y.to_bits()),
            (expected.x.to_bits(), expected.y.to_bits())
        );
        let turn = wrap_angle(found.theta - expected.theta).abs();
        assert!(turn <= 1e-15, "{} became {}", expected.theta, found.theta);
    }
}

/// A trajectory file of any format, with every setting.
pub fn any_format(bytes: &[u8]) {
    let read = |settings| {
        bounded(bytes.len(), ANY_INPUT, 64, || trajectory_file::read(bytes, "fuzzed", &settings))
    };
    for order in [QuaternionOrder::Xyzw, QuaternionOrder::Wxyz] {
        let strict = read(ReadSettings { non_planar: NonPlanar::Refuse, order });
        let projected = read(ReadSettings { non_planar: NonPlanar::Project, order });
        if let Ok(strict) = &strict {
            assert_eq!(strict, projected.as_ref().expect("planar poses can be projected"));
        }
        let file = match projected {
            Ok(file) => file,
            Err(error) => {
                let message = error.to_string();
                assert!(message.starts_with("fuzzed") && message.len() < 4000, "{message}");
                continue;
            }
        };
        let poses = file.trajectory.poses();
        assert!(!poses.is_empty() && poses.iter().all(|pose| pose.is_finite()));
        assert!(file.has_headings || poses.iter().all(|pose| pose.theta == 0.0));
        assert!(file.backward_stamps + file.repeated_stamps < poses.len());
        if file.format == TrajectoryFormat::Tum
            && file.has_headings
            && order == QuaternionOrder::Xyzw
        {
            let tum = tum::read(bytes, "fuzzed", NonPlanar::Project).expect("it is a TUM file");
            assert_eq!(tum.trajectory, file.trajectory);
        }
    }
}

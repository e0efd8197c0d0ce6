//! Trajectory files.

use mcl_core::wrap_angle;
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

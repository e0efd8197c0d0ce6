//! Checks whether poses in space are those of a robot in the plane.

/// A driving robot is tilted by less than this (degrees), except for a part of its way.
const TILT_DEGREES: f64 = 10.0;
const TILTED_PART: f64 = 0.1;
/// Its heights vary by less than this, in metres and as a part of the distance driven.
const HEIGHTS: (f64, f64) = (0.5, 0.25);

/// A pose in space, reduced to what matters here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseInSpace {
    /// x, y and z in metres.
    pub position: [f64; 3],
    /// Angle between its z axis and that of the parent frame.
    pub tilt_degrees: f64,
}

/// The remark on poses that are projected into the plane although they do not lie in it: they are tilted, or
/// their heights vary as only horizontal positions do. Most often another axis of their frame points upwards.
pub fn out_of_plane(poses: impl Iterator<Item = PoseInSpace>) -> Option<String> {
    let (mut count, mut tilted, mut worst) = (0_usize, 0_usize, 0.0_f64);
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for PoseInSpace { position, tilt_degrees } in poses {
        count += 1;
        tilted += usize::from(tilt_degrees > TILT_DEGREES);
        worst = worst.max(tilt_degrees);
        for axis in 0..3 {
            low[axis] = low[axis].min(position[axis]);
            high[axis] = high[axis].max(position[axis]);
        }
    }
    let [x, y, z] = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let is_tilted = tilted as f64 > TILTED_PART * count as f64;
    let varies = z > HEIGHTS.0 && z > HEIGHTS.1 * x.max(y);
    (is_tilted || varies).then(|| {
        format!(
            "{tilted} of {count} poses are tilted by more than {TILT_DEGREES}° (by up to {worst:.0}°), and heights vary by {z:.2} m while x varies by {x:.2} m and y by {y:.2} m, expected poses of a robot in the plane: does an axis other than z point upwards?"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramps_are_not_another_axis() {
        let poses = |tilt_degrees: f64, rise: f64| {
            let at = move |k: usize| PoseInSpace {
                position: [0.1 * k as f64, 0.0, rise * k as f64],
                tilt_degrees,
            };
            out_of_plane((0..100).map(at))
        };
        assert_eq!((poses(0.5, 0.0), poses(6.0, 0.01)), (None, None));
        assert!(poses(15.0, 0.0).unwrap().contains("100 of 100 poses are tilted"));
        assert!(poses(0.0, 0.05).unwrap().contains("heights vary by 4.95 m"));
        assert_eq!(out_of_plane([].into_iter()), None);
    }
}

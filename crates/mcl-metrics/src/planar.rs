//! Conversion of 3-D poses to planar poses.

use std::f64::consts::FRAC_PI_2;

use mcl_core::{math, wrap_angle};

/// Largest height above or below the plane of a planar pose, in metres.
pub const MAX_Z: f64 = 1e-3;

/// Largest tilt of the vertical axis of a planar pose (roll and pitch together), in radians.
pub const MAX_TILT: f64 = 1e-3;

/// How to treat poses that are not in the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NonPlanar {
    /// As an error with the pose.
    #[default]
    Refuse,
    /// Drop height, roll and pitch; the heading is the yaw of the Z-Y-X Euler angles, the
    /// direction of the body's x axis seen from above. Poses tilted by more than 90° are errors.
    Project,
}

/// The order of the four numbers of a quaternion in a TUM file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum QuaternionOrder {
    /// `qx qy qz qw`, as the format specifies.
    #[default]
    Xyzw,
    /// `qw qx qy qz`, as some programs write.
    Wxyz,
}

/// Settings for reading trajectory files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadSettings {
    /// How to treat poses that are not in the plane.
    pub non_planar: NonPlanar,
    /// The order of quaternions in files without column names (TUM files).
    pub order: QuaternionOrder,
}

/// The reason why a pose is not planar.
pub(crate) struct Refused {
    /// Whether the height is the reason; otherwise it is the rotation.
    pub is_height: bool,
    pub found: String,
    pub expected: String,
}

impl Refused {
    fn rotation(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Refused { is_height: false, found: found.into(), expected: expected.into() }
    }
}

/// Yaw of the Z-Y-X Euler angles of a rotation, and the angle between the body's z axis and the map's.
#[derive(Clone, Copy)]
pub(crate) struct Attitude {
    yaw: f64,
    tilt: f64,
}

impl Attitude {
    /// From a quaternion x, y, z, w, which need not be normalized.
    pub fn of_quaternion(quaternion: [f64; 4]) -> Result<Self, Refused> {
        let largest = quaternion.iter().fold(0.0, |largest: f64, q| largest.max(q.abs()));
        if largest == 0.0 {
            return Err(Refused::rotation("0 0 0 0", "a quaternion that can be normalized"));
        }
        let [x, y, z, w] = quaternion.map(|q| q / largest);
        let tilt = 2.0 * math::atan2(math::hypot(x, y), math::hypot(z, w));
        // In units of |q|² ≥ 1.
        Attitude::new([w * w + x * x - y * y - z * z, 2.0 * (w * z + x * y)], tilt)
    }

    /// From a rotation matrix, row by row.
    pub fn of_matrix([x, y, z]: [[f64; 3]; 3]) -> Result<Self, Refused> {
        let axis = |column: usize| math::hypot(math::hypot(x[column], y[column]), z[column]) - 1.0;
        if !(0..3).all(|column| axis(column).abs() < 0.01) {
            return Err(Refused::rotation(
                "a matrix that is not a rotation",
                "columns of length 1",
            ));
        }
        Attitude::new([x[0], y[0]], math::atan2(math::hypot(x[2], y[2]), z[2]))
    }

    /// From the body's x axis seen from above.
    fn new([cos, sin]: [f64; 2], tilt: f64) -> Result<Self, Refused> {
        // Too short to have a direction.
        if math::hypot(sin, cos) < 1e-9 {
            let expected = "an x axis that is not vertical: this one has no heading";
            return Err(Refused::rotation("a pitch of ±90°", expected));
        }
        Ok(Attitude { yaw: wrap_angle(math::atan2(sin, cos)), tilt })
    }

    /// Whether the body stands upright.
    pub fn is_upright(&self) -> bool {
        self.tilt <= MAX_TILT
    }

    /// The heading of a planar pose, wrapped; `advice` is added to the error if the rotation is refused.
    pub fn heading(&self, non_planar: NonPlanar, advice: Option<&str>) -> Result<f64, Refused> {
        let largest = match non_planar {
            NonPlanar::Refuse => MAX_TILT,
            NonPlanar::Project => FRAC_PI_2,
        };
        if self.tilt <= largest {
            return Ok(self.yaw);
        }
        let upside_down = if self.tilt > 1.5 * FRAC_PI_2 { ", nearly upside down" } else { "" };
        let found = format!("a tilt of {:.4} rad{upside_down}", self.tilt);
        let expected = match non_planar {
            NonPlanar::Refuse => format!("roll and pitch within {MAX_TILT} rad of 0"),
            NonPlanar::Project => "less than 90° to be projected".to_owned(),
        };
        let expected = match advice {
            Some(advice) => format!("{expected}; {advice}"),
            None if self.tilt <= FRAC_PI_2 => format!("{expected}; {PROJECT}"),
            None => expected,
        };
        Err(Refused::rotation(found, expected))
    }
}

const PROJECT: &str = "project the poses onto the plane if that is meant";

/// Checks the height of a pose.
pub(crate) fn check_height(z: f64, non_planar: NonPlanar) -> Result<(), Refused> {
    if non_planar == NonPlanar::Project || z.abs() <= MAX_Z {
        return Ok(());
    }
    let expected = format!("a height within {MAX_Z} m of 0; {PROJECT}");
    Err(Refused { is_height: true, found: format!("{z} m"), expected })
}

/// The heading of a 3-D pose, given the four numbers of its quaternion in file order.
pub(crate) fn heading(written: [f64; 4], settings: &ReadSettings) -> Result<f64, Refused> {
    let from_wxyz = |[w, x, y, z]: [f64; 4]| [x, y, z, w];
    if settings.order == QuaternionOrder::Wxyz {
        let attitude = Attitude::of_quaternion(from_wxyz(written))?;
        return attitude.heading(settings.non_planar, None);
    }
    let is_upright_as_wxyz =
        Attitude::of_quaternion(from_wxyz(written)).is_ok_and(|attitude| attitude.is_upright());
    let advice = is_upright_as_wxyz.then_some("are the quaternions in the order qw qx qy qz?");
    Attitude::of_quaternion(written)?.heading(settings.non_planar, advice)
}

/// Quotes the start of a text, because a broken file can have very long fields.
pub(crate) fn quoted(text: &str) -> String {
    let start: String = text.chars().take(40).collect();
    if start.len() < text.len() { format!("{start:?}…") } else { format!("{start:?}") }
}

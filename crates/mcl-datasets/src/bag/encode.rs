//! Encodes messages as plain little-endian CDR, field by field.

use mcl_core::{Pose2, Stamp, math};

/// A message being encoded. Fields are written in the order of its description.
#[derive(Debug, Clone)]
pub struct Encoder {
    bytes: Vec<u8>,
}

/// The encapsulation header before the message; alignment counts from its end.
const HEAD: [u8; 4] = [0, 1, 0, 0];

impl Default for Encoder {
    fn default() -> Self {
        Encoder { bytes: HEAD.to_vec() }
    }
}

impl Encoder {
    /// The encoded message.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn aligned<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        let length = (self.bytes.len() - HEAD.len()).next_multiple_of(N) + HEAD.len();
        self.bytes.resize(length, 0);
        self.bytes.extend(bytes);
        self
    }

    /// Raw bytes: the elements of a `uint8[]` after its length.
    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.bytes.extend(bytes);
        self
    }

    /// A `uint8` or a `bool` (0 or 1).
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.bytes(&[value])
    }

    /// A `uint32`, also the length of an array.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.aligned(value.to_le_bytes())
    }

    /// A `float32`.
    pub fn f32(&mut self, value: f32) -> &mut Self {
        self.aligned(value.to_le_bytes())
    }

    /// `float64`s in sequence, without a length.
    pub fn f64s(&mut self, values: &[f64]) -> &mut Self {
        for value in values {
            self.aligned(value.to_le_bytes());
        }
        self
    }

    /// A `string`.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
        self
    }

    /// A `std_msgs/Header`. Times are 32-bit seconds: a larger stamp is truncated, so check before.
    pub fn header(&mut self, stamp: Stamp, frame: &str) -> &mut Self {
        const NANOSECONDS: i64 = 1_000_000_000;
        let sec = stamp.nanoseconds().div_euclid(NANOSECONDS) as i32;
        let nanosec = stamp.nanoseconds().rem_euclid(NANOSECONDS) as u32;
        self.aligned(sec.to_le_bytes()).u32(nanosec).text(frame)
    }

    /// A planar pose or transform: x, y and z, then the quaternion of the heading.
    pub fn pose(&mut self, pose: Pose2) -> &mut Self {
        let (sin, cos) = math::sin_cos(0.5 * pose.theta);
        self.f64s(&[pose.x, pose.y, 0.0, 0.0, 0.0, sin, cos])
    }
}

//! `sensor_msgs/PointCloud2` as points.

use mcl_core::{Point, math};

use super::cdr::View;
use super::messages::{Header, MessageError, header, malformed};

/// Type codes of `sensor_msgs/PointField` supported for coordinates.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;
/// Names of the type codes, from 1.
const TYPES: [&str; 8] =
    ["INT8", "UINT8", "INT16", "UINT16", "INT32", "UINT32", "FLOAT32", "FLOAT64"];
const AXES: [&str; 3] = ["x", "y", "z"];

/// The measured points of a `sensor_msgs/PointCloud2`, in its own frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CloudMessage {
    pub header: Header,
    /// In metres, row by row.
    pub points: Vec<Point<3>>,
    /// Points with a coordinate that is NaN or infinite, where nothing was detected. Drivers write them into
    /// clouds marked as dense, too.
    pub not_finite: usize,
    /// Points at the origin, where the scanner itself is, or beyond the largest range.
    pub out_of_range: usize,
}

/// Offset and type of a coordinate within a point.
#[derive(Debug, Clone, Copy)]
struct Coordinate {
    offset: usize,
    width: usize,
}

impl CloudMessage {
    /// Converts a message. With a largest range (m), only points with `0 < r ≤ max_range` from the origin of
    /// the cloud's frame are taken.
    pub fn new(view: &View<'_>, max_range: Option<f64>) -> Result<Self, MessageError> {
        let header = header(view)?;
        let size = |name: &str| view.number(name).map(|value| value as u64);
        let (height, width) = (size("height")?, size("width")?);
        let (point_step, row_step) = (size("point_step")?, size("row_step")?);
        let is_big_endian = view.number("is_bigendian")? != 0.0;
        let data = view.bytes("data")?;
        let coordinates = coordinates(view, point_step)?;
        // All are 32-bit numbers, so no product overflows.
        if row_step < width * point_step {
            return Err(malformed(
                "row_step",
                row_step.to_string(),
                format!("at least {width} points of {point_step} bytes"),
            ));
        }
        if (data.len() as u64) < height * row_step {
            return Err(malformed(
                "data",
                format!("{} bytes long", data.len()),
                format!("at least {height} rows of {row_step} bytes"),
            ));
        }
        let mut cloud = CloudMessage { header, points: Vec::new(), not_finite: 0, out_of_range: 0 };
        // An empty row or point has no length to split data by; without points there is nothing to split.
        if height == 0 || width == 0 {
            return Ok(cloud);
        }
        let rows = data.chunks_exact(row_step as usize).take(height as usize);
        let points =
            rows.flat_map(|row| row.chunks_exact(point_step as usize).take(width as usize));
        for point in points {
            cloud.push(coordinates.map(|axis| axis.of(point, is_big_endian)), max_range);
        }
        Ok(cloud)
    }

    fn push(&mut self, point: Point<3>, max_range: Option<f64>) {
        if !point.iter().all(|coordinate| coordinate.is_finite()) {
            self.not_finite += 1;
        } else if max_range.is_some_and(|max_range| !is_in_range(&point, max_range)) {
            self.out_of_range += 1;
        } else {
            self.points.push(point);
        }
    }
}

/// Whether a point is a measurement of a scanner at the origin: `0 < r ≤ max_range` (m).
pub fn is_in_range(point: &Point<3>, max_range: f64) -> bool {
    let range = math::hypot(math::hypot(point[0], point[1]), point[2]);
    range > 0.0 && range <= max_range
}

impl Coordinate {
    /// Its value from the bytes of a point, which are long enough.
    fn of(self, point: &[u8], is_big_endian: bool) -> f64 {
        let mut wide = [0; 8];
        wide[..self.width].copy_from_slice(&point[self.offset..self.offset + self.width]);
        if is_big_endian {
            wide[..self.width].reverse();
        }
        let bits = u64::from_le_bytes(wide);
        match self.width {
            4 => f64::from(f32::from_bits(bits as u32)),
            _ => f64::from_bits(bits),
        }
    }
}

/// Finds x, y and z among the fields, and checks that they lie within a point of `point_step` bytes.
fn coordinates(view: &View<'_>, point_step: u64) -> Result<[Coordinate; 3], MessageError> {
    let fields = view.messages("fields")?;
    let mut found: [Option<Coordinate>; 3] = [None; 3];
    for field in &fields {
        let name = field.text("name")?;
        let Some(axis) = AXES.iter().position(|axis| *axis == name) else { continue };
        let place = |part: &str| format!("fields[{name}].{part}");
        if found[axis].is_some() {
            return Err(malformed("fields", format!("two named {name:?}"), "one of each name"));
        }
        let width = match field.number("datatype")? as u8 {
            FLOAT32 => 4,
            FLOAT64 => 8,
            other => {
                let known = usize::from(other).checked_sub(1).and_then(|index| TYPES.get(index));
                let type_name = known.map_or("no type known".to_owned(), |name| (*name).to_owned());
                return Err(malformed(
                    &place("datatype"),
                    format!("{other} ({type_name})"),
                    "7 (FLOAT32) or 8 (FLOAT64)",
                ));
            }
        };
        let count = field.number("count")?;
        if count != 1.0 {
            return Err(malformed(&place("count"), count.to_string(), "1"));
        }
        let offset = field.number("offset")? as u64;
        if offset + width > point_step {
            return Err(malformed(
                &place("offset"),
                format!("{offset}, for {width} bytes"),
                format!("to end within the {point_step} bytes of a point"),
            ));
        }
        found[axis] = Some(Coordinate { offset: offset as usize, width: width as usize });
    }
    let names = || {
        let names = fields.iter().take(20).map(|field| field.text("name").unwrap_or_default());
        format!("[{}]", names.collect::<Vec<_>>().join(", "))
    };
    let [Some(x), Some(y), Some(z)] = found else {
        return Err(malformed("fields", names(), "x, y and z among them"));
    };
    // Overlapping coordinates are a mistake, and would let a small message hold a huge number of points.
    let overlap = |a: Coordinate, b: Coordinate| {
        a.offset < b.offset + b.width && b.offset < a.offset + a.width
    };
    if overlap(x, y) || overlap(x, z) || overlap(y, z) {
        let offsets = format!("offsets {}, {} and {}", x.offset, y.offset, z.offset);
        return Err(malformed("fields", offsets, "x, y and z that do not overlap"));
    }
    Ok([x, y, z])
}

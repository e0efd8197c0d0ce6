//! PCD (the Point Cloud Library's format): fields x, y, z.

use std::io::{self, Cursor};

use mcl_core::Point;
use mcl_core::memory::check_room;
use pcd_rs::{DataKind, DynReader, DynRecord, Field, PcdMeta, Schema, ValueKind, WriterInit};

use super::columns::{AXES, Axes, NotFinite, Parsed, with_height};
use super::text_rows::{TextColumn, TextRows};
use super::{Encoding, FilePosition, MapProblem};

/// Bytes of a line of text, unless numbers are unusually small in magnitude.
const USUAL_LINE: usize = 3 * 20;

/// Writes to memory first, because the library's writer panics when it is dropped after a failed write.
pub(super) fn encode<const D: usize>(
    points: &[Point<D>],
    encoding: Encoding,
) -> io::Result<Vec<u8>> {
    let room = match encoding {
        Encoding::Binary => size_of::<[f64; 3]>(),
        Encoding::Ascii => USUAL_LINE,
    };
    check_room(points.len(), room, "points of a PCD file").map_err(io::Error::other)?;
    let mut bytes = Vec::new();
    let init = WriterInit {
        width: points.len() as u64,
        height: 1,
        viewpoint: Default::default(),
        data_kind: match encoding {
            Encoding::Binary => DataKind::Binary,
            Encoding::Ascii => DataKind::Ascii,
        },
        schema: Some(Schema::from_iter(AXES.map(|axis| (axis, ValueKind::F64, 1)))),
        version: None,
    };
    let mut writer = init
        .build_from_writer::<DynRecord, _>(Cursor::new(&mut bytes))
        .map_err(io::Error::other)?;
    let mut pushed = Ok(());
    for point in points {
        let fields = with_height(point).map(|coordinate| Field::F64(vec![coordinate]));
        pushed = writer.push(&DynRecord(fields.into()));
        if pushed.is_err() {
            break;
        }
    }
    // Always finish: the writer panics when it is dropped unfinished.
    let finished = writer.finish();
    pushed.and(finished).map_err(io::Error::other)?;
    Ok(bytes)
}

pub(super) fn parse<const D: usize>(
    bytes: &[u8],
    not_finite: NotFinite,
) -> Result<Parsed<D>, MapProblem> {
    let mut payload = bytes;
    let meta = PcdMeta::from_reader(&mut payload)
        .map_err(|error| MapProblem::syntax(format!("bad PCD header: {error}")))?;
    let start = bytes.len() - payload.len();
    if meta.width.checked_mul(meta.height) != Some(meta.num_points) {
        return Err(MapProblem::syntax(format!(
            "bad PCD header: WIDTH {} × HEIGHT {} is not POINTS {}",
            meta.width, meta.height, meta.num_points
        )));
    }
    for field in &meta.field_defs {
        if field.count != 1 && AXES.iter().any(|axis| field.name.eq_ignore_ascii_case(axis)) {
            return Err(MapProblem::syntax(format!(
                "bad PCD header: field {:?} has COUNT {}, expected 1",
                field.name, field.count
            )));
        }
    }
    if meta.data == DataKind::Ascii {
        let names: Vec<_> = meta.field_defs.iter().map(|field| &field.name).collect();
        let columns: Vec<_> =
            meta.field_defs.iter().map(|field| TextColumn::Values(field.count)).collect();
        let mut rows = TextRows::after_header(bytes, start)?;
        let points = rows.points(meta.num_points, &columns, &Axes::find(&names, not_finite)?)?;
        if rows.next_row().is_some() {
            return Err(MapProblem::count("points", meta.num_points, "more"));
        }
        return Ok(points);
    }
    // The library leaves padding fields out of its records.
    let names: Vec<_> = meta
        .field_defs
        .iter()
        .filter(|field| !field.is_padding())
        .map(|field| &field.name)
        .collect();
    let axes = Axes::find(&names, not_finite)?;
    check_size(&meta, payload)?;
    let records = DynReader::from_reader(bytes)
        .map_err(|error| MapProblem::syntax(format!("bad PCD data: {error}")))?;
    let mut points = Parsed::new();
    for (index, record) in (0..).zip(records) {
        let place = FilePosition::Point(index);
        let record = record.map_err(|error| MapProblem::syntax(format!("{place}: {error}")))?;
        points.push(axes.point(place, |column, _| Ok(first_value(&record.0[column])))?);
    }
    Ok(points)
}

/// Checks the number of points against the size of the data. The library trusts the header, and would allocate by
/// it or copy past the end.
fn check_size(meta: &PcdMeta, payload: &[u8]) -> Result<(), MapProblem> {
    let mut record_size = 0_u64;
    for field in &meta.field_defs {
        record_size = field
            .count
            .checked_mul(field.kind.byte_size() as u64)
            .and_then(|size| size.checked_add(record_size))
            .ok_or_else(|| MapProblem::syntax("bad PCD header: COUNT is far too large"))?;
    }
    let data_size = if meta.data == DataKind::BinaryCompressed {
        let sizes = payload.first_chunk::<8>().ok_or_else(|| {
            MapProblem::syntax("found no sizes of the compressed data: the file is cut short")
        })?;
        let [compressed, data] = [0, 4].map(|at| {
            u64::from(u32::from_le_bytes([sizes[at], sizes[at + 1], sizes[at + 2], sizes[at + 3]]))
        });
        let held = payload.len() as u64 - 8;
        if compressed > held {
            return Err(MapProblem::syntax(format!(
                "found {held} bytes of compressed data, expected {compressed}: \
                 the file is cut short"
            )));
        }
        // The longest LZF match encodes 264 bytes in 3.
        if data > compressed * (264 / 3) {
            return Err(MapProblem::syntax(format!(
                "{compressed} bytes of compressed data cannot hold the announced {data}"
            )));
        }
        data
    } else {
        payload.len() as u64
    };
    let held = data_size / record_size.max(1);
    // Less than one record may be left over (such as a final line break); compressed sizes are exact.
    let exact = meta.data != DataKind::BinaryCompressed || data_size == held * record_size;
    if held != meta.num_points || !exact {
        return Err(MapProblem::count("points", meta.num_points, held.to_string()));
    }
    Ok(())
}

/// Returns the single value of a coordinate. 64-bit integers beyond 2⁵³ are rounded, by far less than the resolution
/// of any map.
fn first_value(field: &Field) -> f64 {
    let value = match field {
        Field::I8(values) => values.first().map(|&value| f64::from(value)),
        Field::I16(values) => values.first().map(|&value| f64::from(value)),
        Field::I32(values) => values.first().map(|&value| f64::from(value)),
        Field::I64(values) => values.first().map(|&value| value as f64),
        Field::U8(values) => values.first().map(|&value| f64::from(value)),
        Field::U16(values) => values.first().map(|&value| f64::from(value)),
        Field::U32(values) => values.first().map(|&value| f64::from(value)),
        Field::U64(values) => values.first().map(|&value| value as f64),
        Field::F32(values) => values.first().map(|&value| f64::from(value)),
        Field::F64(values) => values.first().copied(),
    };
    // An empty field would have COUNT 0, which the library reads as 1.
    value.unwrap_or(f64::NAN)
}

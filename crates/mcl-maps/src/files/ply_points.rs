//! PLY (the Stanford polygon file format): element `vertex` with properties x, y, z.

use std::io::{self, Write};

use mcl_core::Point;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    Addable, ElementDef, Encoding as PlyEncoding, Header, Property, PropertyAccess,
    PropertyAccessResult, PropertyDef, PropertyType, ScalarType,
};
use ply_rs_bw::writer::Writer;

use super::columns::{AXES, Axes, NotFinite, Parsed, with_height};
use super::text_rows::{TextColumn, TextRows};
use super::{Encoding, FilePosition, MapProblem};

const VERTEX: &str = "vertex";

/// A point to write.
struct Vertex([f64; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex([0.0; 3])
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        AXES.iter().position(|&axis| axis == name).map(|axis| self.0[axis])
    }
}

pub(super) fn write<const D: usize>(
    points: &[Point<D>],
    encoding: Encoding,
    sink: &mut impl Write,
) -> io::Result<()> {
    let mut vertex = ElementDef::new(VERTEX.to_owned());
    vertex.count = points.len();
    for axis in AXES {
        let double = PropertyType::Scalar(ScalarType::Double);
        vertex.properties.add(PropertyDef::new(axis.to_owned(), double));
    }
    let mut header = Header::new();
    header.encoding = match encoding {
        Encoding::Binary => PlyEncoding::BinaryLittleEndian,
        Encoding::Ascii => PlyEncoding::Ascii,
    };
    header.elements.add(vertex.clone());
    let writer = Writer::new();
    writer.write_header(sink, &header)?;
    for point in points {
        let point = Vertex(with_height(point));
        match encoding {
            Encoding::Binary => writer.write_little_endian_element(sink, &point, &vertex)?,
            Encoding::Ascii => writer.write_ascii_element(sink, &point, &vertex)?,
        };
    }
    Ok(())
}

/// An element read from a file: its properties in the order of the header, lists as NaN.
struct ElementRow(Vec<f64>);

impl PropertyAccess for ElementRow {
    fn new() -> Self {
        ElementRow(Vec::new())
    }

    fn set_property(&mut self, _name: &str, property: Property) -> PropertyAccessResult {
        self.0.push(match property {
            Property::Char(value) => value.into(),
            Property::UChar(value) => value.into(),
            Property::Short(value) => value.into(),
            Property::UShort(value) => value.into(),
            Property::Int(value) => value.into(),
            Property::UInt(value) => value.into(),
            Property::Float(value) => value.into(),
            Property::Double(value) => value,
            _ => f64::NAN,
        });
        PropertyAccessResult::Set
    }
}

pub(super) fn parse<const D: usize>(
    bytes: &[u8],
    not_finite: NotFinite,
) -> Result<Parsed<D>, MapProblem> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<ElementRow>::new()
        .read_header(&mut reader)
        .map_err(|error| bad_header(bytes, &error))?;
    let payload = reader.into_inner();
    let start = bytes.len() - payload.len();
    check_names(&bytes[..start], &header)?;
    let elements: Vec<&ElementDef> = header.elements.values().collect();
    let Some(at) = elements.iter().position(|element| element.name == VERTEX) else {
        let found: Vec<_> = elements.iter().map(|element| format!("{:?}", element.name)).collect();
        let found = found.join(", ");
        return Err(MapProblem::syntax(format!("no element \"vertex\", found [{found}]")));
    };
    let (before, vertex) = (&elements[..at], elements[at]);
    let is_last = elements[at + 1..].iter().all(|element| element.count == 0);
    let names: Vec<_> = vertex.properties.values().map(column_name).collect();
    let axes = Axes::find(&names, not_finite)?;
    if header.encoding == PlyEncoding::Ascii {
        let mut rows = TextRows::after_header(bytes, start)?;
        for element in before {
            for read in 0..element.count {
                if rows.next_row().is_none() {
                    return Err(short(element, read));
                }
            }
        }
        let columns: Vec<_> = vertex.properties.values().map(text_column).collect();
        let points = rows.points(vertex.count as u64, &columns, &axes)?;
        if is_last && rows.next_row().is_some() {
            return Err(MapProblem::count("points", vertex.count as u64, "more"));
        }
        return Ok(points);
    }
    let mut rest = payload;
    for element in before {
        read_binary(&mut rest, element, &header, |_, _| Ok(()))?;
    }
    let mut points = Parsed::new();
    read_binary(&mut rest, vertex, &header, |index, row| {
        points.push(axes.point(FilePosition::Point(index), |column, _| Ok(row.0[column]))?);
        Ok(())
    })?;
    if is_last && rest.len() >= least_size(vertex) {
        return Err(MapProblem::count("points", vertex.count as u64, "more"));
    }
    Ok(points)
}

/// Reads the rows of one element of a binary file.
fn read_binary(
    rest: &mut &[u8],
    element: &ElementDef,
    header: &Header,
    mut use_row: impl FnMut(u64, &ElementRow) -> Result<(), MapProblem>,
) -> Result<(), MapProblem> {
    let size = least_size(element);
    if size == 0 {
        return Ok(()); // Nothing is stored for an element without properties.
    }
    // Checked before the first row, so that a wrong header causes no long reads or large allocations.
    if element.count > rest.len() / size {
        return Err(short(element, rest.len() / size));
    }
    let parser = Parser::<ElementRow>::new();
    for index in 0..element.count {
        let row = match header.encoding {
            PlyEncoding::BinaryBigEndian => parser.read_big_endian_element(rest, element),
            _ => parser.read_little_endian_element(rest, element),
        };
        let row = row.map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => short(element, index),
            _ => MapProblem::syntax(format!(
                "{} {index}: {}",
                element.name,
                one_line(&error.to_string())
            )),
        })?;
        use_row(index as u64, &row)?;
    }
    Ok(())
}

/// The smallest size of a binary row in bytes, with every list empty.
fn least_size(element: &ElementDef) -> usize {
    let size = |scalar: &ScalarType| match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    element
        .properties
        .values()
        .map(|property| match &property.data_type {
            PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => size(scalar),
        })
        .sum()
}

/// Refuses duplicate names: the library keeps only the last of equally named elements or properties, which would
/// shift the others.
fn check_names(header_text: &[u8], header: &Header) -> Result<(), MapProblem> {
    let declared = |keyword: &[u8]| {
        header_text
            .split(|&byte| byte == b'\n')
            .filter(|line| line.split(u8::is_ascii_whitespace).next() == Some(keyword))
            .count()
    };
    let properties: usize = header.elements.values().map(|element| element.properties.len()).sum();
    if declared(b"element") != header.elements.len() || declared(b"property") != properties {
        return Err(MapProblem::syntax(
            "the header declares an element or property of the same name twice",
        ));
    }
    Ok(())
}

fn column_name(property: &PropertyDef) -> String {
    match property.data_type {
        PropertyType::Scalar(_) => property.name.clone(),
        // A list is never a coordinate, whatever its name.
        PropertyType::List(..) => format!("list {}", property.name),
    }
}

fn text_column(property: &PropertyDef) -> TextColumn {
    match property.data_type {
        PropertyType::Scalar(_) => TextColumn::Values(1),
        PropertyType::List(..) => TextColumn::List,
    }
}

fn short(element: &ElementDef, found: usize) -> MapProblem {
    let what = if element.name == VERTEX { "points".to_owned() } else { element.name.clone() };
    MapProblem::count(what, element.count as u64, format!("at most {found}"))
}

/// What is wrong with a header. About a line that it does not accept, the library's message is debugging output.
fn bad_header(bytes: &[u8], error: &ParseError) -> MapProblem {
    let line = error.line().filter(|_| error.kind() == io::ErrorKind::InvalidInput);
    let found =
        line.and_then(|line| bytes.split(|&byte| byte == b'\n').nth(line.saturating_sub(1)));
    MapProblem::syntax(match (line, found) {
        (Some(line), Some(found)) => {
            let found = one_line(&String::from_utf8_lossy(found));
            format!("bad PLY header, line {line}: found {found:?}, which is not valid there")
        }
        _ => format!("bad PLY header: {}", one_line(&error.to_string())),
    })
}

/// Text without line breaks, truncated to a readable length.
fn one_line(text: &str) -> String {
    let words: Vec<_> = text.split_whitespace().collect();
    words.join(" ").chars().take(300).collect()
}

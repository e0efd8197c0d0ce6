//! Map files: exact round trips, files of other programs, damaged files.

use std::path::{Path, PathBuf};

use mcl_core::{CoreError, Point, PointMap};
use mcl_maps::files::{Encoding, FilePosition, MapFileError, MapProblem, read_map, write_map};
use proptest::prelude::*;
use tempfile::TempDir;

/// Every format in every encoding that we write.
const WRITTEN: [(&str, Encoding); 5] = [
    ("map.csv", Encoding::Ascii),
    ("map.ply", Encoding::Ascii),
    ("map.ply", Encoding::Binary),
    ("map.pcd", Encoding::Ascii),
    ("map.pcd", Encoding::Binary),
];

fn bits<const D: usize>(points: &[Point<D>]) -> Vec<[u64; D]> {
    points.iter().map(|point| point.map(f64::to_bits)).collect()
}

fn file(name: &str, bytes: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read<const D: usize>(name: &str, bytes: impl AsRef<[u8]>) -> Vec<Point<D>> {
    let (_folder, path) = file(name, bytes);
    read_map(path).unwrap_or_else(|error| panic!("{error}")).into_points()
}

/// The problem found in a file; the message must name the file and stay on one line.
fn problem<const D: usize>(name: &str, bytes: impl AsRef<[u8]>) -> MapProblem {
    let (_folder, path) = file(name, bytes);
    let error = read_map::<D>(&path).unwrap_err();
    assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
    assert!(!error.to_string().contains('\n'), "{error}");
    match error {
        MapFileError::Content { problem, .. } => problem,
        other => panic!("expected a problem of the content, got {other}"),
    }
}

fn written<const D: usize>(name: &str, points: &[Point<D>], encoding: Encoding) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write_map(&path, &PointMap::new(points.to_vec()).unwrap(), encoding).unwrap();
    std::fs::read(path).unwrap()
}

fn assert_round_trip<const D: usize>(points: &[Point<D>]) {
    for (name, encoding) in WRITTEN {
        let back = read::<D>(name, written(name, points, encoding));
        assert_eq!(bits(&back), bits(points), "{name} {encoding:?}");
    }
}

#[test]
fn odd_values_survive_bit_for_bit() {
    let utm = [532_418.123_456_789_1, 5_320_977.000_000_001];
    let tiny = [f64::from_bits(1), -f64::MIN_POSITIVE / 3.0];
    let planar = [[0.0, -0.0], utm, tiny, [0.1 + 0.2, -1.0 / 3.0], [1e12, -1e12], [7.0, 7.0]];
    assert_round_trip(&planar);
    let spatial: Vec<_> = planar.iter().map(|&[x, y]| [x, y, -x / 7.0]).collect();
    assert_round_trip(&spatial);
}

#[test]
fn what_is_written() {
    let points = [[0.5, -0.0], [2.0, 3.0]];
    assert_eq!(written("m.csv", &points, Encoding::Binary), b"x,y\n0.5,-0\n2,3\n");
    assert_eq!(written("m.csv", &[[1.0, 2.0, 3.0]], Encoding::Ascii), b"x,y,z\n1,2,3\n");
    let ply = String::from_utf8(written("m.PLY", &points, Encoding::Ascii)).unwrap();
    assert_eq!(
        ply,
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\n\
         property double z\nend_header\n0.5 -0 0\n2 3 0\n"
    );
    let pcd = String::from_utf8(written("m.pcd", &points, Encoding::Ascii)).unwrap();
    assert!(pcd.contains("\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\n"));
    assert!(pcd.ends_with("DATA ascii\n0.5 -0 0\n2 3 0\n"), "{pcd}");
    let payload: Vec<u8> = [0.5, -0.0, 0.0, 2.0, 3.0, 0.0_f64]
        .iter()
        .flat_map(|coordinate| coordinate.to_le_bytes())
        .collect();
    for name in ["m.ply", "m.pcd"] {
        assert!(written(name, &points, Encoding::default()).ends_with(&payload));
    }
}

#[test]
fn csv_of_other_programs() {
    let text = "\u{feff}# from a spreadsheet\r\n\"Intensity\", Y ,X\r\n7,1.5,-.5\r\n\r\n# note\r\n\
                8,2e0,+3.\r\n";
    assert_eq!(read::<2>("m.csv", text), [[-0.5, 1.5], [3.0, 2.0]]);
    assert_eq!(read::<2>("m.csv", "x,y,z\n1,2,0\n3,4,-0.0"), [[1.0, 2.0], [3.0, 4.0]]);
}

#[test]
fn ply_of_other_programs() {
    let ascii = "ply\r\nformat ascii 1.0\r\ncomment made elsewhere\r\nobj_info scan 1\r\n\
        element camera 1\r\nproperty float fov\r\nelement vertex 2\r\nproperty uchar red\r\n\
        property float z\r\nproperty list uchar int tags\r\nproperty float y\r\n\
        property float32 x\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\n\
        end_header\r\n90\r\n255 0 2 7 7 .5 1\r\n0 0.0 0 -2 1e1\r\n3 0 1 0\r\n";
    assert_eq!(read::<2>("m.ply", ascii), [[1.0, 0.5], [10.0, -2.0]]);

    for (order, big) in [("big", true), ("little", false)] {
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement list_first 1\n\
             property list uchar uchar skipped\nelement vertex 2\nproperty float x\n\
             property short y\nproperty list uchar uchar tags\nproperty double z\nend_header\n"
        )
        .into_bytes();
        bytes.extend([2, 9, 9]);
        for (x, y, tags, z) in [(0.25_f32, -3_i16, vec![], 1e-7_f64), (5.5, 4, vec![1_u8, 2], -8.0)]
        {
            bytes.extend(if big { x.to_be_bytes() } else { x.to_le_bytes() });
            bytes.extend(if big { y.to_be_bytes() } else { y.to_le_bytes() });
            bytes.push(tags.len() as u8);
            bytes.extend(tags);
            bytes.extend(if big { z.to_be_bytes() } else { z.to_le_bytes() });
        }
        assert_eq!(read::<3>("m.ply", &bytes), [[0.25, -3.0, 1e-7], [5.5, 4.0, -8.0]]);
    }
}

const PCD_FOREIGN: &str = "# .PCD v0.7\nVERSION 0.7\nFIELDS rgb y _ x z\nSIZE 4 4 1 8 4\n\
    TYPE U F U F I\nCOUNT 1 1 3 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n";

/// Two records under [`PCD_FOREIGN`].
fn pcd_records() -> [Vec<u8>; 2] {
    [(0.5, 1e6 + 0.1, 0), (-2.0, 3.0, 0)].map(|(y, x, z): (f32, f64, i32)| {
        let mut record = 7_u32.to_le_bytes().to_vec();
        record.extend(y.to_le_bytes());
        record.extend([9, 9, 9]);
        record.extend(x.to_le_bytes());
        record.extend(z.to_le_bytes());
        record
    })
}

/// The records of [`pcd_records`], field by field, as LZF literals.
fn pcd_compressed() -> Vec<u8> {
    let records = pcd_records();
    let mut data = Vec::new();
    for field in [0..4, 4..8, 8..11, 11..19, 19..23] {
        for record in &records {
            data.extend(&record[field.clone()]);
        }
    }
    let mut packed = Vec::new();
    for run in data.chunks(32) {
        packed.push(run.len() as u8 - 1);
        packed.extend(run);
    }
    let mut bytes = format!("{PCD_FOREIGN}DATA binary_compressed\n").into_bytes();
    bytes.extend((packed.len() as u32).to_le_bytes());
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(packed);
    bytes
}

#[test]
fn pcd_of_other_programs() {
    let expected = [[1e6 + 0.1, 0.5], [3.0, -2.0]];
    let ascii = format!("{PCD_FOREIGN}DATA ascii\n7 .5 9 9 9 1000000.1 0\n7 -2 9 9 9 3 0\n");
    assert_eq!(read::<2>("m.pcd", &ascii), expected);
    assert_eq!(read::<2>("m.pcd", ascii.replace('\n', "\r\n")), expected);
    let mut binary = format!("{PCD_FOREIGN}DATA binary\n").into_bytes();
    binary.extend(pcd_records().concat());
    assert_eq!(read::<2>("m.pcd", &binary), expected);
    binary.push(b'\n');
    assert_eq!(read::<2>("m.pcd", &binary), expected);
    assert_eq!(read::<2>("m.pcd", pcd_compressed()), expected);
}

#[test]
fn unknown_endings_list_the_known_ones() {
    let map = PointMap::new(vec![[0.0, 0.0]]).unwrap();
    for name in ["map.xyz", "map", ".ply"] {
        for error in
            [read_map::<2>(name).unwrap_err(), write_map(name, &map, Encoding::Binary).unwrap_err()]
        {
            assert!(matches!(error, MapFileError::UnknownEnding { .. }));
            assert!(error.to_string().contains(".csv, .ply, .pcd"), "{error}");
        }
    }
    for name in ["office.pgm", "office.png"] {
        let error = read_map::<2>(name).unwrap_err();
        assert!(matches!(error, MapFileError::BareImage { .. }));
        assert!(error.to_string().contains("name the .yaml file"), "{error}");
    }
    let error = read_map::<2>("absent/map.csv").unwrap_err();
    assert!(matches!(error, MapFileError::Unreadable { .. }), "{error}");
    let error = write_map("absent/map.csv", &map, Encoding::Binary).unwrap_err();
    assert!(matches!(error, MapFileError::Unwritable { .. }), "{error}");
    assert!(!Path::new("absent").exists());
}

#[test]
fn a_missing_column_is_named_beside_those_found() {
    let missing = |column, found: &str| MapProblem::MissingColumn { column, found: found.into() };
    assert_eq!(problem::<2>("m.csv", "x,h\n1,2\n"), missing("y", "\"x\", \"h\""));
    assert_eq!(problem::<3>("m.csv", "x,y\n1,2\n"), missing("z", "\"x\", \"y\""));
    assert_eq!(problem::<2>("m.csv", ""), missing("x", "no columns"));
    let headless = problem::<2>("m.csv", "1,2\n3,4\n").to_string();
    assert!(headless.contains("header line is missing"), "{headless}");
    let list = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n\
        property list uchar float y\nend_header\n1 1 2\n";
    assert_eq!(problem::<2>("m.ply", list), missing("y", "\"x\", \"list y\""));
    let pcd = PCD_FOREIGN.replace(" x ", " u ") + "DATA binary\n";
    assert!(matches!(problem::<2>("m.pcd", pcd), MapProblem::MissingColumn { column: "x", .. }));
    let double = problem::<2>("m.csv", "x,y,X\n1,2,3\n");
    assert!(matches!(double, MapProblem::DoubleColumn { column: "x", .. }), "{double}");
}

#[test]
fn bad_values_are_named_with_line_and_column() {
    let value = |place, column, found: &str, expected| MapProblem::Value {
        place,
        column,
        found: found.into(),
        expected,
    };
    let (number, finite) = ("a number of metres", "a finite number of metres");
    let flat = "0, because the map is planar";
    let line = FilePosition::Line;
    let text = "# a\n\nx,y\n1,2\n# b\n\n1,two\n";
    for text in [text.to_owned(), text.replace('\n', "\r\n")] {
        assert_eq!(problem::<2>("m.csv", text), value(line(7), "y", "\"two\"", number));
    }
    assert_eq!(problem::<2>("m.csv", "x,y\n1,\n"), value(line(2), "y", "\"\"", number));
    assert_eq!(problem::<2>("m.csv", "x,y\n1,2\nnan,2\n"), value(line(3), "x", "NaN", finite));
    assert_eq!(problem::<2>("m.csv", "x,y\n1,-inf\n"), value(line(2), "y", "-inf", finite));
    assert_eq!(problem::<2>("m.csv", "x,y,z\n1,2,0\n1,2,3\n"), value(line(3), "z", "3", flat));

    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\n\
        end_header\n1 2\n";
    let comma = problem::<2>("m.ply", format!("{ply}1 2,5\n"));
    assert_eq!(comma, value(line(8), "y", "\"2,5\"", number));
    assert_eq!(problem::<2>("m.ply", format!("{ply}NaN 2\n")), value(line(8), "x", "NaN", finite));
    let pcd = format!("{PCD_FOREIGN}DATA ascii\n7 .5 9 9 9 1 0\n7 -2 9 9 9 inf 0\n");
    assert_eq!(problem::<2>("m.pcd", pcd), value(line(13), "x", "inf", finite));

    let spatial = [[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]];
    for name in ["m.ply", "m.pcd"] {
        let mut bytes = written(name, &spatial, Encoding::Binary);
        assert_eq!(problem::<2>(name, &bytes), value(FilePosition::Point(1), "z", "0.5", flat));
        let at = bytes.len() - 24;
        bytes[at..at + 8].copy_from_slice(&f64::INFINITY.to_le_bytes());
        assert_eq!(problem::<3>(name, &bytes), value(FilePosition::Point(1), "x", "inf", finite));
    }
    let far = problem::<2>("m.csv", "x,y\n1,2\n1e300,0\n");
    assert!(matches!(far, MapProblem::Points(CoreError::TooLarge { index: 1, .. })), "{far}");
}

#[test]
fn rows_of_a_wrong_length_are_named() {
    let length = |line, found, expected| MapProblem::RowLength {
        place: FilePosition::Line(line),
        found,
        expected,
    };
    assert_eq!(problem::<2>("m.csv", "x,y\n1,2\n3\n"), length(3, 1, 2));
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int a\n\
        property double x\nproperty double y\nend_header\n";
    assert_eq!(problem::<2>("m.ply", format!("{ply}1 5 1\n")), length(8, 3, 4));
    assert_eq!(problem::<2>("m.ply", format!("{ply}0 1 2 3\n")), length(8, 4, 3));
    let huge = problem::<2>("m.ply", format!("{ply}18446744073709551613 1 2\n"));
    assert_eq!(huge, length(8, 3, u64::MAX - 1));
    let pcd = format!("{PCD_FOREIGN}DATA ascii\n7 .5 9 9 1 0\n");
    assert_eq!(problem::<2>("m.pcd", pcd), length(12, 6, 7));
}

/// Fault: the message was debugging output of the library.
#[test]
fn a_bad_line_of_a_ply_header_is_named() {
    let cases = [
        ("ply\nformat ascii 1.0\nelement vertex 1\npropertx float x\r\n", 4, "propertx float x"),
        ("format ascii 1.0\n", 1, "format ascii 1.0"),
        ("ply\nformat ascii 1.0\nproperty float x\n", 3, "property float x"),
        ("ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", 3, "element vertex -1"),
    ];
    for (text, line, found) in cases {
        let expected =
            format!("bad PLY header, line {line}: found {found:?}, which is not valid there");
        assert_eq!(problem::<2>("m.ply", text).to_string(), expected);
    }
    let cut = problem::<2>("m.ply", "ply\nformat ascii 1.0\n").to_string();
    assert!(cut.contains("missing 'end_header'"), "{cut}");
}

#[test]
fn no_points_is_an_error() {
    let empty = MapProblem::Points(CoreError::NoPoints);
    assert_eq!(problem::<2>("m.csv", "x,y\n"), empty);
    for encoding in ["ascii", "binary_little_endian"] {
        let ply = format!(
            "ply\nformat {encoding} 1.0\nelement vertex 0\nproperty float x\nproperty float y\n\
             end_header\n"
        );
        assert_eq!(problem::<2>("m.ply", ply), empty);
    }
    let pcd = PCD_FOREIGN.replace("WIDTH 2", "WIDTH 0").replace("POINTS 2", "POINTS 0");
    for data in ["ascii\n", "binary\n", "binary_compressed\n\0\0\0\0\0\0\0\0"] {
        assert_eq!(problem::<2>("m.pcd", format!("{pcd}DATA {data}")), empty, "{data}");
    }
}

/// A header with too few, too many, or absurdly many points must neither lose points silently
/// nor make the reader allocate memory for that number.
#[test]
fn a_wrong_point_count_is_an_error() {
    let points: Vec<_> = (0..40).map(|i| [f64::from(i), 0.5]).collect();
    for (name, encoding) in &WRITTEN[1..] {
        let honest = written(name, &points, *encoding);
        let ends_header = |word: &[u8]| word == b"DATA" || word == b"end_";
        let start = honest.windows(4).position(ends_header).unwrap();
        let header = String::from_utf8(honest[..start].to_vec()).unwrap();
        for lie in ["1", "41", "18446744073709551615", "9223372036854775808", "4000000000"] {
            let lying = header
                .replace("vertex 40", &format!("vertex {lie}"))
                .replace("WIDTH 40", &format!("WIDTH {lie}"))
                .replace("POINTS 40", &format!("POINTS {lie}"));
            assert_ne!(lying, header);
            let found = problem::<2>(name, [lying.as_bytes(), &honest[start..]].concat());
            let MapProblem::Count { announced, .. } = found else {
                panic!("{name} {encoding:?} {lie}: {found}");
            };
            assert_eq!(announced.to_string(), lie);
        }
        // A text file that lacks only its final line break would still be complete.
        for cut in [4, 24, 300] {
            let found = problem::<2>(name, &honest[..honest.len() - cut]);
            let noticed = matches!(
                found,
                MapProblem::Count { announced: 40, .. } | MapProblem::RowLength { .. }
            );
            assert!(noticed, "{name} {encoding:?} {cut}: {found}");
        }
    }
}

#[test]
fn wrong_compressed_sizes_are_errors() {
    let honest = pcd_compressed();
    let sizes = honest.windows(5).position(|word| word == b"ssed\n").unwrap() + 5;
    for (at, lie) in [(0, u32::MAX), (4, u32::MAX), (4, 45), (4, 47), (0, 2)] {
        let mut bytes = honest.clone();
        bytes[sizes + at..sizes + at + 4].copy_from_slice(&u32::to_le_bytes(lie));
        problem::<2>("m.pcd", bytes);
    }
    for end in sizes..honest.len() {
        problem::<2>("m.pcd", &honest[..end]);
    }
}

#[test]
fn elements_without_properties_cost_nothing() {
    let ply = "ply\nformat binary_little_endian 1.0\nelement nothing 18446744073709551615\n\
        element vertex 1\nproperty float x\nproperty float y\nend_header\n";
    let bytes = [ply.as_bytes(), &1_f32.to_le_bytes(), &2_f32.to_le_bytes()].concat();
    assert_eq!(read::<2>("m.ply", bytes), [[1.0, 2.0]]);
}

/// The library keeps only the last of equally named properties, which shifts all columns after it.
#[test]
fn repeated_ply_properties_are_an_error() {
    let ply = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float a\n\
        property float a\nproperty float x\nproperty float y\nend_header\n";
    let found = problem::<2>("m.ply", [ply.as_bytes(), &[0; 16]].concat());
    assert!(found.to_string().contains("same name twice"), "{found}");
}

/// A valid file of each kind, changed in a few places.
fn damaged() -> impl Strategy<Value = (&'static str, Vec<u8>)> {
    let points = [[1.5, -2.0], [1e6, 0.1], [3.0, 4.0], [-0.0, 0.0]];
    let mut files: Vec<_> =
        WRITTEN.iter().map(|&(name, encoding)| (name, written(name, &points, encoding))).collect();
    files.push(("map.pcd", pcd_compressed()));
    let words = ["0", "-1", "18446744073709551615", "nan", "list uchar float", "vertex", "\n", ","];
    let inserted = prop_oneof![
        any::<u8>().prop_map(|byte| vec![byte]),
        prop::sample::select(words.to_vec()).prop_map(|word| word.as_bytes().to_vec()),
        Just(Vec::new()),
    ];
    let change = (any::<prop::sample::Index>(), 0_usize..40, inserted);
    (prop::sample::select(files), prop::collection::vec(change, 1..6)).prop_map(
        |((name, mut bytes), changes)| {
            for (at, removed, inserted) in changes {
                let start = at.index(bytes.len() + 1);
                let end = (start + removed).min(bytes.len());
                bytes.splice(start..end, inserted);
            }
            (name, bytes)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(800))]

    #[test]
    fn damaged_files_never_panic((name, bytes) in damaged()) {
        let (_folder, path) = file(name, bytes);
        if let Ok(map) = read_map::<2>(&path) {
            prop_assert!(map.points().iter().flatten().all(|value| value.is_finite()));
        }
        if let Err(error) = read_map::<3>(&path) {
            prop_assert!(error.to_string().contains(name));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_coordinates_survive_bit_for_bit(
        points in prop::collection::vec(
            prop::array::uniform3(any::<f64>().prop_filter("a place", |value| value.abs() <= 1e12)),
            1..20,
        )
    ) {
        assert_round_trip(&points);
        let planar: Vec<_> = points.iter().map(|&[x, y, _]| [x, y]).collect();
        assert_round_trip(&planar);
    }
}

//! Grid maps of map_server: modes, damaged files, and the two files that are written.

use std::f64::consts::FRAC_PI_2;
use std::fs;
use std::path::Path;

use mcl_core::{Point, PointMap, Pose2};
use mcl_maps::files::{Encoding, read_grid, read_map, write_grid, write_map};
use mcl_maps::occupancy::{Cell, OccupancyGrid, rasterize};
use png::{BitDepth, ColorType};
use proptest::prelude::*;

const YAML: &str = "image: map.pgm\nresolution: 0.5\norigin: [1, -2, 0]\nnegate: 0\n\
    occupied_thresh: 0.65\nfree_thresh: 0.196\n";

/// A folder with a description and an image.
fn folder(yaml: &str, image_name: &str, image: &[u8]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("map.yaml"), yaml).unwrap();
    fs::write(folder.path().join(image_name), image).unwrap();
    folder
}

fn read(yaml: &str, image_name: &str, image: &[u8]) -> Result<OccupancyGrid, String> {
    let folder = folder(yaml, image_name, image);
    let result = read_grid(folder.path().join("map.yaml")).map_err(|error| error.to_string());
    if let Err(message) = &result {
        assert!(message.starts_with(&folder.path().display().to_string()), "{message}");
        assert!(!message.contains('\n'), "{message}");
    }
    result
}

/// The cells as letters, the top row first: `#` occupied, `.` free, `?` unknown.
fn drawn(grid: &OccupancyGrid) -> Vec<String> {
    let letter = |cell: &Cell| match cell {
        Cell::Occupied => '#',
        Cell::Free => '.',
        Cell::Unknown => '?',
    };
    grid.cells().chunks(grid.width()).rev().map(|row| row.iter().map(letter).collect()).collect()
}

fn png_of(width: u32, color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let bits = width as usize * color.samples() * depth as usize;
    let rows = data.len() / bits.div_ceil(8);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, rows as u32);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == ColorType::Indexed {
        encoder.set_palette(vec![255, 255, 255, 0, 0, 0]);
    }
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

#[test]
fn the_top_row_of_the_image_has_the_largest_y() {
    let image = b"P2 3 2 255\n0 254 205\n205 254 254\n";
    let grid = read(YAML, "map.pgm", image).unwrap();
    assert_eq!(drawn(&grid), ["#.?", "?.."]);
    assert_eq!(grid.occupied_points(), [[1.25, -1.25]]);
    let turned = YAML.replace("-2, 0]", &format!("-2, {FRAC_PI_2}]"));
    let [x, y] = read(&turned, "map.pgm", image).unwrap().occupied_points()[0];
    assert!((x - 0.25).abs() < 1e-12 && (y + 1.75).abs() < 1e-12, "({x}, {y})");
}

#[test]
fn thresholds_are_not_reached_by_being_equal() {
    // p = (255 − v)/255; occupied above 0.6 (v < 102), free below 0.2 (v > 204).
    let yaml = YAML.replace("0.65", "0.6").replace("0.196", "0.2");
    let image = b"P5 6 1 255\n\x00\x65\x66\xcc\xcd\xff";
    assert_eq!(drawn(&read(&yaml, "map.pgm", image).unwrap()), ["##??.."]);
    let negated = yaml.replace("negate: 0", "negate: 1");
    assert_eq!(drawn(&read(&negated, "map.pgm", image).unwrap()), [".??###"]);
    let scale = format!("{yaml}mode: scale\n");
    assert_eq!(drawn(&read(&scale, "map.pgm", image).unwrap()), ["##??.."]);
    // Other maximum values give the same result.
    assert_eq!(drawn(&read(&yaml, "map.pgm", b"P2 4 1 10 3 4 8 9").unwrap()), ["#??."]);
    let wide = b"P5 4 1 1000\n\x01\x8f\x01\x90\x03\x20\x03\x21";
    assert_eq!(drawn(&read(&yaml, "map.pgm", wide).unwrap()), ["#??."]);
}

/// Nav2's map_saver writes unknown cells as 205 and a free_thresh of 0.25, by which they would be free: on the Olin map
/// four fifths of all cells, outside of the building.
#[test]
fn what_map_saver_writes_as_unknown_is_not_free() {
    let yaml = YAML.replace("0.196", "0.25");
    assert_eq!(drawn(&read(&yaml, "map.pgm", b"P2 3 1 255 0 205 254").unwrap()), ["#?."]);
    // With any other value in the image, the thresholds apply as given.
    assert_eq!(drawn(&read(&yaml, "map.pgm", b"P2 4 1 255 0 205 254 230").unwrap()), ["#..."]);
    let negated = yaml.replace("negate: 0", "negate: 1");
    assert_eq!(drawn(&read(&negated, "map.pgm", b"P2 3 1 255 0 205 254").unwrap()), [".##"]);
}

#[test]
fn raw_values_are_percent() {
    // Above occupied_thresh, below free_thresh, above 100; negate is ignored.
    for negate in ["negate: 0", "negate: 1"] {
        let yaml = format!("{YAML}mode: raw\n").replace("negate: 0", negate);
        let image = b"P2 8 1 255 0 19 20 65 66 100 101 255";
        assert_eq!(drawn(&read(&yaml, "map.pgm", image).unwrap()), ["..??##??"]);
    }
}

#[test]
fn alpha_as_map_server_has_it() {
    let yaml = YAML.replace("map.pgm", "map.png");
    let image = |color, depth, data: &[u8]| png_of(3, color, depth, data);
    // Black opaque; black transparent; white transparent.
    let rgba = [0, 0, 0, 255, 0, 0, 0, 0, 255, 255, 255, 0];
    let rgba = image(ColorType::Rgba, BitDepth::Eight, &rgba);
    // Trinary: alpha is one channel of the mean: 255/4, 0, 3·255/4, so p = 0.75, 1, 0.25.
    assert_eq!(drawn(&read(&yaml, "map.png", &rgba).unwrap()), ["##?"]);
    let scale = format!("{yaml}mode: scale\n");
    assert_eq!(drawn(&read(&scale, "map.png", &rgba).unwrap()), ["#??"]);
    let grey = image(ColorType::GrayscaleAlpha, BitDepth::Eight, &[0, 255, 0, 0, 255, 254]);
    assert_eq!(drawn(&read(&scale, "map.png", &grey).unwrap()), ["#??"]);
}

#[test]
fn pictures_of_every_kind() {
    let yaml = YAML.replace("map.pgm", "map.png");
    for image in [
        png_of(3, ColorType::Grayscale, BitDepth::Eight, &[0, 205, 254]),
        png_of(3, ColorType::Grayscale, BitDepth::Sixteen, &[0, 9, 205, 0, 255, 255]),
        png_of(3, ColorType::Grayscale, BitDepth::Two, &[0b0010_1100]),
        png_of(3, ColorType::Rgb, BitDepth::Eight, &[0, 0, 9, 255, 205, 155, 255, 250, 254]),
    ] {
        let found = drawn(&read(&yaml, "map.png", &image).unwrap());
        assert!(["#?.", "#?."].contains(&found[0].as_str()), "{found:?}");
    }
    let indexed = png_of(3, ColorType::Indexed, BitDepth::One, &[0b0110_0000]);
    assert_eq!(drawn(&read(&yaml, "map.png", &indexed).unwrap()), [".##"]);
    // The content determines the format, not the extension.
    let grey = png_of(3, ColorType::Grayscale, BitDepth::Eight, &[0, 205, 254]);
    assert_eq!(drawn(&read(YAML, "map.pgm", &grey).unwrap()), ["#?."]);
}

#[test]
fn what_cannot_be_read_is_named() {
    let good = b"P5 1 1 255\n\x00";
    for (yaml, image, expected) in [
        ("", &good[..], "map.yaml: no field \"image\", found none"),
        (&YAML.replace("map.pgm", "other.pgm"), good, "map.yaml: field \"image\": found"),
        (YAML, b"P5 2 1 255\n\x00", "map.pgm: the header announces 2 pixels, the file holds 1"),
        (YAML, b"", "map.pgm: the image begins with \"\", expected PGM (P2, P5) or PNG"),
        (YAML, b"GIF89a", "map.pgm: the image begins with \"GIF89a\""),
        (YAML, b"P5 100000 100000 255\n\x00", "expected at least 1 and at most 100000000"),
    ] {
        let message = read(yaml, "map.pgm", image).unwrap_err();
        assert!(message.contains(expected), "{message}");
    }
    let whole = png_of(3, ColorType::Grayscale, BitDepth::Eight, &[0, 205, 254, 1, 2, 3]);
    for length in 8..whole.len() - 12 {
        let message = read(YAML, "map.pgm", &whole[..length]).unwrap_err();
        assert!(message.contains("the PNG image cannot be read"), "{message}");
    }
    let mut huge = whole.clone();
    huge[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    assert!(read(YAML, "map.pgm", &huge).is_err());
}

#[test]
fn point_maps_from_and_to_grids() {
    let folder = folder(YAML, "map.pgm", b"P2 2 1 255 254 205");
    let path = folder.path().join("map.yaml");
    let message = read_map::<2>(&path).unwrap_err().to_string();
    assert!(message.contains("no cell of 2 × 1 is occupied"), "{message}");
    let message = read_map::<2>(folder.path().join("map.pgm")).unwrap_err().to_string();
    assert!(message.contains("name the .yaml file"), "{message}");
    let cube = PointMap::new(vec![[1.0, 2.0, 3.0]]).unwrap();
    for error in [write_map(&path, &cube, Encoding::Binary), read_map::<3>(&path).map(drop)] {
        assert!(error.unwrap_err().to_string().contains("a grid map is planar"));
    }
    let map = PointMap::new(vec![[0.01, 0.01], [0.02, 0.02], [-0.01, 0.07]]).unwrap();
    write_map(&path, &map, Encoding::Binary).unwrap();
    let back = read_map::<2>(&path).unwrap();
    for (found, expected) in back.points().iter().zip([[0.025, 0.025], [-0.025, 0.075]]) {
        assert!((found[0] - expected[0]).abs() < 1e-12 && (found[1] - expected[1]).abs() < 1e-12);
    }
    let far = PointMap::new(vec![[0.0, 0.0], [1e6, 1e6]]).unwrap();
    let message = write_map(&path, &far, Encoding::Binary).unwrap_err().to_string();
    assert!(message.contains("use a larger resolution"), "{message}");
    assert_eq!(read_map::<2>(&path).unwrap(), back);
}

#[test]
fn files_as_map_saver_writes_them() {
    let folder = tempfile::tempdir().unwrap();
    let cells = vec![Cell::Free, Cell::Unknown, Cell::Occupied, Cell::Free];
    let grid = OccupancyGrid::new(2, 0.05, Pose2::new(-1.5, 2.0, 0.0), cells).unwrap();
    let path = folder.path().join("floor.1.yaml");
    write_grid(&path, &grid).unwrap();
    assert_eq!(
        fs::read_to_string(&path).unwrap(),
        "image: floor.1.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.5, 2.0, 0.0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    );
    let image = fs::read(folder.path().join("floor.1.pgm")).unwrap();
    assert_eq!(image, b"P5\n2 2\n255\n\x00\xfe\xfe\xcd");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    assert_eq!(read_grid(&path).unwrap(), grid);
    assert!(write_grid(folder.path().join("floor.pgm"), &grid).is_err());
}

fn point() -> impl Strategy<Value = Point<2>> {
    [-30.0..30.0f64, -30.0..30.0]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn the_cells_written_are_the_cells_read(
        points in prop::collection::vec(point(), 1..60), resolution in 0.02..0.5f64,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.yaml");
        let map = PointMap::new(points.clone()).unwrap();
        let grid = rasterize(&map, resolution, None).unwrap();
        write_grid(&path, &grid).unwrap();
        let back = read_grid(&path).unwrap();
        prop_assert_eq!(&back, &grid);
        // Centres are within half a cell of their points, and are rasterized to themselves.
        let centres = back.occupied_points();
        for [x, y] in points {
            let near = |&[cx, cy]: &Point<2>| {
                (cx - x).abs().max((cy - y).abs()) <= 0.5 * resolution + 1e-9
            };
            prop_assert!(centres.iter().any(near));
        }
        let again = rasterize(&PointMap::new(centres).unwrap(), resolution, None).unwrap();
        prop_assert_eq!(again, grid);
    }
}

/// Facts: the image is 903 × 1706 pixels; its description says 0.03 m and origin (−1.12, −39.4).
#[test]
#[cfg_attr(not(real_data = "olin-mac"), ignore = "needs olin-mac in MCL_DATA_DIR")]
fn the_map_of_the_olin_bag() {
    let folder = std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set");
    let path = Path::new(&folder).join("olin-mac/mac_1st_floor_final.yaml");
    let grid = read_grid(&path).unwrap();
    assert_eq!((grid.width(), grid.height()), (903, 1706));
    let image = fs::read(path.with_extension("pgm")).unwrap();
    let pixels = &image[image.len() - 903 * 1706..];
    let black = pixels.iter().filter(|&&value| value < 90).count();
    assert_eq!(grid.count(Cell::Occupied), black);
    let white = pixels.iter().filter(|&&value| value == 254).count();
    assert_eq!(grid.count(Cell::Free), white);
    let map = read_map::<2>(&path).unwrap();
    assert_eq!(map.len(), black);
    let bounds = map.bounds();
    assert!(bounds.min[0] > -1.12 && bounds.max[0] < -1.12 + 903.0 * 0.03);
    assert!(bounds.min[1] > -39.4 && bounds.max[1] < -39.4 + 1706.0 * 0.03);
}

/// Found by fuzzing: an interlaced image of a few bytes whose header gives a hundred million pixels allocated a
/// hundred megabytes before its first row was read.
#[test]
fn a_png_too_short_for_its_size_is_refused() {
    const IMAGE: &[u8] = b"\x89PNG\x0d\x0a\x1a\x0a\x00\x00\x00\x0dIHDR\x00\x00'\x10\x00\x00'\x10\x08\x00\x00\x00\x01\xe8\x22\x0dm\
        \x00\x00\x00\x0cIDATx\x9cc`\xa0=\x00\x00\x00d\x00\x01\x86d<5\x00\x00\x00\x00IEND\xaeB`\x82";
    let message = read(YAML, "map.pgm", IMAGE).unwrap_err();
    assert!(message.contains("10000 × 10000 pixels, which its 69 bytes cannot hold"), "{message}");
}

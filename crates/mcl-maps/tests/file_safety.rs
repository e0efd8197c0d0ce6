//! Map files are written atomically wherever writing stops, and never over inputs.

use std::fs;
use std::path::{Path, PathBuf};

use mcl_core::files::fault::{Fault, during};
use mcl_core::files::remove_leftovers;
use mcl_core::{PointMap, Pose2};
use mcl_maps::files::{
    Encoding, MapFileError, check_writable, read_grid, read_map, write_grid, write_map,
};
use mcl_maps::occupancy::{Cell, OccupancyGrid};

#[test]
fn a_map_file_is_the_old_or_the_new_one_wherever_its_writing_ends() {
    let old = PointMap::new(vec![[0.5, -0.25]]).unwrap();
    let new = PointMap::new(vec![[1.0 / 3.0, 2.0], [1e9, 0.1], [-0.0, 7.25]]).unwrap();
    for name in ["map.csv", "map.ply", "map.pcd"] {
        for encoding in [Encoding::Binary, Encoding::Ascii] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(name);
            let (_, steps) = during(Fault::None, || write_map(&path, &new, encoding).unwrap());
            let mut failed = 0;
            for (at, (_, length, _)) in steps.iter().enumerate() {
                for bytes in 0..=*length {
                    for fault in [Fault::Stop { at, bytes }, Fault::Full { at, bytes }] {
                        write_map(&path, &old, encoding).unwrap();
                        let (result, _) = during(fault, || write_map(&path, &new, encoding));
                        let found = read_map::<2>(&path).unwrap();
                        let expected = if result.is_ok() { &new } else { &old };
                        assert_eq!(&found, expected, "{name} {fault:?}");
                        failed += usize::from(result.is_err());
                    }
                    remove_leftovers(folder.path());
                    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
                }
            }
            assert!(failed > 100, "{failed}");
        }
    }
}

fn grid(cells: &[Cell], resolution: f64) -> OccupancyGrid {
    OccupancyGrid::new(2, resolution, Pose2::IDENTITY, cells.to_vec()).unwrap()
}

/// Image and description are two files: a description beside the wrong image would put every wall in a wrong place.
#[test]
fn a_grid_map_is_never_half_another_one() {
    let old = grid(&[Cell::Occupied, Cell::Free, Cell::Unknown, Cell::Occupied], 0.05);
    let new = grid(&[Cell::Free, Cell::Occupied], 0.1);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.yaml");
    let (_, steps) = during(Fault::None, || write_grid(&path, &new).unwrap());
    let (mut kept, mut gone) = (0, 0);
    for (at, (_, length, _)) in steps.iter().enumerate() {
        for bytes in 0..=*length {
            for fault in [Fault::Stop { at, bytes }, Fault::Full { at, bytes }, Fault::Fail { at }]
            {
                write_grid(&path, &old).unwrap();
                let (result, _) = during(fault, || write_grid(&path, &new));
                match (read_grid(&path), result) {
                    (Ok(found), Ok(())) => assert_eq!(found, new, "{fault:?}"),
                    (Ok(found), Err(_)) => {
                        assert_eq!(found, old, "{fault:?}");
                        kept += 1;
                    }
                    (Err(error), result) => {
                        assert!(matches!(error, MapFileError::Unreadable { .. }), "{error}");
                        assert!(result.is_err() && !path.exists(), "{fault:?}");
                        assert!(!matches!(fault, Fault::Full { .. }), "a full disk loses nothing");
                        gone += 1;
                    }
                }
                remove_leftovers(folder.path());
                assert!(fs::read_dir(folder.path()).unwrap().count() <= 2, "{fault:?}");
            }
        }
    }
    assert!(kept > 200 && gone > 0, "{kept} {gone}");
}

#[test]
fn a_grid_map_is_two_files_also_as_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let cells = grid(&[Cell::Free, Cell::Occupied], 0.1);
    write_grid(at("office.yaml"), &cells).unwrap();
    let text = fs::read_to_string(at("office.yaml")).unwrap();
    fs::write(at("renamed.yaml"), text.replace("office.pgm", "image.pgm")).unwrap();
    fs::rename(at("office.pgm"), at("image.pgm")).unwrap();
    let check = |output: &str, input: &str| check_writable(at(output), &[at(input)]);

    check("new.yaml", "renamed.yaml").unwrap();
    check("office.csv", "renamed.yaml").unwrap();
    // `image.yaml` does not exist, but its image would replace that of `renamed.yaml`.
    let error = check("image.yaml", "renamed.yaml").unwrap_err();
    let MapFileError::Unwritable { path, source } = error else { panic!("{error}") };
    assert_eq!(path, at("image.pgm"));
    assert!(source.to_string().contains("it is an input"), "{source}");
    assert!(check("renamed.yaml", "renamed.yaml").is_err());
    assert!(check("map.ply", "map.ply").is_ok(), "a missing file is not read");
    let error = check("absent/map.csv", "renamed.yaml").unwrap_err().to_string();
    assert!(error.contains("there is no folder"), "{error}");
    for name in ["map.pgm", "map", "map.txt"] {
        assert!(check_writable(Path::new(name), &[] as &[PathBuf]).is_err(), "{name}");
    }
}

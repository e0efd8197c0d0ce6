//! KITTI: the upper three rows of the homogeneous matrix of each pose, one pose per line, without stamps.

use std::io::BufRead;
use std::path::Path;

use mcl_core::{Pose2, Stamp};

use super::{ParsedFile, TrajectoryFileError, TrajectoryFormat};
use crate::planar::{Attitude, NonPlanar, Refused, check_height, quoted};

pub(super) fn read(
    reader: impl BufRead,
    file: &Path,
    non_planar: NonPlanar,
) -> Result<ParsedFile, TrajectoryFileError> {
    let mut poses = Vec::new();
    for (index, text) in reader.lines().enumerate() {
        let line = index as u64 + 1;
        let read = |source| TrajectoryFileError::Read { file: file.to_owned(), line, source };
        let text = text.map_err(read)?;
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        poses.push(pose(text, file, line, non_planar)?);
    }
    let stamps = (0..).map(|frame| Stamp::from_nanoseconds(frame * 1_000_000_000));
    Ok(ParsedFile {
        trajectory: stamps.zip(poses).collect(),
        format: TrajectoryFormat::Kitti,
        has_headings: true,
        notes: vec![
            "a file in the KITTI format has no stamps: its frame numbers are used as seconds"
                .into(),
        ],
    })
}

fn pose(
    text: &str,
    file: &Path,
    line: u64,
    non_planar: NonPlanar,
) -> Result<Pose2, TrajectoryFileError> {
    let field = |field: &str, found, expected: &str| TrajectoryFileError::Field {
        file: file.to_owned(),
        line,
        field: field.to_owned(),
        found,
        expected: expected.to_owned(),
    };
    let (mut matrix, mut count) = ([0.0; 12], 0);
    for text in text.split_whitespace() {
        if let Some(number) = matrix.get_mut(count) {
            *number = match text.parse::<f64>() {
                Ok(value) if value.is_finite() => value,
                _ => return Err(field(&(count + 1).to_string(), quoted(text), "a finite number")),
            };
        }
        count += 1;
    }
    if count != matrix.len() {
        let expected = "12, as in the lines before: a matrix of 3 rows and 4 columns".to_owned();
        let file = file.to_owned();
        return Err(TrajectoryFileError::FieldCount { file, line, found: count, expected });
    }
    let [xx, xy, xz, x, yx, yy, yz, y, zx, zy, zz, z] = matrix;
    let refused = |Refused { is_height, found, expected }: Refused| {
        field(if is_height { "12 (z)" } else { "1 to 11 (rotation)" }, found, &expected)
    };
    check_height(z, non_planar).map_err(refused)?;
    let attitude =
        Attitude::of_matrix([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]).map_err(refused)?;
    Ok(Pose2::new(x, y, attitude.heading(non_planar, None).map_err(refused)?))
}

//! The program, called in a folder.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Stdout and stderr of a call that must end with a code. No data set but the simulated ones is at hand.
#[track_caller]
pub fn ends(folder: &Path, args: &[&str], code: i32) -> (String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_mcl-eval"))
        .current_dir(folder)
        .env_remove("MCL_DATA_DIR")
        .args(args)
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{args:?}\n{stdout}\n{stderr}");
    (stdout, stderr)
}

/// Writes the first 40 scans of the simulated office as `office.log`.
pub fn write_office(folder: &Path) {
    ends(folder, &["simulate", "-o", "whole.log"], 0);
    let text = fs::read_to_string(folder.join("whole.log")).unwrap();
    let end = text.match_indices("FLASER").nth(40).unwrap().0;
    fs::write(folder.join("office.log"), &text[..end]).unwrap();
}

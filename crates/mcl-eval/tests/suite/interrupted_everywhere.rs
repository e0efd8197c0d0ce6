//! Every operation on files of a study is interrupted: the process is killed before it or in the middle of
//! it, it fails, or the disk is full from there on. Going on then gives the bytes of an undisturbed run.
//!
//! The program is built with the feature `fault-injection` of `mcl-core` here, as a development dependency
//! asks for; see the module `files::fault`.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::office::{Bench, assert_same};

const LIKELIHOOD: &str = r#"
seed = 3
measures = ["likelihood"]
[base]
tolerance = 1e-2
max_iterations = 3
[[trials]]
map = ["gbs", "rnd+f-km"]
size = 10
draws = 2
[views.summary]
columns = ["log_likelihood"]
[[views.tests]]
y = "log_likelihood"
pairs = [["gbs", "rnd+f-km"]]
"#;

/// Its pictures are of a trial that is there, and of maps that no trial is of.
const LOCALIZATION: &str = r#"
seed = 3
[base]
tolerance = 1e-2
max_iterations = 3
particles = 20
beams = 10
[[trials]]
map = ["gbs", "gbs+f-km"]
size = 10
draws = 1
runs = 2
[[views.pictures]]
name = "path"
maps = [{ map = "gbs+f-km", size = 10 }]
run = 0
"#;

/// An operation of an undisturbed run.
struct Step {
    is_write: bool,
    bytes: usize,
}

fn arguments(name: &str, root: &str) -> Vec<String> {
    let definition = format!("{name}.toml");
    ["run", &definition, "--dataset", "office.log", "--quiet", "--threads", "1", "-o", root]
        .map(str::to_owned)
        .to_vec()
}

fn run(bench: &Bench, name: &str, variable: &str, value: &str) -> Output {
    let arguments = arguments(name, "disturbed");
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    bench.command(&arguments).env(variable, value).output().unwrap()
}

/// The operations of a run from where the folder `disturbed` is.
fn steps(bench: &Bench, name: &str) -> Vec<Step> {
    let trace = bench.path("trace");
    let output = run(bench, name, "MCL_FILE_TRACE", &trace.display().to_string());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = fs::read_to_string(&trace).unwrap();
    fs::remove_file(&trace).unwrap();
    let step = |line: &str| {
        let mut words = line.split(' ');
        let (kind, bytes) = (words.next().unwrap(), words.next().unwrap());
        Step { is_write: kind == "Write", bytes: bytes.parse().unwrap() }
    };
    text.lines().map(step).collect()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        match path.is_dir() {
            true => copy(&path, &target),
            false => drop(fs::copy(&path, &target).unwrap()),
        }
    }
}

/// Interrupts each operation of a study in each way, beginning with what is in `before` or with nothing.
fn interrupt_everywhere(bench: &Bench, name: &str, before: Option<&Path>) {
    let undisturbed = bench.study(name, "undisturbed", &["--quiet", "--threads", "1"]);
    let root = bench.path("disturbed");
    let folder = root.join(name).join("office");
    let begin = || {
        if root.exists() {
            fs::remove_dir_all(&root).unwrap();
        }
        if let Some(before) = before {
            copy(before, &folder);
        }
    };
    begin();
    let steps = steps(bench, name);
    assert_same(&folder, &undisturbed);
    let mut faults: Vec<String> = Vec::new();
    for (at, Step { is_write, bytes }) in steps.iter().enumerate() {
        faults.extend(["stop", "fail", "full"].map(|kind| format!("{kind} {at}")));
        if *is_write {
            let mut torn = [1, bytes / 2, bytes - 1].to_vec();
            torn.retain(|&torn| torn > 0 && torn < *bytes);
            torn.dedup();
            faults.extend(torn.iter().map(|torn| format!("stop {at} {torn}")));
            faults.extend(torn.last().map(|torn| format!("full {at} {torn}")));
        }
    }
    let (mut killed, mut failed) = (0, 0);
    for fault in &faults {
        begin();
        let output = run(bench, name, "MCL_FILE_FAULT", fault);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        match output.status.code() {
            None => killed += 1,
            Some(0 | 1 | 3) => failed += 1,
            Some(code) => panic!("{fault}: exit {code}: {message}"),
        }
        assert_eq!(output.status.code().is_none(), fault.starts_with("stop"), "{fault}: {message}");
        assert!(!message.contains("panicked"), "{fault}: {message}");
        let again = run(bench, name, "MCL_FILE_FAULT_NONE", "");
        let message = String::from_utf8_lossy(&again.stderr);
        assert!(again.status.success(), "going on after {fault}: {message}");
        eprintln!("{name}: {fault}");
        assert_same(&folder, &undisturbed);
    }
    eprintln!(
        "{name}: {} operations, {} faults: {killed} kills, {failed} failures",
        steps.len(),
        faults.len()
    );
}

#[test]
fn a_likelihood_study() {
    let bench = Bench::with_scans(6, &[("likelihood", LIKELIHOOD)]);
    interrupt_everywhere(&bench, "likelihood", None);
}

#[test]
fn a_localization_study_with_pictures() {
    let bench = Bench::with_scans(6, &[("localization", LOCALIZATION)]);
    interrupt_everywhere(&bench, "localization", None);
}

/// Field case `figures-edited-then-killed`: the next run found the new definition and the old maps, and kept
/// them for ever.
#[test]
fn a_study_whose_pictures_were_edited() {
    let before = LOCALIZATION
        .replace("\"gbs+f-km\", size = 10 }]\nrun = 0", "\"gbs\", size = 10 }]\nrun = 1");
    assert_ne!(before, LOCALIZATION);
    let bench = Bench::with_scans(6, &[("localization", &before)]);
    let before = bench.study("localization", "before", &[]);
    fs::write(bench.path("localization.toml"), LOCALIZATION).unwrap();
    interrupt_everywhere(&bench, "localization", Some(&before));
}

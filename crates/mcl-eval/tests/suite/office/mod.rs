//! A small laser log, and studies of it as a user runs them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Localization with 36 trials of two runs.
pub const LOCALIZATION: &str = r#"
seed = 3
[base]
sigma = 0.05
tolerance = 1e-3
max_iterations = 50
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 50
beams = 30
[[trials]]
split = ["same", "alternate"]
map = ["all", "gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [5, 20]
draws = 2
runs = 2
[views.summary]
columns = ["map_points", "weighted", "diverged"]
[[views.tests]]
y = "weighted"
ratio = true
pairs = [["gbs+f-km", "gbs"], ["rnd+f-km", "rnd"], ["gbs", "rnd"], ["gbs+f-km", "rnd+f-km"]]
[[views.charts]]
name = "figure5-localization-{split}"
x = { column = "real_percent", scale = "log" }
y = { column = "weighted", scale = "log" }
marks = "diverged"
[[views.pictures]]
name = "trajectory"
maps = [{ map = "gbs+f-km", size = 5 }]
run = 0
"#;

/// A folder with the first scans of the simulated office as `office.log`, and studies by name.
pub struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// Of 40 scans.
    pub fn new(studies: &[(&str, &str)]) -> Self {
        Self::with_scans(40, studies)
    }

    pub fn with_scans(scans: usize, studies: &[(&str, &str)]) -> Self {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        bench.mcl_eval(&["simulate", "-o", "whole.log"]);
        let whole = fs::read_to_string(bench.path("whole.log")).unwrap();
        // Comment and parameter lines, then each scan with its two odometry lines.
        let head = whole.lines().position(|line| line.starts_with("FLASER")).unwrap();
        let lines: Vec<&str> = whole.lines().take(head + 3 * scans).collect();
        fs::write(bench.path("office.log"), lines.join("\n") + "\n").unwrap();
        for (name, definition) in studies {
            fs::write(bench.path(&format!("{name}.toml")), definition).unwrap();
        }
        bench
    }

    /// A file of this name.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program, to be run in the folder.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        command.args(arguments).current_dir(self.folder.path());
        command
    }

    /// Runs the program in the folder.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs a command that has to succeed, and returns its stdout.
    #[track_caller]
    pub fn mcl_eval(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs a study, which has to succeed, and returns its result folder.
    #[track_caller]
    pub fn study(&self, name: &str, root: &str, more: &[&str]) -> PathBuf {
        let definition = format!("{name}.toml");
        let mut arguments = vec!["run", &definition, "--dataset", "office.log", "-o", root];
        arguments.extend(more);
        self.mcl_eval(&arguments);
        self.path(root).join(name).join("office")
    }

    /// Runs a study on one thread, on two, and again after its rows were cut off in the middle, which has
    /// to give the same bytes, and returns its result folder.
    #[track_caller]
    pub fn reproduced(&self, name: &str) -> PathBuf {
        let one = self.study(name, "one", &["--threads", "1"]);
        let two = self.study(name, "two", &["--threads", "2"]);
        assert_same(&two, &one);
        cut_rows(&two, 3);
        self.study(name, "two", &["--threads", "7"]);
        assert_same(&two, &one);
        one
    }
}

/// The files of rows of a result folder.
pub fn parts(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder.join("parts")) else { return Vec::new() };
    entries.map(|entry| entry.unwrap().path()).collect()
}

/// Cuts off the rows of a folder with one file of them, so that one in so many bytes is left.
#[track_caller]
pub fn cut_rows(folder: &Path, share: usize) {
    let [path] = &parts(folder)[..] else { panic!("expected one file of rows") };
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() / share]).unwrap();
}

/// The rows of a CSV file, by column.
#[track_caller]
pub fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().clone();
    let row = |record: csv::StringRecord| {
        header.iter().map(str::to_owned).zip(record.iter().map(str::to_owned)).collect()
    };
    reader.records().map(|record| row(record.unwrap())).collect()
}

/// The number in a cell of a row.
#[track_caller]
pub fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} is {:?}", row[column]))
}

/// What is in the files of a result folder that are the same bytes for every run, by path.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let relative = path.strip_prefix(folder).unwrap().to_owned();
            if path.is_dir() {
                folders.push(path);
            } else if relative != Path::new("timings.csv") && !relative.starts_with("parts") {
                found.insert(relative, fs::read(path).unwrap());
            }
        }
    }
    found
}

/// Asserts that two result folders hold the same files with the same bytes.
#[track_caller]
pub fn assert_same(found: &Path, expected: &Path) {
    let (found, expected) = (contents(found), contents(expected));
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (path, bytes) in &expected {
        assert!(found[path] == *bytes, "{} differs", path.display());
    }
}

//! A study in parts: several processes run shares of it, and the merge makes the files that one run makes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

const STUDY: &str = r#"
seed = 1
measures = ["likelihood"]
[base]
odometry_noise = { xy = 0.01, theta = 0.01 }
start = "anywhere"
length = 30
particles = 50
[[trials]]
map = ["gbs", "rnd"]
size = [0.1, 0.2]
draws = 4
runs = 1
[[dataset]]
name = "simulated-office"
[[views.tests]]
y = "weighted"
pairs = [["gbs", "rnd"]]
[[views.charts]]
name = "chart"
x = { column = "size_percent" }
y = { column = "weighted", scale = "log" }
[[views.pictures]]
name = "picture"
maps = [{ map = "gbs", size = 0.2 }, { map = "rnd", size = 0.3 }]
run = 0
"#;

struct Lab(TempDir);

impl Lab {
    fn new() -> Self {
        let lab = Lab(tempfile::tempdir().unwrap());
        fs::write(lab.path("study.toml"), STUDY).unwrap();
        lab
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, root: &str, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        command.current_dir(self.0.path()).args(["run", "study.toml", "-o", root]).args(args);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn spawn(&self, root: &str, args: &[&str]) -> Child {
        self.command(root, args).spawn().unwrap()
    }

    fn run(&self, root: &str, args: &[&str], code: i32) -> String {
        ended(self.command(root, args).output().unwrap(), code)
    }

    fn folder(&self, root: &str) -> PathBuf {
        self.path(root).join("study/simulated-office")
    }
}

fn ended(output: Output, code: i32) -> String {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let all = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{all}");
    all
}

/// All files below a folder but those that differ between any two runs: rows as they ended, and times.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() && name != "parts" {
                folders.push(path);
            } else if path.is_file() && name != "timings.csv" {
                files.insert(
                    path.strip_prefix(folder).unwrap().to_owned(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    files
}

fn assert_same(found: &Path, expected: &Path) {
    let (found, expected) = (files(found), files(expected));
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (name, bytes) in &expected {
        assert!(found[name] == *bytes, "{} differs", name.display());
    }
}

#[test]
fn parts_and_a_merge_make_the_files_of_one_run() {
    let lab = Lab::new();
    lab.run("whole", &["--threads", "2"], 0);
    assert!(files(&lab.folder("whole")).len() > 10);

    // All at once, one of them twice, with threads of their own.
    let parts = ["1/3", "2/3", "3/3", "2/3"];
    let children: Vec<Child> = parts
        .iter()
        .map(|part| lab.spawn("parts", &["--part", part, "--threads", "1", "-q"]))
        .collect();
    for child in children {
        ended(child.wait_with_output().unwrap(), 0);
    }
    assert!(!lab.folder("parts").join("trials.csv").exists(), "a part makes no tables");
    lab.run("parts", &["--merge"], 0);
    assert_same(&lab.folder("parts"), &lab.folder("whole"));

    // A part that is lost for good: the merge says what is missing, and decides nothing.
    for part in ["1/3", "3/3"] {
        lab.run("lost", &["--part", part, "-q"], 0);
    }
    let told = lab.run("lost", &["--merge"], 3);
    assert!(told.contains("of 16 trials have rows; missing: "), "{told}");
    assert!(told.contains("run parts again, and merge"), "{told}");
    let svg = fs::read_to_string(lab.folder("lost").join("figures/chart.svg")).unwrap();
    assert!(svg.contains("Incomplete: "), "the caption says so");
    let done: usize = {
        let csv = fs::read_to_string(lab.folder("lost").join("trials.csv")).unwrap();
        csv.lines().count() - 1
    };
    assert!((8..16).contains(&done), "{done}");
    // Every cell of the table has some of its draws.
    let summary = fs::read_to_string(lab.folder("lost").join("summary.csv")).unwrap();
    assert_eq!(summary.lines().count(), 1 + 4, "{summary}");
    let status = |code| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        let output = command.current_dir(lab.0.path()).args(["status", "lost", "--json"]).output();
        let text = ended(output.unwrap(), code);
        let found: Value = serde_json::from_str(&text).unwrap();
        found["folders"][0].clone()
    };
    let found = status(3);
    assert_eq!((&found["asked"], &found["done"]), (&16.into(), &done.into()));
    assert_eq!(found["missing"], 16 - done);

    // Any other number of parts completes it.
    for part in ["1/2", "2/2"] {
        lab.run("lost", &["--part", part, "-q"], 0);
    }
    lab.run("lost", &["--merge"], 0);
    assert_same(&lab.folder("lost"), &lab.folder("whole"));
    assert_eq!(status(0)["missing"], 0);
    // Nothing is left to be run.
    let rows = || fs::read_dir(lab.folder("lost").join("parts")).unwrap().count();
    let before = rows();
    lab.run("lost", &["--part", "1/5"], 0);
    assert_eq!(rows(), before);
}

#[test]
fn parts_of_array_jobs() {
    let lab = Lab::new();
    for task in ["1", "2"] {
        let mut command = lab.command("array", &["--part", "array/2", "-q"]);
        let output = command.env("SLURM_ARRAY_TASK_ID", task).output().unwrap();
        ended(output, 0);
    }
    lab.run("array", &["--merge"], 0);
    let told = lab.run("array", &["--part", "array/2"], 1);
    assert!(told.contains("none of SLURM_ARRAY_TASK_ID"), "{told}");
    for wrong in
        [&["--part", "3/2"][..], &["--part", "1/2", "--merge"], &["--part", "1/2", "--fresh"]]
    {
        lab.run("array", wrong, 2);
    }
    // Nothing is there to be merged.
    let told = lab.run("empty", &["--merge"], 1);
    assert!(told.contains("nothing to summarize"), "{told}");
}

#[test]
fn a_plan_starts_nothing_and_says_how_to_start() {
    let lab = Lab::new();
    let plan = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        let output =
            command.current_dir(lab.0.path()).args(["plan", "study.toml"]).args(args).output();
        ended(output.unwrap(), 0)
    };
    let found: Value = serde_json::from_str(&plan(&["--parts", "3", "--json"])).unwrap();
    assert_eq!((&found["trials"], &found["is_measured"]), (&16.into(), &false.into()));
    let of_parts: u64 =
        found["each"].as_array().unwrap().iter().map(|part| part["trials"].as_u64().unwrap()).sum();
    assert_eq!(of_parts, 16);
    assert!(!lab.path("results").exists());
    let slurm = plan(&["--parts", "3", "--engine", "slurm"]);
    for expected in
        ["sbatch --parsable", "--array=1-3", "--requeue", "--part array/3", "afterany", "--merge"]
    {
        assert!(slurm.contains(expected), "{slurm}");
    }
    // Where parts have run, they are the measurement.
    lab.run("results", &["--part", "1/3", "-q"], 0);
    let found: Value = serde_json::from_str(&plan(&["--parts", "3", "--json"])).unwrap();
    assert_eq!((&found["each"][0]["trials"], &found["is_measured"]), (&0.into(), &true.into()));
    assert!(plan(&["--parts", "2", "--engine", "kubernetes"]).contains("completionMode: Indexed"));
    assert!(plan(&["--parts", "2", "--engine", "parallel"]).contains("parallel -S"));
}

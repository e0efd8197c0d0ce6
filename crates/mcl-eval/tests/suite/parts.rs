//! A study in parts: several processes run shares of it, and the merge makes the files that one run makes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use crate::office::{assert_same, contents};
use mcl_study::store::parts::seal;
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

#[test]
fn parts_and_a_merge_make_the_files_of_one_run() {
    let lab = Lab::new();
    lab.run("whole", &["--threads", "2"], 0);
    assert!(contents(&lab.folder("whole")).len() > 10);

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
    let stderr = lab.run("lost", &["--merge"], 3);
    assert!(stderr.contains("of 16 trials have rows; missing: "), "{stderr}");
    assert!(stderr.contains("run parts again, and merge"), "{stderr}");
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
    let stderr = lab.run("array", &["--part", "array/2"], 1);
    assert!(stderr.contains("none of SLURM_ARRAY_TASK_ID"), "{stderr}");
    for wrong in
        [&["--part", "3/2"][..], &["--part", "1/2", "--merge"], &["--part", "1/2", "--fresh"]]
    {
        lab.run("array", wrong, 2);
    }
    // Nothing is there to be merged.
    let stderr = lab.run("empty", &["--merge"], 1);
    assert!(stderr.contains("nothing to summarize"), "{stderr}");
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
    // The parts read the data as the plan did.
    let read = ["-o", "other", "--max-range", "7.5", "--laser-pose", "-0.1,0,3.14", "--no-deskew"];
    let script = plan(&[&["--parts", "2", "--engine", "parallel"], &read[..]].concat());
    let options = " --max-range=7.5 --laser-pose=-0.1,0,3.14 --no-deskew -o other";
    assert_eq!(script.matches(options).count(), 2, "{script}");
}

/// Makes the study so long that its parts are not over before somebody looks.
const LONG: [(&str, &str); 2] = [("runs = 1", "runs = 10"), ("length = 30", "length = 100")];

#[test]
fn a_merge_while_parts_run_takes_what_is_there() {
    let lab = Lab::new();
    lab.run("whole", &[], 0);
    let mut children: Vec<Child> = ["1/2", "2/2"]
        .map(|part| lab.spawn("parts", &["--part", part, "--threads", "1", "-q"]))
        .into();
    let mut codes = Vec::new();
    while children.iter_mut().any(|child| child.try_wait().unwrap().is_none()) {
        let output = lab.command("parts", &["--merge", "-q"]).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        match output.status.code() {
            Some(0) => {}
            Some(1) => assert!(stderr.contains("nothing to summarize"), "{stderr}"),
            Some(3) => assert!(stderr.contains("of 16 trials have rows; missing: "), "{stderr}"),
            code => panic!("{code:?}: {stderr}"),
        }
        codes.push(output.status.code());
    }
    assert!(!codes.is_empty());
    children.into_iter().for_each(|child| drop(ended(child.wait_with_output().unwrap(), 0)));
    lab.run("parts", &["--merge"], 0);
    assert_same(&lab.folder("parts"), &lab.folder("whole"));
}

#[test]
fn a_part_of_another_build_is_refused() {
    let lab = Lab::new();
    lab.run("parts", &["--part", "1/2", "-q"], 0);
    let rows = rows_of(&lab.folder("parts"));
    let text = fs::read_to_string(&rows).unwrap();
    let (first, rest) = text.split_once('\n').unwrap();
    let mut identity = serde_json::from_str::<Value>(first).unwrap()["line"].take();
    identity["identity"]["build"]["sources"] = "0123456789abcdef".into();
    let first = seal(&serde_json::to_vec(&identity).unwrap());
    fs::write(&rows, [&first, &b"\n"[..], rest.as_bytes()].concat()).unwrap();
    for share in [&["--part", "2/2"][..], &["--merge"]] {
        let stderr = lab.run("parts", share, 1);
        assert!(
            stderr.contains("were computed by build") && stderr.contains("0123456789abcdef"),
            "{stderr}"
        );
    }
    assert_eq!(fs::read(&rows).unwrap(), [&first, &b"\n"[..], rest.as_bytes()].concat());
}

#[test]
fn a_part_of_other_data_is_refused() {
    let lab = Lab::new();
    let simulate = |seed: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        command.current_dir(lab.0.path()).args(["simulate", "-o", "log.log", "--seed", seed]);
        ended(command.output().unwrap(), 0);
    };
    let log = ["--dataset", "log.log"];
    simulate("1");
    lab.run("parts", &[&["--part", "1/2", "-q"][..], &log].concat(), 0);
    fs::remove_file(lab.path("log.log")).unwrap();
    simulate("2");
    for share in [&["--part", "2/2"][..], &["--merge"]] {
        let stderr = lab.run("parts", &[share, &log].concat(), 1);
        assert!(stderr.contains("the rows there were computed from"), "{stderr}");
    }
}

/// A part that cannot write any more keeps what it has written, and the same part goes on once there is room.
#[cfg(unix)]
#[test]
fn a_part_on_a_full_disk_goes_on_when_there_is_room() {
    let lab = Lab::new();
    lab.run("whole", &[], 0);
    lab.run("parts", &["--part", "2/2", "-q"], 0);
    // No file of more than 8 KiB can be written, as on a disk with so much room: that of the rows is the first.
    let mut command = Command::new("sh");
    command.current_dir(lab.0.path());
    command.args([
        "-c",
        "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"",
        env!("CARGO_BIN_EXE_mcl-eval"),
    ]);
    command.args(["run", "study.toml", "-o", "parts", "--part", "1/2", "--threads", "1", "-q"]);
    let stderr = ended(command.output().unwrap(), 1);
    assert!(stderr.contains("cannot write rows in"), "{stderr}");
    let stderr = lab.run("parts", &["--merge"], 3);
    assert!(stderr.contains("of 16 trials have rows; missing: "), "{stderr}");
    lab.run("parts", &["--part", "1/2", "-q"], 0);
    lab.run("parts", &["--merge"], 0);
    assert_same(&lab.folder("parts"), &lab.folder("whole"));
}

/// Requeued and preempted jobs are stopped, continued and ended from outside.
#[cfg(unix)]
#[test]
fn a_part_that_is_stopped_and_ended_goes_on() {
    use rustix::process::{Pid, Signal, kill_process};

    let lab = Lab::new();
    let study = LONG.into_iter().fold(STUDY.to_owned(), |text, (old, new)| text.replace(old, new));
    fs::write(lab.path("study.toml"), study).unwrap();
    let child = lab.spawn("parts", &["--part", "1/2", "--threads", "1", "-q"]);
    let parts = lab.folder("parts").join("parts");
    let has_rows = || {
        let mut entries = fs::read_dir(&parts).into_iter().flatten().flatten();
        entries.any(|entry| fs::read_to_string(entry.path()).unwrap().lines().count() > 1)
    };
    while !has_rows() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let process = Pid::from_child(&child);
    kill_process(process, Signal::STOP).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300));
    kill_process(process, Signal::CONT).unwrap();
    kill_process(process, Signal::TERM).unwrap();
    let stderr = ended(child.wait_with_output().unwrap(), 143);
    assert!(stderr.contains("the same command continues"), "{stderr}");
    let saved = fs::read_to_string(rows_of(&lab.folder("parts"))).unwrap();
    assert!(saved.ends_with('\n'), "ended between two rows");
    // What is there is not run again, and the rest is as if nothing had been.
    for part in ["1/2", "2/2"] {
        lab.run("parts", &["--part", part, "-q"], 0);
    }
    lab.run("parts", &["--merge"], 0);
    lab.run("whole", &[], 0);
    assert_same(&lab.folder("parts"), &lab.folder("whole"));
}

/// The only file of rows.
fn rows_of(folder: &Path) -> PathBuf {
    let mut entries =
        fs::read_dir(folder.join("parts")).unwrap().map(|entry| entry.unwrap().path());
    let only = entries.next().unwrap();
    assert!(entries.next().is_none());
    only
}

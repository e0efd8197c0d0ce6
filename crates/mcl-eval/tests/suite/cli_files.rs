//! What commands write: never an input, never through a link, whole or not there wherever they are killed.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

const TUM: &str = "0.0 0 0 0 0 0 0 1\n1.0 1 0 0 0 0 0 1\n2.0 2 0 0 0 0 0 1\n";

/// A folder with a short log (`office.log`, `office.mcap`), maps of it, and trajectories.
struct Lab(TempDir);

impl Lab {
    fn new() -> Self {
        let lab = Lab(tempfile::tempdir().unwrap());
        lab.ends(&["simulate", "-o", "whole.log"], 0);
        let text = fs::read_to_string(lab.at("whole.log")).unwrap();
        let end = text.match_indices("FLASER").nth(6).unwrap().0;
        fs::write(lab.at("office.log"), &text[..end]).unwrap();
        fs::remove_file(lab.at("whole.log")).unwrap();
        lab.ends(&["convert", "office.log", "office.mcap"], 0);
        lab.ends(&["map", "office.log", "--init", "grid", "--cell", "0.5", "-o", "map.csv"], 0);
        lab.ends(&["convert", "map.csv", "map.ply"], 0);
        lab.ends(&["convert", "map.csv", "map.yaml"], 0);
        for name in ["reference.tum", "estimate.tum"] {
            fs::write(lab.at(name), TUM).unwrap();
        }
        lab
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        command.current_dir(self.0.path()).args(args).args(["--quiet", "--threads", "1"]);
        command
    }

    /// What a call says on stderr that must end with a code.
    #[track_caller]
    fn ends(&self, args: &[&str], code: i32) -> String {
        let Output { status, stdout, stderr } = self.command(args).output().unwrap();
        let stderr = String::from_utf8(stderr).unwrap();
        assert_eq!(status.code(), Some(code), "{args:?}\n{stderr}");
        assert!(code == 0 || stdout.is_empty(), "{args:?} printed a result");
        stderr
    }

    /// Every file, below folders too, with its content.
    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        let mut folders = vec![self.0.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                let kind = fs::symlink_metadata(&path).unwrap().file_type();
                if kind.is_dir() {
                    folders.push(path);
                } else if kind.is_file() {
                    files.insert(path.clone(), fs::read(path).unwrap());
                }
            }
        }
        files
    }
}

/// What each command writes, the output left out.
const GRID: [&str; 4] = ["--init", "grid", "--cell", "0.4"];
const LOCALIZE: [&str; 7] =
    ["localize", "office.log", "--map", "map.csv", "--particles", "20", "--beams=10"];

fn with<'a>(parts: &[&[&'a str]]) -> Vec<&'a str> {
    parts.concat()
}

/// `convert X X` once rewrote a bag with scans, odometry and transforms only.
#[test]
fn no_command_writes_over_what_it_reads() {
    let lab = Lab::new();
    fs::create_dir(lab.at("split")).unwrap();
    fs::copy(lab.at("office.mcap"), lab.at("split/split_0.mcap")).unwrap();
    fs::create_dir(lab.at("out")).unwrap();
    fs::copy(lab.at("map.csv"), lab.at("out/run-000.csv")).unwrap();
    fs::copy(lab.at("reference.tum"), lab.at("reference.svg")).unwrap();
    fs::hard_link(lab.at("office.log"), lab.at("hard.log")).unwrap();
    fs::hard_link(lab.at("map.ply"), lab.at("hard.ply")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("office.mcap", lab.at("link.mcap")).unwrap();
        std::os::unix::fs::symlink(".", lab.at("here")).unwrap();
    }
    fs::create_dir_all(lab.at("datasets/lab")).unwrap();
    fs::copy(lab.at("map.ply"), lab.at("datasets/lab/lab.ply")).unwrap();
    let definition = "title = 'Lab'\ndescription = ''\nformat = 'cloud'\nfile = 'lab.ply'\nurls = []\n\
                      max_range = 1000\nterms = ''\ncitation = ''\n";
    fs::write(lab.at("datasets/lab/dataset.toml"), definition).unwrap();

    let map = |input, output| with(&[&["map", input], &GRID, &["-o", output]]);
    let evaluate = |more: &[&'static str]| {
        with(&[&["evaluate", "--reference", "reference.tum", "estimate.tum"], more])
    };
    let localize = |more: &[&'static str]| with(&[&LOCALIZE, more]);
    let mut calls = vec![
        vec!["convert", "office.log", "office.log"],
        vec!["convert", "office.log", "./office.log"],
        vec!["convert", "office.log", "hard.log"],
        vec!["convert", "hard.log", "office.log"],
        vec!["convert", "office.mcap", "office.mcap"],
        vec!["convert", "split", "split/split_0.mcap"],
        vec!["convert", "map.csv", "map.csv"],
        vec!["convert", "map.yaml", "map.yaml"],
        map("map.ply", "map.ply"),
        map("map.ply", "hard.ply"),
        map("lab", "datasets/lab/lab.ply"),
        evaluate(&["--errors", "reference.tum"]),
        evaluate(&["--errors", "./estimate.tum"]),
        with(&[
            &["evaluate", "--reference", "reference.svg", "estimate.tum"],
            &["--plot", "reference.svg"],
        ]),
        vec!["localize", "office.mcap", "--map", "map.csv", "--replay", "office.mcap"],
        vec!["localize", "split", "--map", "map.csv", "--replay", "split/split_0.mcap"],
        vec!["localize", "office.log", "--map", "out/run-000.csv", "-o", "out"],
    ];
    if cfg!(unix) {
        calls.extend([
            vec!["convert", "office.mcap", "link.mcap"],
            vec!["convert", "link.mcap", "office.mcap"],
            vec!["convert", "office.log", "here/office.log"],
            map("here/map.ply", "map.ply"),
            evaluate(&["--errors", "here/reference.tum"]),
            vec!["localize", "link.mcap", "--map", "map.csv", "--replay", "office.mcap"],
            vec!["localize", "office.log", "--map", "here/out/run-000.csv", "-o", "out"],
        ]);
    }
    let before = lab.files();
    for call in calls {
        let stderr = lab.ends(&call, 1);
        let is_refused = stderr.contains("cannot write") && stderr.contains("input");
        assert!(is_refused && stderr.contains("another name"), "{call:?}: {stderr}");
        assert_eq!(lab.files(), before, "{call:?}");
    }
    let stderr = lab.ends(&evaluate(&["--errors", "x.svg", "--plot", "./x.svg"]), 1);
    assert!(stderr.contains("would be written there, too"), "{stderr}");
    // Files that are not inputs may be replaced, also by files made from them.
    lab.ends(&map("map.ply", "map.csv"), 0);
    lab.ends(&evaluate(&["--errors", "office.mcap"]), 0);
    lab.ends(&localize(&["-o", "out"]), 0);
}

#[cfg(unix)]
#[test]
fn no_command_writes_through_a_link_or_waits_for_a_pipe() {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    let lab = Lab::new();
    let (target, place) = (lab.at("target"), |name: &str| lab.at(name));
    fs::write(&target, "not ours").unwrap();
    let calls: [(&str, Vec<&str>); 9] = [
        ("x.log", vec!["convert", "office.mcap"]),
        ("x.mcap", vec!["convert", "office.log"]),
        ("x.ply", vec!["convert", "map.csv"]),
        ("x.yaml", vec!["convert", "map.csv"]),
        ("x.csv", with(&[&["map", "office.log"], &GRID, &["-o"]])),
        ("y.log", vec!["simulate", "-o"]),
        ("e.csv", vec!["evaluate", "--reference=reference.tum", "estimate.tum", "--errors"]),
        ("e.png", vec!["evaluate", "--reference=reference.tum", "estimate.tum", "--plot"]),
        ("r.mcap", with(&[&LOCALIZE, &["--replay"]])),
    ];
    for (name, call) in calls {
        let call = with(&[&call, &[name]]);
        for what in ["a symbolic link", "a FIFO", "a folder"] {
            match what {
                "a symbolic link" => std::os::unix::fs::symlink(&target, place(name)).unwrap(),
                "a folder" => fs::create_dir(place(name)).unwrap(),
                _ => mknodat(CWD, place(name), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap(),
            }
            let before = lab.files();
            let stderr = lab.ends(&call, 1);
            assert!(stderr.contains(what) && stderr.contains(name), "{call:?}: {stderr}");
            assert_eq!(lab.files(), before, "{call:?}");
            match what {
                "a folder" => fs::remove_dir(place(name)).unwrap(),
                _ => fs::remove_file(place(name)).unwrap(),
            }
        }
    }
    // The image of a grid map as well; and of a folder of results, what would be replaced.
    std::os::unix::fs::symlink(&target, place("x.pgm")).unwrap();
    fs::create_dir(place("out")).unwrap();
    std::os::unix::fs::symlink(&target, place("out/run-000.tum")).unwrap();
    for call in [vec!["convert", "map.csv", "x.yaml"], with(&[&LOCALIZE, &["-o", "out"]])] {
        let stderr = lab.ends(&call, 1);
        assert!(stderr.contains("a symbolic link"), "{call:?}: {stderr}");
    }
    assert_eq!(fs::read_to_string(&target).unwrap(), "not ours");
}

/// A call, what it may write, and how.
type Call = (&'static [&'static str], &'static [&'static str]);

const CALLS: [Call; 8] = [
    (&["convert", "office.log", "new.mcap"], &["new.mcap"]),
    (&["convert", "office.mcap", "new.log.gz"], &["new.log.gz"]),
    (&["convert", "map.csv", "new.yaml"], &["new.yaml", "new.pgm"]),
    (&["map", "office.log", "--init=grid", "--cell=0.4", "-o", "new.ply"], &["new.ply"]),
    (&["simulate", "-o", "new.log"], &["new.log"]),
    (
        &[
            "evaluate",
            "--reference=reference.tum",
            "estimate.tum",
            "--errors=e.csv",
            "--plot=e.svg",
        ],
        &["e.csv", "e.svg"],
    ),
    (
        &["localize", "office.log", "--map=map.csv", "--particles=20", "--replay=new.mcap"],
        &["new.mcap"],
    ),
    (
        &["localize", "office.log", "--map=map.csv", "--particles=20", "--runs=2", "-o", "out"],
        &[
            "out/reference.tum",
            "out/run-000.csv",
            "out/run-000.tum",
            "out/run-000.watch.json",
            "out/run-001.csv",
            "out/run-001.tum",
            "out/run-001.watch.json",
            "out/summary.json",
        ],
    ),
];

/// The operations on files of a call: how many bytes each writes.
fn operations(lab: &Lab, call: &[&str]) -> Vec<usize> {
    let trace = tempfile::NamedTempFile::new().unwrap();
    let output = lab.command(call).env("MCL_FILE_TRACE", trace.path()).output().unwrap();
    assert!(output.status.success(), "{call:?}: {}", String::from_utf8_lossy(&output.stderr));
    let text = fs::read_to_string(trace.path()).unwrap();
    text.lines().map(|line| line.split(' ').nth(1).unwrap().parse().unwrap()).collect()
}

/// Files other than those that were there, as seen from the folder; the times of runs are in the summary.
fn written(lab: &Lab, before: &BTreeMap<PathBuf, Vec<u8>>) -> BTreeMap<String, Vec<u8>> {
    let is_new = |(path, bytes): &(PathBuf, Vec<u8>)| before.get(path) != Some(bytes);
    let named = |(path, bytes): (PathBuf, Vec<u8>)| {
        let name = path.strip_prefix(lab.0.path()).unwrap().to_str().unwrap().to_owned();
        let is_timed = name.ends_with("summary.json");
        (name, if is_timed { Vec::new() } else { bytes })
    };
    lab.files().into_iter().filter(is_new).map(named).collect()
}

/// Killed between any two operations and within any write, a call leaves whole files or none, and the same call
/// afterwards leaves what an undisturbed one does: once temporary files stayed for good.
#[test]
fn a_call_killed_anywhere_is_repaired_by_the_next() {
    let lab = Lab::new();
    let mut kills = 0;
    for (call, outputs) in CALLS {
        let before = lab.files();
        let operations = operations(&lab, call);
        let whole = written(&lab, &before);
        assert_eq!(whole.keys().map(String::as_str).collect::<Vec<_>>(), {
            let mut outputs = outputs.to_vec();
            outputs.sort_unstable();
            outputs
        });
        let forget = || {
            for path in lab.files().keys().filter(|path| !before.contains_key(*path)) {
                fs::remove_file(path).unwrap();
            }
        };
        for (at, &bytes) in operations.iter().enumerate() {
            for bytes in if bytes > 1 { vec![0, bytes / 2] } else { vec![0] } {
                forget();
                let fault = format!("stop {at} {bytes}");
                let output = lab.command(call).env("MCL_FILE_FAULT", &fault).output().unwrap();
                assert_eq!(output.status.code(), None, "{call:?}, {fault}: it went on");
                kills += 1;
                for (name, found) in written(&lab, &before) {
                    match name.contains(".mcl-eval-") {
                        true => assert!(!outputs.contains(&name.as_str()), "{name}"),
                        false => assert_eq!(found, whole[&name], "{call:?}, {fault}: {name}"),
                    }
                }
                lab.ends(call, 0);
                assert_eq!(written(&lab, &before), whole, "{call:?}, {fault}");
            }
        }
        forget();
    }
    eprintln!("{kills} kills");
    assert!(kills > 80, "{kills}");
}

/// A disk that fills up at any operation costs nothing that was there.
#[test]
fn a_full_disk_leaves_what_was_there() {
    let lab = Lab::new();
    let mut failures = 0;
    // Results of localization are replaced as a whole folder, the old ones first.
    for (call, outputs) in &CALLS[..7] {
        let operations = operations(&lab, call);
        for name in *outputs {
            fs::write(lab.at(name), "old").unwrap();
        }
        let before = lab.files();
        for (at, bytes) in operations.iter().enumerate() {
            for kind in ["full", "fail"] {
                let fault = match kind {
                    "full" => format!("full {at} {}", bytes / 2),
                    _ => format!("fail {at}"),
                };
                let output = lab.command(call).env("MCL_FILE_FAULT", &fault).output().unwrap();
                let stderr = String::from_utf8_lossy(&output.stderr);
                let after = lab.files();
                match output.status.code() {
                    // Removing and renaming take no room.
                    Some(0) => assert_eq!(kind, "full"),
                    Some(1) => {
                        failures += 1;
                        assert!(stderr.contains("full") || stderr.contains("space"), "{stderr}");
                        assert!(after.keys().all(|path| before.contains_key(path)), "{fault}");
                        let kept = |path: &&PathBuf| after.get(*path) == before.get(*path);
                        let lost: Vec<&PathBuf> =
                            before.keys().filter(|path| !kept(path)).collect();
                        // The first of two files may be new; and where the disk is not full but fails at the
                        // very name, a description without its image is gone.
                        if kind == "full" || outputs.len() == 1 {
                            assert!(lost.len() < outputs.len(), "{call:?}, {fault}: {lost:?}");
                        }
                    }
                    code => panic!("{call:?}, {fault}: {code:?}: {stderr}"),
                }
                for (path, bytes) in &before {
                    fs::write(path, bytes).unwrap();
                }
            }
        }
        for name in *outputs {
            fs::remove_file(lab.at(name)).unwrap();
        }
    }
    assert!(failures > 50, "{failures}");
}

/// The temporary name was once longer than the file system allows.
#[test]
fn names_as_long_as_the_file_system_allows_can_be_written() {
    let lab = Lab::new();
    for length in 240..=255 {
        let name = |ending: &str| "x".repeat(length - ending.len()) + ending;
        let (map, bag, errors) = (name(".ply"), name(".mcap"), name(".csv"));
        lab.ends(&["convert", "map.csv", &map], 0);
        assert!(Path::exists(&lab.at(&map)));
        if length % 5 == 0 {
            lab.ends(&["convert", "office.log", &bag], 0);
            lab.ends(&with(&[&LOCALIZE, &["--replay", &bag]]), 0);
            lab.ends(&["map", "office.log", "--init=all", "-o", &name(".yaml")], 0);
            lab.ends(&["simulate", "-o", &name(".log.gz")], 0);
            let evaluate = ["evaluate", "--reference=reference.tum", "estimate.tum"];
            lab.ends(&with(&[&evaluate, &["--errors", &errors, "--plot", &name(".svg")]]), 0);
        }
    }
    let too_long = "x".repeat(252) + ".ply";
    let stderr = lab.ends(&["convert", "map.csv", &too_long], 1);
    assert!(stderr.contains("too long"), "{stderr}");
}

/// A hundred million runs once took 132 GB at once, before the first.
#[cfg(target_os = "linux")]
#[test]
fn memory_for_runs_is_reserved_first() {
    let lab = Lab::new();
    let mut shell = Command::new("sh");
    let program = env!("CARGO_BIN_EXE_mcl-eval");
    shell.current_dir(lab.0.path()).args(["-c", "ulimit -v 3000000; exec \"$0\" \"$@\"", program]);
    let output = shell.args(LOCALIZE).args(["--runs", "100000000"]).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("bytes for errors of runs were refused"), "{stderr}");
}

//! Where a program is let down: no memory, no room on the disk, nobody who reads its output, results
//! folders that cannot be written, and files that lead elsewhere.

use crate::office;
use std::fs::{self, File, OpenOptions};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::office::{Bench, LOCALIZATION, assert_same};

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn bench() -> Bench {
    Bench::new(&[("localization", LOCALIZATION)])
}

/// The program under limits that a shell sets, in the folder of the bench.
fn limited(bench: &Bench, limits: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{limits}; exec \"$0\" \"$@\"")]);
    command.arg(env!("CARGO_BIN_EXE_mcl-eval")).args(arguments).current_dir(bench.path(""));
    command
}

/// Three trials, of which that on all points takes by far the most memory.
#[cfg(target_os = "linux")]
const THREE_TRIALS: &str = r#"
seed = 3
[base]
tolerance = 1e-2
max_iterations = 3
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 20
beams = 10
[[trials]]
split = "same"
map = ["all", "gbs", "gbs+f-km"]
size = 1
runs = 1
[[views.charts]]
name = "errors"
x = { column = "map", scale = "places" }
y = { column = "weighted", scale = "log" }
[[views.pictures]]
name = "trajectory"
maps = [{ map = "gbs+f-km", size = 1 }]
run = 0
"#;

/// Figures of point clouds.
#[cfg(target_os = "linux")]
const LIKELIHOOD: &str = r#"
seed = 1
measures = ["likelihood"]
[base]
tolerance = 1e-2
max_iterations = 3
[[trials]]
map = ["gbs", "gbs+f-km"]
size = [5, 10]
draws = 2
[[views.charts]]
name = "likelihood"
x = { column = "real_percent" }
y = { column = "log_likelihood" }
[[views.pictures]]
name = "maps"
maps = [{ map = "all" }, { map = "gbs", size = 10, offset = "origin" }]
"#;

#[cfg(target_os = "linux")]
#[test]
fn a_trial_without_memory_is_a_row_and_the_rest_go_on() {
    let bench = Bench::new(&[("three", THREE_TRIALS)]);
    let run = |root| ["run", "three.toml", "--dataset", "whole.log", "--threads", "1", "-o", root];
    bench.mcl_eval(&run("undisturbed"));
    let expected = bench.path("undisturbed/three/whole");
    let folder = bench.path("limited/three/whole");
    // How much the program itself takes differs from machine to machine.
    let mut messages = Vec::new();
    let failed = (100..=400).step_by(20).find_map(|megabytes| {
        drop(fs::remove_dir_all(&folder));
        let limits = format!("ulimit -v {}", 1024 * megabytes);
        let output = limited(&bench, &limits, &run("limited"))
            // Otherwise every thread sets 64 MB of addresses aside.
            .env("MALLOC_ARENA_MAX", "1")
            .output()
            .unwrap();
        messages.push(format!("{megabytes} MB: {}\n{}", output.status, message(&output)));
        (output.status.code() == Some(3)).then_some(output)
    });
    let output = failed.unwrap_or_else(|| panic!("never exit 3:\n{}", messages.join("\n")));
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(stdout.contains("2 trials done, 1 failed"), "{stdout}");
    let failures = fs::read_to_string(folder.join("failures.csv")).unwrap();
    assert!(failures.contains("same all σ 0.05 m #0") && failures.contains("out of memory"));
    assert_eq!(failures.lines().count(), 2, "{failures}");
    assert!(message(&output).contains("bytes for"), "{}", message(&output));

    // With the limit lifted, only what is missing is done.
    let output = bench.run(&run("limited"));
    assert!(output.status.success(), "{}", message(&output));
    assert!(message(&output).contains("2 of 3 trials are there already"), "{}", message(&output));
    assert_same(&folder, &expected);
}

/// The pictures of point clouds were asked for without a check, which ended the program.
#[cfg(target_os = "linux")]
#[test]
fn figures_without_memory_are_an_error_that_says_which_and_how_much() {
    let bench = Bench::new(&[("three", THREE_TRIALS), ("likelihood", LIKELIHOOD)]);
    // What the program takes to start, which is mostly its own size.
    let starts = |megabytes: &u32| {
        let limits = format!("ulimit -v {}", 1024 * megabytes);
        let version =
            limited(&bench, &limits, &["--version"]).env("MALLOC_ARENA_MAX", "1").output();
        version.unwrap().status.success()
    };
    let start = (10..400).find(starts).unwrap();
    for experiment in ["three", "likelihood"] {
        let folder = bench.study(experiment, experiment, &[]);
        let expected = office::contents(&folder);
        let figures: Vec<_> =
            expected.keys().filter(|path| path.starts_with("figures")).cloned().collect();
        let mut codes = Vec::new();
        // From where there is memory for rows and texts alone to where there is enough for every figure.
        for megabytes in [10, 40, 90, 140, 360].map(|more| start + more) {
            for figure in &figures {
                drop(fs::remove_file(folder.join(figure)));
            }
            let limits = format!("ulimit -v {}", 1024 * megabytes);
            let output = limited(&bench, &limits, &["plot", experiment, "--threads", "1"])
                .env("MALLOC_ARENA_MAX", "1")
                .output()
                .unwrap();
            codes.push(output.status.code());
            let message = message(&output);
            if message.contains("cannot render") {
                assert_eq!(output.status.code(), Some(1), "{message}");
                let is_named = message.contains(&format!("{experiment}/office/figures/"))
                    && message.contains("bytes for pixels of a ");
                assert!(is_named && !message.contains("backend"), "{message}");
            }
            assert!(!message.contains("memory allocation of"), "{megabytes} MB: {message}");
            // Rows and summaries are as they were, and figures are whole or not there.
            for (path, bytes) in office::contents(&folder) {
                assert!(expected[&path] == bytes, "{megabytes} MB: {}", path.display());
            }
        }
        assert!(codes.contains(&Some(1)) && codes.contains(&Some(0)), "{codes:?}");
        bench.mcl_eval(&["plot", experiment]);
        assert!(office::contents(&folder) == expected);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn particles_without_memory_are_an_error_that_says_how_much() {
    let bench = bench();
    bench.mcl_eval(&["map", "office.log", "--init", "grid", "--size", "100", "-o", "map.csv"]);
    let arguments =
        ["localize", "office.log", "--map", "map.csv", "--particles", "10000000", "--threads", "1"];
    let output = limited(&bench, "ulimit -v 600000", &arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", message(&output));
    assert!(message(&output).contains("bytes for particles were refused"), "{}", message(&output));
}

/// Fault: a compressed image of some kilobytes has a hundred million cells, whose memory was not asked for.
#[cfg(target_os = "linux")]
#[test]
fn a_grid_map_without_memory_is_an_error_that_says_how_much() {
    let bench = bench();
    let mut image = png::Encoder::new(File::create(bench.path("huge.png")).unwrap(), 10_000, 9_999);
    image.set_color(png::ColorType::Grayscale);
    image.set_depth(png::BitDepth::One);
    image.write_header().unwrap().write_image_data(&vec![0; 1_250 * 9_999]).unwrap();
    fs::write(
        bench.path("huge.yaml"),
        "image: huge.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n",
    )
    .unwrap();
    for megabytes in [200, 300, 1000] {
        let arguments = ["convert", "huge.yaml", "huge.csv", "--threads", "1"];
        let limits = format!("ulimit -v {}", 1024 * megabytes);
        let output = limited(&bench, &limits, &arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{megabytes} MB: {}", message(&output));
        assert!(message(&output).contains("were refused"), "{}", message(&output));
    }
}

#[test]
fn a_data_set_without_points_does_not_stop_the_others() {
    let bench = bench();
    // A copy whose readings are all beyond the limit.
    let log = fs::read_to_string(bench.path("office.log")).unwrap();
    let blind: Vec<String> = log
        .lines()
        .map(|line| match line.strip_prefix("FLASER 180 ") {
            Some(rest) => {
                let after: Vec<&str> = rest.split(' ').skip(180).collect();
                format!("FLASER 180 {}{}", "81.83 ".repeat(180), after.join(" "))
            }
            None => line.to_owned(),
        })
        .collect();
    fs::write(bench.path("blind.log"), blind.join("\n") + "\n").unwrap();
    let run = ["run", "localization.toml", "--dataset", "blind.log"];
    let output = bench.run(&run);
    assert_eq!(output.status.code(), Some(1), "{}", message(&output));
    assert!(message(&output).contains("no reading is usable"), "{}", message(&output));

    let output = bench.run(&[&run[..], &["--dataset", "office.log", "--json"]].concat());
    assert_eq!(output.status.code(), Some(3), "{}", message(&output));
    assert!(message(&output).contains("no reading is usable"), "{}", message(&output));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&json["done"], &json["failed"]), (&36.into(), &0.into()));
    assert_eq!(json["lost"][0]["dataset"], "blind.log");
    assert!(json["lost"][0]["reason"].as_str().unwrap().contains("no reading is usable"));
    let expected = bench.study("localization", "expected", &[]);
    assert_same(&bench.path("results/localization/office"), &expected);

    let neither = bench.run(&[&run[..], &["--dataset", "./blind.log"]].concat());
    assert_eq!(neither.status.code(), Some(1), "{}", message(&neither));
}

#[test]
fn a_map_without_points_is_refused() {
    let bench = bench();
    fs::write(bench.path("empty.csv"), "x,y\n").unwrap();
    for command in ["likelihood", "localize"] {
        let output = bench.run(&[command, "office.log", "--map", "empty.csv"]);
        assert_eq!(output.status.code(), Some(1), "{command}");
        let message = message(&output);
        assert!(message.contains("empty.csv") && message.contains("no points"), "{message}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_or_closed_stderr_ends_no_run() {
    let bench = bench();
    let expected = bench.study("localization", "expected", &[]);
    let run = |root| ["run", "localization.toml", "--dataset", "office.log", "-o", root];
    let full = || OpenOptions::new().write(true).open("/dev/full").unwrap();

    // The log of the run is on a full disk: there are notes, for the second run goes on.
    for _ in 0..2 {
        let output = bench.command(&run("stderr")).stderr(full()).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
    }
    assert_same(&bench.path("stderr/localization/office"), &expected);
    let output = bench.command(&["plot", "stderr"]).stderr(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let output = bench.command(&["inspect", "no.log"]).stderr(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));

    // The result is what was asked for: it cannot be printed, but what was saved stays.
    let output = bench.command(&run("stdout")).stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let message = self::message(&output);
    assert!(message.contains("cannot write to standard output"), "{message}");
    assert_same(&bench.path("stdout/localization/office"), &expected);
    for arguments in [&["--help"][..], &["--version"], &["map", "--help"], &["datasets", "list"]] {
        let output = bench.command(arguments).stdout(full()).output().unwrap();
        let message = self::message(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert!(message.contains("cannot write to standard output"), "{message}");
    }
    // What plot prints are notes.
    let output = bench.command(&["plot", "stdout"]).stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(0));
}

#[cfg(unix)]
#[test]
fn readers_that_went_away_and_closed_streams_are_no_error() {
    let bench = bench();
    bench.mcl_eval(&["map", "office.log", "--init", "grid", "--size", "100", "-o", "map.csv"]);
    let commands: [&[&str]; 5] = [
        &["inspect", "office.log"],
        &["likelihood", "office.log", "--map", "map.csv"],
        &["datasets", "list"],
        &["localize", "--help"],
        &["--version"],
    ];
    for arguments in commands {
        for streams in ["exec >&-", "exec 2>&-", "exec <&-", "exec >&- 2>&- <&-"] {
            let output = limited(&bench, streams, arguments).output().unwrap();
            assert_eq!(output.status.code(), Some(0), "{arguments:?} {streams}");
        }
        // A pipe whose reader has gone.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = bench.command(arguments).stdout(writer).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", message(&output));
        assert!(!message(&output).contains("panicked"), "{}", message(&output));
    }
}

/// Files that may not grow beyond a limit stand for a disk that is full, which takes rights to make.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_changes_no_byte_once_there_is_room() {
    let bench = bench();
    let expected = bench.study("localization", "expected", &[]);
    let run = ["run", "localization.toml", "--dataset", "office.log", "-o", "full"];
    let folder = bench.path("full/localization/office");
    let mut codes = Vec::new();
    // In blocks of 512 bytes (dash) or 1024 (bash).
    for blocks in [0, 1, 4, 8, 30, 100, 200] {
        let limits = format!("ulimit -f {blocks}");
        let output = limited(&bench, &limits, &run).output().unwrap();
        let code = output.status.code();
        codes.push(code);
        assert!(matches!(code, Some(0 | 1)), "{blocks}: {code:?} {}", message(&output));
        if code == Some(1) {
            assert!(message(&output).contains("cannot write"), "{}", message(&output));
            assert_whole(&folder, &expected);
        }
    }
    assert!(codes.iter().filter(|code| **code == Some(1)).count() > 3, "{codes:?}");
    bench.study("localization", "full", &[]);
    assert_same(&folder, &expected);

    let limits = "ulimit -f 1";
    let commands: [&[&str]; 5] = [
        &["map", "office.log", "--init", "all", "-o", "new.ply"],
        &["simulate", "-o", "new.log"],
        &["convert", "office.log", "new.mcap"],
        &["claims", "expected", "-o", "new.md"],
        &["localize", "office.log", "--map", "all.csv", "--particles", "5", "--replay", "new.mcap"],
    ];
    bench.mcl_eval(&["map", "office.log", "--init", "all", "-o", "all.csv"]);
    let files = || {
        let mut names: Vec<_> = fs::read_dir(bench.path("")).unwrap().flatten().collect();
        names.sort_by_key(|entry| entry.file_name());
        names.into_iter().map(|entry| entry.file_name()).collect::<Vec<_>>()
    };
    let before = files();
    for arguments in commands {
        let output = limited(&bench, limits, arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", message(&output));
        assert!(message(&output).contains("cannot write"), "{}", message(&output));
        assert_eq!(files(), before, "{arguments:?}");
    }
}

/// Asserts that whatever is there but the files of rows, which grow, is whole ([`office::contents`] leaves those out).
#[cfg(target_os = "linux")]
#[track_caller]
fn assert_whole(folder: &Path, expected: &Path) {
    if !folder.exists() {
        return;
    }
    let expected = office::contents(expected);
    for (path, bytes) in office::contents(folder) {
        assert!(expected.get(&path) == Some(&bytes), "{} is half-written", path.display());
    }
}

#[test]
fn a_results_path_that_is_a_file_is_refused() {
    let bench = bench();
    File::create(bench.path("taken")).unwrap();
    for root in ["taken", "taken/below"] {
        let run = ["run", "localization.toml", "--dataset", "office.log", "-o", root];
        let output = bench.run(&run);
        assert_eq!(output.status.code(), Some(1), "{}", message(&output));
        assert!(message(&output).contains("cannot make taken"), "{}", message(&output));
    }
}

#[test]
fn a_results_folder_that_vanishes_ends_the_run() {
    let long = LOCALIZATION.replace("runs = 2", "runs = 200");
    let bench = Bench::new(&[("long", &long)]);
    let run = ["run", "long.toml", "--dataset", "office.log", "-o", "gone", "--quiet"];
    let mut command = bench.command(&run);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let folder = bench.path("gone/long/office");
    while office::parts(&folder).is_empty() {
        assert!(child.try_wait().unwrap().is_none(), "ended before its folder vanished");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    fs::rename(bench.path("gone"), bench.path("away")).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", message(&output));
    assert!(message(&output).contains("cannot write rows in gone/long"), "{}", message(&output));
}

/// Results may come from anywhere: drawing them must not write elsewhere.
#[test]
fn a_study_that_names_figures_elsewhere_is_refused() {
    let study = r#"
seed = 1
[base]
tolerance = 1e-2
max_iterations = 3
particles = 20
beams = 10
[[trials]]
map = "gbs"
size = 5
sigma_hit = [0.1, 0.3]
draws = 2
runs = 1
[[views.charts]]
name = "noise"
x = { column = "sigma_hit" }
y = { column = "weighted" }
[[dataset]]
name = "office"
"#;
    let bench = Bench::new(&[("study", study)]);
    let folder = bench.study("study", "results", &[]);
    bench.mcl_eval(&["plot", "results"]);
    for name in ["../../../../elsewhere", "/elsewhere", "a/b", "", "C:elsewhere"] {
        let hostile = study.replace("\"noise\"", &format!("{name:?}"));
        assert_ne!(hostile, study);
        fs::write(folder.join("study.toml"), hostile).unwrap();
        let output = bench.run(&["plot", "results"]);
        assert_eq!(output.status.code(), Some(1), "{name}: {}", message(&output));
        assert!(message(&output).contains("views.charts"), "{}", message(&output));
    }
    // Nor is anything read elsewhere.
    let hostile = study.replace("\"office\"", "\"../../office\"");
    fs::write(bench.path("study.toml"), hostile).unwrap();
    let output = bench.run(&["run", "study.toml", "--dataset", "office.log"]);
    assert_eq!(output.status.code(), Some(1), "{}", message(&output));
    assert!(message(&output).contains("dataset.name is \"../../office\""), "{}", message(&output));
}

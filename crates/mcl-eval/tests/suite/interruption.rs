//! Runs that are killed, interrupted or doubled, and trials that fail.

use std::fs;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::office::{Bench, LOCALIZATION, assert_same, parts, rows};
use mcl_core::Seed;
use rand::RngExt;

const RUN: [&str; 6] = ["run", "localization.toml", "--dataset", "office.log", "--quiet", "-o"];

fn bench() -> Bench {
    // Long enough to be hit, and no more: 36 trials.
    Bench::new(&[("localization", LOCALIZATION)])
}

fn start(bench: &Bench, root: &str) -> Child {
    let mut command = bench.command(&[&RUN[..], &[root]].concat());
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn fifty_kills_change_no_byte() {
    let bench = bench();
    let start_of_run = Instant::now();
    let undisturbed = bench.study("localization", "undisturbed", &[]);
    let whole = start_of_run.elapsed().as_secs_f64();
    let killed = bench.path("killed/localization/office");
    let mut rng = Seed::new(50).rng();
    let (mut kills, mut finished) = (0, 0);
    while kills < 50 {
        let mut child = start(&bench, "killed");
        // Most of it in the first part, for little is left to do after some kills.
        sleep(Duration::from_secs_f64(0.35 * whole * rng.random::<f64>()));
        if child.try_wait().unwrap().is_none() {
            child.kill().unwrap();
            kills += 1;
        } else {
            finished += 1;
        }
        let output = child.wait_with_output().unwrap();
        if output.status.success() {
            assert_same(&killed, &undisturbed);
            fs::remove_dir_all(&killed).unwrap();
        } else if let Some(code) = output.status.code() {
            panic!("exit {code}: {}", String::from_utf8_lossy(&output.stderr));
        }
    }
    bench.study("localization", "killed", &[]);
    assert_same(&killed, &undisturbed);
    eprintln!("{kills} kills, {finished} runs came to their end in between");
}

/// Rows that were saved, whole or not.
fn saved(bench: &Bench, root: &str) -> String {
    let files = parts(&bench.path(root).join("localization/office"));
    files.iter().map(|path| fs::read_to_string(path).unwrap()).collect()
}

/// Starts a run and waits until it has saved a row.
fn start_and_wait(bench: &Bench, root: &str) -> Child {
    let mut child = start(bench, root);
    // The first line says what the rows depend on.
    while saved(bench, root).lines().count() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
        sleep(Duration::from_millis(1));
    }
    child
}

/// Every process appends to a file of its own and reads those of all: no lock is needed, nothing is refused.
#[test]
fn two_runs_into_one_folder_end_as_one() {
    let bench = bench();
    let undisturbed = bench.study("localization", "undisturbed", &[]);
    let together = bench.path("together/localization/office");
    for delay in [0, 100, 400] {
        let first = start(&bench, "together");
        sleep(Duration::from_millis(delay));
        let second = start(&bench, "together");
        for run in [first, second] {
            let output = run.wait_with_output().unwrap();
            let message = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{delay} ms: {message}");
        }
        assert_same(&together, &undisturbed);
        fs::remove_dir_all(&together).unwrap();
    }
    // The rows of a run that is killed are those of the other.
    let mut first = start_and_wait(&bench, "together");
    let second = start(&bench, "together");
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(second.wait_with_output().unwrap().status.success());
    assert_same(&together, &undisturbed);
}

#[cfg(unix)]
#[test]
fn an_interrupt_says_how_to_continue() {
    // So many runs that nobody has to hurry.
    let bench = Bench::new(&[("localization", &LOCALIZATION.replace("runs = 2", "runs = 200"))]);
    let child = start_and_wait(&bench, "out");
    let process = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(process, rustix::process::Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{message}");
    assert!(message.contains("the same command continues"), "{message}");
    let saved = saved(&bench, "out");
    assert!(saved.ends_with('\n') && saved.lines().count() > 1, "{saved}");
}

#[test]
fn trials_that_fail_are_rows_with_the_reason() {
    let bench = bench();
    // The odometry from the tenth scan on is lost: more than can be bridged, on odd scans and on all.
    let log = fs::read_to_string(bench.path("office.log")).unwrap();
    let mut scans = 0;
    let kept = log.lines().filter(|line| {
        scans += usize::from(line.starts_with("FLASER"));
        !(line.starts_with("ODOM") && scans >= 10)
    });
    fs::write(bench.path("gap.log"), kept.collect::<Vec<_>>().join("\n") + "\n").unwrap();
    let output = bench.run(&["run", "localization.toml", "--dataset", "gap.log"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    // That which the picture shows is one of them.
    assert!(message.contains("36 of 36 trials failed"), "{message}");
    // The same reason is printed once: of either split the number of steps differs.
    assert_eq!(message.matches("has no odometry increment").count(), 2, "{message}");
    let failures = rows(&bench.path("results/localization/gap/failures.csv"));
    assert_eq!(failures.len(), 36);
    assert!(failures.iter().all(|row| row["reason"].contains("has no odometry increment")));

    // Some fail: the others are rows, and the exit code says that not all is there.
    let maps = LOCALIZATION
        .replace("[views.summary]", "[[trials]]\nmap = \"rnd\"\nsize = 5\n[views.summary]");
    fs::write(bench.path("localization.toml"), maps).unwrap();
    let output = bench.run(&["run", "localization.toml", "--dataset", "gap.log", "--json"]);
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["trials"].as_u64(), json["done"].as_u64()), (Some(37), Some(1)));
    assert_eq!(rows(&bench.path("results/localization/gap/trials.csv")).len(), 1);
}

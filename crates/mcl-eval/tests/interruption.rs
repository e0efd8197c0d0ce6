//! Runs that are killed, interrupted or doubled, and trials that fail.

mod office;

use std::fs;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use mcl_core::Seed;
use office::{Bench, LOCALIZATION, assert_same};
use rand::RngExt;

const RUN: [&str; 6] = ["run", "localization.toml", "--dataset", "office.log", "--quiet", "-o"];

fn bench() -> Bench {
    // Long enough to be hit, and no more: 20 trials.
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
    let undisturbed = bench.experiment("localization", "undisturbed", &[]);
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
    bench.experiment("localization", "killed", &[]);
    assert_same(&killed, &undisturbed);
    eprintln!("{kills} kills, {finished} runs came to their end in between");
}

/// Starts a run and waits until it has saved a row.
fn start_and_wait(bench: &Bench, root: &str) -> Child {
    let mut child = start(bench, root);
    let rows = bench.path(root).join("localization/office/trials.csv");
    while fs::metadata(&rows).map_or(true, |file| file.len() == 0) {
        assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
        sleep(Duration::from_millis(1));
    }
    child
}

/// As [`LOCALIZATION`], with so many runs that nobody has to hurry.
fn long_bench() -> Bench {
    Bench::new(&[("localization", &LOCALIZATION.replace("runs = 4", "runs = 400"))])
}

#[test]
fn two_runs_into_one_folder_are_refused() {
    let bench = long_bench();
    let mut first = start_and_wait(&bench, "out");
    let second = bench.run(&[&RUN[..], &["out"]].concat());
    first.kill().unwrap();
    first.wait().unwrap();
    let message = String::from_utf8_lossy(&second.stderr);
    assert_eq!(second.status.code(), Some(1), "{message}");
    assert!(message.contains("another run is writing to") && message.contains("-o"), "{message}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_says_how_to_go_on() {
    let bench = long_bench();
    let child = start_and_wait(&bench, "out");
    let process = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(process, rustix::process::Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{message}");
    assert!(message.contains("the same command goes on"), "{message}");
    let rows = fs::read_to_string(bench.path("out/localization/office/trials.csv")).unwrap();
    assert!(rows.ends_with('\n') && rows.lines().count() > 1, "{rows}");
}

#[test]
fn trials_that_fail_are_rows_with_the_reason() {
    let bench = bench();
    // The odometry between two scans of the second half is lost: held-out runs and runs on all scans
    // cannot get past it.
    let log = fs::read_to_string(bench.path("office.log")).unwrap();
    let mut scans = 0;
    let kept = log.lines().filter(|line| {
        scans += usize::from(line.starts_with("FLASER"));
        !(line.starts_with("ODOM") && scans == 30)
    });
    fs::write(bench.path("gap.log"), kept.collect::<Vec<_>>().join("\n") + "\n").unwrap();
    let output = bench.run(&["run", "localization.toml", "--dataset", "gap.log"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("20 of 20 trials failed"), "{message}");
    // The same reason is told once.
    assert_eq!(message.matches("has no odometry increment").count(), 1, "{message}");
    let failures = bench.path("results/localization/gap/failures.csv");
    assert_eq!(csv::Reader::from_path(failures).unwrap().records().count(), 20);
}

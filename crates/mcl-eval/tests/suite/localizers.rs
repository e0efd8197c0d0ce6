//! Programs of others in a study, as a user runs them: those that work, and those that misbehave in every way.

use crate::office;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::office::{Bench, rows};
use mcl_datasets::log::read_log;
use mcl_metrics::tum::{self, NonPlanar};
use rustix::process::{Pid, Signal, kill_process, test_kill_process};

const HEAD: &str = r#"
seed = 4
[base]
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 50
beams = 20
"#;

/// Writes the start pose at the stamp of every scan.
const STILL: &str = r#"#!/bin/sh
echo $$ >> "$PIDS"
awk '
FNR == NR { gsub(/[",:]/, " "); if ($1 == "robot") { here = 1 } else if (here && NF == 2) { start[$1] = $2 }
            if ($1 == "laser") { here = 0 } next }
/^FLASER/ { print $(NF - 2), start["x"], start["y"], 0, 0, 0, sin(start["theta"] / 2), cos(start["theta"] / 2) }
' start.json run.log > "$1"
"#;

/// A localizer that runs a script beside the study.
fn localizer(name: &str, limits: &str) -> String {
    format!(
        r#"
[localizer.{name}]
command = ["sh", "{{study}}/{name}.sh", "{{output}}"]
log = "carmen"
map = "csv"
files = ["{name}.sh"]
environment = {{ PIDS = "{{study}}/pids" }}
{limits}
"#
    )
}

fn trials(names: &[&str], more: &str) -> String {
    format!("[[trials]]\nmap = \"gbs\"\nsize = 5\nlocalizer = {names:?}\n{more}\n")
}

fn by_localizer(folder: &Path) -> BTreeMap<String, BTreeMap<String, String>> {
    rows(&folder.join("trials.csv"))
        .into_iter()
        .map(|row| (row["localizer"].clone(), row))
        .collect()
}

/// Processes that scripts started.
fn pids(bench: &Bench) -> Vec<i32> {
    let text = fs::read_to_string(bench.path("pids")).unwrap_or_default();
    text.lines().map(|line| line.parse().unwrap()).collect()
}

fn is_alive(pid: i32) -> bool {
    // One that nobody has waited for yet does nothing any more.
    let state = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    test_kill_process(Pid::from_raw(pid).unwrap()).is_ok() && !state.contains(") Z ")
}

/// Whatever a program does, there is a row that says so, and nothing of it is left.
#[test]
fn programs_that_misbehave_are_rows_with_their_reasons() {
    let half = STILL.replace("> \"$1\"", "| head -n 20 > \"$1\"\nprintf '999999 1.5 2' >> \"$1\"");
    let scripts: [(&str, &str, String, &str); 13] = [
        ("still", "time_limit = 60", STILL.to_owned(), "ok"),
        ("hangs", "time_limit = 1", "echo $$ >> $PIDS\nexec sleep 1000\n".into(), "time limit"),
        // The shell ignores the signal, and so does what it starts.
        (
            "stubborn",
            "time_limit = 1",
            format!("trap '' TERM\n{STILL}\nwhile :; do sleep 1; done\n"),
            "time limit",
        ),
        ("crashes", "time_limit = 60", "echo no map >&2\nexit 7\n".into(), "exit code 7"),
        ("killed", "time_limit = 60", "kill -9 $$\n".into(), "signal 9"),
        (
            "floods",
            "time_limit = 60",
            format!("head -c 300000000 /dev/zero >&2\necho the end >&2\n{STILL}\nexit 1\n"),
            "exit code 1",
        ),
        ("half", "time_limit = 60", half.clone(), "malformed output: estimate, line 21: 3 fields"),
        ("cut", "time_limit = 60", format!("{half}\nexit 3\n"), "exit code 3"),
        (
            "nan",
            "time_limit = 60",
            STILL.replace("start[\"y\"], 0", "\"nan\", 0"),
            "malformed output: estimate, line 1, field y: found \"nan\", expected a finite number",
        ),
        (
            "backwards",
            "time_limit = 60",
            STILL.replace("> \"$1\"", "| sort -r > \"$1\""),
            "malformed output: pose 2: its stamp ",
        ),
        (
            "large",
            "time_limit = 60\noutput_limit = 5",
            "echo $$ >> $PIDS\nhead -c 10000000000 /dev/zero > large\n".into(),
            "output limit",
        ),
        ("leaves", "time_limit = 60", format!("sleep 1000 &\necho $! >> $PIDS\n{STILL}"), "ok"),
        ("nothing", "time_limit = 60", "cat > /dev/null\n".into(), "no output"),
    ];
    let mut study = HEAD.to_owned();
    let mut names = vec!["own"];
    for (name, limits, ..) in &scripts {
        study += &localizer(name, limits);
        names.push(name);
    }
    study += &trials(&names, "runs = 1");
    // A picture of what there is.
    study += "[[views.pictures]]\nname = \"paths\"\nrun = 0\nmaps = [\n";
    for name in ["own", "cut", "nothing"] {
        study += &format!("{{ map = \"gbs\", size = 5, localizer = \"{name}\" }},\n");
    }
    study += "]\n";
    let bench = Bench::new(&[("many", &study)]);
    for (name, _, script, _) in &scripts {
        fs::write(bench.path(&format!("{name}.sh")), script).unwrap();
    }
    let since = Instant::now();
    let output = bench.run(&["run", "many.toml", "--dataset", "office.log", "-o", "out", "--json"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(since.elapsed() < Duration::from_secs(60), "{:?}", since.elapsed());
    assert!(stderr.contains("this study runs programs"), "{stderr}");
    assert!(stderr.contains("crashes: sh {study}/crashes.sh {output}"), "{stderr}");
    assert!(stderr.contains("1 of 1 runs of hangs failed (time limit: 1)"), "{stderr}");
    let folder = bench.path("out/many/office");
    let found = by_localizer(&folder);
    assert_eq!(found.len(), names.len());
    for (name, _, _, ended) in &scripts {
        assert!(found[*name]["ended"].starts_with(ended), "{name}: {}", found[*name]["ended"]);
    }
    let started = pids(&bench);
    assert!(started.len() >= 8, "{started:?}");
    assert!(!started.iter().any(|&pid| is_alive(pid)), "{started:?}");
    assert!(!folder.join("running").exists());
    assert!(folder.join("figures/paths.svg").exists());

    // What was written counts, as far as it goes: a robot that is taken to stand still.
    let number = |name: &str, column: &str| found[name][column].parse::<f64>().unwrap();
    for name in ["still", "stubborn", "floods", "leaves"] {
        assert_eq!(number(name, "coverage"), 1.0, "{name}");
        assert_eq!(found[name]["weighted"], found["still"]["weighted"]);
    }
    assert!(number("still", "weighted") > 3.0 * number("own", "weighted"));
    assert_eq!(number("cut", "coverage"), 0.5);
    assert!(number("cut", "lost_share") >= 0.5);
    for name in ["hangs", "crashes", "half", "nan", "backwards", "large", "nothing"] {
        let row = &found[name];
        assert_eq!(
            [&*row["coverage"], &*row["weighted"], &*row["diverged"]],
            ["0", "", "true"],
            "{name}"
        );
        assert_eq!(row["lost_share"], "1", "{name}");
    }
    let row = &found["still"];
    assert_eq!(["preset", "particles", "used_beams", "resamplings"].map(|c| &*row[c]), [""; 4]);
    assert_eq!(row["noise_xy"], found["own"]["noise_xy"]);
    assert!(number("floods", "processor_s") > 0.0 && number("own", "processor_s") > 0.0);
    if cfg!(target_os = "linux") {
        assert!((0.5..100.0).contains(&number("hangs", "peak_memory_mb")));
    }

    // What failed is named, with the end of what it said.
    let failures = rows(&folder.join("failures.csv"));
    assert_eq!(failures.len(), scripts.iter().filter(|(.., ended)| *ended != "ok").count());
    let reason = |name: &str| {
        let row = failures.iter().find(|row| row["trial"].contains(name)).unwrap();
        let (ended, file) = row["reason"].rsplit_once(" (").unwrap();
        let text = fs::read(folder.join(file.trim_end_matches(')'))).unwrap();
        assert!(text.len() < 200_000, "{}", text.len());
        (ended.to_owned(), String::from_utf8(text).unwrap())
    };
    let (ended, text) = reason("crashes");
    assert_eq!(ended, "exit code 7");
    assert!(text.contains("\nno map\n"), "{text}");
    assert!(reason("floods").1.contains("the end"));

    // Rows are there: nothing is run again, and what shows rows runs nothing either.
    for command in
        [&["run", "many.toml", "--dataset", "office.log", "-o", "out"][..], &["plot", "out"]]
    {
        bench.mcl_eval(command);
        assert_eq!(pids(&bench), started, "{command:?}");
    }
    assert_eq!(rows(&folder.join("failures.csv")), failures);
    bench.mcl_eval(&["run", "many.toml", "--dataset", "office.log", "-o", "out", "--list"]);
    assert_eq!(pids(&bench), started);
}

/// A process that leaves the group of its program is found by its environment.
#[cfg(target_os = "linux")]
#[test]
fn processes_that_leave_the_group_or_grow_are_ended() {
    let escapes = format!("setsid sleep 1000 &\necho $! >> $PIDS\n{STILL}");
    let grows = "awk 'BEGIN { for (i = 0; ; i++) a[i] = i }'\n";
    let limits = ["time_limit = 60", "time_limit = 60\nmemory_limit = 60"];
    let study = [
        HEAD,
        &localizer("escapes", limits[0]),
        &localizer("grows", limits[1]),
        &trials(&["escapes", "grows"], "runs = 1"),
    ];
    let bench = Bench::new(&[("two", &study.concat())]);
    fs::write(bench.path("escapes.sh"), escapes).unwrap();
    fs::write(bench.path("grows.sh"), grows).unwrap();
    let found = by_localizer(&bench.study("two", "out", &[]));
    assert_eq!([&*found["escapes"]["ended"], &*found["grows"]["ended"]], ["ok", "memory limit"]);
    assert!(found["grows"]["peak_memory_mb"].parse::<f64>().unwrap() > 60.0);
    let started = pids(&bench);
    assert_eq!(started.len(), 2);
    assert!(!started.iter().any(|&pid| is_alive(pid)), "{started:?}");
}

/// Rows of a deterministic program depend on nothing but the study, apart from times; the own filter's are those of a
/// study without programs.
#[test]
fn rows_are_the_same_on_any_number_of_threads() {
    let with = [
        HEAD,
        &localizer("still", "time_limit = 60"),
        &trials(&["own", "still"], "draws = 2\nruns = 2"),
        "[[views.tests]]\ny = \"translation\"\ncolumn = \"localizer\"\n[views.summary]\ncolumns = [\"coverage\", \"processor_s\"]\n",
    ]
    .concat();
    let without = format!("{HEAD}[[trials]]\nmap = \"gbs\"\nsize = 5\ndraws = 2\nruns = 2\n");
    let bench = Bench::new(&[("with", &with), ("without", &without)]);
    fs::write(bench.path("still.sh"), STILL).unwrap();
    let one = bench.study("with", "one", &["--threads", "1"]);
    let two = bench.study("with", "two", &["--threads", "2"]);
    bench.mcl_eval(&["compare", "one", "two"]);
    let own = rows(&bench.study("without", "one", &[]).join("trials.csv"));
    let all = rows(&two.join("trials.csv"));
    assert_eq!((all.len(), own.len()), (8, 4));
    let of_own = all.iter().filter(|row| row["localizer"] == "own");
    for (row, own) in of_own.zip(&own) {
        assert!(!own.contains_key("localizer") && !own.contains_key("ended"));
        for (column, value) in own {
            assert_eq!(&row[column], value, "{column}");
        }
    }
    // In pairs, over draws.
    let tests = rows(&one.join("tests.csv"));
    assert_eq!(tests.len(), 1);
    assert_eq!([&*tests[0]["a"], &*tests[0]["b"], &*tests[0]["blocks"]], ["own", "still", "2"]);
    let summary = rows(&one.join("summary.csv"));
    let names: Vec<&str> = summary.iter().map(|row| &*row["localizer"]).collect();
    assert_eq!(names, ["own", "still"]);
    assert!(!summary[0].contains_key("particles"));

    // Another program is another row.
    fs::write(bench.path("still.sh"), format!("{STILL}\necho done\n")).unwrap();
    let before = pids(&bench).len();
    bench.study("with", "one", &[]);
    assert_eq!(pids(&bench).len(), before + 4);
}

/// Whoever ends the run ends its programs, and their rows are not there.
#[test]
fn an_interrupted_run_leaves_no_program() {
    let study = [HEAD, &localizer("hangs", "time_limit = 1000"), &trials(&["hangs"], "runs = 1")];
    let bench = Bench::new(&[("one", &study.concat())]);
    let script = "echo $$ >> $PIDS\nsleep 1000 &\necho $! >> $PIDS\nwait\n";
    fs::write(bench.path("hangs.sh"), script).unwrap();
    for (signal, code) in [(Signal::INT, 130), (Signal::TERM, 143)] {
        fs::write(bench.path("pids"), "").unwrap();
        let mut command =
            bench.command(&["run", "one.toml", "--dataset", "office.log", "-o", "out"]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while pids(&bench).len() < 2 {
            assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
            sleep(Duration::from_millis(5));
        }
        assert!(pids(&bench).iter().all(|&pid| is_alive(pid)));
        kill_process(Pid::from_child(&child), signal).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(code));
        assert!(!pids(&bench).iter().any(|&pid| is_alive(pid)));
        let parts = office::parts(&bench.path("out/one/office"));
        let saved: String = parts.iter().map(|path| fs::read_to_string(path).unwrap()).collect();
        assert!(!saved.contains("\"trial\":{"), "{saved}");
    }
    // A later run removes what was left of the program's folder.
    fs::write(bench.path("hangs.sh"), "exit 2\n").unwrap();
    assert_eq!(by_localizer(&bench.study("one", "out", &[]))["hangs"]["ended"], "exit code 2");
    assert!(!bench.path("out/one/office/running").exists());
}

/// A program that is not there is no result: the trial fails, and is run once the program is there.
#[test]
fn a_program_that_cannot_be_started_is_a_failed_trial() {
    let study =
        [HEAD, &localizer("still", "time_limit = 60"), &trials(&["own", "still"], "runs = 1")];
    let study = study.concat().replace("\"sh\"", "\"{study}/program\"");
    let bench = Bench::new(&[("one", &study)]);
    fs::write(bench.path("still.sh"), STILL).unwrap();
    let output = bench.run(&["run", "one.toml", "--dataset", "office.log", "-o", "out"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("cannot start") && stderr.contains("/program"), "{stderr}");
    std::os::unix::fs::symlink("/bin/sh", bench.path("program")).unwrap();
    let found = by_localizer(&bench.study("one", "out", &[]));
    assert_eq!(found["still"]["ended"], "ok");
}

/// What is exported says nothing of where the robot was, and comes back through `evaluate`.
#[test]
fn exported_runs_hold_no_truth_and_can_be_evaluated() {
    let disturbed = "split = \"alternate\"\nruns = 1\ndisturbance = { kidnapped = { at = 0.5 } }\n";
    let study = [
        HEAD,
        &localizer("still", "time_limit = 60"),
        &trials(&["own", "still"], disturbed),
        &trials(&["own"], "runs = 1\ninitial_pose = { kind = \"uniform\" }"),
    ];
    let bench = Bench::with_scans(400, &[("some", &study.concat())]);
    fs::write(bench.path("still.sh"), STILL).unwrap();
    let export = ["export", "some.toml", "--dataset", "office.log"];
    let listed = bench.mcl_eval(&[&export[..], &["--list", "--json"]].concat());
    let listed: serde_json::Value = serde_json::from_str(&listed).unwrap();
    let names =
        listed["runs"].as_array().unwrap().iter().map(|run| run["localizer"].as_str().unwrap());
    assert_eq!(names.collect::<Vec<_>>(), ["own", "still", "own"]);

    for (log, file, map) in [
        ("mcap", "run.mcap", "ply"),
        ("bag", "run.bag", "grid"),
        ("db3", "run.db3", "csv"),
        ("carmen", "run.log", "pcd"),
    ] {
        bench.mcl_eval(
            &[&export[..], &["--run", "1", "--log", log, "--map", map, "-o", log]].concat(),
        );
        let folder = bench.path(log).join("run-1");
        let exported = read_log(&folder.join(file)).unwrap().recording;
        assert_eq!(exported.scans.len(), 200, "{log}");
        assert!(exported.has_odometry() && !exported.has_reference(), "{log}");
        assert!(exported.scans.iter().all(|scan| scan.map_from_laser.is_none()), "{log}");
        let reference =
            tum::read_file(bench.path(log).join("run-1.tum"), NonPlanar::Refuse).unwrap();
        let stamps: Vec<_> = exported.scans.iter().map(|scan| scan.stamp.unwrap()).collect();
        assert_eq!(reference.trajectory.stamps(), stamps, "{log}");
        assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "{log}");
        let poses = reference.trajectory.poses();
        assert!(poses[99].distance(&poses[100]) >= 5.0, "the robot was carried off");
        let run = fs::read_to_string(folder.join("run.json")).unwrap();
        let run: serde_json::Value = serde_json::from_str(&run).unwrap();
        assert_eq!(run["made_stamps"].as_u64().map(|made| made > 0), Some(true), "{log}");
        assert_eq!(run["first_stamp"], stamps[0].to_string());
        assert_eq!(run["start"]["robot"]["x"].as_f64(), Some(poses[0].x), "{log}");
        // Nothing but the start is of the reference.
        let text = fs::read_to_string(folder.join("start.json")).unwrap() + &run.to_string();
        assert!(
            !text.contains(&poses[1].x.to_string()) && !text.contains(&poses[150].x.to_string())
        );
    }
    // The same odometry as the own filter's, whatever the format.
    let steps = |path: &str| -> Vec<_> {
        let log = read_log(&bench.path(path)).unwrap().recording;
        log.scans.iter().skip(1).map(|scan| scan.odometry.unwrap()).collect()
    };
    for (a, b) in steps("mcap/run-1/run.mcap").iter().zip(&steps("carmen/run-1/run.log")) {
        assert!(a.distance(b) < 1e-9 && (a.theta - b.theta).abs() < 1e-9, "{a:?} {b:?}");
    }

    // A run elsewhere has the error that the study says.
    bench.mcl_eval(&[&export[..], &["--run", "2", "--run", "3", "-o", "ex"]].concat());
    let unknown = fs::read_to_string(bench.path("ex/run-3/start.json")).unwrap();
    assert_eq!(unknown, "{\n  \"kind\": \"unknown\"\n}\n");
    let status = Command::new("sh")
        .args(["../../still.sh", "estimate"])
        .current_dir(bench.path("ex/run-2"))
        .env("PIDS", bench.path("pids"))
        .status();
    assert!(status.unwrap().success());
    let printed = bench.mcl_eval(&[
        "evaluate",
        "--reference",
        "ex/run-2.tum",
        "ex/run-2/estimate",
        "--frame",
        "robot",
        "--json",
    ]);
    let json: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let row = &by_localizer(&bench.study("some", "out", &[]))["still"];
    let of_study: f64 = row["weighted"].parse().unwrap();
    let elsewhere = json["estimates"][0]["weighted"]["mean"].as_f64().unwrap();
    assert!((of_study - elsewhere).abs() < 1e-9, "{of_study} {elsewhere}");
    // Nothing is written over.
    let again = bench.run(&[&export[..], &["--run", "2", "-o", "ex"]].concat());
    assert_eq!(again.status.code(), Some(1));
    assert_eq!(
        bench.run(&[&export[..], &["--run", "4", "-o", "ex"]].concat()).status.code(),
        Some(2)
    );
}

/// The study and the localizer that docs/localizers.md shows.
#[test]
fn the_example_of_the_docs_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let docs = fs::read_to_string(root.join("docs/localizers.md")).unwrap();
    let study = docs.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let bench = Bench::with_scans(80, &[("mine", study)]);
    if Command::new("python3").arg("--version").output().is_err() {
        eprintln!("there is no python3 here, which the example is for");
        return;
    }
    fs::create_dir(bench.path("localizers")).unwrap();
    let program = "localizers/particle_filter.py";
    fs::copy(root.join("experiments").join(program), bench.path(program)).unwrap();
    let folder = bench.study("mine", "out", &[]);
    let found = rows(&folder.join("trials.csv"));
    let of_program: Vec<_> = found.iter().filter(|row| row["localizer"] == "page").collect();
    assert_eq!((found.len(), of_program.len()), (12, 6));
    for row in of_program {
        assert_eq!([&*row["ended"], &*row["coverage"], &*row["diverged"]], ["ok", "1", "false"]);
        let error: f64 = row["translation"].parse().unwrap();
        assert!((1e-3..0.15).contains(&error), "{error}");
    }
    assert!(folder.join("figures/localizers.svg").exists());
    assert_eq!(rows(&folder.join("tests.csv")).len(), 2);
}

//! What broke results, outputs and terminals once, as a user meets it.

use crate::office;
use std::fs;
use std::path::Path;

use crate::office::{Bench, assert_same, parts, rows};

const MAPS: &str = r#"
seed = 3
measures = ["likelihood"]
[[trials]]
map = ["gbs", "rnd"]
size = 5
draws = 3
[[views.tests]]
y = "log_likelihood"
pairs = [["gbs", "rnd"]]
[[views.charts]]
name = "chart"
x = { column = "real_percent" }
y = { column = "log_likelihood" }
"#;

fn bench() -> Bench {
    Bench::with_scans(10, &[("maps", MAPS)])
}

fn message(output: &std::process::Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Field case `one-torn-folder-stops-all`.
#[test]
fn a_damaged_folder_stops_no_other() {
    let bench = bench();
    for name in ["a", "b", "c", "d"] {
        let log = format!("{name}.log");
        fs::copy(bench.path("office.log"), bench.path(&log)).unwrap();
        bench.mcl_eval(&["run", "maps.toml", "--dataset", &log]);
    }
    let at = |name: &str| bench.path("results/maps").join(name);
    fs::write(at("a").join("manifest.json"), "{").unwrap();
    #[cfg(unix)]
    {
        fs::rename(at("b").join("trials.csv"), bench.path("precious")).unwrap();
        std::os::unix::fs::symlink(bench.path("precious"), at("b").join("trials.csv")).unwrap();
    }
    let before = office::contents(&at("d"));
    for table in ["trials.csv", "tests.csv"] {
        fs::remove_file(at("d").join(table)).unwrap();
    }
    let output = bench.run(&["plot"]);
    let text = message(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(text.contains("leaving out results/maps/a: ") && text.contains("--fresh"), "{text}");
    #[cfg(unix)]
    assert!(
        text.contains("leaving out results/maps/b: ") && text.contains("symbolic link"),
        "{text}"
    );
    assert!(office::contents(&at("d")) == before);

    // A study on another data set of the root ends well, too.
    let first = parts(&at("c"))[0].clone();
    let bytes = fs::read(&first).unwrap();
    fs::write(&first, &bytes[..bytes.len() - 5]).unwrap();
    bench.mcl_eval(&["run", "maps.toml", "--dataset", "d.log"]);
    // Nothing can be drawn where no folder can be read.
    for name in ["b", "c", "d"] {
        fs::remove_dir_all(at(name)).unwrap();
    }
    let output = bench.run(&["plot"]);
    assert_eq!(output.status.code(), Some(1), "{}", message(&output));
}

/// Damage is reported, the trial is run again, and then all is there.
#[test]
fn damaged_rows_are_reported_and_computed_again() {
    let bench = bench();
    let folder = bench.study("maps", "results", &[]);
    let whole = bench.study("maps", "whole", &[]);
    let [path] = &parts(&folder)[..] else { panic!("expected one file of rows") };
    let text = fs::read_to_string(path).unwrap();
    let damaged = text.replacen("\"draw\"", "\"drew\"", 3);
    fs::write(path, damaged).unwrap();
    let output = bench.run(&["run", "maps.toml", "--dataset", "office.log", "--json"]);
    let text = message(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert_eq!(text.matches("damaged, left out").count(), 3, "{text}");
    assert!(text.contains("3 of 6 trials are there already"), "{text}");
    assert_same(&folder, &whole);
}

/// Field case `compare-and-links`: links to the folder itself were followed through 2^40 paths, and an empty
/// folder was found equal.
#[test]
fn compare_follows_no_loops_and_needs_something_to_compare() {
    let bench = bench();
    bench.study("maps", "results", &[]);
    #[cfg(unix)]
    for link in ["a", "b"] {
        std::os::unix::fs::symlink(".", bench.path("results").join(link)).unwrap();
    }
    let printed = bench.mcl_eval(&["compare", "results", "results"]);
    assert!(printed.ends_with("files agree\n"), "{printed}");
    fs::create_dir_all(bench.path("empty/maps/office")).unwrap();
    // Times are no results.
    fs::copy(
        bench.path("results/maps/office/timings.csv"),
        bench.path("empty/maps/office/timings.csv"),
    )
    .unwrap();
    for expected in ["empty", "absent"] {
        let output = bench.run(&["compare", "results", expected]);
        assert_eq!(output.status.code(), Some(1), "{}", message(&output));
        assert!(message(&output).contains(expected), "{}", message(&output));
    }
    let output = bench.run(&["compare", "empty", "results"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(message(&output).contains("trials.csv is missing"), "{}", message(&output));
    #[cfg(unix)]
    {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        let pipe = bench.path("empty/maps/office/trials.csv");
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let output = bench.run(&["compare", "empty", "results"]);
        assert_eq!(output.status.code(), Some(1));
        assert!(message(&output).contains("FIFO"), "{}", message(&output));
    }
}

/// A mistake in a line of 100 MB put 100 MB on the terminal.
#[test]
fn a_huge_study_is_refused_with_a_short_message() {
    let bench = bench();
    let huge = format!("seed = 1\nmeasures = [\"{}\"]\n", "x".repeat(100 << 20));
    fs::write(bench.path("huge.toml"), &huge).unwrap();
    let long = &huge[..1 << 19];
    for (name, text) in [
        ("long", format!("{long}\"]\n{MAPS}")),
        ("key", format!("{MAPS}\n[views.{}]\n", "k".repeat(1 << 19))),
        ("value", MAPS.replace("\"rnd\"", &format!("\"{}\"", "v".repeat(1 << 19)))),
        ("dataset", format!("{MAPS}\n[[dataset]]\nname = \"/{}\"\n", "d".repeat(1 << 19))),
    ] {
        fs::write(bench.path(&format!("{name}.toml")), text).unwrap();
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink("/dev/zero", bench.path("device.toml")).unwrap();
    for name in ["huge", "long", "key", "value", "dataset", "device"] {
        let file = format!("{name}.toml");
        if !bench.path(&file).exists() {
            continue; // Devices are elsewhere.
        }
        let output = bench.run(&["run", &file, "--dataset", "office.log"]);
        let text = message(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {}", text.len());
        assert!(text.len() < 2000 && text.contains(&file), "{name}: {} bytes", text.len());
    }
}

/// 10,000 threads took 75 s until the system refused them, without a word of what.
#[test]
fn too_many_threads_are_refused() {
    let bench = bench();
    for threads in ["1025", "10000", "18446744073709551615", "-1"] {
        let threads = format!("--threads={threads}");
        let output = bench.run(&["run", "maps.toml", "--dataset", "office.log", &threads]);
        assert_eq!(output.status.code(), Some(2), "{threads}");
        assert!(
            message(&output).contains("1024") || threads.ends_with("-1"),
            "{}",
            message(&output)
        );
    }
    let one = bench.study("maps", "one", &["--threads", "1"]);
    assert_same(&bench.study("maps", "many", &["--threads", "64"]), &one);
}

/// Field case `escape-codes`: names act on terminals, in spreadsheets and in pages.
#[test]
fn names_are_shown_and_not_executed() {
    let bench = bench();
    let names = ["a\nb", "\u{1b}[31mred", "=1+1", "<script>", "büro,\"x\"", "a\u{202e}b", "-o"];
    for name in names {
        let log = format!("./{name}.log");
        fs::copy(bench.path("office.log"), bench.path(&log)).unwrap();
        for arguments in [
            &["run", "maps.toml", "--dataset", &log, "-o", "named"][..],
            &["run", "maps.toml", "--dataset", &log, "-o", "named", "--list"],
        ] {
            let output = bench.run(arguments);
            let shown = [&output.stdout[..], &output.stderr].concat();
            let shown = String::from_utf8(shown).unwrap();
            assert_eq!(output.status.code(), Some(0), "{name:?}: {shown}");
            let acts = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
            assert!(!shown.contains(acts) && !shown.contains("a\nb"), "{name:?}: {shown:?}");
        }
        let trials = rows(&bench.path("named/maps").join(name).join("trials.csv"));
        assert_eq!(trials.len(), 6);
        // What a spreadsheet would compute is quoted.
        let quoted =
            if name.starts_with(['=', '-']) { format!("'{name}") } else { name.to_owned() };
        assert!(trials.iter().all(|row| row["dataset"] == quoted), "{name:?}");
    }
    let output = bench.run(&["plot", "named"]);
    let shown = message(&output);
    assert_eq!(output.status.code(), Some(0), "{shown}");
    assert!(
        !shown.contains(|c: char| (c.is_control() && c != '\n') || c == '\u{202e}'),
        "{shown:?}"
    );
    assert!(shown.contains(r"named/maps/a\u{a}b/") && !shown.contains("a\nb"), "{shown:?}");
    assert_eq!(fs::read_dir(bench.path("named/maps")).unwrap().count(), names.len());
}

/// Folders whose name is no UTF-8 hold results as others do; an input of such a name is refused in words.
#[cfg(target_os = "linux")]
#[test]
fn names_that_are_not_utf_8() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let bench = bench();
    let expected = bench.study("maps", "results", &[]);
    let root = OsStr::from_bytes(b"r\xffsults");
    for json in [&[][..], &["--json"]] {
        let mut command = bench.command(&["run", "maps.toml", "--dataset", "office.log"]);
        let output = command.args(json).arg("-o").arg(root).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", message(&output));
        assert!(String::from_utf8_lossy(&output.stdout).contains("r\u{fffd}sults"));
    }
    let folder = bench.path("").join(root).join("maps/office");
    assert_same(&folder, &expected);
    let output = bench.command(&["plot"]).arg(root).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", message(&output));
    assert_same(&folder, &expected);

    let log = OsStr::from_bytes(b"b\xfcro.log");
    fs::copy(bench.path("office.log"), bench.path("").join(log)).unwrap();
    let output = bench.command(&["run", "maps.toml", "--dataset"]).arg(log).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(message(&output).contains("UTF-8"), "{}", message(&output));
}

/// Two logs of one name are reported before the first is computed.
#[test]
fn data_listed_twice_is_refused_before_anything_is_run() {
    let bench = bench();
    fs::create_dir(bench.path("other")).unwrap();
    fs::copy(bench.path("office.log"), bench.path("other/office.clf")).unwrap();
    for second in ["office.log", "./office.log", "other/office.clf"] {
        let output =
            bench.run(&["run", "maps.toml", "--dataset", "office.log", "--dataset", second]);
        assert_eq!(output.status.code(), Some(1));
        let text = message(&output);
        assert!(text.contains(second) && text.contains("listed twice"), "{text}");
        assert!(!Path::new(&bench.path("results")).exists());
    }
}

//! Results that were lost, mixed or overwritten once: each of these tests cuts, edits or replaces
//! everywhere, and finds the bytes of an undisturbed run, or a refusal with the reason.

mod bench;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use bench::{assert_holds, contents, folder, fresh, log, part, run, tables};
use mcl_core::{Pose2, Stamp};
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::run::{Event, run_study};
use mcl_study::share::Share;
use mcl_study::store::parts::seal;
use mcl_study::store::results::{Results, read_all};
use mcl_study::study::definition::Study;
use mcl_study::trial::division::StudyData;
use serde_json::{Value, json};

/// Three maps.
const MAPS: &str = r#"
seed = 3
measures = ["likelihood"]
[base]
tolerance = 1e-3
max_iterations = 20
[[trials]]
map = ["gbs", "rnd", "gbs+f-km"]
size = 10
"#;

/// Everything that a study can have.
const STUDY: &str = r#"
seed = 3
measures = ["likelihood"]
[base]
sigma = 0.05
tolerance = 1e-3
max_iterations = 20
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 20
beams = 10
sigma_hit = 0.2
alpha = [0.05, 0.05, 0.05, 0.05]
[refinement]
more = { method = "restarts", restarts = 2 }
[[trials]]
split = ["same", "alternate"]
map = ["gbs", "gbs+f-km", "gbs+more", "gbs+best"]
size = [5, 10]
draws = 2
runs = 2
[[dataset]]
name = "office"
[[dataset]]
name = "other"
[[views.pictures]]
name = "path"
maps = [{ map = "gbs+f-km", size = 5 }]
run = 0
[[views.pictures]]
name = "maps"
maps = [{ map = "gbs", size = 5, offset = "origin" }, { map = "all" }]
"#;

/// A name that is neither ASCII nor one line, and not what a table expects.
const NAME: &str = "büro\n\"1\", =x";

fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}

/// Field cases `header-only-and-timings`, `torn-row-in-a-name`, `estimate-tum-not-atomic`: rows were cut inside the
/// first row, inside a name, or to the header alone, and the folder was lost for good.
#[test]
fn rows_cut_at_every_byte_are_computed_again() {
    let expected = fresh(MAPS, log(NAME));
    let folder = folder();
    run(MAPS, log(NAME), folder.path()).unwrap();
    let path = part(folder.path());
    let whole = fs::read(&path).unwrap();
    assert_eq!(whole.iter().filter(|&&byte| byte == b'\n').count(), 1 + 3);
    for length in 0..=whole.len() {
        fs::remove_dir_all(folder.path().join("parts")).unwrap();
        fs::create_dir(folder.path().join("parts")).unwrap();
        fs::write(&path, &whole[..length]).unwrap();
        let ran = run(MAPS, log(NAME), folder.path()).unwrap();
        assert!(tables(&ran).damage.is_empty(), "{length}: {:?}", tables(&ran).damage);
        assert_holds(folder.path(), &expected, &format!("cut at {length}"));
        // What the next run finds is a second file of rows beside the cut one.
        if length % 100 == 0 {
            run(MAPS, log(NAME), folder.path()).unwrap();
            assert_holds(folder.path(), &expected, &format!("cut at {length}, twice"));
        }
    }
    eprintln!("{} cuts", whole.len() + 1);
}

/// A bit that flips in a number would leave a line that can be read, with another result in it.
#[test]
fn rows_damaged_at_any_byte_are_computed_again() {
    let expected = fresh(MAPS, log(NAME));
    let folder = folder();
    run(MAPS, log(NAME), folder.path()).unwrap();
    let path = part(folder.path());
    let whole = fs::read(&path).unwrap();
    let mut damages: Vec<(String, Vec<u8>)> = Vec::new();
    for at in 0..whole.len() {
        let mut bytes = whole.clone();
        match at % 4 {
            0 | 1 => bytes[at] ^= 1 << (at % 8),
            2 => bytes[at] = 0,
            _ => drop(bytes.remove(at)),
        }
        damages.push((format!("byte {at}"), bytes));
    }
    let lines: Vec<&[u8]> = whole.split_inclusive(|&byte| byte == b'\n').collect();
    let nothing = [0; 512];
    for (what, pieces) in [
        ("zeros behind the rows", vec![&whole[..], &nothing]),
        ("a line of zeros behind the rows", vec![&whole[..], &nothing, b"\n"]),
        ("zeros for a row", vec![lines[0], lines[1], &nothing, b"\n", lines[3]]),
        ("zeros for the first line", vec![&nothing, b"\n", lines[1], lines[2], lines[3]]),
        ("no first line", vec![lines[1], lines[2], lines[3]]),
        ("the first line alone", vec![lines[0]]),
        ("the first line twice", vec![lines[0], &whole]),
        ("every row twice", vec![&whole, lines[1], lines[2], lines[3]]),
        ("rows backwards", vec![lines[0], lines[3], lines[2], lines[1]]),
        ("no text", vec![lines[0], b"\xff\xfe\n", lines[2]]),
        ("nothing", vec![]),
        ("empty lines", vec![b"\n\n\n"]),
    ] {
        damages.push((what.to_owned(), pieces.concat()));
    }
    for (what, bytes) in &damages {
        fs::remove_dir_all(folder.path().join("parts")).unwrap();
        fs::create_dir(folder.path().join("parts")).unwrap();
        fs::write(&path, bytes).unwrap();
        let ran = run(MAPS, log(NAME), folder.path()).unwrap();
        assert!(tables(&ran).is_complete(), "{what}");
        assert_holds(folder.path(), &expected, what);
    }
    eprintln!("{} damages", damages.len());
}

/// Field cases `definition-made-smaller`, `key-removed-from-definition`, `figures-edited-then-killed`: rows
/// and pictures that were no longer asked for stayed in tables and figures.
#[test]
fn an_edited_study_is_that_of_a_fresh_run() {
    let edits = [
        ("fewer sizes", "size = [5, 10]", "size = 5"),
        ("more sizes", "size = [5, 10]", "size = [5, 10, 20]"),
        ("sizes the other way round", "size = [5, 10]", "size = [10, 5]"),
        ("sizes in points", "size = [5, 10]", "points = [18, 36]"),
        ("a size that the data chooses", "size = [5, 10]", "size = [5, \"bic\"]"),
        ("fewer draws", "draws = 2", "draws = 1"),
        ("more draws", "draws = 2", "draws = 3"),
        ("fewer runs", "runs = 2", "runs = 1"),
        ("more runs", "runs = 2", "runs = 3"),
        ("no runs", "runs = 2", "runs = 0"),
        ("fewer splits", "[\"same\", \"alternate\"]", "\"alternate\""),
        ("splits the other way round", "[\"same\", \"alternate\"]", "[\"alternate\", \"same\"]"),
        ("without the best", ", \"gbs+best\"]", "]"),
        ("another builder", "\"gbs\", \"gbs+f-km\"", "\"rnd\", \"gbs+f-km\""),
        ("maps the other way round", "\"gbs\", \"gbs+f-km\"", "\"gbs+f-km\", \"gbs\""),
        ("other restarts", "restarts = 2", "restarts = 1"),
        (
            "another refinement of that name",
            "method = \"restarts\", restarts = 2",
            "method = \"annealed\", start = 4, steps = 2",
        ),
        ("another sigma", "sigma = 0.05", "sigma = 0.1"),
        ("sigma left out", "sigma = 0.05\n", ""),
        ("a sigma that the data chooses", "draws = 2", "draws = 2\nsigma = \"likelihood\""),
        ("another tolerance", "tolerance = 1e-3", "tolerance = 1e-2"),
        ("fewer updates", "max_iterations = 20", "max_iterations = 2"),
        ("another seed", "seed = 3", "seed = 4"),
        ("more particles", "particles = 20", "particles = 21"),
        ("another sigma_hit", "sigma_hit = 0.2", "sigma_hit = 0.3"),
        ("sigma_hit left out", "sigma_hit = 0.2\n", ""),
        ("another alpha", "alpha = [0.05,", "alpha = [0.06,"),
        ("another proposal", "beams = 10", "beams = 10\nproposal = \"adaptive\""),
        ("more noise", "xy = 0.01", "xy = 0.02"),
        ("noise left out", "odometry_noise = { xy = 0.01, theta = 0.01 }\n", ""),
        ("more measures", "[\"likelihood\"]", "[\"likelihood\", \"consistency\"]"),
        ("no measures", "measures = [\"likelihood\"]\n", ""),
        ("a named entry", "[[trials]]\n", "[[trials]]\nname = \"all-of-them\"\n"),
        ("grids at the origin", "draws = 2", "draws = 2\noffset = \"origin\""),
        (
            "data sets the other way round",
            "\"office\"\n[[dataset]]\nname = \"other\"",
            "\"other\"\n[[dataset]]\nname = \"office\"",
        ),
        ("points hidden", "name = \"other\"", "name = \"other\"\nhide_above = 2.0"),
        ("another map in the picture", "{ map = \"all\" }", "{ map = \"rnd\", size = 10 }"),
        ("another path in the picture", "run = 0", "run = 3"),
        ("the path's map of another size", "\"gbs+f-km\", size = 5 }", "\"gbs+f-km\", size = 10 }"),
        ("no path", "maps = [{ map = \"gbs+f-km\", size = 5 }]\nrun = 0", "maps = []"),
        ("no pictures", &STUDY[STUDY.find("[[views").unwrap()..], ""),
        ("a remark", "seed = 3", "seed = 3 # as before"),
    ];
    let before = fresh(STUDY, log("office"));
    let folder = folder();
    run(STUDY, log("office"), folder.path()).unwrap();
    for (what, old, new) in edits {
        let edited = STUDY.replacen(old, new, 1);
        assert_ne!(edited, STUDY, "{what}");
        let expected = fresh(&edited, log("office"));
        assert_ne!(expected, before, "{what}");
        let ran = run(&edited, log("office"), folder.path()).unwrap();
        assert!(ran.failed.is_empty(), "{what}: {:?}", ran.failed);
        assert_holds(folder.path(), &expected, what);
        // And back, without a trial that is run.
        run(STUDY, log("office"), folder.path()).unwrap();
        assert_holds(folder.path(), &before, &format!("{what}, and back"));
    }
    eprintln!("{} edits", edits.len());
}

/// Two names may mean one refinement; a row has the name that the study gave it.
#[test]
fn a_refinement_may_be_renamed() {
    let renamed = STUDY.replace("more = {", "others = {").replace("gbs+more", "gbs+others");
    let expected = fresh(&renamed, log("office"));
    let folder = folder();
    run(STUDY, log("office"), folder.path()).unwrap();
    run(&renamed, log("office"), folder.path()).unwrap();
    assert_holds(folder.path(), &expected, "renamed");
    let both = STUDY
        .replace("more = {", "others = { method = \"restarts\", restarts = 2 }\nmore = {")
        .replace("\"gbs+more\"", "\"gbs+more\", \"gbs+others\"");
    let ran = run(&both, log("office"), folder.path()).unwrap();
    let named =
        |name: &str| tables(&ran).table.rows().filter(|row| row.text("map") == name).count();
    assert_eq!((named("gbs+more"), named("gbs+others")), (16, 16));
}

/// Field case `listed-twice`: each was run and counted twice, p = 0.0007 for 0.034.
#[test]
fn duplicates_are_refused_or_count_once() {
    for (old, new) in [
        ("[5, 10]", "[5, 10, 5]"),
        ("\"alternate\"]", "\"alternate\", \"same\"]"),
        ("[\"gbs\", ", "[\"gbs\", \"gbs\", "),
        ("sigma_hit = 0.2", "sigma_hit = [0.2, 0.2]"),
        ("name = \"other\"", "name = \"office\""),
    ] {
        let edited = STUDY.replacen(old, new, 1);
        let Err(error) = Study::parse(&edited) else { panic!("accepted: {new}") };
        let message = format!("{error:#}");
        let named = ["listed twice", "has 2 values"].iter().any(|reason| message.contains(reason));
        assert!(named && message.starts_with("line "), "{new}: {message}");
    }
    // The same trials by another entry, or by a number written otherwise, are the same rows.
    let once = fresh(MAPS, log("office"));
    for edited in [MAPS.replace("size = 10", "size = [10, 10.0]"), {
        let entry = &MAPS[MAPS.find("[[trials]]").unwrap()..];
        format!("{MAPS}{entry}")
    }] {
        assert_eq!(
            fresh(&edited, log("office"))[Path::new("trials.csv")],
            once[Path::new("trials.csv")]
        );
    }
}

/// Field case `rows-of-something-else`: names decide seeds, and the laser's mount decides where a robot is,
/// but neither was compared.
#[test]
fn rows_of_other_data_are_refused_with_the_first_difference() {
    let other = |change: fn(&mut LogSource)| {
        let mut log = log("office");
        change(&mut log);
        log
    };
    let changes: [(&str, LogSource, &str); 9] = [
        (
            "name",
            other(|log| log.name = "other".to_owned()),
            "of data set \"office\", this is \"other\"",
        ),
        (
            "mount",
            other(|log| log.recording.robot_from_laser = Pose2::new(0.1, 0.0, 0.0)),
            "other data",
        ),
        ("reading", other(|log| log.recording.scans[11].ranges[29] += 0.01), "other data"),
        (
            "direction",
            other(|log| log.recording.scans[3].geometry.start_angle += 0.01),
            "other data",
        ),
        (
            "reference",
            other(|log| log.recording.scans[5].map_from_laser.as_mut().unwrap().x += 0.01),
            "other data",
        ),
        (
            "odometry",
            other(|log| log.recording.scans[5].odometry.as_mut().unwrap().theta += 0.01),
            "other data",
        ),
        (
            "stamp",
            other(|log| log.recording.scans[5].stamp = Some(Stamp::from_nanoseconds(1))),
            "other data",
        ),
        ("scans", other(|log| drop(log.recording.scans.pop())), "other data"),
        ("range", other(|log| log.max_range = 5.0), "max_range 10 m, this is 5 m"),
    ];
    let expected = fresh(STUDY, log("office"));
    let folder = folder();
    run(STUDY, log("office"), folder.path()).unwrap();
    for (what, other, difference) in changes {
        let Err(error) = run(STUDY, other, folder.path()) else { panic!("{what}: mixed") };
        let message = format!("{error:#}");
        assert!(message.contains(difference) && message.contains("--fresh"), "{what}: {message}");
        assert_holds(folder.path(), &expected, what);
    }
    // Whoever else measured it under that title, or in what file: the same data.
    let titled = other(|log| log.title = "Office".to_owned());
    run(STUDY, titled, folder.path()).unwrap();
}

/// Builds with other sources were not distinguished: rows of any commit counted as version 0.1.0.
#[test]
fn rows_of_another_build_are_refused() {
    let folder = folder();
    run(MAPS, log("office"), folder.path()).unwrap();
    let path = part(folder.path());
    let written = text(&path);
    let (first, rows) = written.split_once('\n').unwrap();
    let line = serde_json::from_str::<Value>(first).unwrap()["line"].clone();
    let with = |key: &str, value: Value| {
        let mut line = line.clone();
        line["identity"]["build"][key] = value;
        let mut bytes = seal(&serde_json::to_vec(&line).unwrap());
        bytes.extend_from_slice(format!("\n{rows}").as_bytes());
        fs::write(&path, bytes).unwrap();
    };
    for (key, value) in [("sources", "0123456789abcdef"), ("version", "0.0.9")] {
        with(key, json!(value));
        let Err(error) = run(MAPS, log("office"), folder.path()) else { panic!("mixed") };
        let message = format!("{error:#}");
        assert!(
            message.contains("computed by build")
                && message.contains(value)
                && message.contains("--fresh"),
            "{message}"
        );
        assert!(message.contains(&path.display().to_string()), "{message}");
    }
    // Another revision with the same sources is the same build.
    with("revision", json!("0123456789ab"));
    let expected = fresh(MAPS, log("office"));
    run(MAPS, log("office"), folder.path()).unwrap();
    assert_holds(folder.path(), &expected, "revision");
}

/// What only a damaged disk or an edit by hand leaves: two rows that cannot both be right.
#[test]
fn rows_that_contradict_each_other_are_refused_with_both_places() {
    let folder = folder();
    run(MAPS, log("office"), folder.path()).unwrap();
    let path = part(folder.path());
    let written = text(&path);
    let lines: Vec<&str> = written.lines().collect();
    let mut line = serde_json::from_str::<Value>(lines[1]).unwrap()["line"].clone();
    let columns = line["trial"]["columns"].as_array().unwrap();
    let column = columns.iter().position(|name| name == "map_points").unwrap();
    line["trial"]["rows"][0][1][column] = json!(7);
    let sealed = String::from_utf8(seal(&serde_json::to_vec(&line).unwrap())).unwrap();
    let other = path.with_file_name("rows-1-AAAAAAAA.jsonl");
    fs::write(&other, format!("{}\n{sealed}\n", lines[0])).unwrap();
    let Err(error) = run(MAPS, log("office"), folder.path()) else { panic!("accepted") };
    let message = format!("{error:#}");
    for part in ["map_points", "\"7\"", "rows-1-AAAAAAAA.jsonl", &path.display().to_string()] {
        assert!(message.contains(part), "{part}: {message}");
    }
    // Removed, all is well.
    fs::remove_file(&other).unwrap();
    run(MAPS, log("office"), folder.path()).unwrap();
}

/// Field case `figures-edited-then-killed`: a map of other data was taken for that of the row.
#[test]
fn pictures_of_other_data_are_not_kept() {
    let folder = folder();
    let mut other = log("office");
    other.recording.robot_from_laser = Pose2::new(0.5, 0.0, 0.0);
    other.recording.scans[0].ranges[0] += 0.5;
    run(STUDY, other, folder.path()).unwrap();
    // A run that was killed before its first row, but after its pictures, leaves this.
    fs::remove_dir_all(folder.path().join("parts")).unwrap();
    // The rows of all trials come to be there, the pictures' not: a run was killed in between.
    let without = &STUDY[..STUDY.find("[[views").unwrap()];
    run(without, log("office"), folder.path()).unwrap();
    run(STUDY, log("office"), folder.path()).unwrap();
    assert_holds(folder.path(), &fresh(STUDY, log("office")), "pictures");
}

/// Field case `folder-removed-and-begun-anew`: the first run went on, and replaced the results of the second.
#[test]
fn a_folder_started_over_keeps_the_results_of_the_second_run() {
    let other = MAPS.replace("seed = 3", "seed = 4");
    let expected = fresh(&other, log("office"));
    for is_moved in [false, true] {
        let root = folder();
        let (folder, aside) = (root.path().join("office"), root.path().join("aside"));
        let data = StudyData::new(DataSource::Log(log("office")));
        let study = Study::parse(MAPS).unwrap();
        let mut ended = 0;
        let result =
            run_study(&study, "study", &data, &folder, Share::Whole { fresh: false }, |event| {
                if let Event::Ended { .. } = event {
                    ended += 1;
                }
                if ended == 1 {
                    ended += 1;
                    match is_moved {
                        true => fs::rename(&folder, &aside).unwrap(),
                        false => fs::remove_dir_all(&folder).unwrap(),
                    }
                    run(&other, log("office"), &folder).unwrap();
                }
            });
        let Err(error) = result else { panic!("went on") };
        let message = format!("{error:#}");
        assert!(message.contains("removed or replaced while the run went on"), "{message}");
        assert_holds(&folder, &expected, "the second run's");
        if is_moved {
            run(MAPS, log("office"), &aside).unwrap();
            assert_holds(&aside, &fresh(MAPS, log("office")), "the first run's");
        }
    }
    // The study of the folder was edited meanwhile, and rows of both are there: the first writes no tables.
    let root = folder();
    let folder = root.path().join("office");
    let data = StudyData::new(DataSource::Log(log("office")));
    let study = Study::parse(MAPS).unwrap();
    let mut is_edited = false;
    let result =
        run_study(&study, "study", &data, &folder, Share::Whole { fresh: false }, |event| {
            if let Event::Ended { .. } = event
                && !std::mem::replace(&mut is_edited, true)
            {
                run(&other, log("office"), &folder).unwrap();
            }
        });
    let Err(error) = result else { panic!("went on") };
    assert!(format!("{error:#}").contains("another run has changed the study"), "{error:#}");
    assert_holds(&folder, &expected, "the edited study's");
    run(MAPS, log("office"), &folder).unwrap();
    assert_holds(&folder, &fresh(MAPS, log("office")), "the first again");
}

/// Calls `see` with a result folder and a path in it where a run is about to write: in the place of each
/// file and folder of a run whose rows are gone, there is nothing.
fn for_every_output(mut see: impl FnMut(&Path, &Path)) {
    let done = folder();
    run(STUDY, log("office"), done.path()).unwrap();
    let mut paths: Vec<PathBuf> = contents(done.path()).into_keys().collect();
    let others = ["timings.csv", "failures.csv", "parts", "shown", "figures"];
    paths.extend(others.map(PathBuf::from));
    assert_eq!(paths.len(), 3 + 3 + 3 + 5, "{paths:?}");
    for path in paths {
        let root = folder();
        let folder = root.path().join("office");
        run(STUDY, log("office"), &folder).unwrap();
        fs::remove_dir_all(folder.join("parts")).unwrap();
        let output = folder.join(&path);
        match output.is_dir() {
            true => fs::remove_dir_all(&output).unwrap(),
            false if output.exists() => fs::remove_file(&output).unwrap(),
            false => {}
        }
        see(&folder, &output);
    }
}

/// Field case `links-written-through`: `.lock` and `trials.csv` wrote to what a link led to.
#[cfg(unix)]
#[test]
fn nothing_is_written_through_a_link() {
    let expected = fresh(STUDY, log("office"));
    for_every_output(|folder, link| {
        let name = link.display();
        let target = folder.with_file_name("target");
        match link.extension() {
            None => fs::create_dir(&target).unwrap(),
            Some(_) => fs::write(&target, "precious").unwrap(),
        }
        std::os::unix::fs::symlink(&target, link).unwrap();
        let ran = run(STUDY, log("office"), folder);
        match target.is_dir() {
            true => assert_eq!(fs::read_dir(&target).unwrap().count(), 0, "{name}"),
            false => assert_eq!(text(&target), "precious", "{name}"),
        }
        // Refused, by the run or by a trial, unless what is to be there is nothing.
        match ran {
            Err(error) => assert!(format!("{error:#}").contains("symbolic link"), "{error:#}"),
            Ok(ran) if link.parent() == Some(&folder.join("shown")) => {
                let [failed] = &ran.failed[..] else { panic!("{name}: {:?}", ran.failed) };
                assert!(failed.reason.contains("symbolic link"), "{failed:?}");
            }
            Ok(_) => assert!(link.ends_with("failures.csv") && !link.is_symlink(), "{name}"),
        }
        if link.is_symlink() {
            fs::remove_file(link).unwrap();
        }
        run(STUDY, log("office"), folder).unwrap();
        assert_holds(folder, &expected, &name.to_string());
    });
}

/// Field case `links-written-through`: a FIFO as `.lock` or `trials.csv` was waited for, for ever.
#[cfg(unix)]
#[test]
fn a_pipe_is_not_waited_for() {
    use std::os::unix::fs::FileTypeExt;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    let is_pipe = |path: &Path| {
        fs::symlink_metadata(path).is_ok_and(|metadata| metadata.file_type().is_fifo())
    };
    let expected = fresh(STUDY, log("office"));
    let check = |folder: &Path, pipe: &Path| {
        mknodat(CWD, pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let (sender, receiver) = mpsc::channel();
        let running = folder.to_owned();
        std::thread::spawn(move || {
            let ran = run(STUDY, log("office"), &running);
            let read = Results::read(&running);
            sender.send((ran.map(|ran| ran.failed), read.map(drop)))
        });
        let (ran, _) = receiver
            .recv_timeout(Duration::from_secs(120))
            .unwrap_or_else(|_| panic!("{} is waited for", pipe.display()));
        let message = match ran {
            Err(error) => format!("{error:#}"),
            Ok(failed) => failed.iter().map(|failed| failed.reason.as_str()).collect(),
        };
        if is_pipe(pipe) {
            let named = ["FIFO", "expected a folder", "File exists", "Not a directory"];
            // Figures are drawn by others.
            let is_known =
                named.iter().any(|text| message.contains(text)) || pipe.ends_with("figures");
            assert!(is_known, "{}: {message}", pipe.display());
            fs::remove_file(pipe).unwrap();
        }
        run(STUDY, log("office"), folder).unwrap();
        assert_holds(folder, &expected, &pipe.display().to_string());
    };
    for_every_output(check);
    let root = folder();
    fs::create_dir_all(root.path().join("office/parts")).unwrap();
    check(&root.path().join("office"), &root.path().join("office/parts/rows-1-AbCd1234.jsonl"));
}

/// Field case `one-torn-folder-stops-all`, and result folders with a manifest but without rows, as they are
/// committed, which counted as results.
#[test]
fn a_damaged_folder_stops_no_other() {
    let root = folder();
    let at = |name: &str| root.path().join("study").join(name);
    for name in ["a", "b", "c", "d", "e"] {
        run(MAPS, log(name), &at(name)).unwrap();
    }
    fs::write(at("b").join("manifest.json"), "{").unwrap();
    fs::write(at("c").join("study.toml"), "seed = \"x\"").unwrap();
    fs::remove_dir_all(at("d").join("parts")).unwrap();
    // Torn rows are no damage: the trial is missing.
    let bytes = fs::read(part(&at("e"))).unwrap();
    fs::write(part(&at("e")), &bytes[..bytes.len() - 9]).unwrap();
    let found = read_all(root.path()).unwrap();
    let names = |folders: Vec<&Path>| -> Vec<String> {
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        folders.into_iter().map(name).collect()
    };
    assert_eq!(names(found.results.iter().map(|found| &*found.folder).collect()), ["a", "e"]);
    assert_eq!(names(found.without_rows.iter().map(|path| &**path).collect()), ["d"]);
    assert_eq!(names(found.damaged.iter().map(|damaged| &*damaged.0).collect()), ["b", "c"]);
    for (folder, error) in &found.damaged {
        let message = format!("{error:#}");
        assert!(message.contains(&folder.display().to_string()), "{message}");
    }
    let [whole, torn] = &found.results[..] else { unreachable!() };
    assert_eq!((whole.done, whole.asked, torn.done, torn.asked), (3, 3, 2, 3));
    assert!(whole.is_complete() && !torn.is_complete());
}

/// Leftovers of a killed process go, a file that somebody else put there stays.
#[test]
fn leftovers_of_killed_processes_are_removed() {
    let folder = folder();
    run(STUDY, log("office"), folder.path()).unwrap();
    // A neighbour of this process's own name: the host is the one in its name.
    let mut output = mcl_core::files::Output::create(&folder.path().join("trials.csv")).unwrap();
    std::io::Write::write_all(&mut output, b"half").unwrap();
    let name = output.temporary_path().file_name().unwrap().to_str().unwrap().to_owned();
    drop(output);
    let mut left = Vec::new();
    for subfolder in ["", "shown", "figures"] {
        let path = folder.path().join(subfolder).join(&name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, "half").unwrap();
        left.push(path);
    }
    let note = folder.path().join("shown/note.txt");
    fs::write(&note, "mine").unwrap();
    run(STUDY, log("office"), folder.path()).unwrap();
    assert!(left.iter().all(|path| !path.exists()), "{left:?}");
    assert_eq!(text(&note), "mine");
    fs::remove_file(note).unwrap();
    assert_holds(folder.path(), &fresh(STUDY, log("office")), "leftovers");
}

/// A study after whose edit every trial fails has no tables of the trials before.
#[test]
fn tables_of_trials_that_are_no_longer_asked_for_go_when_all_fail() {
    let folder = folder();
    run(MAPS, log("office"), folder.path()).unwrap();
    for file in ["summary.csv", "tests.csv"] {
        fs::write(folder.path().join(file), "old").unwrap();
    }
    let failing = MAPS.replace("size = 10", "points = 1000");
    let Err(error) = run(&failing, log("office"), folder.path()) else { panic!("no trial failed") };
    assert!(format!("{error:#}").contains("3 of 3 trials failed"), "{error:#}");
    let left: Vec<PathBuf> = contents(folder.path()).into_keys().collect();
    assert_eq!(left, ["failures.csv", "manifest.json", "study.toml"].map(PathBuf::from));
    assert_eq!(text(&folder.path().join("failures.csv")).lines().count(), 1 + 3);
    run(MAPS, log("office"), folder.path()).unwrap();
    assert_holds(folder.path(), &fresh(MAPS, log("office")), "the trials before");
}

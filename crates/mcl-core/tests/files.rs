//! The file layer with a stop, a partial write or a full disk at every operation, and paths it must never write to.

use std::fs;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use mcl_core::files::fault::{Fault, Operation, Step, during};
use mcl_core::files::{
    Journal, JournalLine, Output, OwnFile, create_folder, hold, journal_lines, journals, open,
    prepare, remove, remove_folder, remove_leftovers, write_atomically, write_with,
};
use tempfile::{TempDir, tempdir};

/// All faults for some work: a stop, a failure and a full disk at each operation and within each write.
fn faults(steps: &[Step]) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (at, (operation, length, _)) in steps.iter().enumerate() {
        faults.push(Fault::Fail { at });
        let last = if *operation == Operation::Write { *length } else { 0 };
        for bytes in 0..=last {
            faults.extend([Fault::Stop { at, bytes }, Fault::Full { at, bytes }]);
        }
    }
    faults
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_file_is_the_old_or_the_new_one_wherever_its_writing_ends() {
    let write = |path: &Path| write_atomically(path, b"the new content");
    let folder = tempdir().unwrap();
    let (result, steps) = during(Fault::None, || write(&folder.path().join("count")));
    result.unwrap();
    use Operation::{Create, Rename, Sync, Write};
    let operations: Vec<Operation> = steps.iter().map(|step| step.0).collect();
    assert_eq!(operations, [Create, Write, Sync, Rename]);

    let mut failed = 0;
    for fault in faults(&steps) {
        for old in [None, Some("old")] {
            let folder = tempdir().unwrap();
            let path = folder.path().join("map.csv");
            if let Some(old) = old {
                fs::write(&path, old).unwrap();
            }
            let (result, _) = during(fault, || write(&path));
            let expected = match result {
                Ok(()) => Some("the new content"),
                Err(_) => old,
            };
            failed += usize::from(result.is_err());
            assert_eq!(fs::read_to_string(&path).ok().as_deref(), expected, "{fault:?}");
            // Only a stopped process leaves a temporary file, and it is recognized.
            let left = names(folder.path()).len() - usize::from(expected.is_some());
            assert!(left == 0 || (left == 1 && matches!(fault, Fault::Stop { .. })), "{fault:?}");
            remove_leftovers(folder.path());
            assert_eq!(names(folder.path()).len(), usize::from(expected.is_some()), "{fault:?}");
            write(&path).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), "the new content");
        }
    }
    assert!(failed > 60, "{failed}");
}

#[test]
fn a_file_written_in_pieces_is_whole_or_not_there_as_well() {
    const PIECE: usize = 200_000; // Larger than the buffer.
    let write = |path: &Path| {
        write_with(path, |file| (0..3).try_for_each(|piece| file.write_all(&[piece; PIECE])))
    };
    let folder = tempdir().unwrap();
    let path = folder.path().join("map.csv");
    fs::write(&path, "old").unwrap();
    let refused = write_with(&path, |file| {
        file.write_all(b"new")?;
        Err(io::Error::other("of the writer"))
    });
    assert_eq!(refused.unwrap_err().to_string(), "of the writer");
    assert_eq!(names(folder.path()), ["map.csv"]);
    assert_eq!(fs::read(&path).unwrap(), b"old");

    let (result, steps) = during(Fault::None, || write(&path));
    result.unwrap();
    assert!(steps.iter().filter(|step| step.0 == Operation::Write).count() >= 3);
    for at in 0..steps.len() {
        for bytes in [0, 1, PIECE / 2] {
            let faults = [Fault::Fail { at }, Fault::Full { at, bytes }, Fault::Stop { at, bytes }];
            for fault in faults {
                fs::write(&path, "old").unwrap();
                let (result, _) = during(fault, || write(&path));
                let length = fs::metadata(&path).unwrap().len() as usize;
                assert_eq!(length, if result.is_ok() { 3 * PIECE } else { 3 }, "{fault:?}");
                remove_leftovers(folder.path());
                assert_eq!(names(folder.path()), ["map.csv"], "{fault:?}");
            }
        }
    }
}

#[test]
fn a_new_file_takes_the_place_of_nothing_else() {
    let write = |path: &Path| -> io::Result<()> {
        let mut output = Output::create_readable(path)?;
        assert!(output.temporary_path().extension().is_some_and(|ending| ending == "log"));
        output.write_all(b"-ew")?;
        output.seek(SeekFrom::Start(0))?;
        output.write_all(b"n")?;
        output.seek(SeekFrom::Start(0))?;
        let mut text = String::new();
        output.read_to_string(&mut text)?;
        assert_eq!(text, "new");
        output.commit_new()
    };
    let folder = tempdir().unwrap();
    let path = folder.path().join("office.log");
    let (_, steps) = during(Fault::None, || write(&path).unwrap());
    assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    fs::write(&path, "mine").unwrap();
    assert_eq!(write(&path).unwrap_err().kind(), ErrorKind::AlreadyExists);
    assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
    assert_eq!(names(folder.path()), ["office.log"]);

    for fault in faults(&steps) {
        let folder = tempdir().unwrap();
        let path = folder.path().join("office.log");
        let (result, _) = during(fault, || write(&path));
        let content = fs::read_to_string(&path).ok();
        assert_eq!(content.as_deref(), result.is_ok().then_some("new"), "{fault:?}");
        remove_leftovers(folder.path());
        assert_eq!(names(folder.path()).len(), usize::from(result.is_ok()), "{fault:?}");
    }
}

#[test]
fn an_output_that_is_dropped_was_never_there() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    fs::write(&path, "old").unwrap();
    let mut output = Output::create(&path).unwrap();
    output.write_all(b"new").unwrap();
    drop(output);
    assert_eq!(names(folder.path()), ["run.mcap"]);
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    assert!(Output::create(&folder.path().join("absent/run.mcap")).is_err());
    assert!(Output::create(Path::new("..")).is_err());
}

#[cfg(unix)]
#[test]
fn files_have_the_permissions_of_ordinary_ones() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempdir().unwrap();
    let ordinary = folder.path().join("ordinary");
    fs::write(&ordinary, "").unwrap();
    let written = folder.path().join("written");
    write_atomically(&written, b"").unwrap();
    let journal = Journal::create(folder.path(), "rows").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&written), mode(&ordinary));
    assert_eq!(mode(journal.path()), mode(&ordinary));
}

/// Paths at which no file can be written, and how the error describes them.
#[cfg(unix)]
fn obstacles(folder: &Path) -> Vec<(PathBuf, &'static str)> {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::os::unix::{fs::symlink, net::UnixListener};
    let place = |name: &str| folder.join(name);
    fs::write(place("target"), "not ours").unwrap();
    symlink(place("target"), place("link")).unwrap();
    symlink("nothing", place("dangling")).unwrap();
    symlink("round", place("round")).unwrap();
    fs::create_dir(place("folder")).unwrap();
    mknodat(CWD, place("fifo"), FileType::Fifo, Mode::from_raw_mode(0o644), 0).unwrap();
    UnixListener::bind(place("socket")).unwrap();
    vec![
        (place("link"), "a symbolic link to"),
        (place("dangling"), "a symbolic link to \"nothing\""),
        (place("round"), "a symbolic link to"),
        (place("folder"), "a folder"),
        (place("fifo"), "a FIFO"),
        (place("socket"), "a socket"),
        (PathBuf::from("/dev/null"), "a device"),
    ]
}

#[cfg(unix)]
#[test]
fn nothing_is_written_through_links_or_over_anything_but_files() {
    let folder = tempdir().unwrap();
    let obstacles = obstacles(folder.path());
    let before = names(folder.path());
    for (path, what) in obstacles {
        let results = [
            write_atomically(&path, b"new"),
            Output::create_readable(&path).map(drop),
            OwnFile::open_or_create(&path).map(drop),
            prepare(&[&path], &[]).map_err(|error| error.source),
        ];
        for result in results {
            let message = result.unwrap_err().to_string();
            // In the last case, the system detects the loop first.
            let is_named = message.contains(what) || message.contains("symbolic link");
            assert!(is_named, "{path:?}: {message}");
        }
        if !path.ends_with("link") {
            assert!(open(&path).is_err(), "{path:?}");
            assert!(journal_lines(&path, 10).is_err(), "{path:?}");
        }
    }
    assert_eq!(names(folder.path()), before);
    assert_eq!(fs::read_to_string(folder.path().join("target")).unwrap(), "not ours");
    assert!(fs::symlink_metadata(folder.path().join("link")).unwrap().is_symlink());
}

#[cfg(unix)]
#[test]
fn a_link_that_appears_meanwhile_is_not_replaced() {
    let folder = tempdir().unwrap();
    let (path, target) = (folder.path().join("map.csv"), folder.path().join("target"));
    fs::write(&target, "not ours").unwrap();
    let mut output = Output::create(&path).unwrap();
    output.write_all(b"new").unwrap();
    std::os::unix::fs::symlink(&target, &path).unwrap();
    let message = output.commit().unwrap_err().to_string();
    assert!(message.contains("symbolic link to"), "{message}");
    assert_eq!(fs::read_to_string(&target).unwrap(), "not ours");
    assert_eq!(names(folder.path()), ["map.csv", "target"]);
}

#[test]
fn no_output_is_an_input_whatever_it_is_called() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("office.log"), "log").unwrap();
    fs::create_dir(at("bag")).unwrap();
    fs::write(at("bag/bag_0.mcap"), "bag").unwrap();
    fs::hard_link(at("office.log"), at("hard.log")).unwrap();
    let mut same = vec![
        (at("office.log"), at("office.log")),
        (at("./bag/../office.log"), at("office.log")),
        (at("hard.log"), at("office.log")),
        (at("office.log"), at("hard.log")),
        (at("bag/bag_0.mcap"), at("bag")),
    ];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("office.log", at("link.log")).unwrap();
        std::os::unix::fs::symlink(".", at("here")).unwrap();
        same.push((at("link.log"), at("office.log")));
        same.push((at("office.log"), at("link.log")));
        same.push((at("here/office.log"), at("office.log")));
        same.push((at("here/here/hard.log"), at("link.log")));
        same.push((at("here/bag/bag_0.mcap"), at("bag")));
    }
    for (output, input) in same {
        let error = prepare(&[&at("new.csv"), &output], &[&at("absent.log"), &input]).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(&*output.to_string_lossy()), "{message}");
        assert!(message.contains("input") && message.contains("another name"), "{message}");
    }
    let inputs = [at("office.log"), at("bag"), at("absent.log")];
    let inputs = inputs.each_ref().map(PathBuf::as_path);
    prepare(&[&at("new.csv"), &at("other.csv"), &at("bag/new.mcap")], &inputs).unwrap();
    fs::write(at("new.csv"), "old").unwrap();
    prepare(&[&at("new.csv")], &inputs).unwrap();
}

#[test]
fn two_outputs_are_two_files() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for exists in [false, true] {
        if exists {
            fs::write(at("figure.svg"), "").unwrap();
        }
        let message =
            prepare(&[&at("figure.svg"), &at("./figure.svg")], &[]).unwrap_err().to_string();
        assert!(message.contains("would be written there, too"), "{message}");
    }
    let message = prepare(&[&at("absent/map.csv")], &[]).unwrap_err().to_string();
    assert!(message.contains("there is no folder") && message.contains("map.csv"), "{message}");
    assert!(prepare(&[&at("figure.svg/map.csv")], &[]).is_err());
    assert!(prepare(&[&folder.path().join("..")], &[]).is_err());
}

#[test]
fn files_being_written_are_not_leftovers() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("map.csv");
    let mut output = Output::create(&path).unwrap();
    output.write_all(b"new").unwrap();
    remove_leftovers(folder.path());
    prepare(&[&path], &[]).unwrap();
    output.commit().unwrap();
    assert_eq!(names(folder.path()), ["map.csv"]);
}

#[cfg(unix)]
#[test]
fn leftovers_are_removed_and_nothing_else() {
    use std::time::{Duration, SystemTime};
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let ended = Fault::Stop { at: 3, bytes: 0 };
    let (result, _) = during(ended, || write_atomically(&at("map.csv"), b"new"));
    result.unwrap_err();
    let killed = names(folder.path()).pop().unwrap();
    assert!(killed.starts_with(".map.csv.mcl-eval-"), "{killed}");
    assert!(killed.contains(&format!("-{}-", std::process::id())), "{killed}");

    // A file that is being written stays, however old its last write is.
    let output = Output::create(&at("slow.csv")).unwrap();
    let slow = fs::OpenOptions::new().write(true).open(output.temporary_path()).unwrap();
    slow.set_modified(SystemTime::now() - Duration::from_secs(7 * 3600)).unwrap();

    // From another host, whose processes are unknown here.
    let young = ".map.csv.mcl-eval-ffffff-1-AbCd1234.tmp";
    let old = ".map.csv.mcl-eval-ffffff-1-AbCd5678.tmp";
    for (name, hours) in [(young, 5), (old, 7)] {
        let file = fs::File::create(at(name)).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(hours * 3600)).unwrap();
    }
    let others = ["map.csv.tmp", ".map.csv.tmp", ".map.csv.mcl-eval-1-2-3.tmp"];
    for name in others {
        fs::write(at(name), "").unwrap();
    }
    // The name alone is not enough.
    let (link, inner) = (killed.replace("map", "link"), killed.replace("map", "folder"));
    std::os::unix::fs::symlink("map.csv.tmp", at(&link)).unwrap();
    fs::create_dir(at(&inner)).unwrap();

    prepare(&[&at("map.csv")], &[]).unwrap();
    output.commit().unwrap();
    let mut expected = others.map(str::to_owned).to_vec();
    expected.extend([young.to_owned(), link, inner, "slow.csv".to_owned()]);
    expected.sort();
    assert_eq!(names(folder.path()), expected);
    remove_leftovers(&at("absent"));
}

/// Lines that a journal may contain, not all of them valid text.
fn lines() -> Vec<Vec<u8>> {
    let texts: [&[u8]; 5] = [b"{\"a\":1}", b"", b"\xff\xfe\x00", b"\xc3\xa4 and more", b"last"];
    texts.map(<[u8]>::to_vec).to_vec()
}

/// The complete lines of a journal, and the length of an incomplete one.
fn read(path: &Path) -> (Vec<Vec<u8>>, Option<u64>) {
    let (mut whole, mut torn) = (Vec::new(), None);
    for line in journal_lines(path, 1000).unwrap() {
        assert_eq!(torn, None, "a line after the last");
        match line.unwrap() {
            JournalLine::Whole(line) => whole.push(line),
            JournalLine::Torn { bytes } => torn = Some(bytes),
        }
    }
    (whole, torn)
}

/// Appends all lines, continuing after failures, and returns those reported as saved.
fn append_all(folder: &Path) -> Vec<Vec<u8>> {
    let Ok(mut journal) = Journal::create(folder, "rows") else { return Vec::new() };
    lines().into_iter().filter(|line| journal.append(line).is_ok()).collect()
}

#[test]
fn lines_reported_as_saved_are_there_wherever_writing_stops() {
    let folder = tempdir().unwrap();
    let (saved, steps) = during(Fault::None, || append_all(folder.path()));
    assert_eq!(saved, lines());
    // Two to create it; a write and a sync per line.
    assert_eq!(steps.len(), 2 + 2 * lines().len());
    let faults = faults(&steps);
    assert!(faults.len() > 90, "{}", faults.len());
    for fault in faults {
        let folder = tempdir().unwrap();
        let (saved, _) = during(fault, || append_all(folder.path()));
        let found = journals(folder.path(), "rows").unwrap();
        assert!(found.len() <= 1, "{found:?}");
        let (whole, torn) = found.first().map_or((Vec::new(), None), |path| read(path));
        match fault {
            // The line at which it stopped may be there, completely or in part.
            Fault::Stop { .. } => {
                assert_eq!(whole[..saved.len()], saved, "{fault:?}");
                assert!(whole.len() <= saved.len() + 1, "{fault:?}");
                assert_eq!(whole, lines()[..whole.len()], "{fault:?}");
                if let Some(bytes) = torn {
                    assert!(bytes <= lines()[whole.len()].len() as u64, "{fault:?}");
                }
            }
            _ => assert_eq!((whole, torn), (saved, None), "{fault:?}"),
        }
    }
}

#[test]
fn a_line_that_cannot_be_taken_back_ends_the_journal() {
    let folder = tempdir().unwrap();
    let mut journal = Journal::create(folder.path(), "rows").unwrap();
    journal.append(b"first").unwrap();
    let (result, steps) = during(Fault::Stop { at: 0, bytes: 3 }, || journal.append(b"second"));
    result.unwrap_err();
    assert_eq!(steps.last().unwrap().0, Operation::Truncate);
    let message = journal.append(b"third").unwrap_err().to_string();
    assert!(message.contains("could not be removed"), "{message}");
    assert_eq!(read(journal.path()), (vec![b"first".to_vec()], Some(3)));
}

#[test]
fn a_journal_cut_anywhere_gives_its_whole_lines() {
    let folder = tempdir().unwrap();
    append_all(folder.path());
    let path = &journals(folder.path(), "rows").unwrap()[0];
    let bytes = fs::read(path).unwrap();
    for length in 0..=bytes.len() {
        let cut = folder.path().join("cut");
        fs::write(&cut, &bytes[..length]).unwrap();
        let (whole, torn) = read(&cut);
        let is_end = |byte: &u8| *byte == b'\n';
        let ends = bytes[..length].iter().filter(|byte| is_end(byte)).count();
        assert_eq!(whole, lines()[..ends], "{length}");
        let rest = length - bytes[..length].iter().rposition(is_end).map_or(0, |at| at + 1);
        assert_eq!(torn, (rest > 0).then_some(rest as u64), "{length}");
    }
}

#[test]
fn a_line_longer_than_the_limit_is_named_and_left_out() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("rows");
    for long in [11, 1000, 100_000] {
        let text = ["short", &"x".repeat(long), "exactly 10", &"y".repeat(long)].join("\n");
        fs::write(&path, text).unwrap();
        let mut lines = journal_lines(&path, 10).unwrap();
        let mut next = || match lines.next().unwrap() {
            Ok(JournalLine::Whole(line)) => String::from_utf8(line).unwrap(),
            Ok(JournalLine::Torn { bytes }) => format!("torn after {bytes}"),
            Err(error) => error.to_string(),
        };
        assert_eq!(next(), "short");
        assert_eq!(next(), format!("line 2 has {long} bytes, expected at most 10"));
        assert_eq!(next(), "exactly 10");
        assert_eq!(next(), format!("torn after {long}"));
        assert!(lines.next().is_none() && lines.next().is_none());
    }
}

#[test]
fn every_journal_is_a_file_of_its_own() {
    let folder = tempdir().unwrap();
    let mut all: Vec<Journal> =
        (0..50).map(|_| Journal::create(folder.path(), "rows").unwrap()).collect();
    for (number, journal) in all.iter_mut().enumerate() {
        journal.append(number.to_string().as_bytes()).unwrap();
    }
    for other in [
        "rows.jsonl",
        "rows-1.jsonl",
        "rows-1-AbCd123.jsonl",
        "rows-1-AbCd1234.jsonl.bak",
        "more-rows-1-AbCd1234.jsonl",
        "rows-x-AbCd1234.jsonl",
    ] {
        fs::write(folder.path().join(other), "").unwrap();
    }
    let mut expected: Vec<PathBuf> = all.iter().map(|journal| journal.path().to_owned()).collect();
    expected.sort();
    assert_eq!(journals(folder.path(), "rows").unwrap(), expected);
    assert_eq!(journals(&folder.path().join("absent"), "rows").unwrap(), Vec::<PathBuf>::new());
    for (number, journal) in all.iter().enumerate() {
        assert_eq!(read(journal.path()).0, [number.to_string().into_bytes()]);
    }
    let error = all[0].append(b"two\nlines").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::InvalidInput);
    assert!(Journal::create(&folder.path().join("absent"), "rows").is_err());
}

#[test]
fn rows_in_a_removed_or_replaced_folder_are_not_reported_as_saved() {
    type Change = fn(&TempDir, &Path);
    let changes: [Change; 6] = [
        |_, path| fs::remove_file(path).unwrap(),
        |_, path| fs::remove_dir_all(path.parent().unwrap()).unwrap(),
        |top, path| fs::rename(path.parent().unwrap(), top.path().join("moved")).unwrap(),
        |top, path| {
            fs::rename(path.parent().unwrap(), top.path().join("moved")).unwrap();
            fs::create_dir(path.parent().unwrap()).unwrap();
            fs::copy(top.path().join("moved").join(path.file_name().unwrap()), path).unwrap();
        },
        |top, path| {
            fs::copy(path, top.path().join("copy")).unwrap();
            fs::rename(top.path().join("copy"), path).unwrap();
        },
        |_, path| {
            fs::remove_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path.parent().unwrap(), "a file").unwrap();
        },
    ];
    for (number, change) in changes.into_iter().enumerate() {
        let top = tempdir().unwrap();
        let folder = top.path().join("results");
        create_folder(&folder).unwrap();
        let mut journal = Journal::create(&folder, "rows").unwrap();
        journal.append(b"first").unwrap();
        change(&top, journal.path());
        for _ in 0..2 {
            let error = journal.append(b"second").unwrap_err();
            assert_eq!(error.kind(), ErrorKind::NotFound, "{number}: {error}");
            assert!(error.to_string().contains("removed or replaced"), "{number}: {error}");
        }
        if journal.path().exists() {
            assert_eq!(read(journal.path()).0, [b"first".to_vec()], "{number}");
        }
    }
}

#[test]
fn an_own_file_goes_on_where_it_ended() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("log.part");
    let mut file = OwnFile::open_or_create(&path).unwrap();
    file.write_all(b"abcdef").unwrap();
    file.set_length(4).unwrap();
    drop(file);
    let mut file = OwnFile::open_or_create(&path).unwrap();
    assert_eq!(file.length().unwrap(), 4);
    file.seek(SeekFrom::End(0)).unwrap();
    file.write_all(b"-").unwrap();
    file.sync().unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "abcd-");
    assert!(file.is_in_place().unwrap());
    file.remove().unwrap();
    assert!(!path.exists());
    // Removing a missing file is fine; failing to remove one is an error.
    remove(&path).unwrap();
    remove_folder(&path).unwrap();
    assert!(remove(folder.path()).is_err());
}

#[test]
fn nothing_is_written_while_writes_are_held() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("map.csv");
    let mut journal = Journal::create(folder.path(), "rows").unwrap();
    let rows = journal.path().to_owned();
    let held = hold();
    std::thread::scope(|scope| {
        let writers = [
            scope.spawn(|| write_atomically(&path, b"new").unwrap()),
            scope.spawn(move || journal.append(b"row").unwrap()),
        ];
        std::thread::sleep(std::time::Duration::from_millis(100));
        assert!(!path.exists() && fs::read(&rows).unwrap().is_empty());
        assert_eq!(names(folder.path()).len(), 1);
        drop(held);
        for writer in writers {
            writer.join().unwrap();
        }
    });
    assert_eq!(fs::read(&path).unwrap(), b"new");
    assert_eq!(fs::read(&rows).unwrap(), b"row\n");
}

#[test]
fn names_of_every_length_can_be_written() {
    let folder = tempdir().unwrap();
    for length in 1..=255 {
        let path = folder.path().join("x".repeat(length));
        write_atomically(&path, b"new").unwrap();
        write_atomically(&path, b"newer").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"newer");
    }
    assert_eq!(names(folder.path()).len(), 255);
    assert!(write_atomically(&folder.path().join("x".repeat(256)), b"new").is_err());
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::ffi::OsStringExt;
        for length in [1, 200, 255] {
            let name = std::ffi::OsString::from_vec(vec![0xff; length]);
            write_atomically(&folder.path().join(name), b"new").unwrap();
        }
    }
}

//! Fetching a data set from a local HTTP server that truncates, stalls, lies and recovers.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::http_server::{
    Answer, Server, ok, ok_without_length, rest, status, truncated, with_headers,
};
use mcl_core::files::fault::{Fault, during};
use mcl_core::{LaserScan, Pose2, Recording, ScanGeometry};
use mcl_datasets::registry::{
    Content, Facts, FetchError, FetchEvent, FetchSettings, Fetched, ReadLogError, Registry,
    UrlFailure, Verification, VerifyError,
};
use tempfile::TempDir;

/// A log in a format of these tests: one scan per line, one reading per word.
fn log() -> Vec<u8> {
    (0..2000).map(|i| format!("{}.5 {}.25 20\n", i % 9 + 1, i % 5 + 1)).collect::<String>().into()
}

/// As if a header line differed: other bytes, the same numbers of scans and points.
fn other_copy() -> Vec<u8> {
    [b"3.0 4.0 21\n", &log()[b"1.5 1.25 20\n".len()..]].concat()
}

const FACTS: &str = "[facts]\nscans = 2000\nreadings = 6000\npoints = 4000\n";

fn read(path: &Path) -> Result<Facts, ReadLogError> {
    let mut scans = Vec::new();
    for line in std::fs::read_to_string(path)?.lines() {
        let ranges = line.split(' ').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        scans.push(LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: 0.0, angle_step: 0.1, beams: ranges.len() },
            ranges,
            map_from_laser: Some(Pose2::IDENTITY),
            odometry: None,
            sweep: Default::default(),
        });
    }
    Ok(Facts::of(&Recording { scans, robot_from_laser: Pose2::IDENTITY }, 10.0))
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn content(bytes: &[u8]) -> Content {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    Content::of_file(file.path()).unwrap()
}

/// A folder with a registry of one data set, `lab`, whose only known copy is `log()`.
struct Lab {
    folder: TempDir,
}

impl Lab {
    fn new(urls: &[String]) -> Lab {
        Lab::with_facts(urls, FACTS)
    }

    fn with_facts(urls: &[String], facts: &str) -> Lab {
        let lab = Lab { folder: tempfile::tempdir().unwrap() };
        std::fs::create_dir_all(lab.data()).unwrap();
        lab.define(urls, facts);
        lab
    }

    fn define(&self, urls: &[String], facts: &str) {
        let Content { sha256, bytes } = content(&log());
        let text = format!(
            "title = 'Lab'\ndescription = ''\nformat = 'carmen'\nfile = 'lab.gfs.log'\n\
             other_names = ['lab-corrected.log.gz']\nurls = {urls:?}\nmax_range = 10.0\n\
             terms = ''\ncitation = ''\nsensor.robot_from_laser = {{ x = 0, y = 0, theta = 0 }}\n\
             {facts}[[copy]]\nsha256 = '{sha256}'\nbytes = {bytes}\n"
        );
        std::fs::write(self.data().join("dataset.toml"), text).unwrap();
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("datasets/lab")
    }

    fn registry(&self) -> Registry {
        Registry::discover(self.folder.path(), None).unwrap()
    }

    fn fetch(&self) -> Result<Fetched, FetchError> {
        self.fetch_with(&settings(), &mut |_| ())
    }

    fn fetch_with(
        &self,
        settings: &FetchSettings,
        report: &mut dyn FnMut(FetchEvent<'_>),
    ) -> Result<Fetched, FetchError> {
        let registry = self.registry();
        registry.fetch(registry.get("lab").unwrap(), settings, &read, report)
    }

    fn verify(&self) -> Result<Verification, VerifyError> {
        let registry = self.registry();
        registry.verify(registry.get("lab").unwrap(), &read)
    }

    /// Names of all files beside the definition.
    fn files(&self) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.data()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name != "dataset.toml").collect()
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.data().join(name), bytes).unwrap();
    }

    /// The fetched file is there, whole, and nothing else is.
    #[track_caller]
    fn assert_only_the_log(&self, result: Result<Fetched, FetchError>) {
        let fetched = result.unwrap_or_else(|error| panic!("{error}"));
        let Fetched::Downloaded { path, .. } = fetched else { panic!("{fetched:?}") };
        assert_eq!(path, self.data().join("lab.gfs.log"));
        assert_eq!(std::fs::read(path).unwrap(), log());
        assert_eq!(self.files(), BTreeSet::from(["lab.gfs.log".to_owned()]));
    }

    /// Nothing is there but, if anything, a part file.
    #[track_caller]
    fn assert_files(&self, expected: &[&str]) {
        assert_eq!(self.files(), expected.iter().map(|name| name.to_string()).collect());
    }
}

/// No waiting between attempts, but patience with a busy machine.
fn settings() -> FetchSettings {
    FetchSettings { retry_wait: Duration::ZERO, ..FetchSettings::default() }
}

#[track_caller]
fn last_failure(result: Result<Fetched, FetchError>) -> (UrlFailure, String) {
    let error = result.expect_err("the fetch should have failed");
    let message = error.to_string();
    let FetchError::AllFailed { mut failures, .. } = error else { panic!("{error}") };
    (failures.pop().unwrap().1, message)
}

#[test]
fn a_plain_file_is_fetched_and_progress_is_reported() {
    let server = Server::start(vec![Answer::Send(ok(&log()))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    let mut progress = Vec::new();
    let result = lab.fetch_with(&settings(), &mut |event| {
        if let FetchEvent::Progress { downloaded, total } = event {
            progress.push((downloaded, total));
        }
    });
    lab.assert_only_the_log(result);
    let size = log().len() as u64;
    assert_eq!(progress.first(), Some(&(0, Some(size))));
    assert_eq!(progress.last(), Some(&(size, Some(size))));
    assert!(progress.is_sorted());
    assert_eq!(server.ranges(), [None]);
    let Verification::Found(found) = lab.verify().unwrap() else { panic!("no file") };
    assert_eq!(found.status(), "known copy, facts agree");
    assert!(found.is_good());
}

/// The answer of a well-behaved server to whoever has so many bytes.
fn answer_to(kept: usize, bytes: &[u8]) -> Answer {
    Answer::Send(match kept {
        0 => ok(bytes),
        kept if kept < bytes.len() => rest(bytes, kept),
        _ => {
            let range = [("Content-Range", format!("bytes */{}", bytes.len()))];
            with_headers("416 Range Not Satisfiable", &range, b"")
        }
    })
}

/// Killed fetches once left the unpacked log behind, each a copy of its own.
#[test]
fn a_fetch_that_ends_anywhere_goes_on_and_leaves_nothing() {
    let packed = gzip(&log());
    let lab_at = |answer: Answer| {
        let server = Server::start(vec![answer]);
        let lab = Lab::new(&[server.url("lab.log.gz")]);
        (server, lab)
    };
    let once = FetchSettings { attempts: 1, ..settings() };
    let (_server, lab) = lab_at(answer_to(0, &packed));
    let (_, steps) = during(Fault::None, || lab.fetch().unwrap());
    assert!(steps.len() >= 9, "{steps:?}");
    let (mut resumed, mut killed) = (0, 0);
    for (at, (_, length, _)) in steps.iter().enumerate() {
        let mut cuts = vec![0];
        if *length > 0 {
            cuts.extend([1, length / 2, length - 1]);
        }
        for bytes in cuts {
            for fault in [Fault::Stop { at, bytes }, Fault::Full { at, bytes }, Fault::Fail { at }]
            {
                let (_server, lab) = lab_at(answer_to(0, &packed));
                let (result, _) = during(fault, || lab.fetch_with(&once, &mut |_| ()));
                killed += usize::from(result.is_err());
                let part = std::fs::metadata(lab.data().join("lab.gfs.log.part"));
                let kept = part.map_or(0, |part| part.len() as usize);
                resumed += usize::from(kept > 0);
                let server = Server::start(vec![answer_to(kept, &packed)]);
                lab.define(&[server.url("lab.log.gz")], FACTS);
                lab.fetch().unwrap_or_else(|error| panic!("{fault:?}: {error}"));
                lab.assert_files(&["lab.gfs.log"]);
                assert_eq!(std::fs::read(lab.data().join("lab.gfs.log")).unwrap(), log());
            }
        }
    }
    assert!(killed > 40 && resumed > 20, "{killed} {resumed}");
}

#[cfg(unix)]
#[test]
fn a_part_file_that_is_a_link_or_a_pipe_is_not_written() {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    let place = |lab: &Lab, name: &str| lab.data().join(name);
    type Obstacle = fn(&Path, &Path);
    let obstacles: [(Obstacle, &str); 3] = [
        (|path, target| std::os::unix::fs::symlink(target, path).unwrap(), "symbolic link"),
        (|path, _| std::fs::create_dir(path).unwrap(), "a folder"),
        (
            |path, _| mknodat(CWD, path, FileType::Fifo, Mode::from_raw_mode(0o644), 0).unwrap(),
            "a FIFO",
        ),
    ];
    for name in ["lab.gfs.log.part", "lab.gfs.log"] {
        for (put, what) in obstacles {
            let server = Server::start(vec![Answer::Send(ok(&log()))]);
            let lab = Lab::new(&[server.url("lab.log")]);
            let target = lab.folder.path().join("target");
            // A link to a file is where the log is read from: only one to nothing is in the way.
            if name.ends_with(".part") {
                std::fs::write(&target, "not ours").unwrap();
            }
            put(&place(&lab, name), &target);
            let message = lab.fetch().unwrap_err().to_string();
            assert!(message.contains(name) && message.contains(what), "{message}");
            assert_eq!(server.requests().len(), 0, "{message}");
            let untouched = std::fs::read_to_string(&target).ok();
            assert_eq!(untouched.as_deref(), name.ends_with(".part").then_some("not ours"));
            lab.assert_files(&[name]);
        }
    }
}

#[cfg(unix)]
#[test]
fn a_fetched_file_has_the_permissions_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let server = Server::start(vec![Answer::Send(ok(&log()))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.fetch().unwrap();
    let mode =
        |name: &str| std::fs::metadata(lab.data().join(name)).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode("lab.gfs.log"), mode("dataset.toml"));
}

#[test]
fn gzip_is_unpacked_whatever_the_address_is_called() {
    for path in ["lab.gfs.log.gz", "lab.log", "download?id=7"] {
        let server = Server::start(vec![Answer::Send(ok(&gzip(&log())))]);
        let lab = Lab::new(&[server.url(path)]);
        lab.assert_only_the_log(lab.fetch());
    }
}

#[test]
fn redirects_are_followed_and_keep_the_range() {
    let log = log();
    let to_other = || {
        let location = ("Location", "/other".to_owned());
        Answer::Send(with_headers(
            "302 Found",
            &[location, ("Content-Length", "0".to_owned())],
            b"",
        ))
    };
    let server = Server::start(vec![
        to_other(),
        Answer::Send(truncated(&log, 700)),
        to_other(),
        Answer::Send(rest(&log, 700)),
    ]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.assert_only_the_log(lab.fetch());
    let requests = server.requests();
    assert_eq!(requests[3].path, "/other");
    assert_eq!(requests[3].range.as_deref(), Some("bytes=700-"));
}

#[test]
fn redirects_to_other_schemes_and_without_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let secret = folder.path().join("lab.gfs.log");
    std::fs::write(&secret, log()).unwrap();
    let to = |location: &str| {
        let headers = [("Location", location.to_owned()), ("Content-Length", "0".to_owned())];
        Answer::Send(with_headers("302 Found", &headers, b""))
    };
    let file = format!("file://{}", secret.display());
    for location in [&file, "ftp://127.0.0.1/lab.gfs.log", "gopher://127.0.0.1/", "javascript:0"] {
        let server = Server::start(vec![to(location)]);
        let lab = Lab::new(&[server.url("lab.log")]);
        // What has no host is taken for a path at the server, which has no such file.
        let (failure, message) = last_failure(lab.fetch());
        let refused = matches!(failure, UrlFailure::NoAnswer(_) | UrlFailure::Status(_));
        assert!(refused, "{location}: {message}");
        assert!(server.requests().len() <= 2, "{location}: {message}");
        lab.assert_files(&[]);
    }
    let server = Server::start((0..50).map(|_| to("/again")).collect());
    let lab = Lab::new(&[server.url("lab.log")]);
    let (failure, message) = last_failure(lab.fetch());
    assert!(matches!(failure, UrlFailure::NoAnswer(ureq::Error::TooManyRedirects)), "{message}");
    assert!(server.requests().len() <= 11, "{}", server.requests().len());
    lab.assert_files(&[]);
}

#[test]
fn a_truncated_transfer_goes_on_within_one_fetch() {
    let packed = gzip(&log());
    let half = packed.len() / 2;
    let server = Server::start(vec![
        Answer::Send(truncated(&packed, half)),
        Answer::Send(rest(&packed, half)),
    ]);
    let lab = Lab::new(&[server.url("lab.log.gz")]);
    lab.assert_only_the_log(lab.fetch());
    assert_eq!(server.ranges(), [None, Some(format!("bytes={half}-"))]);
}

#[test]
fn a_truncated_transfer_goes_on_in_the_next_fetch() {
    let packed = gzip(&log());
    let half = packed.len() / 2;
    let server = Server::start(vec![
        Answer::Send(truncated(&packed, half)),
        Answer::Send(rest(&packed, half)),
    ]);
    let lab = Lab::new(&[server.url("lab.log.gz")]);
    let once = FetchSettings { attempts: 1, ..settings() };
    let (failure, message) = last_failure(lab.fetch_with(&once, &mut |_| ()));
    assert!(
        matches!(failure, UrlFailure::Broken { received, total, .. }
            if received == half as u64 && total == Some(packed.len() as u64)),
        "{failure}"
    );
    assert!(message.contains(&format!("{half} bytes are kept in ")), "{message}");
    assert!(message.contains("fetch again"), "{message}");
    lab.assert_files(&["lab.gfs.log.part"]);
    assert!(matches!(lab.verify(), Err(VerifyError::Locate(_))));

    lab.assert_only_the_log(lab.fetch());
    assert_eq!(server.ranges(), [None, Some(format!("bytes={half}-"))]);
}

#[test]
fn a_server_that_ignores_the_range_sends_the_whole_file() {
    let log = log();
    let server = Server::start(vec![Answer::Send(truncated(&log, 1000)), Answer::Send(ok(&log))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.assert_only_the_log(lab.fetch());
    assert_eq!(server.ranges()[1].as_deref(), Some("bytes=1000-"));
}

#[test]
fn a_server_that_answers_another_range_is_asked_for_the_whole_file() {
    let log = log();
    let server = Server::start(vec![
        Answer::Send(truncated(&log, 1000)),
        Answer::Send(rest(&log, 500)),
        Answer::Send(ok(&log)),
    ]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.assert_only_the_log(lab.fetch());
    assert_eq!(server.ranges(), [None, Some("bytes=1000-".to_owned()), None]);
}

#[test]
fn kept_bytes_that_do_not_match_are_dropped_and_the_file_is_fetched_again() {
    let log = log();
    let server = Server::start(vec![Answer::Send(rest(&log, 300)), Answer::Send(ok(&log))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.put("lab.gfs.log.part", &[b'x'; 300]);
    lab.assert_only_the_log(lab.fetch());
    assert_eq!(server.ranges(), [Some("bytes=300-".to_owned()), None]);
}

#[test]
fn kept_bytes_that_are_the_whole_file_need_no_transfer() {
    let log = log();
    let range = [("Content-Range", format!("bytes */{}", log.len()))];
    let server =
        Server::start(vec![Answer::Send(with_headers("416 Range Not Satisfiable", &range, b""))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.put("lab.gfs.log.part", &log);
    lab.assert_only_the_log(lab.fetch());
}

#[test]
fn kept_bytes_beyond_the_end_of_the_file_are_dropped() {
    let log = log();
    let range = [("Content-Range", format!("bytes */{}", log.len()))];
    let server = Server::start(vec![
        Answer::Send(with_headers("416 Range Not Satisfiable", &range, b"")),
        Answer::Send(ok(&log)),
    ]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.put("lab.gfs.log.part", &[log.clone(), b"more".to_vec()].concat());
    lab.assert_only_the_log(lab.fetch());
}

#[test]
fn a_gzip_answer_without_a_length_that_ends_early_is_resumed() {
    let packed = gzip(&log());
    let half = packed.len() / 2;
    let server = Server::start(vec![
        Answer::Send(ok_without_length(&packed[..half])),
        Answer::Send(rest(&packed, half)),
    ]);
    let lab = Lab::new(&[server.url("lab.log.gz")]);
    lab.assert_only_the_log(lab.fetch());
}

#[test]
fn a_wrong_file_is_refused_and_leaves_nothing() {
    let wrong = [log(), b"1.0 2.0 3.0\n".to_vec()].concat();
    let server = Server::start(vec![Answer::Send(ok(&gzip(&wrong)))]);
    let lab = Lab::new(&[server.url("lab.log.gz")]);
    let (failure, message) = last_failure(lab.fetch());
    let found = content(&wrong);
    assert!(matches!(failure, UrlFailure::UnknownCopy { found: f, .. } if f == found), "{failure}");
    assert!(message.contains(&found.sha256.to_string()), "{message}");
    assert!(message.contains(&content(&log()).sha256.to_string()), "{message}");
    assert!(message.contains("add to datasets/lab/dataset.toml:\n[[copy]]\n"), "{message}");
    lab.assert_files(&[]);
    assert_eq!(server.requests().len(), 1, "a whole wrong file is not asked for twice");
}

#[test]
fn what_the_error_says_to_add_makes_an_unknown_copy_a_known_one() {
    let other = other_copy();
    let server = Server::start(vec![Answer::Send(ok(&other)), Answer::Send(ok(&other))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    let (_, message) = last_failure(lab.fetch());
    let (_, to_add) = message.split_once("dataset.toml:\n").unwrap();
    let definition = lab.data().join("dataset.toml");
    let text = std::fs::read_to_string(&definition).unwrap();
    std::fs::write(&definition, format!("{text}\n{to_add}\n")).unwrap();
    lab.fetch().unwrap();
    assert_eq!(std::fs::read(lab.data().join("lab.gfs.log")).unwrap(), other);
}

#[test]
fn a_gzip_file_that_is_broken_at_the_server_is_refused_and_leaves_nothing() {
    let packed = gzip(&log());
    let mut flipped = packed.clone();
    flipped[packed.len() / 2] ^= 0x55;
    for broken in [packed[..packed.len() / 2].to_vec(), flipped] {
        let server = Server::start(vec![Answer::Send(ok(&broken))]);
        let lab = Lab::new(&[server.url("lab.log.gz")]);
        let (failure, _) = last_failure(lab.fetch());
        // A flipped bit may also decode to something else; the checksum of gzip then shows it.
        assert!(matches!(failure, UrlFailure::Gzip(_)), "{failure}");
        lab.assert_files(&[]);
    }
}

#[test]
fn what_is_far_too_large_is_not_read_on() {
    // Announced, not announced, and packed so well that only unpacking shows it.
    let big = vec![b'1'; 3_000_000];
    let announced = with_headers("200 OK", &[("Content-Length", big.len().to_string())], b"1 1");
    for answer in [announced, ok_without_length(&big), ok(&gzip(&big))] {
        let server = Server::start(vec![Answer::Send(answer)]);
        let lab = Lab::new(&[server.url("lab.log")]);
        let (failure, _) = last_failure(lab.fetch());
        assert!(matches!(failure, UrlFailure::TooLarge { .. }), "{failure}");
        lab.assert_files(&[]);
    }
}

#[test]
fn a_stalled_answer_is_given_up_and_what_came_is_kept() {
    let log = log();
    let server = Server::start(vec![
        Answer::Hang(truncated(&log, 1000)),
        Answer::Hang(Vec::new()),
        Answer::Send(rest(&log, 1000)),
    ]);
    let lab = Lab::new(&[server.url("lab.log")]);
    // Long enough that a busy machine does not look like a stalled server.
    let impatient =
        FetchSettings { stall_timeout: Duration::from_secs(1), attempts: 2, ..settings() };
    let mut failed = Vec::new();
    let result = lab.fetch_with(&impatient, &mut |event| {
        if let FetchEvent::Failed { failure, retrying, .. } = event {
            failed.push((failure.to_string(), retrying));
        }
    });
    let (_, message) = last_failure(result);
    let [(first, true), (second, false)] = failed.as_slice() else { panic!("{failed:?}") };
    assert!(first.contains("after 1000 bytes of") && first.contains("timeout"), "{first}");
    assert!(second.contains("no answer: timeout"), "{second}");
    assert!(message.contains("1000 bytes are kept in"), "{message}");
    lab.assert_files(&["lab.gfs.log.part"]);
    lab.assert_only_the_log(lab.fetch());
}

#[test]
fn a_server_that_drips_is_given_up_at_the_limit_of_an_attempt() {
    let server = Server::start(vec![Answer::Drip(truncated(&log(), 10))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    let attempt_timeout = Duration::from_secs(1);
    let once = FetchSettings { attempt_timeout, attempts: 1, ..settings() };
    let (failure, message) = last_failure(lab.fetch_with(&once, &mut |_| ()));
    assert!(matches!(failure, UrlFailure::Broken { .. }), "{message}");
    assert!(message.contains("timeout: global"), "{message}");
}

#[test]
fn another_address_is_asked_when_the_first_does_not_have_the_file() {
    let server = Server::start(vec![
        Answer::Send(status("404 Not Found", "no such log")),
        Answer::Send(ok(&gzip(&log()))),
    ]);
    let lab = Lab::new(&[server.url("old.log"), server.url("new.log.gz")]);
    lab.assert_only_the_log(lab.fetch());
    let paths: Vec<_> = server.requests().into_iter().map(|request| request.path).collect();
    assert_eq!(paths, ["/old.log", "/new.log.gz"]);
}

#[test]
fn another_address_is_asked_when_the_first_has_a_wrong_file() {
    let server =
        Server::start(vec![Answer::Send(ok(b"<html>moved</html>")), Answer::Send(ok(&log()))]);
    let lab = Lab::new(&[server.url("old.log"), server.url("new.log")]);
    lab.assert_only_the_log(lab.fetch());
}

#[test]
fn an_overloaded_server_is_asked_again_and_a_refusing_one_is_not() {
    let server = Server::start(vec![
        Answer::Send(status("503 Service Unavailable", "")),
        Answer::Send(ok(&log())),
    ]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.assert_only_the_log(lab.fetch());

    let server = Server::start(vec![Answer::Send(status("403 Forbidden", ""))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    let (_, message) = last_failure(lab.fetch());
    assert!(message.contains("403 Forbidden"), "{message}");
    assert_eq!(server.requests().len(), 1);
    lab.assert_files(&[]);
}

#[test]
fn every_address_is_named_when_none_answers() {
    let closed = Server::start(vec![]);
    let urls = [closed.url("a.log"), closed.url("b.log")];
    drop(closed);
    let lab = Lab::new(&urls);
    let (_, message) = last_failure(lab.fetch());
    assert!(urls.iter().all(|url| message.contains(url.as_str())), "{message}");
    assert!(message.contains("no answer"), "{message}");
    lab.assert_files(&[]);
}

#[test]
fn a_known_copy_on_disk_is_taken_under_any_name_and_nothing_is_downloaded() {
    for (name, bytes) in [
        ("lab.gfs.log", log()),
        ("lab.gfs.log.gz", gzip(&log())),
        ("lab-corrected.log", log()),
        ("lab-corrected.log.gz", gzip(&log())),
        // The content says whether it is packed, not the name.
        ("lab-corrected.log.gz", log()),
    ] {
        let server = Server::start(vec![]);
        let lab = Lab::new(&[server.url("lab.log")]);
        lab.put(name, &bytes);
        let path = lab.data().join(name);
        let expected = Fetched::AlreadyPresent { path, content: content(&log()) };
        assert_eq!(lab.fetch().unwrap(), expected);
        assert_eq!(server.requests(), []);
        lab.assert_files(&[name]);
    }
}

#[test]
fn an_unknown_file_on_disk_is_neither_taken_nor_overwritten() {
    let other = [b"1.0 2.0 30.0\n".to_vec(), log()].concat();
    let server = Server::start(vec![]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.put("lab-corrected.log", &other);
    let message = lab.fetch().unwrap_err().to_string();
    assert!(message.contains("lab-corrected.log is there already"), "{message}");
    assert!(message.contains(&content(&other).sha256.to_string()), "{message}");
    assert_eq!(server.requests(), []);
    assert_eq!(std::fs::read(lab.data().join("lab-corrected.log")).unwrap(), other);

    let Verification::Found(found) = lab.verify().unwrap() else { panic!("no file") };
    assert_eq!(found.status(), "unknown copy, facts differ");
    assert!(!found.is_good());
    assert_eq!(found.mismatches.unwrap()[0].to_string(), "2001 scans, expected 2000");
}

#[test]
fn an_unknown_copy_whose_facts_agree_is_distinguished() {
    let lab = Lab::new(&[]);
    lab.put("lab.gfs.log", &other_copy());
    let Verification::Found(found) = lab.verify().unwrap() else { panic!("no file") };
    assert_eq!(found.status(), "unknown copy, facts agree");
    assert!(found.is_good() && !found.accepted);
}

#[test]
fn a_cut_off_file_on_disk_is_an_error_of_verify_and_fetch() {
    let packed = gzip(&log());
    let server = Server::start(vec![]);
    let lab = Lab::new(&[server.url("lab.log")]);
    lab.put("lab.gfs.log.gz", &packed[..packed.len() / 2]);
    assert!(matches!(lab.verify(), Err(VerifyError::Content { .. })));
    assert!(matches!(lab.fetch(), Err(FetchError::UnreadableFile { .. })));
    lab.assert_files(&["lab.gfs.log.gz"]);
}

#[test]
fn a_known_copy_that_contradicts_the_facts_is_not_stored() {
    let server = Server::start(vec![Answer::Send(ok(&log()))]);
    let lab = Lab::with_facts(&[server.url("lab.log")], &FACTS.replace("4000", "4001"));
    let message = lab.fetch().unwrap_err().to_string();
    assert!(message.contains("4000 points, expected 4001"), "{message}");
    lab.assert_files(&[]);
}

#[test]
fn a_known_copy_in_the_data_folder_is_used_and_an_unknown_one_does_not_interfere() {
    let server = Server::start(vec![Answer::Send(ok(&log()))]);
    let lab = Lab::new(&[server.url("lab.log")]);
    let shared = tempfile::tempdir().unwrap();
    std::fs::create_dir(shared.path().join("lab")).unwrap();
    let path = shared.path().join("lab/lab.gfs.log");
    let registry = Registry::discover(lab.folder.path(), Some(shared.path())).unwrap();
    let dataset = registry.get("lab").unwrap();

    std::fs::write(&path, log()).unwrap();
    let fetched = registry.fetch(dataset, &settings(), &read, &mut |_| ()).unwrap();
    assert_eq!(fetched, Fetched::AlreadyPresent { path: path.clone(), content: content(&log()) });

    std::fs::write(&path, b"1.0\n").unwrap();
    assert_eq!(registry.locate(dataset).unwrap(), path);
    lab.assert_only_the_log(registry.fetch(dataset, &settings(), &read, &mut |_| ()));
    assert_eq!(registry.locate(dataset).unwrap(), lab.data().join("lab.gfs.log"));
    assert_eq!(std::fs::read(&path).unwrap(), b"1.0\n");
}

#[test]
fn simulated_data_and_data_without_an_address_say_so() {
    let lab = Lab::new(&[]);
    let registry = lab.registry();
    let office = registry.get("simulated-office").unwrap();
    let fetched = registry.fetch(office, &settings(), &read, &mut |_| ()).unwrap();
    assert_eq!(fetched, Fetched::Simulated);
    assert_eq!(registry.verify(office, &read).unwrap(), Verification::Simulated);
    let message = lab.fetch().unwrap_err().to_string();
    assert!(message.contains("names no address"), "{message}");
    assert!(message.contains(&lab.data().display().to_string()), "{message}");
}

#[test]
fn a_file_of_an_archive_is_taken_out_of_it_and_checked() {
    let archive = |path: &str| {
        let mut archive = tar::Builder::new(Vec::new());
        for (path, bytes) in [("lab-1.0/README.md", &b"A lab."[..]), (path, &log())] {
            let mut header = tar::Header::new_gnu();
            header.set_size(bytes.len() as u64);
            header.set_mode(0o644);
            archive.append_data(&mut header, path, bytes).unwrap();
        }
        gzip(&archive.into_inner().unwrap())
    };
    let of_member = |lab: &Lab| {
        let path = lab.data().join("dataset.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(path, format!("member = 'lab-1.0/data/lab.log'\n{text}")).unwrap();
    };
    let server = Server::start(vec![Answer::Send(ok(&archive("lab-1.0/data/lab.log")))]);
    let lab = Lab::new(&[server.url("/lab-1.0.tar.gz")]);
    of_member(&lab);
    lab.assert_only_the_log(lab.fetch());

    let server = Server::start(vec![Answer::Send(ok(&archive("lab-1.0/elsewhere.log")))]);
    let lab = Lab::new(&[server.url("/lab-1.0.tar.gz")]);
    of_member(&lab);
    let (failure, message) = last_failure(lab.fetch());
    assert!(matches!(failure, UrlFailure::NoMember { .. }), "{message}");
    assert!(message.contains("no file \"lab-1.0/data/lab.log\""), "{message}");
    lab.assert_files(&[]);
}

//! Every target over its saved corpus, and over mutations of it: what libFuzzer does on nightly, without
//! coverage, on any toolchain.
//!
//! `MCL_FUZZ_CASES` is the number of mutations per target (2,000 unless set); `MCL_FUZZ_SEED` (0 unless
//! set) chooses others. A failing input is saved, and the message says where; `MCL_FUZZ_INPUT=FILE` runs
//! that file alone.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use mcl_fuzz::{TARGETS, Target};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

const CASES: u32 = 2_000;
/// Longest input, in bytes: longer than any in the corpus, of which bags of ROS 1 have their index at the end.
const MAX_BYTES: usize = 1 << 15;

/// What stands at the edge of what numbers, lengths and texts can be.
const EDGES: [&[u8]; 26] = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e308",
    b"-1e308",
    b"1e-320",
    b"0",
    b"-0",
    b"-1",
    b"1e9",
    b"-1e9",
    b"6.28318530717958647692",
    b"2147483648",
    b"4294967295",
    b"9223372036854775808",
    b"18446744073709551615",
    b"99999999999999999999999",
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\"",
    b"\r\n",
    &[0xff; 4],
    &[0, 0, 0, 0, 0, 0, 0, 0x80],
    &[0xff; 8],
    &[0, 0, 0, 0, 0, 0, 0xf0, 0x7f],
];

/// A change of an input; positions are parts of its length.
#[derive(Debug, Clone)]
enum Mutation {
    Flip(Index, u8),
    Insert(Index, Vec<u8>),
    Delete(Index, Index),
    Repeat(Index, Index, usize),
    Splice(Index, Index, Index),
    Overwrite(Index, Index),
    /// The number, or word, that stands there.
    ReplaceWord(Index, Index),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let at = any::<Index>;
    prop_oneof![
        (at(), 1..=255_u8).prop_map(|(at, bits)| Mutation::Flip(at, bits)),
        (at(), prop::collection::vec(any::<u8>(), 1..9)).prop_map(|(a, b)| Mutation::Insert(a, b)),
        (at(), at()).prop_map(|(from, to)| Mutation::Delete(from, to)),
        (at(), at(), 1..8_usize).prop_map(|(from, to, times)| Mutation::Repeat(from, to, times)),
        (at(), at(), at()).prop_map(|(at, other, from)| Mutation::Splice(at, other, from)),
        (at(), at()).prop_map(|(at, edge)| Mutation::Overwrite(at, edge)),
        (at(), at()).prop_map(|(at, edge)| Mutation::ReplaceWord(at, edge)),
    ]
}

fn apply(mutation: &Mutation, input: &mut Vec<u8>, corpus: &[(PathBuf, Vec<u8>)]) {
    let length = input.len();
    let position = |index: &Index| index.index(length + 1);
    // At most 64 bytes, so that most of an input stays what it was.
    let range = |from: &Index, to: &Index| {
        let from = position(from);
        from..(from + 1 + to.index(64)).min(length)
    };
    match mutation {
        Mutation::Flip(at, bits) if length > 0 => input[at.index(length)] ^= bits,
        Mutation::Flip(..) => {}
        Mutation::Insert(at, bytes) => {
            let at = position(at);
            input.splice(at..at, bytes.iter().copied());
        }
        Mutation::Delete(from, to) => drop(input.drain(range(from, to))),
        Mutation::Repeat(from, to, times) => {
            let range = range(from, to);
            let (end, repeated) = (range.end, input[range].repeat(*times));
            input.splice(end..end, repeated);
        }
        Mutation::Splice(at, other, from) => {
            let other = &other.get(corpus).1;
            input.truncate(position(at));
            input.extend(&other[from.index(other.len() + 1)..]);
        }
        Mutation::Overwrite(at, edge) => {
            let (at, edge) = (position(at), edge.get(&EDGES));
            input.splice(at..(at + edge.len()).min(length), edge.iter().copied());
        }
        Mutation::ReplaceWord(at, edge) => {
            let at = position(at);
            let is_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"+-._".contains(byte);
            let start = input[..at].iter().rposition(|byte| !is_word(byte)).map_or(0, |at| at + 1);
            let end = input[at..].iter().position(|byte| !is_word(byte)).map_or(length, |n| at + n);
            input.splice(start..end, edge.get(&EDGES).iter().copied());
        }
    }
    input.truncate(MAX_BYTES);
}

/// The saved inputs of a target, by name.
fn corpus_of(target: &Target) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target.name);
    let entries = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("no corpus {}: {error}", folder.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{} is empty", folder.display());
    let read = |path: PathBuf| {
        let bytes = std::fs::read(&path).unwrap();
        (path, bytes)
    };
    paths.into_iter().map(read).collect()
}

/// Runs one input; when it fails, says which it was and how to run it again.
fn run(target: &Target, name: &str, bytes: &[u8], slowest: &mut Duration) {
    let start = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| (target.run)(bytes)));
    *slowest = (*slowest).max(start.elapsed());
    let Err(panic) = outcome else { return };
    let reason = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or(panic.downcast_ref::<&str>().copied())
        .unwrap_or("unknown");
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}.failing", target.name));
    let saved = std::fs::write(&path, bytes);
    panic!(
        "target {}, {name}: {reason}\nthe input ({} bytes: \"{}\") is saved as {} ({saved:?}); run it again with \
         MCL_FUZZ_INPUT={} cargo test -p mcl-fuzz {}",
        target.name,
        bytes.len(),
        bytes[..bytes.len().min(200)].escape_ascii(),
        path.display(),
        path.display(),
        target.name
    );
}

fn setting<T: std::str::FromStr>(name: &str, default: T) -> T {
    let Ok(text) = std::env::var(name) else { return default };
    text.parse().unwrap_or_else(|_| panic!("{name} is {text:?}, expected a number"))
}

fn check(name: &str) {
    let target = TARGETS.iter().find(|target| target.name == name).unwrap();
    let mut slowest = Duration::ZERO;
    if let Some(path) = std::env::var_os("MCL_FUZZ_INPUT") {
        let bytes = std::fs::read(&path).unwrap();
        return run(target, &path.to_string_lossy(), &bytes, &mut slowest);
    }
    let corpus = corpus_of(target);
    for (path, bytes) in &corpus {
        run(target, &path.display().to_string(), bytes, &mut slowest);
    }
    let mut seed = [0; 32];
    seed[..8].copy_from_slice(&setting::<u64>("MCL_FUZZ_SEED", 0).to_le_bytes());
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &seed);
    let mut runner = TestRunner::new_with_rng(Config::default(), rng);
    let strategy = (any::<Index>(), prop::collection::vec(mutation(), 1..6));
    for case in 0..setting("MCL_FUZZ_CASES", CASES) {
        let (base, mutations) = strategy.new_tree(&mut runner).unwrap().current();
        let (path, bytes) = base.get(&corpus);
        let mut input = bytes.clone();
        for mutation in &mutations {
            apply(mutation, &mut input, &corpus);
        }
        let name = format!("mutation {case} of {}: {mutations:?}", path.display());
        run(target, &name, &input, &mut slowest);
    }
    // Not asserted: machines differ, and so does their load.
    eprintln!("{name}: the slowest input took {slowest:?}");
}

/// Memory is counted for the whole process, so one target runs at a time.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

macro_rules! targets {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
            check(stringify!($name));
        })*

        #[test]
        fn every_target_is_here_and_under_libfuzzer() {
            assert_eq!(TARGETS.map(|target| target.name), [$(stringify!($name)),*]);
            let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
            let manifest = std::fs::read_to_string(fuzz.join("Cargo.toml")).unwrap();
            for target in &TARGETS {
                let path = format!("targets/{}.rs", target.name);
                assert!(manifest.contains(&format!("path = \"{path}\"")), "{path}");
                let text = std::fs::read_to_string(fuzz.join(&path)).unwrap();
                assert!(text.contains(&format!("run(\"{}\",", target.name)), "{path}");
            }
        }
    };
}

targets! {
    carmen log mcap mcap_chunk ros1_bag ros1_chunk database cdr bag_metadata tum trajectory map_csv map_ply map_pcd map_grid dataset study
    parts results
}

//! `mcl-eval report` as a user calls it: what is on the page, what becomes of hostile content, how it ends.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use mcl_study::data::facts::DataFacts;
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::{OwnPart, PARTS, SavedTrial};
use mcl_study::store::results::{MANIFEST, Manifest, STUDY, TRIALS};
use mcl_study::study::definition::Study;
use mcl_study::table::{Cells, Value};
use serde_json::Value as Json;
use tempfile::TempDir;

const LIKELIHOOD: &str = r#"# How likely the data is.
seed = 1
measures = ["likelihood"]
[[trials]]
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [1, 20]
draws = 3
[[dataset]]
name = "elsewhere"
[[views.tests]]
y = "log_likelihood"
pairs = [["gbs+f-km", "gbs"], ["rnd+f-km", "rnd"]]
[[views.charts]]
name = "chart"
x = { column = "size_percent", scale = "log" }
y = { column = "log_likelihood", scale = "symlog" }
"#;

/// Markup, a control character and a change of direction.
const HOSTILE: &str = "</script><script>bad()</script><img src=x onerror=bad()>\u{202e}\u{1b}[31m";

fn facts(dataset: &str, title: &str) -> DataFacts {
    DataFacts {
        name: dataset.into(),
        title: title.into(),
        sha256: "00".into(),
        dimensions: 2,
        scans: 910,
        max_range: Some(10.0),
        points: 155_648,
        skipped_records: 0,
    }
}

/// A folder of a study with rows of so many of its trials: fuzzy k-means gains 3 nats per point at 1 % and a
/// twentieth of it at 20 %.
fn plant(root: &Path, name: &str, text: &str, data: DataFacts, trials: usize) -> PathBuf {
    let folder = root.join(name).join(&data.name);
    fs::create_dir_all(&folder).unwrap();
    let study = Study::parse(text).unwrap();
    let plan = study.plan(&data.name).unwrap();
    let identity = Identity { build: Build::this(), data };
    let manifest = Manifest { study: name.into(), identity: identity.clone() };
    fs::write(folder.join(MANIFEST), manifest.to_text().unwrap()).unwrap();
    fs::write(folder.join(STUDY), text).unwrap();
    let mut part = OwnPart::new(&folder, &identity);
    for trial in plan.trials.iter().take(trials) {
        let identities = trial.identities(&study.measures).unwrap();
        let measured = |mut cells: Cells| {
            let of =
                |column: &str| cells.iter().find(|(name, _)| name == column).unwrap().1.clone();
            let (map, size) = (of("map").to_string(), of("size_percent").number().unwrap());
            let draw = of("draw").number().unwrap();
            let gain = if map.ends_with("f-km") { 3.0 / size } else { 0.0 };
            let value = gain + 0.001 * draw * if map.ends_with("f-km") { 1.0 } else { 2.0 };
            cells.push(("log_likelihood".to_owned(), Value::Number(value)));
            cells
        };
        let rows = identities.into_iter().map(|identity| (identity, measured(trial.map.cells())));
        part.save(Ok(SavedTrial::new(trial.to_string(), rows.collect(), Vec::new()))).unwrap();
    }
    folder
}

fn report(roots: &[&Path], output: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
    command.arg("report").args(roots).arg("-o").arg(output).arg("--json");
    command.output().unwrap()
}

fn code(output: &Output) -> Option<i32> {
    output.status.code()
}

/// The page without what it carries compressed, and without its own styles and scripts.
fn text_of(path: &Path) -> String {
    let page = fs::read_to_string(path).unwrap();
    let mut text = String::new();
    for (at, part) in page.split("<script").enumerate() {
        text += if at == 0 { part } else { part.split_once("</script>").unwrap().1 };
    }
    let (start, rest) = text.split_once("<style>").unwrap();
    start.to_owned() + rest.split_once("</style>").unwrap().1
}

#[test]
fn the_page_answers_in_order_and_from_the_numbers() {
    let root = tempfile::tempdir().unwrap();
    plant(root.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), usize::MAX);
    let page = root.path().join("page.html");
    let output = report(&[root.path()], &page);
    assert_eq!(code(&output), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let json: Json = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&json["folders"], &json["damaged"], &json["without_rows"]),
        (&1.into(), &0.into(), &0.into())
    );
    assert_eq!(json["bytes"].as_u64().unwrap(), fs::metadata(&page).unwrap().len());
    let text = text_of(&page);
    let places: Vec<usize> =
        [r#"id="run""#, r#"id="answer""#, r#"id="claims""#, r#"class="study""#]
            .map(|part| text.find(part).unwrap_or_else(|| panic!("no {part}")))
            .to_vec();
    assert!(places.is_sorted(), "{places:?}");
    assert!(text.contains("24 of 24 trials done, 24 rows"), "{text}");
    assert!(
        text.contains("Better in all of 2 tests. Largest effect at 1 % on A building: +3.00"),
        "{text}"
    );
    assert!(text.contains("No results of elsewhere"));
    assert!(text.contains("How likely the data is."));
    let command =
        format!("mcl-eval run likelihood.toml --dataset PATH -o {}", root.path().display());
    assert!(text.contains(&command) && text.contains("# PATH: the log office, SHA-256 00"));
    // The same rows are the same page.
    let again = root.path().join("again.html");
    report(&[root.path()], &again);
    assert!(fs::read(page).unwrap() == fs::read(again).unwrap());
}

/// What would load something, and what may: places on the page, and data that it carries.
#[test]
fn the_page_loads_nothing_from_elsewhere() {
    let root = tempfile::tempdir().unwrap();
    plant(root.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), usize::MAX);
    let path = root.path().join("page.html");
    report(&[root.path()], &path);
    let page = fs::read_to_string(&path).unwrap();
    let text = text_of(&path);
    let mut found = 0;
    for attribute in ["src=", "href=", "action=", "srcset=", "data=", "poster=", "url("] {
        for part in text.split(attribute).skip(1) {
            found += 1;
            assert!(part.trim_start_matches('"').starts_with('#'), "{attribute}{part:.80}");
        }
    }
    assert!(found > 5, "{found}");
    for element in ["<link", "<iframe", "<object", "<embed", "<base", "@import", "<script src"] {
        assert!(!page.contains(element), "{element}");
    }
    assert!(text.contains("default-src &#39;none&#39;; script-src &#39;sha256-"), "{text:.600}");
    assert!(!text.contains("unsafe-eval") && !text.contains("script-src &#39;unsafe-inline"));
}

/// Field case of reports of all kinds: a name from a file that is markup, or acts.
#[test]
fn hostile_names_are_text() {
    let root = tempfile::tempdir().unwrap();
    let title = format!("{HOSTILE}{}", "x".repeat(10_000));
    let study =
        LIKELIHOOD.replace("# How likely the data is.", &format!("# </code>{}", &HOSTILE[..40]));
    let folder = plant(root.path(), "likelihood", &study, facts("a<b>c", &title), usize::MAX);
    let cell = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    fs::write(folder.join("failures.csv"), format!("trial,reason\n{0},{0}\n", cell(HOSTILE)))
        .unwrap();
    let figures = folder.join("figures");
    fs::create_dir(&figures).unwrap();
    fs::write(figures.join("<img src=x onerror=bad()>.svg"), "<svg><script>bad()</script></svg>")
        .unwrap();
    let page = root.path().join("page.html");
    let output = report(&[root.path()], &page);
    assert_eq!(code(&output), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let page_text = fs::read_to_string(&page).unwrap();
    let text = text_of(&page);
    for bad in ["<script>bad", "<img", "<b>c", "\u{202e}", "\u{1b}"] {
        assert!(!page_text.contains(bad), "{bad:?}");
    }
    assert!(text.contains(r"\u{202e}\u{1b}[31m"), "shown as escapes");
    let count = format!("(10,0{} characters)", HOSTILE.chars().count());
    assert!(text.contains(&count), "cut, and said so");
    assert!(text.contains("the log &#39;a&#60;b&#62;c&#39;"), "quoted for a shell");
    // Every script element is one of the program's, or data.
    let kinds: BTreeSet<&str> =
        page_text.split("<script").skip(1).map(|part| part.split_once('>').unwrap().0).collect();
    let kinds: BTreeSet<&str> =
        kinds.iter().map(|kind| kind.split(" id=").next().unwrap()).collect();
    assert_eq!(kinds, BTreeSet::from(["", r#" type="text/plain""#]));
}

/// Folders as they are committed: tables and points of charts, no rows.
#[test]
fn folders_without_rows_are_shown_from_their_tables() {
    let root = tempfile::tempdir().unwrap();
    let folder =
        plant(root.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), usize::MAX);
    let mut plot = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
    assert_eq!(code(&plot.arg("plot").arg(root.path()).output().unwrap()), Some(0));
    let with_rows = root.path().join("with.html");
    report(&[root.path()], &with_rows);
    fs::remove_dir_all(folder.join(PARTS)).unwrap();
    fs::remove_file(folder.join(TRIALS)).unwrap();
    let without = root.path().join("without.html");
    let output = report(&[root.path()], &without);
    assert_eq!(code(&output), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains("1 result folder without rows"));
    let [with_rows, without] = [text_of(&with_rows), text_of(&without)];
    assert!(without.contains("1 result folder has tables and figures but no rows"), "{without}");
    assert!(without.contains("No rows here that the claims are about"));
    // The answer and the charts are the same.
    let answer = |text: &str| {
        let start = text.split_once(r#"id="answer""#).unwrap().1;
        start.split_once("</section>").unwrap().0.to_owned()
    };
    assert_eq!(answer(&with_rows), answer(&without));
    assert_eq!(with_rows.matches("class=\"chart\"").count(), 1);
    assert_eq!(without.matches("class=\"chart\"").count(), 1);
    assert_eq!(with_rows.matches("data-curve=").count(), without.matches("data-curve=").count());
}

#[test]
fn missing_and_damaged_results_are_reported() {
    let root = tempfile::tempdir().unwrap();
    plant(root.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), 5);
    let broken = plant(root.path(), "broken", LIKELIHOOD, facts("office", "A building"), 5);
    fs::write(broken.join(STUDY), "seed = \"none\"").unwrap();
    let begun = plant(root.path(), "begun", LIKELIHOOD, facts("office", "A building"), 1);
    fs::remove_dir_all(begun.join(PARTS)).unwrap();
    let page = root.path().join("page.html");
    let output = report(&[root.path()], &page);
    assert_eq!(code(&output), Some(3));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("leaving out") && stderr.contains("broken"), "{stderr}");
    let json: Json = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&json["damaged"], &json["incomplete"]), (&2.into(), &1.into()));
    let text = text_of(&page);
    assert!(text.contains("likelihood on office: 5 of 24 trials have rows."), "{text}");
    assert!(text.contains("broken/office: ") && text.contains("begun/office: it has no rows"));
}

/// Fault: 31 of 1,480 trials of a study were the answer, and the studies that had decided something came after
/// it; data sets on the page were said to have no results.
#[test]
fn incomplete_studies_come_last_and_say_so() {
    let root = tempfile::tempdir().unwrap();
    plant(root.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), 17);
    plant(root.path(), "other", LIKELIHOOD, facts("office", "A building"), usize::MAX);
    let elsewhere = DataFacts { dimensions: 3, ..facts("elsewhere", "Elsewhere") };
    plant(root.path(), "other", LIKELIHOOD, elsewhere, usize::MAX);
    let page = root.path().join("page.html");
    assert_eq!(code(&report(&[root.path()], &page)), Some(3));
    let text = text_of(&page);
    let (_, answer) = text.split_once(r#"id="answer""#).unwrap();
    let (answer, _) = answer.split_once("</section>").unwrap();
    let [first, partial, last] =
        ["<bdi>other</bdi>", "from 17 of 24 trials", "<bdi>likelihood</bdi>"]
            .map(|part| answer.find(part).unwrap_or_else(|| panic!("no {part}: {answer}")));
    assert!(first < last && last < partial, "{answer}");
    assert!(!text.contains("No results of elsewhere"), "{text}");
}

#[test]
fn several_roots_are_one_page() {
    let [a, b] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    plant(a.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), usize::MAX);
    plant(b.path(), "likelihood", LIKELIHOOD, facts("aces", "Another"), usize::MAX);
    let page = a.path().join("page.html");
    assert_eq!(code(&report(&[a.path(), b.path()], &page)), Some(0));
    let text = text_of(&page);
    assert!(text.contains("1 study on 2 data sets: 2 result folders"), "{text}");
    assert!(text.contains("Better in all of 4 tests"));
}

/// Nothing that is read is written over, whatever it is called.
#[test]
fn the_page_replaces_no_input() {
    let root = TempDir::new().unwrap();
    let folder =
        plant(root.path(), "likelihood", LIKELIHOOD, facts("office", "A building"), usize::MAX);
    let manifest = folder.join(MANIFEST);
    let before = fs::read(&manifest).unwrap();
    fs::create_dir(folder.join("figures")).unwrap();
    let figure = folder.join("figures/chart.csv");
    fs::write(&figure, "panel,curve,x,y\n").unwrap();
    for output in [manifest.clone(), figure, folder.join("../office").join(STUDY)] {
        let found = report(&[root.path()], &output);
        assert_eq!(code(&found), Some(1), "{}", output.display());
    }
    assert_eq!(fs::read(&manifest).unwrap(), before);
    let nothing = root.path().join("nothing");
    fs::create_dir(&nothing).unwrap();
    let found = report(&[&nothing], &root.path().join("page.html"));
    assert_eq!(code(&found), Some(1));
    assert!(String::from_utf8_lossy(&found.stderr).contains("no results"));
    assert!(!root.path().join("page.html").exists());
    let nowhere = report(&[root.path()], &root.path().join("absent/page.html"));
    assert_eq!(code(&nowhere), Some(1));
}

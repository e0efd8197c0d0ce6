//! How long the page of many results takes, and how large it is: `cargo bench -p mcl-eval --bench report`, with the number
//! of folders (200) and rows in each (5,000) as arguments.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

use anyhow::{Result, bail};
use mcl_eval::report::gather::gather;
use mcl_eval::report::page::page;
use mcl_study::data::facts::DataFacts;
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::{PARTS, SavedTrial, seal};
use mcl_study::store::results::{MANIFEST, Manifest, STUDY};
use mcl_study::study::definition::Study;
use mcl_study::table::Cells;
use rayon::prelude::*;
use serde_json::json;

/// Data sets; the folders are as many studies on each as it takes.
const DATASETS: usize = 10;

/// Four kinds of map in 25 sizes, runs on each, with tests and a chart.
fn study(rows: usize) -> String {
    let draws = rows.div_ceil(100).max(2);
    format!(
        r#"seed = 1
[[trials]]
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = {{ from = 0.1, to = 99, factor = 1.33 }}
draws = {draws}
runs = 1
[[views.tests]]
y = "weighted"
ratio = true
[[views.charts]]
name = "errors"
x = {{ column = "size_percent", scale = "log" }}
y = {{ column = ["weighted", "translation", "heading"], scale = "log" }}
marks = "diverged"
"#
    )
}

fn plant(root: &Path, number: usize, text: &str) -> Result<usize> {
    let (name, dataset) =
        (format!("study-{:02}", number / DATASETS), format!("data-{}", number % DATASETS));
    let folder = root.join(&name).join(&dataset);
    std::fs::create_dir_all(&folder)?;
    let data = DataFacts {
        name: dataset.clone(),
        title: format!("Building {}", number % DATASETS),
        sha256: "00".to_owned(),
        dimensions: 2,
        scans: 1000,
        max_range: Some(10.0),
        points: 150_000,
        skipped_records: 0,
    };
    let identity = Identity { build: Build::this(), data };
    let manifest = Manifest { study: name, identity: identity.clone() };
    std::fs::write(folder.join(MANIFEST), manifest.to_text()?)?;
    std::fs::write(folder.join(STUDY), text)?;
    let study = Study::parse(text)?;
    // As parts leave them, but not onto the disk one by one.
    std::fs::create_dir(folder.join(PARTS))?;
    let mut file =
        BufWriter::new(File::create_new(folder.join(PARTS).join("rows-1-AbCd1234.jsonl"))?);
    let mut write = |line: serde_json::Value| -> Result<()> {
        file.write_all(&[&seal(&serde_json::to_vec(&line)?)[..], b"\n"].concat())?;
        Ok(())
    };
    write(json!({ "identity": identity }))?;
    let mut count = 0;
    for trial in study.plan(&dataset)?.trials {
        let mut rows = Vec::new();
        for (identity, run) in trial.identities(&study.measures)?.into_iter().zip(&trial.runs) {
            count += 1;
            let luck = 1.0 + 0.1 * ((count * 7919) % 1000) as f64 / 1000.0;
            let mut cells: Cells = [trial.map.cells(), run.cells()?].concat();
            for (measure, value) in [("weighted", 0.03), ("translation", 0.02), ("heading", 0.01)] {
                cells.push((measure.to_owned(), (value * luck).into()));
            }
            cells.push(("diverged".to_owned(), (count % 97 == 0).into()));
            rows.push((identity, cells));
        }
        write(json!({ "trial": SavedTrial::new(trial.to_string(), rows, Vec::new()) }))?;
    }
    file.flush()?;
    Ok(count)
}

/// Of this process so far, in seconds.
fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn main() -> Result<()> {
    let numbers: Vec<usize> =
        std::env::args().filter_map(|argument| argument.parse().ok()).collect();
    let (folders, rows) = (*numbers.first().unwrap_or(&200), *numbers.get(1).unwrap_or(&5000));
    let root = tempfile::tempdir()?;
    let text = study(rows);
    let rows: usize = (0..folders)
        .into_par_iter()
        .map(|number| plant(root.path(), number, &text))
        .sum::<Result<usize>>()?;
    let (start, before) = (Instant::now(), processor_time());
    let report = gather(&[root.path().to_owned()], &[], true)?;
    if let Some((folder, why)) = report.damaged.first() {
        bail!("{}: {why}", folder.display());
    }
    let gathered = start.elapsed().as_secs_f64();
    let page = page(&report)?;
    let seconds = start.elapsed().as_secs_f64();
    let processor = processor_time() - before;
    let megabytes = page.len() as f64 / 1e6;
    println!(
        "{folders} folders, {rows} rows: read in {gathered:.1} s, page of {megabytes:.1} MB after {seconds:.1} s, {processor:.1} s of the \
         processor"
    );
    if let Some(path) = std::env::var_os("MCL_REPORT") {
        std::fs::write(path, page)?;
    }
    Ok(())
}

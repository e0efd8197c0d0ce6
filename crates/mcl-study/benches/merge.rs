//! What a merge takes, and a part that begins when all others have ended, as a study grows: a folder of made-up
//! rows, merged by a process of its own.
//!
//! `cargo bench -p mcl-study --bench merge [-- TRIALS PARTS]`, 5,000 trials of 500 parts unless said.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use mcl_core::Seed;
use mcl_datasets::simulator::{OfficeSettings, simulate};
use mcl_study::data::facts::DataFacts;
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::run::run_study;
use mcl_study::share::{Part, Share};
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::{PARTS, SavedTrial, seal};
use mcl_study::study::definition::Study;
use mcl_study::study::plan::Plan;
use mcl_study::table::Value;
use mcl_study::trial::division::StudyData;
use serde_json::json;

const NAME: &str = "study";

fn main() -> Result<()> {
    let given: Vec<String> = std::env::args().skip(1).filter(|given| given != "--bench").collect();
    let given: Vec<&str> = given.iter().map(String::as_str).collect();
    match given[..] {
        ["measure", share, trials, folder] => measure(share, trials.parse()?, Path::new(folder)),
        [] => compare(5_000, 500),
        [trials, parts] => compare(trials.parse()?, parts.parse()?),
        _ => bail!("expected TRIALS PARTS"),
    }
}

fn compare(trials: usize, parts: usize) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let bytes = write_rows(trials, parts, folder.path())?;
    println!("{trials} trials, {parts} files, {:.1} MB", bytes as f64 / 1e6);
    for share in ["part", "merge"] {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["measure", share, &trials.to_string()]).arg(folder.path());
        ensure!(command.status()?.success(), "{share} failed");
    }
    Ok(())
}

/// Half of the trials grid-based, half random, of ten sizes, a run on each.
fn study(trials: usize) -> Result<Study> {
    Study::parse(&format!(
        "seed = 1
         [base]
         odometry_noise = {{ xy = 0.01, theta = 0.01 }}
         [[trials]]
         map = [\"gbs\", \"rnd\"]
         size = [0.1, 0.25, 0.5, 1, 2, 3, 5, 10, 25, 50]
         draws = {}
         runs = 1
         [[views.tests]]
         y = \"weighted\"
         pairs = [[\"gbs\", \"rnd\"]]",
        trials.div_ceil(20)
    ))
}

fn data() -> Result<StudyData> {
    Ok(StudyData::new(DataSource::Log(LogSource::of_recording(
        "simulated-office",
        simulate(&OfficeSettings::default(), Seed::new(1))?,
    ))))
}

/// Writes the rows as parts leave them, and returns their bytes.
fn write_rows(trials: usize, parts: usize, folder: &Path) -> Result<usize> {
    let (study, data) = (study(trials)?, data()?);
    let identity = Identity { build: Build::this(), data: DataFacts::of(&data.source)? };
    let plan: Plan = study.plan(&identity.data.name)?;
    let recipes = plan.recipes()?;
    let columns = plan.columns(&study.measures)?;
    let folder = folder.join(PARTS);
    std::fs::create_dir(&folder)?;
    let mut files = Vec::new();
    for part in 0..parts {
        let mut file =
            BufWriter::new(File::create_new(folder.join(format!("rows-{part}-AbCd1234.jsonl")))?);
        file.write_all(
            &[&seal(&serde_json::to_vec(&json!({ "identity": identity }))?)[..], b"\n"].concat(),
        )?;
        files.push(file);
    }
    let mut bytes = 0;
    for (k, (trial, recipe)) in plan.trials.iter().zip(recipes.rows()).enumerate() {
        let measured = |place: usize| Value::Number(((k * 31 + place * 7) % 997) as f64 / 331.0);
        let cells = columns.iter().enumerate().map(|(place, column)| {
            let is_of_recipe = recipes.column(column).is_some();
            let value = if is_of_recipe { recipe.get(column).clone() } else { measured(place) };
            (column.clone(), value)
        });
        let identity = trial.identities(&study.measures)?.swap_remove(0);
        let seconds = vec![("map".to_owned(), 0.5), ("runs".to_owned(), 1.5)];
        let saved = SavedTrial::new(trial.to_string(), vec![(identity, cells.collect())], seconds);
        let line = [&seal(&serde_json::to_vec(&json!({ "trial": saved }))?)[..], b"\n"].concat();
        bytes += line.len();
        files[k % parts].write_all(&line)?;
    }
    files.iter_mut().try_for_each(|file| file.flush())?;
    Ok(bytes)
}

fn measure(share: &str, trials: usize, folder: &Path) -> Result<()> {
    let (study, data) = (study(trials)?, data()?);
    let taken = match share {
        "merge" => Share::Merge,
        _ => Share::Part(Part::new(1, 1000).map_err(anyhow::Error::msg)?),
    };
    let begin = Instant::now();
    let ran = run_study(&study, NAME, &data, folder, taken, |_| {})?;
    let seconds = begin.elapsed().as_secs_f64();
    ensure!(ran.done == ran.asked, "{} of {} trials", ran.done, ran.asked);
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    let processor = time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9;
    println!(
        "{share}: {seconds:.2} s, {processor:.2} s of the processor, {} at most",
        peak_memory()?
    );
    Ok(())
}

/// As the system reports it, where it does.
fn peak_memory() -> Result<String> {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else {
        return Ok("? MB".to_owned());
    };
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).context("no VmHWM")?;
    let kilobytes: f64 = line.trim().trim_end_matches("kB").trim().parse()?;
    Ok(format!("{:.0} MB", kilobytes / 1e3))
}

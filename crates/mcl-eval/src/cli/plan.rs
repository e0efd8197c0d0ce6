//! `plan`: the cost of a study in parts, and the script that starts it.

use std::path::Path;

use anyhow::{Context, Result};
use mcl_core::text::{counted, printable, thousands};
use mcl_datasets::registry::Registry;
use mcl_study::data::facts::DataFacts;
use mcl_study::run::deal_out;
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::Parts;
use mcl_study::study::definition::Study;
use mcl_study::trial::cost::Costs;
use serde::Serialize;

use super::Outcome;
use super::args::{Engine, Global, PlanArgs};
use super::output::print;
use super::run::{open, read_study};

/// Factor by which a part's processor time may exceed the estimate before an engine ends it; built-in costs
/// are right within a factor of three or so.
const MARGIN_MEASURED: f64 = 2.0;
const MARGIN_BUILT_IN: f64 = 5.0;
/// Memory of the program without data, and per point of it (MB): several copies, maps, and fields of distances on them.
const BASE_MB: f64 = 200.0;
const POINT_MB: f64 = 2e-3;
/// Approximate size of a row of results, in bytes.
const ROW_BYTES: f64 = 1500.0;

#[derive(Serialize)]
struct Planned {
    study: String,
    parts: usize,
    /// Number of trials that are not done.
    trials: usize,
    /// Whether hours are based on the times of completed trials.
    is_measured: bool,
    /// Processor hours of all parts, and of the longest.
    hours: f64,
    longest_hours: f64,
    /// Memory that a part needs (MB).
    memory_mb: f64,
    /// Bytes that each part reads, and that all parts write together.
    data_bytes: u64,
    result_bytes: u64,
    each: Vec<OfPart>,
    /// The script that starts the parts and the merge; null without `--engine`.
    script: Option<String>,
}

#[derive(Clone, Default, Serialize)]
struct OfPart {
    part: usize,
    trials: usize,
    hours: f64,
}

pub fn run(args: &PlanArgs, global: &Global) -> Result<Outcome> {
    let (study, name, datasets) = read_study(&args.of, global)?;
    let parts = args.parts as usize;
    let mut planned = Planned {
        study: name.clone(),
        parts,
        trials: 0,
        is_measured: false,
        hours: 0.0,
        longest_hours: 0.0,
        memory_mb: 0.0,
        data_bytes: 0,
        result_bytes: 0,
        each: (1..=parts).map(|part| OfPart { part, ..OfPart::default() }).collect(),
        script: None,
    };
    for dataset in &datasets {
        add(args, &study, &name, dataset, &mut planned)?;
    }
    planned.hours = planned.each.iter().map(|part| part.hours).sum();
    planned.longest_hours = planned.each.iter().map(|part| part.hours).fold(0.0, f64::max);
    planned.script = args.engine.map(|engine| script(args, &datasets, engine, &planned));
    print(args.json, &planned, text)?;
    Ok(Outcome::Done)
}

/// Adds the cost of a study on a data set.
fn add(
    args: &PlanArgs,
    study: &Study,
    name: &str,
    dataset: &str,
    planned: &mut Planned,
) -> Result<()> {
    let source = open(&args.of, study, dataset)?;
    let identity = Identity { build: Build::this(), data: DataFacts::of(&source)? };
    let plan = study.plan(&identity.data.name)?;
    let folder = args.of.output.join(name).join(&identity.data.name);
    let rows = Parts::read(&folder, &identity).with_context(|| folder.display().to_string())?;
    let costs = Costs::measured(&identity.data, &study.measures, &plan.trials, &rows);
    planned.is_measured |= costs.are_measured();
    let (dealt, _) = deal_out(study, &plan.trials, &folder, &identity.data, planned.parts)?;
    for (trial, part) in plan.trials.iter().zip(dealt) {
        let of_trial = trial.identities(&study.measures)?;
        if of_trial.iter().all(|row| rows.has(row)) {
            continue;
        }
        let of_part = &mut planned.each[part - 1];
        of_part.trials += 1;
        of_part.hours += costs.of(trial) / 3600.0;
        planned.trials += 1;
        planned.result_bytes += (of_trial.len() as f64 * ROW_BYTES) as u64;
    }
    planned.memory_mb = planned.memory_mb.max(BASE_MB + POINT_MB * identity.data.points as f64);
    planned.data_bytes += bytes_of(dataset);
    Ok(())
}

/// Size of the file of a data set or log; 0 without a file, as for the simulated office.
fn bytes_of(dataset: &str) -> u64 {
    let of_registry = || {
        let registry = Registry::from_environment().ok()?;
        registry.locate(registry.get(dataset).ok()?).ok()
    };
    let path = Path::new(dataset);
    let path = if path.exists() { Some(path.to_owned()) } else { of_registry() };
    let size = path.and_then(|path| path.metadata().ok());
    size.filter(std::fs::Metadata::is_file).map_or(0, |metadata| metadata.len())
}

fn text(planned: &Planned) -> String {
    if let Some(script) = &planned.script {
        // To be piped into a shell: no other output.
        return script.clone();
    }
    let mut text = format!(
        "{} in {}: {} to be run, about {:.2} hours of processor time ({})\n",
        planned.study,
        counted(planned.parts, "part"),
        counted(planned.trials, "trial"),
        planned.hours,
        how(planned)
    );
    text += &format!(
        "the longest part {:.2} hours; about {:.0} MB of memory each; {} kB of data read by each part, about {} kB of rows\n",
        planned.longest_hours,
        planned.memory_mb,
        thousands((planned.data_bytes / 1000) as usize),
        thousands((planned.result_bytes / 1000) as usize)
    );
    const MOST: usize = 20;
    for OfPart { part, trials, hours } in planned.each.iter().take(MOST) {
        text += &format!("  part {part}: {}, {hours:.2} hours\n", counted(*trials, "trial"));
    }
    if planned.each.len() > MOST {
        text += &format!("  and {} others\n", planned.each.len() - MOST);
    }
    text
}

fn how(planned: &Planned) -> &'static str {
    match planned.is_measured {
        true => "from the times of finished trials",
        false => "from built-in costs; run a small part first to measure them",
    }
}

/// The commands that start the parts and, after them, the merge.
fn script(args: &PlanArgs, datasets: &[String], engine: Engine, planned: &Planned) -> String {
    let Planned { parts, memory_mb, .. } = planned;
    let margin = if planned.is_measured { MARGIN_MEASURED } else { MARGIN_BUILT_IN };
    let minutes = (planned.longest_hours * 60.0 * margin).ceil().max(5.0) as u64;
    let memory = (memory_mb * 1.5).ceil();
    let mut run = format!("mcl-eval run {}", quoted(&args.of.study.display().to_string()));
    for dataset in datasets {
        run += &format!(" --dataset {}", quoted(dataset));
    }
    for option in &args.given {
        run += &format!(" {}", quoted(option));
    }
    run += &format!(" -o {}", quoted(&args.of.output.display().to_string()));
    let head = format!(
        "# {} in {parts} parts: {} trials, about {:.2} hours of processor time ({}),\n# the longest part {:.2} hours, about {memory_mb:.0} MB of memory each.\n",
        printable(&planned.study),
        planned.trials,
        planned.hours,
        how(planned),
        planned.longest_hours
    );
    match engine {
        Engine::Slurm => format!(
            "#!/bin/sh\n{head}# A part that ends with 3 (a trial failed) counts as failed: the merge waits for any end.\nset -e\n\
             job=$(sbatch --parsable --job-name={name} --array=1-{parts} --requeue --time={minutes} --mem={memory:.0}M \\\n    \
             --wrap {part})\n\
             sbatch --job-name={name}-merge --dependency=afterany:\"$job\" --time=60 --mem={memory:.0}M \\\n    \
             --wrap {merge}\n",
            name = planned.study,
            part = quoted(&format!("exec {run} --part array/{parts} --threads 1 --quiet")),
            merge = quoted(&format!("exec {run} --merge")),
        ),
        Engine::Parallel => format!(
            "#!/bin/sh\n{head}# Machines share the folders, and have the program: HOSTS=host1,host2 sh THIS; without HOSTS here alone.\n\
             seq {parts} | parallel -S \"${{HOSTS:-:}}\" --workdir \"$PWD\" --joblog parts.log \\\n    \
             {part}\n\
             {run} --merge\n",
            part = quoted(&format!("{run} --part {{}}/{parts} --threads 1 --quiet")),
        ),
        Engine::Kubernetes => format!(
            "{head}# Put in the image and the claim of the shared folder; then kubectl apply -f THIS, and when it is complete:\n\
             #   {run} --merge\n\
             apiVersion: batch/v1\nkind: Job\nmetadata:\n  name: {name}\nspec:\n  completionMode: Indexed\n  completions: {parts}\n  \
             parallelism: {parts}\n  backoffLimitPerIndex: 3\n  template:\n    spec:\n      restartPolicy: Never\n      containers:\n      \
             - name: part\n        image: IMAGE\n        workingDir: /data\n        command: [\"sh\", \"-c\", {part}]\n        resources:\n          \
             requests: {{cpu: 1, memory: {memory:.0}Mi}}\n        volumeMounts: [{{name: work, mountPath: /data}}]\n      volumes:\n      \
             - name: work\n        persistentVolumeClaim: {{claimName: CLAIM}}\n",
            name = planned.study,
            part = serde_json::Value::from(format!(
                "exec {run} --part array/{parts} --threads 1 --quiet"
            )),
        ),
    }
}

/// A quoted shell word.
fn quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=,:@%".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text.to_owned(),
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_safe_in_a_shell() {
        assert_eq!(quoted("studies/mine.toml"), "studies/mine.toml");
        assert_eq!(quoted("my log's; rm"), "'my log'\\''s; rm'");
        assert_eq!(quoted(""), "''");
    }
}

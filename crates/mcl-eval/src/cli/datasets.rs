use std::path::Path;

use anyhow::{Result, bail};
use mcl_datasets::log::read_log_as;
use mcl_datasets::registry::{
    Dataset, DatasetKind, Facts, FetchError, FetchEvent, FetchSettings, Fetched, Origin,
    ReadLogError, Registry, Verification,
};
use serde::Serialize;

use super::Outcome;
use super::args::{DatasetNames, DatasetsArgs, DatasetsCommand, Global};
use super::output::print;
use crate::progress::{self, error_message, tell};
use mcl_core::text::thousands;
use mcl_study::data::cloud_source::CloudSource;

pub fn run(args: &DatasetsArgs, global: &Global) -> Result<Outcome> {
    let registry = Registry::from_environment()?;
    match &args.command {
        DatasetsCommand::List(names) => list(&registry, names),
        DatasetsCommand::Fetch(names) => fetch(&registry, names, global),
        DatasetsCommand::Verify(names) => verify(&registry, names),
    }
}

/// A data set with the result of the command, for `--json` and the terminal.
#[derive(Serialize)]
struct Line {
    name: String,
    title: String,
    good: bool,
    status: String,
}

#[derive(Serialize)]
struct Lines {
    datasets: Vec<Line>,
}

/// Prints the status of the named data sets, or all, and returns whether it is good.
fn report(
    registry: &Registry,
    DatasetNames { names, json }: &DatasetNames,
    status: impl Fn(&Dataset) -> (bool, String),
) -> Result<Outcome> {
    let chosen: Vec<&Dataset> = match names.is_empty() {
        true => registry.datasets().collect(),
        false => names.iter().map(|name| registry.get(name)).collect::<Result<_, _>>()?,
    };
    let lines = chosen.into_iter().map(|dataset| {
        let (good, status) = status(dataset);
        Line { name: dataset.name.clone(), title: dataset.title.clone(), good, status }
    });
    let lines = Lines { datasets: lines.collect() };
    print(*json, &lines, |lines| {
        let width = lines.datasets.iter().map(|line| line.name.len()).max().unwrap_or(0);
        let rows =
            lines.datasets.iter().map(|line| format!("{:width$}  {}", line.name, line.status));
        rows.collect::<Vec<_>>().join("\n")
    })?;
    match lines.datasets.iter().all(|line| line.good) {
        true => Ok(Outcome::Done),
        false => bail!("not every data set is in order, see above"),
    }
}

fn list(registry: &Registry, names: &DatasetNames) -> Result<Outcome> {
    report(registry, names, |dataset| {
        let place = match &dataset.source {
            Origin::Simulated { .. } => "simulated, nothing to fetch".to_owned(),
            Origin::File(file) => match registry.locate(dataset) {
                Ok(path) => path.display().to_string(),
                Err(error) if file.urls.is_empty() => format!("not at hand: {error}"),
                Err(_) => format!("not at hand: mcl-eval datasets fetch {}", dataset.name),
            },
        };
        (true, format!("{}\n    {}\n    {place}", dataset.title, dataset.description))
    })
}

fn fetch(registry: &Registry, names: &DatasetNames, global: &Global) -> Result<Outcome> {
    report(registry, names, |dataset| {
        let bar = progress::bytes(&dataset.name, global.quiet);
        let read = |path: &Path| read_for_facts(dataset, path);
        let result =
            registry.fetch(dataset, &FetchSettings::default(), &read, &mut |event| match event {
                FetchEvent::Connecting { url, kept } => {
                    bar.set_position(kept);
                    bar.set_message(url.to_owned());
                }
                FetchEvent::Progress { downloaded, total } => {
                    if let Some(total) = total {
                        bar.set_length(total);
                    }
                    bar.set_position(downloaded);
                }
                FetchEvent::Failed { url, failure, retrying } => {
                    let next = if retrying { "; trying again" } else { "" };
                    bar.suspend(|| tell!("{}: {url}: {failure}{next}", dataset.name));
                }
            });
        bar.finish_and_clear();
        match result {
            Ok(Fetched::Simulated) => (true, "simulated, nothing to fetch".to_owned()),
            Ok(Fetched::AlreadyPresent { path, .. }) => {
                (true, format!("already there: {}", path.display()))
            }
            Ok(Fetched::Downloaded { path, content, .. }) => {
                let bytes = thousands(content.bytes as usize);
                (true, format!("fetched: {} ({bytes} bytes)", path.display()))
            }
            // Without names, data sets that have to be obtained by hand are not a failure.
            Err(error @ FetchError::NoUrl { .. }) if names.names.is_empty() => {
                (true, format!("not at hand: {error}"))
            }
            Err(error) => (false, format!("failed: {}", error_message(&error.into()))),
        }
    })
}

fn verify(registry: &Registry, names: &DatasetNames) -> Result<Outcome> {
    report(registry, names, |dataset| {
        let read = |path: &Path| read_for_facts(dataset, path);
        // Without names, data sets that are not available are not a failure.
        let absent = matches!(dataset.source, Origin::File(_)) && registry.locate(dataset).is_err();
        match registry.verify(dataset, &read) {
            Err(error) if absent && names.names.is_empty() => {
                (true, format!("not at hand: {error}"))
            }
            Err(error) => (false, format!("failed: {}", error_message(&error.into()))),
            Ok(Verification::Simulated) => (true, "simulated, nothing to verify".to_owned()),
            Ok(Verification::Found(found)) => {
                let mut status = format!("{}: {}", found.path.display(), found.status());
                for mismatch in found.mismatches.iter().flatten() {
                    status += &format!("\n    {mismatch}");
                }
                if !found.accepted {
                    status += &format!("\n    sha256 {}", found.content.sha256);
                }
                (found.is_good(), status)
            }
        }
    })
}

fn read_for_facts(dataset: &Dataset, path: &Path) -> Result<Facts, ReadLogError> {
    match dataset.kind {
        DatasetKind::Scans => {
            let log = read_log_as(path, &dataset.reference.into())?;
            Ok(Facts::of(&log.recording, dataset.max_range))
        }
        DatasetKind::Cloud => Ok(CloudSource::facts(path, dataset.max_range)?),
    }
}

//! Data of result folders, where it is available for recomputing something.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use mcl_datasets::registry::{Dataset, DatasetKind, Registry, is_plain_name};
use mcl_study::data::facts::DataFacts;
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::{DataSource, LogSource, name_of};
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::results::Manifest;
use mcl_study::trial::division::StudyData;

/// Opens the logs that rows were computed from.
pub struct AtHand<'a> {
    /// Logs by path, beside the data sets of the registry.
    logs: &'a [String],
    /// The last source opened: several studies use the same log.
    last: Option<(Key, Arc<StudyData>, DataFacts)>,
}

/// The options for opening a log: name, `max_range` and number of scans.
type Key = (String, Option<u64>, Option<usize>);

impl<'a> AtHand<'a> {
    /// With these logs beside the registry's.
    pub fn new(logs: &'a [String]) -> Self {
        AtHand { logs, last: None }
    }

    /// The log of a result folder, truncated after a number of scans, if rows computed from it now would
    /// match the existing ones.
    ///
    /// # Errors
    /// Why they would not.
    pub fn of(&mut self, folder: &Path, scans: Option<usize>) -> Result<Arc<StudyData>> {
        let manifest = Manifest::read(folder)?.context("there is no manifest")?;
        let there = &manifest.identity;
        let build = Build::this();
        let here = Identity { build: build.clone(), data: there.data.clone() };
        check_same(&here, there)?;
        let facts = &there.data;
        let key = (facts.name.clone(), facts.max_range.map(f64::to_bits), scans);
        if !matches!(&self.last, Some((last, ..)) if *last == key) {
            // Two logs at once need more memory than one.
            self.last = None;
            let mut log = self.open(facts)?;
            if let Some(scans) = scans {
                log = log.first_scans(scans);
            }
            let source = DataSource::Log(log);
            let facts = DataFacts::of(&source)?;
            self.last = Some((key, Arc::new(StudyData::new(source)), facts));
        }
        let (_, data, found) = self.last.as_ref().context("opened above")?;
        let here = Identity { build, data: found.clone() };
        check_same(&here, there)?;
        Ok(data.clone())
    }

    fn open(&self, facts: &DataFacts) -> Result<LogSource> {
        let options = SourceOptions { max_range: facts.max_range, ..SourceOptions::default() };
        if let Some(log) = self.logs.iter().find(|log| name_of(log) == facts.name) {
            return LogSource::open(log, &options);
        }
        // The name is read from a file of unknown origin: only data sets of the registry may be opened.
        let registry = Registry::from_environment()?;
        let known = is_plain_name(&facts.name).then(|| registry.get(&facts.name).ok()).flatten();
        let Some(dataset) = known else {
            bail!(
                "its log is not at hand: no data set is named {:?}; --log FILE gives it",
                facts.name
            );
        };
        if let Dataset { kind: DatasetKind::Cloud, .. } = dataset {
            bail!("it is a point cloud, which is not shown");
        }
        Ok(LogSource::open_dataset(&registry, dataset, &options)
            .context("its log is not at hand")?
            .covered())
    }
}

fn check_same(here: &Identity, there: &Identity) -> Result<()> {
    here.check_same(there).map_err(|error| anyhow!("the rows cannot be repeated: they {error}"))
}

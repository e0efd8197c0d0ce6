//! What a result folder `<root>/<study>/<data set>/` holds of a study.

use std::path::PathBuf;

use crate::data::facts::DataFacts;
use crate::study::definition::Study;
use crate::table::{Cells, Table};

/// The rows of a study on a data set: those that the study asks for and no others that lie there.
#[derive(Clone)]
pub struct Results {
    /// The folder.
    pub folder: PathBuf,
    /// Name of the study: that of its file without the ending.
    pub name: String,
    /// What was asked for.
    pub study: Study,
    /// What the data was.
    pub facts: DataFacts,
    /// The rows, sorted, with the columns of [`Plan::columns`](crate::study::plan::Plan::columns).
    pub table: Table,
    /// Trials that have all their rows.
    pub done: usize,
    /// Trials that the study asks for.
    pub asked: usize,
    /// The rows of the maps (and runs) that pictures show, by picture and map as the study lists them;
    /// `None` where one is missing. Each has the [`SHOWN`] files beside it.
    pub pictured: Vec<Vec<Option<Pictured>>>,
}

/// A map that a picture shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Pictured {
    /// What was measured, as in a row.
    pub cells: Cells,
    /// The map's points (`.ply`), below the result folder's [`SHOWN`].
    pub map: PathBuf,
    /// Reference and estimate of the run (TUM), where one is shown.
    pub paths: Option<[PathBuf; 2]>,
}

/// Folder of the files that pictures show.
pub const SHOWN: &str = "shown";

impl Results {
    /// Whether every trial has its rows.
    pub fn is_complete(&self) -> bool {
        self.done == self.asked
    }

    /// "32 of 36 trials", where some are missing: whatever is made of the rows says so.
    pub fn missing(&self) -> Option<String> {
        (!self.is_complete()).then(|| format!("{} of {} trials", self.done, self.asked))
    }
}

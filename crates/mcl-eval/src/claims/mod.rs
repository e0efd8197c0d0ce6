//! What the paper says in numbers and comparisons, beside what was measured: `mcl-eval claims`.
//!
//! Everything is decided from saved result folders, and only from them. Every claim is a function
//! of what is saved and comes out as a [`Claim`]; where something is missing its verdict says so.
//! How each claim is decided, and why so, stands in docs/claims.md. Modules: `saved` reads;
//! `facts`, `maps`, `likelihood` (section V-A), `localization` and `divergence` (section V-B, on
//! the cells of `paired`) decide; [`render`] tells.

mod claim;
mod divergence;
mod facts;
mod likelihood;
mod localization;
mod maps;
mod paired;
#[cfg(test)]
mod planted;
pub mod render;
mod saved;

use std::path::PathBuf;

use anyhow::Result;
use serde::Serialize;

pub use claim::{Claim, Place, Section, Statement, Verdict};

/// Level of every test, as in the paper.
const ALPHA: f64 = 0.01;

/// All claims about one data set.
#[derive(Debug, Clone, Serialize)]
pub struct DatasetClaims {
    /// Name in the registry, or of the log file.
    pub name: String,
    /// The data in words: title, scans and points.
    pub description: String,
    /// The claims, in the paper's order.
    pub claims: Vec<Claim>,
}

/// Decides every claim for every data set that has a likelihood or a localization experiment among
/// the result folders; folders of other kinds are left alone.
///
/// # Errors
/// When a file that is there cannot be read or is damaged; the message names it, and the line.
pub fn decide(folders: &[PathBuf]) -> Result<Vec<DatasetClaims>> {
    Ok(saved::read(folders)?.iter().map(decide_dataset).collect())
}

fn decide_dataset(dataset: &saved::Dataset) -> DatasetClaims {
    let mut claims: Vec<Claim> = facts::CLAIMS.iter().map(|claim| claim(&dataset.facts)).collect();
    for results in &dataset.likelihood {
        let of_experiment = maps::CLAIMS.iter().chain(&likelihood::CLAIMS);
        claims.extend(of_experiment.map(|claim| claim(results)));
    }
    for results in &dataset.localization {
        claims.extend(
            localization::CLAIMS.iter().chain(&divergence::CLAIMS).map(|claim| claim(results)),
        );
    }
    claims.sort_by_key(|claim| claim.statement.section);
    DatasetClaims {
        name: dataset.facts.name.clone(),
        description: dataset.facts.describe(),
        claims,
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

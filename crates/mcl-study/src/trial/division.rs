//! The data of a study, divided by the splits of its recipes.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use anyhow::{Context, Result};
use mcl_core::{Pose2, Recording};
use mcl_maps::PointSet;

use crate::data::cloud_source::{Points, refuse_cloud};
use crate::data::source::{DataSource, LogSource};
use crate::recipe::split::{DividedScans, FOLDS, Split, divide, points_of, reference_of, select};

/// A log or point cloud, divided into the part that builds maps and the part that rates them.
pub struct Division<const D: usize> {
    /// Points that build maps.
    pub building: PointSet<D>,
    /// Points of other scans, where the split holds some out.
    pub held_out: Option<PointSet<D>>,
    /// Indices of the scans.
    pub scans: DividedScans,
    reference: OnceLock<Vec<Pose2>>,
}

impl<const D: usize> Division<D> {
    /// Reference poses of the scans that are localized.
    ///
    /// # Errors
    /// When a scan has none, or there are fewer than two.
    pub fn reference(&self, log: &LogSource) -> Result<&[Pose2]> {
        if let Some(known) = self.reference.get() {
            return Ok(known);
        }
        let found = reference_of(log, &self.scans.rating)?;
        Ok(self.reference.get_or_init(|| found))
    }

    /// The scans that build maps.
    pub fn building_scans(&self, log: &LogSource) -> Recording {
        select(&log.recording, &self.scans.building)
    }
}

/// A division in the dimension of the data.
#[derive(Clone)]
pub enum AnyDivision {
    /// In the plane.
    Planar(Arc<Division<2>>),
    /// In space.
    Spatial(Arc<Division<3>>),
}

impl AnyDivision {
    /// The division in the plane.
    ///
    /// # Errors
    /// When the data is a cloud in space.
    pub fn planar(&self) -> Result<&Arc<Division<2>>> {
        match self {
            AnyDivision::Planar(division) => Ok(division),
            AnyDivision::Spatial(_) => None.context("the points lie in space, not in the plane"),
        }
    }
}

/// Divisions by split and fold.
type Divisions = HashMap<(Option<Split>, Option<usize>), AnyDivision>;

/// An open log or point cloud, and its divisions, computed on demand and cached.
pub struct StudyData {
    /// The data source.
    pub source: DataSource,
    divisions: Mutex<Divisions>,
}

impl StudyData {
    /// From a data source.
    pub fn new(source: DataSource) -> Self {
        StudyData { source, divisions: Mutex::default() }
    }

    /// The log.
    ///
    /// # Errors
    /// When it is a point cloud.
    pub fn log(&self) -> Result<&LogSource> {
        self.source.log()
    }

    /// The data, divided. A cloud has no scans to hold out.
    ///
    /// # Errors
    /// When it cannot be divided like that.
    pub fn divided(&self, split: Option<Split>, fold: Option<usize>) -> Result<AnyDivision> {
        // While one thread divides, others wait: they would do the same work.
        let mut divisions = self.divisions.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = divisions.get(&(split, fold)) {
            return Ok(known.clone());
        }
        let found = self.divide(split, fold)?;
        divisions.insert((split, fold), found.clone());
        Ok(found)
    }

    fn divide(&self, split: Option<Split>, fold: Option<usize>) -> Result<AnyDivision> {
        let cloud = match &self.source {
            DataSource::Log(log) => {
                let scans = divide(&log.recording, split, fold.unwrap_or(0))?;
                let is_whole = scans.building.len() == log.recording.scans.len();
                let (building, held_out) = match is_whole {
                    // Gives a better error for a log that has no points at all.
                    true => (PointSet::new(log.points()?)?, None),
                    false => {
                        (points_of(log, &scans.building)?, Some(points_of(log, &scans.rating)?))
                    }
                };
                let division = Division { building, held_out, scans, reference: OnceLock::new() };
                return Ok(AnyDivision::Planar(Arc::new(division)));
            }
            DataSource::Cloud(cloud) => cloud,
        };
        if split.is_some_and(|split| split != Split::Same) {
            return refuse_cloud(&cloud.name);
        }
        Ok(match &cloud.points {
            Points::Planar(points) => AnyDivision::Planar(undivided(points.clone())?),
            Points::Spatial(points) => AnyDivision::Spatial(undivided(points.clone())?),
        })
    }

    /// Every division that holds out blocks of time, for criteria that rate a map by other scans.
    ///
    /// # Errors
    /// When the log is too short to be divided.
    pub fn folds(&self) -> Result<Vec<Arc<Division<2>>>> {
        let fold = |fold| {
            let divided = self.divided(Some(Split::Blocks), Some(fold))?;
            Ok(divided.planar()?.clone())
        };
        (0..FOLDS).map(fold).collect()
    }
}

fn undivided<const D: usize>(points: Vec<mcl_core::Point<D>>) -> Result<Arc<Division<D>>> {
    let scans = DividedScans { building: Vec::new(), rating: Vec::new() };
    let building = PointSet::new(points)?;
    Ok(Arc::new(Division { building, held_out: None, scans, reference: OnceLock::new() }))
}

//! The course of a run: which scans of the log, with what odometry and which disturbances.

use std::borrow::Cow;
use std::ops::Range;

use anyhow::{Result, bail};
use mcl_core::{Pose2, Recording, Seed};
use mcl_filter::{Replay, noisy_increments};
use rand::RngExt;

use crate::data::source::LogSource;
use crate::recipe::disturbance::{Kidnapped, Slip, Start};
use crate::recipe::run::RunRecipe;
use crate::trial::division::Division;
use crate::trial::people::surround;

/// The scans of a run in the order of the run, and its odometry.
pub struct Course<'a> {
    recording: Cow<'a, Recording>,
    increments: Vec<Option<Pose2>>,
    /// Indices of the localized scans in `recording`.
    used: Vec<usize>,
    /// Indices of the localized scans in the log.
    pub scans: Vec<usize>,
    /// Reference poses of the laser at these scans, in the map's frame.
    pub reference: Vec<Pose2>,
    /// Index of the first scan after the robot was kidnapped.
    pub carried_off: Option<usize>,
}

impl<'a> Course<'a> {
    /// The course of a run. `seed` returns the seed for a purpose, which depends on data set, split and run.
    ///
    /// # Errors
    /// When the log has no reference, is too short, has no place far enough away for a kidnapping, or the
    /// requested share of readings cannot end at people.
    pub fn of(
        recipe: &RunRecipe,
        log: &'a LogSource,
        division: &Division<2>,
        seed: impl Fn(&str) -> Seed,
    ) -> Result<Self> {
        let disturbance = &recipe.disturbance;
        let mut odometry: Vec<Option<Pose2>> =
            log.recording.scans.iter().map(|scan| scan.odometry).collect();
        if let Some(slip) = &disturbance.slip {
            slipped(&mut odometry, slip, seed("slip"));
        }
        let increments =
            noisy_increments(&odometry, recipe.odometry_noise, seed("experiment-noise"))?;
        let (rating, reference) = (&division.scans.rating, division.reference(log)?);
        let part = part_of(recipe, rating.len(), seed("start"))?;
        let carried = match &disturbance.kidnapped {
            Some(kidnapped) => Some(carried_to(kidnapped, &part, reference, seed("kidnapped"))?),
            None => None,
        };
        let parts = match carried {
            None => vec![part],
            Some((scans, to)) => {
                let rest = part.len() - scans;
                vec![part.start..part.start + scans, to..to + rest]
            }
        };
        let mut course = Course {
            recording: Cow::Borrowed(&log.recording),
            increments,
            used: rating.clone(),
            scans: parts.iter().flat_map(|part| &rating[part.clone()]).copied().collect(),
            reference: parts.iter().flat_map(|part| &reference[part.clone()]).copied().collect(),
            carried_off: carried.map(|(scans, _)| scans),
        };
        if course.scans != *rating {
            course.follow(&parts, rating);
        }
        if let Some(people) = &disturbance.people {
            let Course { recording, used, reference, .. } = &mut course;
            let scans = &mut recording.to_mut().scans;
            surround(scans, used, reference, people, log.max_range, seed("people"))?;
        }
        if let Some(share) = disturbance.lost_beams {
            course.lose_beams(share, seed("lost-beams"));
        }
        Ok(course)
    }

    /// The input of the filter.
    pub fn replay(&self) -> Replay<'_> {
        Replay { recording: &self.recording, increments: &self.increments, scans: &self.used }
    }

    /// The poses of the laser by odometry alone, at the localized scans, from the first reference pose on;
    /// where the odometry is not known, it stands still.
    pub fn odometry(&self) -> Vec<Pose2> {
        let Some(&first) = self.reference.first() else { return Vec::new() };
        let (mut pose, mut seen) = (first, self.used.first().copied().unwrap_or(0));
        let mut poses = Vec::with_capacity(self.used.len());
        for &scan in &self.used {
            // The increment of a scan leads to it.
            let steps = self.increments.get(seen + 1..=scan).unwrap_or_default();
            pose = steps.iter().flatten().fold(pose, |pose, step| pose.compose(step));
            seen = seen.max(scan);
            poses.push(pose);
        }
        poses
    }

    /// Appends parts of the localized scans, one after the other. In the odometry, the robot stands still
    /// between them.
    fn follow(&mut self, parts: &[Range<usize>], rating: &[usize]) {
        let (mut scans, mut increments, mut used) = (Vec::new(), Vec::new(), Vec::new());
        for part in parts {
            let rating = &rating[part.clone()];
            let [Some(&first), Some(&last)] = [rating.first(), rating.last()] else { continue };
            used.extend(rating.iter().map(|scan| scan - first + scans.len()));
            increments.push(Some(Pose2::IDENTITY));
            increments.extend_from_slice(&self.increments[first + 1..=last]);
            scans.extend_from_slice(&self.recording.scans[first..=last]);
        }
        let robot_from_laser = self.recording.robot_from_laser;
        self.recording = Cow::Owned(Recording { scans, robot_from_laser });
        (self.increments, self.used) = (increments, used);
    }

    fn lose_beams(&mut self, share: f64, seed: Seed) {
        let recording = self.recording.to_mut();
        for (&place, &scan) in self.used.iter().zip(&self.scans) {
            let mut rng = seed.derive_index(scan as u64).rng();
            for range in &mut recording.scans[place].ranges {
                if rng.random_bool(share) {
                    *range = f64::INFINITY;
                }
            }
        }
    }
}

/// The odometry of slipping wheels. Whether they slip on a step depends on the step alone.
fn slipped(odometry: &mut [Option<Pose2>], slip: &Slip, seed: Seed) {
    for (step, increment) in odometry.iter_mut().enumerate() {
        if let Some(increment) = increment
            && seed.derive_index(step as u64).rng().random_bool(slip.share)
        {
            increment.x *= slip.factor;
            increment.y *= slip.factor;
        }
    }
}

/// The range of the localized scans that the run uses.
fn part_of(recipe: &RunRecipe, scans: usize, seed: Seed) -> Result<Range<usize>> {
    let length = recipe.length.unwrap_or(scans);
    if length > scans {
        bail!("length is {length} scans, expected at most the {scans} that the log has");
    }
    let first = match recipe.start {
        Start::First => 0,
        Start::Anywhere => seed.rng().random_range(0..=scans - length),
    };
    Ok(first..first + length)
}

/// After how many scans of a part the robot is kidnapped, and to which of all localized scans: one that is
/// far enough away, drawn among those followed by enough scans for the rest of the run.
fn carried_to(
    kidnapped: &Kidnapped,
    part: &Range<usize>,
    reference: &[Pose2],
    seed: Seed,
) -> Result<(usize, usize)> {
    let scans = (kidnapped.at * part.len() as f64).round() as usize;
    if scans == 0 || scans >= part.len() {
        bail!(
            "kidnapped.at is {} of {} scans, expected at least one before and one after",
            kidnapped.at,
            part.len()
        );
    }
    let here = reference[part.start + scans - 1];
    let rest = part.len() - scans;
    let is_far = |to: &usize| reference[*to].distance(&here) >= kidnapped.distance;
    let places: Vec<usize> = (0..=reference.len() - rest).filter(is_far).collect();
    if places.is_empty() {
        bail!(
            "kidnapped.distance is {} m, and no place of the log is that far away and has {rest} scans \
             left; expected a smaller distance or shorter runs",
            kidnapped.distance
        );
    }
    Ok((scans, places[seed.rng().random_range(0..places.len())]))
}

#[cfg(test)]
mod tests;

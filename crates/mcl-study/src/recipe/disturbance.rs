//! Disturbances of a run beside noise, and the part of the log that it uses.

use serde::{Deserialize, Serialize};

use crate::table::{Cells, Value};

/// Disturbances of a log. Random draws depend on data set, split and run, never on map or filter, so that
/// everything is compared in pairs. None by default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Disturbance {
    /// People around the robot.
    pub people: Option<People>,
    /// Share of the readings that are lost (no return).
    pub lost_beams: Option<f64>,
    /// The robot is kidnapped.
    pub kidnapped: Option<Kidnapped>,
    /// Wheels slip.
    pub slip: Option<Slip>,
}

/// People who accompany the robot, like the visitors around a guide in a museum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct People {
    /// Share of the usable readings of a run that end at people, up to [`MOST_PEOPLE`].
    pub share: f64,
}

/// A robot that is moved to another place of the log without its odometry noticing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kidnapped {
    /// Share of the run's scans after which it happens.
    pub at: f64,
    /// Smallest distance moved (m).
    #[serde(default = "distance")]
    pub distance: f64,
}

fn distance() -> f64 {
    5.0
}

/// Slipping wheels: the odometry reports more (or less) translation than there was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slip {
    /// Share of the steps on which they slip.
    pub share: f64,
    /// Reported translation of such a step over the true one.
    pub factor: f64,
}

/// A larger share of the readings cannot end at people who keep their distance from the robot.
pub const MOST_PEOPLE: f64 = 0.8;

/// Where in the log a run begins.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// At the first scan.
    #[default]
    First,
    /// At a scan drawn for data set, split and run, among those from which the run's length fits.
    Anywhere,
}

impl Start {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Start::First => "first",
            Start::Anywhere => "anywhere",
        }
    }
}

impl Disturbance {
    /// Whether there is no disturbance.
    pub fn is_none(&self) -> bool {
        *self == Disturbance::default()
    }

    /// Checks every value; disturbances without effect are removed.
    ///
    /// # Errors
    /// What was found, and what was expected.
    pub fn checked(mut self) -> Result<Self, String> {
        let within = |name: &str, value: f64, [low, high]: [f64; 2]| {
            let message = format!("{name} is {value}, expected a number from {low} to {high}");
            (low..=high).contains(&value).then_some(()).ok_or(message)
        };
        if let Some(People { share }) = self.people {
            within("people.share", share, [0.0, MOST_PEOPLE])?;
        }
        if let Some(share) = self.lost_beams {
            within("lost_beams", share, [0.0, 1.0])?;
        }
        if let Some(Kidnapped { at, distance }) = self.kidnapped {
            within("kidnapped.at", at, [0.0, 1.0])?;
            within("kidnapped.distance", distance, [0.0, 1e6])?;
        }
        if let Some(Slip { share, factor }) = self.slip {
            within("slip.share", share, [0.0, 1.0])?;
            within("slip.factor", factor, [-100.0, 100.0])?;
        }
        self.people = self.people.filter(|people| people.share > 0.0);
        self.lost_beams = self.lost_beams.filter(|&share| share > 0.0);
        self.slip = self.slip.filter(|slip| slip.share > 0.0 && slip.factor != 1.0);
        Ok(self)
    }

    /// The columns of a row. A share that is not set is 0, so that it has its place on an axis of shares.
    pub fn cells(&self) -> Cells {
        let Disturbance { people, lost_beams, kidnapped, slip } = self;
        let cells: [(&str, Value); 6] = [
            ("people_share", people.as_ref().map_or(0.0, |people| people.share).into()),
            ("lost_beams", lost_beams.unwrap_or(0.0).into()),
            ("kidnapped_at", kidnapped.as_ref().map(|kidnapped| kidnapped.at).into()),
            ("kidnapped_distance", kidnapped.as_ref().map(|kidnapped| kidnapped.distance).into()),
            ("slip_share", slip.as_ref().map_or(0.0, |slip| slip.share).into()),
            ("slip_factor", slip.as_ref().map(|slip| slip.factor).into()),
        ];
        cells.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(json: &str) -> Result<Disturbance, String> {
        let disturbance: Disturbance = serde_json::from_str(json).map_err(|e| e.to_string())?;
        disturbance.checked()
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (json, expected) in [
            (r#"{"people": {"share": 0.9}}"#, "people.share is 0.9"),
            (r#"{"lost_beams": -0.1}"#, "lost_beams is -0.1"),
            (r#"{"kidnapped": {"at": 1.5}}"#, "kidnapped.at is 1.5"),
            (r#"{"kidnapped": {"at": 0.5, "distance": -1}}"#, "kidnapped.distance is -1"),
            (r#"{"slip": {"share": 2, "factor": 2}}"#, "slip.share is 2"),
            (r#"{"slip": {"share": 0.1, "factor": 1e9}}"#, "slip.factor is 1000000000"),
            (r#"{"peopel": {"share": 0.2}}"#, "peopel"),
        ] {
            let message = parsed(json).unwrap_err();
            assert!(message.contains(expected), "{json}: {message}");
        }
    }

    #[test]
    fn disturbances_of_size_zero_are_none() {
        let none =
            r#"{"people": {"share": 0}, "lost_beams": 0, "slip": {"share": 0.5, "factor": 1}}"#;
        let none = parsed(none).unwrap();
        assert!(none.is_none());
        assert_eq!(none.cells()[0], ("people_share".to_owned(), Value::Number(0.0)));
        assert!(!parsed(r#"{"kidnapped": {"at": 0.5}}"#).unwrap().is_none());
    }
}

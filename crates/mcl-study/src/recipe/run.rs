//! How a robot is localized on a map.

use std::fmt;

use anyhow::{Context, Result};
use mcl_filter::{FilterSettings, OdometryNoise, Preset};
use serde_json::Value as Json;

use crate::table::{Cells, Value};

/// How a robot is localized on a map. Noise belongs to data set, split and run, never to map or
/// filter, so that everything is compared in pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecipe {
    /// The set of settings that the study started from.
    pub preset: Preset,
    /// The particle filter. Its `max_range` is the data set's.
    pub filter: FilterSettings,
    /// Gaussian noise added to the odometry.
    pub odometry_noise: OdometryNoise,
    /// Number of the run: the same number has the same noise on every map.
    pub run: u32,
}

/// The setting that is the data set's and not a run's.
const OF_DATASET: &str = "max_range";

impl RunRecipe {
    /// What the run depends on, as JSON.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn to_json(&self) -> Result<Json> {
        let mut filter = serde_json::to_value(&self.filter)?;
        if let Some(settings) = filter.as_object_mut() {
            settings.remove(OF_DATASET);
            if self.filter.beam_floor.is_some() {
                // It does not count, and shall not make two recipes of one.
                settings.insert("z_rand".to_owned(), Json::Null);
            }
        }
        Ok(serde_json::json!({
            "preset": self.preset,
            "filter": filter,
            "odometry_noise": self.odometry_noise,
            "run": self.run,
        }))
    }

    /// The columns of a row that say how the robot was localized: the preset, and every setting of the
    /// filter, those of several parts flat (`alpha1`, `initial_pose_std_x`).
    ///
    /// # Errors
    /// When a setting cannot be written as JSON.
    pub fn cells(&self) -> Result<Cells> {
        let mut cells = Vec::new();
        let json = self.to_json()?;
        flatten("preset", &json["preset"], &mut cells);
        flatten("", &json["filter"], &mut cells);
        flatten("noise", &json["odometry_noise"], &mut cells);
        cells.push(("run".to_owned(), self.run.into()));
        Ok(cells)
    }

    /// Sets a setting of the filter by its name in a settings file.
    ///
    /// # Errors
    /// When there is none of that name, or the value is none for it.
    pub fn set(&mut self, name: &str, value: &Json) -> Result<()> {
        let mut filter = serde_json::to_value(&self.filter)?;
        let settings = filter.as_object_mut().context("settings of the filter are a table")?;
        settings.insert(name.to_owned(), value.clone());
        if name == "z_rand" {
            // The preset's floor would count in its place.
            settings.insert("beam_floor".to_owned(), Json::Null);
        }
        self.filter = serde_json::from_value(filter)?;
        Ok(())
    }

    /// Names of the settings of the filter that [`RunRecipe::set`] takes.
    ///
    /// # Errors
    /// When they cannot be written as JSON.
    pub fn setting_names() -> Result<Vec<String>> {
        let defaults = serde_json::to_value(FilterSettings::default())?;
        let names = defaults.as_object().into_iter().flatten().map(|(name, _)| name.clone());
        Ok(names.filter(|name| name != OF_DATASET).collect())
    }
}

/// Values of nested tables and lists under joined names.
fn flatten(name: &str, json: &Json, cells: &mut Cells) {
    let joined =
        |part: &str| if name.is_empty() { part.to_owned() } else { format!("{name}_{part}") };
    match json {
        Json::Object(parts) => {
            parts.iter().for_each(|(part, json)| flatten(&joined(part), json, cells))
        }
        Json::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                flatten(&format!("{name}{}", index + 1), item, cells);
            }
        }
        Json::Null => cells.push((name.to_owned(), Value::Empty)),
        Json::Bool(truth) => cells.push((name.to_owned(), (*truth).into())),
        Json::Number(number) => {
            let value = match number.as_u64() {
                Some(count) => Value::Count(count),
                None => number.as_f64().into(),
            };
            cells.push((name.to_owned(), value));
        }
        Json::String(text) => cells.push((name.to_owned(), text.as_str().into())),
    }
}

/// "run 3".
impl fmt::Display for RunRecipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "run {}", self.run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_a_column_and_can_be_set() {
        let noise = OdometryNoise { xy: 0.01, theta: 0.02 };
        let preset = Preset::Carmen;
        let mut run =
            RunRecipe { preset, filter: preset.settings(), odometry_noise: noise, run: 3 };
        run.set("sigma_hit", &0.7.into()).unwrap();
        run.set("alpha", &serde_json::json!([0.1, 0.2, 0.3, 0.4])).unwrap();
        run.set("beams", &60.into()).unwrap();
        let cells = run.cells().unwrap();
        let cell =
            |name: &str| cells.iter().find(|(column, _)| column == name).map(|c| c.1.clone());
        assert_eq!(cell("preset"), Some("carmen".into()));
        assert_eq!([cell("beam_floor"), cell("z_rand")], [Some(0.45.into()), Some(Value::Empty)]);
        assert_eq!(cell("sigma_hit"), Some(0.7.into()));
        assert_eq!(cell("alpha4"), Some(0.4.into()));
        assert_eq!(cell("beams"), Some(60u32.into()));
        assert_eq!(cell("initial_pose_std_theta"), Some(0.05.into()));
        assert_eq!((cell("noise_theta"), cell("run")), (Some(0.02.into()), Some(3u32.into())));
        assert_eq!(cell("max_range"), None);
        assert!(RunRecipe::setting_names().unwrap().contains(&"proposal".to_owned()));
        assert!(run.set("sigma_hitt", &1.into()).is_err());
    }
}

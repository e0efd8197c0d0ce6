//! The recipe of a run.

use std::fmt;
use std::sync::Arc;

use anyhow::{Context, Result};
use mcl_filter::{FilterSettings, InitialPose, OdometryNoise, Preset, Recovery};
use serde_json::Value as Json;
use serde_json::value::RawValue;

use crate::recipe::digest;
use crate::recipe::disturbance::{Disturbance, Start};
use crate::recipe::localizer::{LOCALIZER, Localizer, Program};
use crate::table::{Cells, Value};

/// How a robot is localized on a map. Noise depends on data set, split and run, never on map or filter, so
/// that everything is compared in pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecipe {
    /// The localizer; `None` in a study without external programs, which uses the built-in filter.
    pub localizer: Option<Localizer>,
    /// The set of settings that the study started from.
    pub preset: Preset,
    /// The particle filter. Its `max_range` is the data set's.
    pub filter: FilterSettings,
    /// Gaussian noise added to the odometry.
    pub odometry_noise: OdometryNoise,
    /// Where in the log the run begins.
    pub start: Start,
    /// Number of localized scans; `None`: to the end of the log.
    pub length: Option<usize>,
    /// Disturbances beside noise.
    pub disturbance: Disturbance,
    /// Number of the run: the same number has the same noise on every map.
    pub run: u32,
}

/// A run as written to JSON, which contains everything it depends on.
#[derive(Debug, Clone)]
pub(crate) struct WrittenRun {
    /// [Its JSON](RunRecipe::to_json).
    pub json: Box<RawValue>,
    /// A digest that distinguishes it from the others on its map.
    pub key: String,
}

impl WrittenRun {
    pub fn of(run: &RunRecipe) -> Result<Self> {
        let json = RawValue::from_string(serde_json::to_string(&run.to_json()?)?)?;
        Ok(WrittenRun { key: digest(json.get().as_bytes()), json })
    }
}

/// The setting that belongs to the data set and not to a run.
const OF_DATASET: &str = "max_range";

/// The setting of the filter for the initial pose, which programs are given, too.
const START: &str = "initial_pose";

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
                // It has no effect, and must not make two recipes of one.
                settings.insert("z_rand".to_owned(), Json::Null);
            }
        }
        let mut json = serde_json::json!({
            "preset": self.preset,
            "filter": filter,
            "odometry_noise": self.odometry_noise,
            "run": self.run,
        });
        // Settings of the built-in filter do not apply to a program, except for the initial pose. Naming the
        // built-in filter explicitly does not change its runs.
        if let (Some(Localizer::Program(program)), Some(run)) =
            (&self.localizer, json.as_object_mut())
        {
            run.remove("preset");
            run.remove("filter");
            run.insert(LOCALIZER.to_owned(), serde_json::to_value(&**program)?);
            run.insert(START.to_owned(), serde_json::to_value(self.filter.initial_pose)?);
        }
        // Without disturbance, a run over the whole log keeps the identity that it has without these
        // settings.
        if self.start != Start::First {
            json["start"] = serde_json::to_value(self.start)?;
        }
        if self.length.is_some() {
            json["length"] = self.length.into();
        }
        if !self.disturbance.is_none() {
            json["disturbance"] = serde_json::to_value(&self.disturbance)?;
        }
        Ok(json)
    }

    /// The columns of a row that describe the run's recipe: the preset, and every setting of the filter,
    /// nested ones flattened (`alpha1`, `initial_pose_std_x`). They are the same whatever the settings,
    /// preceded by the localizer in studies that have several: settings that do not apply to a program and
    /// parts that a setting does not have are empty, and an optional one (`recover`) has a column of yes and
    /// no beside those of its parts.
    ///
    /// # Errors
    /// When a setting cannot be written as JSON.
    pub fn cells(&self) -> Result<Cells> {
        let mut cells = Vec::new();
        if let Some(localizer) = &self.localizer {
            cells.push((LOCALIZER.to_owned(), localizer.name().into()));
        }
        let first = cells.len();
        let json = RunRecipe { localizer: None, ..self.clone() }.to_json()?;
        flatten("preset", &json["preset"], &mut cells);
        let [without, with] = shapes()?;
        for (name, shape) in with.as_object().into_iter().flatten() {
            let setting = &json["filter"][name];
            if shape.is_object() && without[name].is_null() {
                cells.push((name.clone(), (!setting.is_null()).into()));
            }
            flatten_as(shape, name, setting, &mut cells);
        }
        if let Some(Localizer::Program(_)) = self.localizer {
            for (_, value) in cells[first..].iter_mut().filter(|(name, _)| !name.starts_with(START))
            {
                *value = Value::Empty;
            }
        }
        flatten("noise", &json["odometry_noise"], &mut cells);
        cells.push(("start".to_owned(), self.start.name().into()));
        cells.push(("length".to_owned(), self.length.into()));
        cells.extend(self.disturbance.cells());
        cells.push(("run".to_owned(), self.run.into()));
        Ok(cells)
    }

    /// Sets a setting of the filter by its name in a settings file. For an optional one, `false` removes it,
    /// and `true` sets all of its defaults.
    ///
    /// # Errors
    /// When there is no setting of that name, or the value is not valid for it.
    pub fn set(&mut self, name: &str, value: &Json) -> Result<()> {
        let mut filter = serde_json::to_value(&self.filter)?;
        let settings = filter.as_object_mut().context("settings of the filter are a table")?;
        let value = match value {
            Json::Bool(false) if !settings[name].is_boolean() => Json::Null,
            Json::Bool(true) if !settings[name].is_boolean() => Json::Object(Default::default()),
            value => value.clone(),
        };
        settings.insert(name.to_owned(), value);
        if name == "z_rand" {
            // Otherwise the preset's floor would be used instead.
            settings.insert("beam_floor".to_owned(), Json::Null);
        }
        self.filter = serde_json::from_value(filter)?;
        Ok(())
    }

    /// Names of the settings of the filter accepted by [`RunRecipe::set`].
    ///
    /// # Errors
    /// When they cannot be written as JSON.
    pub fn setting_names() -> Result<Vec<String>> {
        let defaults = serde_json::to_value(FilterSettings::default())?;
        let names = defaults.as_object().into_iter().flatten().map(|(name, _)| name.clone());
        Ok(names.filter(|name| name != OF_DATASET).collect())
    }

    /// The program that localizes, unless it is the built-in filter.
    pub fn program(&self) -> Option<&Arc<Program>> {
        match &self.localizer {
            Some(Localizer::Program(program)) => Some(program),
            Some(Localizer::Own) | None => None,
        }
    }
}

/// Settings of the filter with the fewest parts, and with all possible parts: the shape of a row.
fn shapes() -> Result<[Json; 2]> {
    let known = InitialPose::Known { std_x: 0.0, std_y: 0.0, std_theta: 0.0 };
    let without =
        FilterSettings { initial_pose: known, recover: None, ..FilterSettings::default() };
    let with = FilterSettings {
        initial_pose: InitialPose::scan(),
        recover: Some(Recovery::default()),
        ..without.clone()
    };
    let without = serde_json::to_value(without)?;
    let mut with = serde_json::to_value(with)?;
    if let (Some(all), Some(others)) = (with.as_object_mut(), without.as_object()) {
        all.remove(OF_DATASET);
        for (name, setting) in all {
            if let (Some(parts), Some(Json::Object(others))) =
                (setting.as_object_mut(), others.get(name))
            {
                parts.extend(others.clone());
            }
        }
    }
    Ok([without, with])
}

/// A flattened setting, with the columns of its shape.
fn flatten_as(shape: &Json, name: &str, json: &Json, cells: &mut Cells) {
    match shape {
        Json::Object(parts) => {
            for (part, shape) in parts {
                flatten_as(shape, &format!("{name}_{part}"), &json[part], cells);
            }
        }
        _ => flatten(name, json, cells),
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

/// "run 3", "amcl run 3".
impl fmt::Display for RunRecipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(localizer) = &self.localizer {
            write!(f, "{} ", localizer.name())?;
        }
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
        let filter = preset.settings();
        let mut run = RunRecipe { preset, filter, odometry_noise: noise, run: 3, ..plain() };
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

    fn plain() -> RunRecipe {
        RunRecipe {
            localizer: None,
            preset: Preset::Default,
            filter: FilterSettings::default(),
            odometry_noise: OdometryNoise::default(),
            start: Start::First,
            length: None,
            disturbance: Disturbance::default(),
            run: 0,
        }
    }

    /// Fault: the runs on a map share their columns in the file of rows, and a start from a scan had other
    /// columns than a known start.
    #[test]
    fn rows_have_the_same_columns_whatever_the_settings() {
        let columns = |run: &RunRecipe| -> Vec<String> {
            run.cells().unwrap().into_iter().map(|(name, _)| name).collect()
        };
        let cell = |run: &RunRecipe, column: &str| {
            let cells = run.cells().unwrap();
            cells.into_iter().find(|(name, _)| name == column).map(|(_, value)| value)
        };
        let expected = columns(&plain());
        for (setting, value) in [
            ("initial_pose", serde_json::json!({ "kind": "scan" })),
            ("initial_pose", serde_json::json!({ "kind": "uniform" })),
            ("recover", true.into()),
            ("recover", serde_json::json!({ "tolerance": 1.5 })),
            ("particles", "100..1000".into()),
            ("sigma_hit", "auto".into()),
        ] {
            let mut run = plain();
            run.set(setting, &value).unwrap();
            assert_eq!(columns(&run), expected, "{setting} = {value}");
        }
        let mut run = plain();
        assert_eq!(cell(&run, "recover"), Some(false.into()));
        run.set("recover", &true.into()).unwrap();
        assert_eq!(run.filter.recover, Some(Recovery::default()));
        assert_eq!(cell(&run, "recover"), Some(true.into()));
        assert_eq!(cell(&run, "recover_tolerance"), Some(Recovery::default().tolerance.into()));
        run.set("recover", &false.into()).unwrap();
        assert_eq!(run, plain());
        assert!(run.set("beams", &true.into()).is_err());
    }

    /// Rows of studies without disturbances are unchanged.
    #[test]
    fn undisturbed_runs_keep_their_identity() {
        let mut run = plain();
        let names = |run: &RunRecipe| -> Vec<String> {
            run.to_json().unwrap().as_object().unwrap().keys().cloned().collect()
        };
        assert_eq!(names(&run), ["filter", "odometry_noise", "preset", "run"]);
        run.length = Some(60);
        run.start = Start::Anywhere;
        run.disturbance.lost_beams = Some(0.1);
        assert_eq!(names(&run)[..2], ["disturbance", "filter"]);
        assert_eq!(names(&run).len(), 7);
        // With programs in the study, the built-in filter has the same runs, but another column.
        let own = RunRecipe { localizer: Some(Localizer::Own), ..run.clone() };
        assert_eq!(own.to_json().unwrap(), run.to_json().unwrap());
        let [own, run] = [own, run].map(|run| run.cells().unwrap());
        assert_eq!((own[0].0.as_str(), &own[1..]), (LOCALIZER, &run[..]));
    }
}

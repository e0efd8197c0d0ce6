//! The factors of a study: what it can vary, and how a value changes a recipe.
//!
//! A factor is a key of `[base]`, `[[trials]]` or a map of a picture: those of [`KEYS`], and every setting of
//! the filter by its name.

use std::sync::Arc;

use mcl_filter::{FilterSettings, OdometryNoise, Preset};
use mcl_maps::Refinement;
use serde_json::Value as Json;

use crate::recipe::criterion::Criterion;
use crate::recipe::disturbance::{Disturbance, Start};
use crate::recipe::kind::{Builder, MapKind, NamedKind};
use crate::recipe::localizer::{LOCALIZER, Localizer, MapFormat, OWN, Program};
use crate::recipe::map::{MapRecipe, Offset, Sigma, Size};
use crate::recipe::run::RunRecipe;

/// The factors that are not settings of the filter.
pub const KEYS: [&str; 15] = [
    LOCALIZER,
    "split",
    "map",
    "size",
    "points",
    "resolution",
    "offset",
    "sigma",
    "tolerance",
    "max_iterations",
    "odometry_noise",
    "start",
    "length",
    "disturbance",
    "preset",
];

/// Names defined by a study, for use in its factors.
#[derive(Debug, Clone, Default)]
pub struct Definitions {
    /// Refinements with settings of their own.
    pub refinements: Vec<(String, Refinement)>,
    /// Programs that localize.
    pub programs: Vec<Arc<Program>>,
}

impl Definitions {
    /// The localizer of a name; `None` for the built-in filter where there is no other.
    fn localizer(&self, name: &str) -> Result<Option<Localizer>, String> {
        if name == OWN {
            return Ok((!self.programs.is_empty()).then_some(Localizer::Own));
        }
        let found = self.programs.iter().find(|program| program.name == name);
        let known = || {
            let names = self.programs.iter().map(|program| program.name.as_str());
            [OWN].into_iter().chain(names).collect::<Vec<_>>().join(", ")
        };
        let program = found.ok_or_else(|| format!("{name:?}, expected one of: {}", known()))?;
        Ok(Some(Localizer::Program(program.clone())))
    }
}

/// A recipe while its factors are set, one by one.
#[derive(Debug, Clone)]
pub struct Draft {
    map: MapRecipe,
    run: RunRecipe,
    percent: Option<Size>,
    points: Option<Size>,
    resolution: Option<Size>,
    /// Changes to settings of the preset, in order.
    settings: Vec<(String, Json)>,
}

impl Draft {
    /// A recipe of a data set before any factor is set: all points, σ = 0.05 m, the default preset, unchanged
    /// odometry.
    pub fn new(dataset: &str, seed: u64) -> Result<Self, String> {
        Ok(Draft {
            map: MapRecipe {
                dataset: dataset.to_owned(),
                split: None,
                kind: NamedKind::parse("all", &[])?,
                size: None,
                offset: Offset::Random,
                sigma: Sigma::Metres(0.05),
                tolerance: 1e-4,
                max_iterations: 1000,
                draw: 0,
                seed,
            },
            run: RunRecipe {
                localizer: None,
                preset: Preset::Default,
                filter: FilterSettings::default(),
                odometry_noise: OdometryNoise::default(),
                start: Start::First,
                length: None,
                disturbance: Disturbance::default(),
                run: 0,
            },
            percent: None,
            points: None,
            resolution: None,
            settings: Vec::new(),
        })
    }

    /// Sets a factor.
    ///
    /// # Errors
    /// What was expected, where the value is not valid for the factor or there is no such factor.
    pub fn set(&mut self, key: &str, value: &Json, defined: &Definitions) -> Result<(), String> {
        match key {
            LOCALIZER => self.run.localizer = defined.localizer(text(value)?)?,
            "split" => self.map.split = Some(parsed(value, "same, alternate or blocks")?),
            "map" => self.map.kind = NamedKind::parse(text(value)?, &defined.refinements)?,
            "size" => {
                self.percent = Some(match value {
                    Json::String(name) => {
                        Size::Chosen(criterion(name, Criterion::decides_size, "size")?)
                    }
                    _ => Size::Percent(number(value, "a percentage above 0 and up to 100", |p| {
                        p > 0.0 && p <= 100.0
                    })?),
                });
            }
            "points" => {
                let points = number(value, "a whole number of points, at least 1", |points| {
                    points >= 1.0 && points.fract() == 0.0 && points < 1e15
                })?;
                self.points = Some(Size::Points(points as usize));
            }
            "resolution" => self.resolution = Some(Size::Resolution(length(value)?)),
            "offset" => {
                self.map.offset = match text(value)? {
                    "random" => Offset::Random,
                    "origin" => Offset::Origin,
                    other => return Err(format!("{other:?}, expected random or origin")),
                };
            }
            "sigma" => {
                self.map.sigma = match value {
                    Json::String(name) => {
                        Sigma::Chosen(criterion(name, Criterion::decides_sigma, "σ")?)
                    }
                    _ => Sigma::Metres(length(value)?),
                };
            }
            "tolerance" => {
                self.map.tolerance = number(value, "a number above 0", |t| t > 0.0)?;
            }
            "max_iterations" => {
                let updates = number(value, "a whole number, at least 1", |updates| {
                    updates >= 1.0 && updates.fract() == 0.0 && updates < 1e15
                })?;
                self.map.max_iterations = updates as usize;
            }
            "odometry_noise" => {
                self.run.odometry_noise = parsed(value, "{ xy = metres, theta = radians }")?;
            }
            "start" => self.run.start = parsed(value, "first or anywhere")?,
            "length" => {
                let scans = number(value, "a whole number of scans, at least 2", |scans| {
                    scans >= 2.0 && scans.fract() == 0.0 && scans < 1e15
                })?;
                self.run.length = Some(scans as usize);
            }
            "disturbance" => {
                let disturbance: Disturbance = parsed(
                    value,
                    "{ people = { share }, lost_beams = share, kidnapped = { at, distance }, slip = \
                     { share, factor } }, each of them or none",
                )?;
                self.run.disturbance = disturbance.checked()?;
            }
            "preset" => {
                self.run.preset = text(value)?.parse().map_err(|error| format!("{error}"))?;
            }
            setting => {
                if !is_setting(setting) {
                    return Err(format!(
                        "there is no such factor, expected {}, draws, runs or a setting of the \
                         filter: {}",
                        KEYS.join(", "),
                        RunRecipe::setting_names().unwrap_or_default().join(", ")
                    ));
                }
                // An invalid value is reported here, where its line is known.
                self.run.set(setting, value).map_err(|error| error.to_string())?;
                self.settings.push((setting.to_owned(), value.clone()));
            }
        }
        Ok(())
    }

    /// The recipes, once all factors are set. Factors that have no effect on a kind of map are reset to their
    /// defaults, so that they make no difference.
    ///
    /// # Errors
    /// When a factor is missing, or factors contradict each other.
    pub fn finish(mut self) -> Result<(MapRecipe, RunRecipe), String> {
        let kind = &self.map.kind;
        let name = &kind.name;
        self.map.size = match (kind.has_resolution(), kind.builder(), self.percent, self.points) {
            (true, ..) => Some(self.resolution.ok_or(format!(
                "{name} needs resolution: the edge of its cells, or how far points may be from \
                 their segment (m)"
            ))?),
            (false, None, ..) => None,
            (false, Some(_), Some(_), Some(_)) => {
                return Err("size and points are both given, expected one of them".to_owned());
            }
            (false, Some(_), None, None) => {
                return Err(format!("{name} needs size (%) or points"));
            }
            (false, Some(_), percent, points) => percent.or(points),
        };
        if kind.builder() != Some(Builder::Grid) {
            self.map.offset = Offset::Random;
        }
        if let (Some(Size::Chosen(_)), Sigma::Chosen(_)) = (self.map.size, self.map.sigma) {
            return Err("the data chooses size or σ, not both at once".to_owned());
        }
        self.run.filter = self.run.preset.settings();
        let is_set = |setting: &str| self.settings.iter().any(|(name, _)| name == setting);
        if is_set("z_rand") && is_set("beam_floor") {
            return Err(
                "z_rand and beam_floor set the same property, expected one of them".to_owned()
            );
        }
        for (setting, value) in &self.settings {
            self.run.set(setting, value).map_err(|error| error.to_string())?;
        }
        self.run.filter.clone().check().map_err(|error| error.to_string())?;
        let OdometryNoise { xy, theta } = self.run.odometry_noise;
        if !(xy >= 0.0 && xy.is_finite() && theta >= 0.0 && theta.is_finite()) {
            return Err(format!(
                "odometry_noise is {xy} m and {theta} rad, expected finite numbers, at least 0"
            ));
        }
        if self.run.start == Start::Anywhere && self.run.length.is_none() {
            return Err("start is anywhere, expected length: the scans of a run".to_owned());
        }
        if let Some(program) = self.run.program() {
            check_map(program, &self.map.kind)?;
        }
        Ok((self.map, self.run))
    }
}

/// Checks that a program can read a map of this kind.
fn check_map(program: &Program, kind: &NamedKind) -> Result<(), String> {
    let (program, formats) = (&program.name, &program.formats);
    match kind.kind {
        MapKind::Ndt { .. } | MapKind::Segments => Err(format!(
            "localizer {program}: expected a map of points or cells, not {}",
            kind.name
        )),
        MapKind::All | MapKind::Sampled { .. }
            if formats.map == MapFormat::Grid && formats.resolution.is_none() =>
        {
            Err(format!(
                "localizer {program}: {} is a map of points; [localizer.{program}] needs resolution: the edge of \
                 the cells of its grid (m)",
                kind.name
            ))
        }
        _ => Ok(()),
    }
}

/// Whether a value of a factor is itself a list, as α₁…α₄ are.
pub fn is_list(key: &str) -> bool {
    let defaults = serde_json::to_value(FilterSettings::default()).unwrap_or_default();
    defaults.get(key).is_some_and(Json::is_array)
}

/// Whether there is a factor of this name.
pub fn is_factor(key: &str) -> bool {
    KEYS.contains(&key) || is_setting(key)
}

fn is_setting(key: &str) -> bool {
    RunRecipe::setting_names().unwrap_or_default().iter().any(|name| name == key)
}

fn parsed<T: serde::de::DeserializeOwned>(value: &Json, expected: &str) -> Result<T, String> {
    T::deserialize(value).map_err(|_| format!("{value}, expected {expected}"))
}

fn text(value: &Json) -> Result<&str, String> {
    value.as_str().ok_or_else(|| format!("{value}, expected a name in quotes"))
}

fn length(value: &Json) -> Result<f64, String> {
    number(value, "metres, above 0", |metres| metres > 0.0)
}

fn number(value: &Json, expected: &str, is_good: impl Fn(f64) -> bool) -> Result<f64, String> {
    match value.as_f64() {
        Some(number) if number.is_finite() && is_good(number) => Ok(number),
        _ => Err(format!("{value}, expected {expected}")),
    }
}

fn criterion(name: &str, decides: fn(Criterion) -> bool, what: &str) -> Result<Criterion, String> {
    let criterion: Criterion = name.parse()?;
    match decides(criterion) {
        true => Ok(criterion),
        false => Err(format!("{criterion} cannot choose the {what}")),
    }
}

//! External localizers: programs that a study runs on the same data as the built-in filter.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use mcl_datasets::bag;
use serde::{Deserialize, Serialize};
use toml::Spanned;

/// The name of the built-in filter among localizers.
pub const OWN: &str = "own";

/// The column, and the factor, with the localizer of a run.
pub const LOCALIZER: &str = "localizer";

/// The localizer of a run in a study with external programs.
#[derive(Debug, Clone, PartialEq)]
pub enum Localizer {
    /// The built-in filter.
    Own,
    /// A program.
    Program(Arc<Program>),
}

impl Localizer {
    /// Its name in the study.
    pub fn name(&self) -> &str {
        match self {
            Localizer::Own => OWN,
            Localizer::Program(program) => &program.name,
        }
    }
}

/// A program that localizes a robot, and its input. All fields are part of the identity of its rows; of the
/// files that it reads, the digests.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Program {
    /// Its name in the study.
    pub name: String,
    /// Program and arguments, with [placeholders](PLACEHOLDERS).
    pub command: Vec<String>,
    /// The formats of its input.
    #[serde(flatten)]
    pub formats: Formats,
    /// Whose poses it writes.
    pub poses: Whose,
    /// The files beside the study that it reads, each with its SHA-256 (empty: not known yet).
    pub files: BTreeMap<String, String>,
    /// Variables of its environment, with placeholders.
    pub environment: BTreeMap<String, String>,
    /// Its resource limits.
    #[serde(flatten)]
    pub limits: Limits,
}

/// The formats of log and map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Formats {
    /// Of the log.
    pub log: LogFormat,
    /// Of the map.
    pub map: MapFormat,
    /// Cells of a grid made of a map of points (m).
    pub resolution: Option<f64>,
}

/// Formats of logs for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// Bag of ROS 2.
    Mcap,
    /// Bag of ROS 1.
    Bag,
    /// Bag of ROS 2, a database.
    Db3,
    /// CARMEN log.
    Carmen,
}

impl LogFormat {
    /// The ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            LogFormat::Mcap => "mcap",
            LogFormat::Bag => "bag",
            LogFormat::Db3 => "db3",
            LogFormat::Carmen => "log",
        }
    }

    /// The format of a bag; `None` for a CARMEN log.
    pub fn of_bag(self) -> Option<bag::Format> {
        match self {
            LogFormat::Mcap => Some(bag::Format::Mcap),
            LogFormat::Bag => Some(bag::Format::Ros1),
            LogFormat::Db3 => Some(bag::Format::Database),
            LogFormat::Carmen => None,
        }
    }
}

/// Formats of maps for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MapFormat {
    /// Points, one line `x,y` each.
    Csv,
    /// Points.
    Ply,
    /// Points.
    Pcd,
    /// Cells: the description of map_server (`.yaml`) with its image.
    Grid,
}

impl MapFormat {
    /// The ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            MapFormat::Csv => "csv",
            MapFormat::Ply => "ply",
            MapFormat::Pcd => "pcd",
            MapFormat::Grid => "yaml",
        }
    }
}

/// Whose poses a program writes, in the frame of the map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Whose {
    /// The robot's (`base_link`).
    #[default]
    Robot,
    /// The laser's.
    Laser,
}

/// Resource limits of a program.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limits {
    /// Wall-clock time in seconds.
    pub time_limit: f64,
    /// Memory of its processes together (MB).
    pub memory_limit: Option<f64>,
    /// Size of its folder (MB), including its input.
    pub output_limit: f64,
}

/// The placeholders, written in braces, of a command and its environment.
pub const PLACEHOLDERS: [&str; 8] =
    ["bag", "log", "map", "start", "run", "output", "seed", "study"];

/// A `[localizer.NAME]` as written in a file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramTable {
    command: Spanned<Vec<Spanned<String>>>,
    log: LogFormat,
    map: MapFormat,
    resolution: Option<Spanned<f64>>,
    #[serde(default)]
    poses: Whose,
    #[serde(default)]
    files: Vec<Spanned<String>>,
    #[serde(default)]
    environment: BTreeMap<String, Spanned<String>>,
    time_limit: Spanned<f64>,
    memory_limit: Option<Spanned<f64>>,
    output_limit: Option<Spanned<f64>>,
}

/// Default limit of the folder's size (MB).
const OUTPUT_LIMIT: f64 = 1000.0;

/// A mistake in a file: its byte range, its key, and what was expected.
type Mistake = (Range<usize>, &'static str, String);

impl ProgramTable {
    /// Checks it. `digests` are those of the files, as far as they are known.
    ///
    /// # Errors
    /// The first mistake, with its place in the file.
    pub fn checked(
        self,
        name: &Spanned<String>,
        digests: &BTreeMap<String, String>,
    ) -> Result<Program, Mistake> {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let text = name.get_ref();
        if text.is_empty() || text == OWN || !text.chars().all(is_word) {
            let expected =
                format!("{text:?}, expected a name of letters, digits, - and _, other than {OWN}");
            return Err((name.span(), "name", expected));
        }
        if self.command.get_ref().is_empty() {
            return Err((self.command.span(), "command", "is empty, expected a program".into()));
        }
        for text in self.command.get_ref() {
            check_placeholders(text).map_err(|message| (text.span(), "command", message))?;
        }
        for text in self.environment.values() {
            check_placeholders(text).map_err(|message| (text.span(), "environment", message))?;
        }
        for file in &self.files {
            let path = std::path::Path::new(file.get_ref());
            let is_below = !path.as_os_str().is_empty()
                && path.components().all(|part| matches!(part, std::path::Component::Normal(_)));
            if !is_below {
                let message =
                    format!("{:?}, expected a file beside or below the study", file.get_ref());
                return Err((file.span(), "files", message));
            }
        }
        let positive = |number: &Spanned<f64>, key: &'static str| {
            let value = *number.get_ref();
            let message = || format!("{value}, expected a number above 0");
            (value > 0.0 && value.is_finite())
                .then_some(value)
                .ok_or_else(|| (number.span(), key, message()))
        };
        let optional = |number: &Option<Spanned<f64>>, key| {
            number.as_ref().map(|number| positive(number, key)).transpose()
        };
        let resolution = optional(&self.resolution, "resolution")?;
        if let (Some(given), true) = (&self.resolution, self.map != MapFormat::Grid) {
            return Err((given.span(), "resolution", "applies only to map = \"grid\"".into()));
        }
        let limits = Limits {
            time_limit: positive(&self.time_limit, "time_limit")?,
            memory_limit: optional(&self.memory_limit, "memory_limit")?,
            output_limit: optional(&self.output_limit, "output_limit")?.unwrap_or(OUTPUT_LIMIT),
        };
        let digest = |file: Spanned<String>| {
            let file = file.into_inner();
            let digest = digests.get(&file).cloned().unwrap_or_default();
            (file, digest)
        };
        let environment = self.environment.into_iter();
        Ok(Program {
            name: text.clone(),
            command: self.command.into_inner().into_iter().map(Spanned::into_inner).collect(),
            formats: Formats { log: self.log, map: self.map, resolution },
            poses: self.poses,
            files: self.files.into_iter().map(digest).collect(),
            environment: environment.map(|(key, value)| (key, value.into_inner())).collect(),
            limits,
        })
    }
}

/// A text with its placeholders replaced; `{{` and `}}` stand for braces.
///
/// # Errors
/// The name in braces that is not a placeholder.
pub fn filled(text: &str, value: impl Fn(&str) -> Option<String>) -> Result<String, String> {
    let mut filled = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(['{', '}']) {
        filled.push_str(&rest[..at]);
        let brace = &rest[at..=at];
        rest = &rest[at + 1..];
        if let Some(behind) = rest.strip_prefix(brace) {
            filled.push_str(brace);
            rest = behind;
            continue;
        }
        let name = rest.split_once('}').filter(|_| brace == "{");
        let Some((name, behind)) = name else {
            return Err(format!(
                "{text:?} has an unpaired {brace}, expected {brace}{brace} for a literal brace"
            ));
        };
        let unknown =
            || format!("{{{name}}} is unknown, expected one of: {}", known_placeholders());
        filled.push_str(&value(name).ok_or_else(unknown)?);
        rest = behind;
    }
    Ok(filled + rest)
}

fn known_placeholders() -> String {
    PLACEHOLDERS.map(|name| format!("{{{name}}}")).join(", ")
}

fn check_placeholders(text: &Spanned<String>) -> Result<(), String> {
    let known = |name: &str| PLACEHOLDERS.contains(&name).then(String::new);
    filled(text.get_ref(), known).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_filled_and_braces_kept() {
        let value = |name: &str| (name == "map").then(|| "a b.csv".to_owned());
        assert_eq!(filled("--map={map} {{x}}", value).unwrap(), "--map=a b.csv {x}");
        for (text, named) in [("{mapp}", "{mapp} is unknown"), ("a}", "}}"), ("{map", "{{")] {
            let message = filled(text, value).unwrap_err();
            assert!(message.contains(named), "{message}");
        }
    }
}

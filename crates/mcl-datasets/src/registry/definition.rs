//! The keys of `dataset.toml` as written, before they are checked.

use mcl_core::Pose2;
use serde::Deserialize;

use crate::log::options::ReferencePoses;

use super::dataset::{Dataset, DatasetKind, KnownCopy, LogFile, Origin};
use super::{DEFINITION_FILE, Facts};

/// What is wrong with a `dataset.toml`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// Not TOML, an unknown key, or a value of the wrong type; the message names line and column.
    #[error("{0}")]
    Toml(#[from] toml::de::Error),
    /// A required key of this format is missing.
    #[error("no key `{key}`, which format \"{format}\" needs")]
    MissingKey {
        /// The key.
        key: &'static str,
        /// The format.
        format: &'static str,
    },
    /// A key that has no meaning for this format.
    #[error("key `{key}` has no meaning for format \"{format}\"; remove it")]
    UselessKey {
        /// The key.
        key: &'static str,
        /// The format.
        format: &'static str,
    },
    /// A value out of its range.
    #[error("`{key}` is {found}, expected {expected}")]
    Value {
        /// The key.
        key: &'static str,
        /// The value found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Format {
    Carmen,
    Mcap,
    Cloud,
    Simulated,
    #[serde(rename = "simulated-cloud")]
    SimulatedCloud,
}

impl Format {
    fn name(&self) -> &'static str {
        match self {
            Format::Carmen => "carmen",
            Format::Mcap => "mcap",
            Format::Cloud => "cloud",
            Format::Simulated => "simulated",
            Format::SimulatedCloud => "simulated-cloud",
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorKeys {
    robot_from_laser: PoseKeys,
    #[serde(default)]
    no_deskew: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseKeys {
    x: f64,
    y: f64,
    theta: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Definition {
    title: String,
    description: String,
    format: Format,
    file: Option<String>,
    #[serde(default)]
    other_names: Vec<String>,
    #[serde(default)]
    urls: Vec<String>,
    seed: Option<u64>,
    max_range: f64,
    #[serde(default)]
    reference: ReferencePoses,
    terms: String,
    citation: String,
    member: Option<String>,
    sensor: Option<SensorKeys>,
    facts: Option<Facts>,
    #[serde(default, rename = "copy")]
    copies: Vec<KnownCopy>,
}

impl Dataset {
    /// Parses the text of a `dataset.toml`; `name` is that of its folder.
    ///
    /// # Errors
    /// [`DefinitionError`] with the line or the key that is wrong, unknown or missing.
    pub fn parse(name: &str, text: &str) -> Result<Dataset, DefinitionError> {
        toml::from_str::<Definition>(text)?.check(name)
    }
}

impl Definition {
    fn check(self, name: &str) -> Result<Dataset, DefinitionError> {
        if !is_plain_name(name) {
            return Err(DefinitionError::Value {
                key: "folder",
                found: format!("{name:?}"),
                expected: PLAIN_NAME,
            });
        }
        if !(self.max_range.is_finite() && self.max_range > 0.0) {
            return Err(DefinitionError::Value {
                key: "max_range",
                found: self.max_range.to_string(),
                expected: "a positive number of metres",
            });
        }
        let format = self.format.name();
        let kind = match self.format {
            Format::Cloud | Format::SimulatedCloud => DatasetKind::Cloud,
            _ => DatasetKind::Scans,
        };
        let (PoseKeys { x, y, theta }, no_deskew) = match (kind, self.sensor) {
            (DatasetKind::Scans, None) => {
                return Err(DefinitionError::MissingKey { key: "sensor", format });
            }
            (DatasetKind::Cloud, Some(_)) => {
                return Err(DefinitionError::UselessKey { key: "sensor", format });
            }
            (_, Some(SensorKeys { robot_from_laser, no_deskew })) => (robot_from_laser, no_deskew),
            (_, None) => (PoseKeys { x: 0.0, y: 0.0, theta: 0.0 }, false),
        };
        let robot_from_laser = Pose2::new(x, y, theta);
        if !robot_from_laser.is_finite() {
            return Err(DefinitionError::Value {
                key: "sensor.robot_from_laser",
                found: format!("({x}, {y}, {theta})"),
                expected: "finite metres, metres and radians",
            });
        }
        let source = match self.format {
            Format::Carmen | Format::Mcap | Format::Cloud => {
                refuse(self.seed.is_some(), "seed", format)?;
                let name = self.file.ok_or(DefinitionError::MissingKey { key: "file", format })?;
                let file = log_file(format, name, self.other_names, self.urls, self.copies)?;
                Origin::File(LogFile { member: self.member, ..file })
            }
            Format::Simulated | Format::SimulatedCloud => {
                refuse(self.file.is_some(), "file", format)?;
                refuse(!self.other_names.is_empty(), "other_names", format)?;
                refuse(!self.urls.is_empty(), "urls", format)?;
                refuse(self.member.is_some(), "member", format)?;
                refuse(!self.copies.is_empty(), "copy", format)?;
                let seed = self.seed.ok_or(DefinitionError::MissingKey { key: "seed", format })?;
                Origin::Simulated { seed }
            }
        };
        Ok(Dataset {
            name: name.to_owned(),
            title: self.title,
            description: self.description.trim().to_owned(),
            kind,
            source,
            max_range: self.max_range,
            robot_from_laser,
            no_deskew,
            reference: self.reference,
            facts: self.facts,
            terms: self.terms.trim().to_owned(),
            citation: self.citation.trim().to_owned(),
        })
    }
}

fn refuse(given: bool, key: &'static str, format: &'static str) -> Result<(), DefinitionError> {
    if given { Err(DefinitionError::UselessKey { key, format }) } else { Ok(()) }
}

fn log_file(
    format: &'static str,
    name: String,
    other_names: Vec<String>,
    urls: Vec<String>,
    copies: Vec<KnownCopy>,
) -> Result<LogFile, DefinitionError> {
    if name.ends_with(".gz") {
        return Err(DefinitionError::Value {
            key: "file",
            found: format!("{name:?}"),
            expected: "the name of the unpacked file, without `.gz`",
        });
    }
    for (key, name) in
        std::iter::once(("file", &name)).chain(other_names.iter().map(|name| ("other_names", name)))
    {
        if !is_plain_name(name) || name == DEFINITION_FILE {
            return Err(DefinitionError::Value {
                key,
                found: format!("{name:?}"),
                expected: PLAIN_NAME,
            });
        }
    }
    if let Some(url) =
        urls.iter().find(|url| !url.starts_with("http://") && !url.starts_with("https://"))
    {
        return Err(DefinitionError::Value {
            key: "urls",
            found: format!("{url:?}"),
            expected: "an address that begins with `http://` or `https://`",
        });
    }
    if !urls.is_empty() && copies.is_empty() {
        // Without a digest, any answer of a server would be accepted.
        return Err(DefinitionError::MissingKey { key: "copy", format });
    }
    Ok(LogFile { name, other_names, urls, member: None, copies })
}

const PLAIN_NAME: &str = "a file name without a path and not beginning with a dot";

/// Whether a name, joined to a folder, stays in it on any system: names of data sets and their files are read
/// from files.
pub fn is_plain_name(name: &str) -> bool {
    !name.is_empty() && !name.starts_with('.') && !name.contains(['/', '\\', ':', '\0'])
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINIMAL: &str = r#"
        title = "Lab"
        description = "A lab."
        format = "carmen"
        file = "lab.log"
        urls = ["http://example.org/lab.log.gz"]
        max_range = 10
        terms = "CC BY"
        citation = "Somebody"
        [sensor]
        robot_from_laser = { x = 0.1, y = 0, theta = 0 }
        [[copy]]
        sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        bytes = 3
    "#;

    #[test]
    fn a_minimal_definition_has_defaults() {
        let dataset = Dataset::parse("lab", MINIMAL).unwrap();
        assert_eq!(dataset.name, "lab");
        assert_eq!(dataset.reference, ReferencePoses::Auto);
        assert_eq!(dataset.facts, None);
        assert_eq!(dataset.robot_from_laser, Pose2::new(0.1, 0.0, 0.0));
        let file = dataset.log_file().unwrap();
        assert_eq!(file.copies[0].bytes, 3);
        assert_eq!(file.copies[0].note, None);
    }

    #[test]
    fn every_wrong_definition_says_which_key_is_wrong() {
        for (from, to, expected) in [
            ("terms =", "licence =", "unknown field `licence`"),
            ("bytes = 3", "size = 3", "unknown field `size`"),
            ("y = 0,", "y = 0, z = 0,", "unknown field `z`"),
            ("bytes = 3", "bytes = -3", "line 14"),
            ("sha256 = \"ba", "sha256 = \"", "64 hexadecimal digits"),
            ("max_range = 10", "max_range = 0", "`max_range` is 0"),
            ("max_range = 10", "max_range = nan", "`max_range` is NaN"),
            ("x = 0.1", "x = inf", "`sensor.robot_from_laser`"),
            ("file = \"lab.log\"", "", "no key `file`"),
            ("file = \"lab.log\"", "file = \"../lab.log\"", "`file` is \"../lab.log\""),
            ("file = \"lab.log\"", "file = \"/lab.log\"", "`file` is \"/lab.log\""),
            ("file = \"lab.log\"", "file = '..\\lab.log'", "`file` is \"..\\\\lab.log\""),
            ("file = \"lab.log\"", "file = \"C:lab.log\"", "`file` is \"C:lab.log\""),
            ("file = \"lab.log\"", "file = \"lab\\u0000.log\"", "`file` is \"lab\\0.log\""),
            ("file = \"lab.log\"", "file = \"dataset.toml\"", "`file` is \"dataset.toml\""),
            ("file = \"lab.log\"", "file = \"lab.log.gz\"", "without `.gz`"),
            ("file =", "other_names = [\"a/b\"]\nfile =", "`other_names` is \"a/b\""),
            ("file =", "seed = 1\nfile =", "key `seed` has no meaning"),
            ("http://", "file:///", "`urls` is \"file:///example.org/lab.log.gz\""),
            ("http://", "ftp://", "`urls` is \"ftp://example.org/lab.log.gz\""),
            ("format = \"carmen\"", "format = \"bag\"", "unknown variant `bag`"),
            ("format = \"carmen\"", "format = \"simulated\"", "key `file` has no meaning"),
            ("format = \"carmen\"", "format = \"cloud\"", "key `sensor` has no meaning"),
        ] {
            let text = MINIMAL.replace(from, to);
            assert_ne!(text, MINIMAL, "{from}");
            let message = Dataset::parse("lab", &text).unwrap_err().to_string();
            assert!(message.contains(expected), "{to}: {message}");
        }
        let (without_copy, _) = MINIMAL.split_once("[[copy]]").unwrap();
        let error = Dataset::parse("lab", without_copy).unwrap_err();
        assert_eq!(error, DefinitionError::MissingKey { key: "copy", format: "carmen" });
        for name in ["", "..", "a/b", ".hidden"] {
            assert!(Dataset::parse(name, MINIMAL).is_err(), "{name}");
        }
    }
}

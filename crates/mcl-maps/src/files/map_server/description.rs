//! The YAML file of a grid map.

use std::collections::BTreeMap;
use std::path::{Component, Path};

use serde::Deserialize;

use crate::files::MapProblem;

/// How pixel values are interpreted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Trinary,
    Scale,
    Raw,
}

const MODES: [(&str, Mode); 3] =
    [("trinary", Mode::Trinary), ("scale", Mode::Scale), ("raw", Mode::Raw)];

/// The fields of the YAML file that map_server uses; others are ignored.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Description {
    /// Name of the image, relative to the folder of the description.
    pub image: String,
    /// The original path, if it leads out of the folder; `image` is then only its file name.
    pub elsewhere: Option<String>,
    /// Metres per pixel.
    pub resolution: f64,
    /// x, y (metres) and yaw (radians) of the lower left corner of the image.
    pub origin: [f64; 3],
    pub negate: bool,
    pub occupied_threshold: f64,
    pub free_threshold: f64,
    pub mode: Mode,
}

/// A YAML value.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Value {
    Truth(bool),
    Number(f64),
    Text(String),
    List(Vec<Value>),
    Other(serde::de::IgnoredAny),
}

impl Value {
    fn described(&self) -> String {
        match self {
            Value::Truth(truth) => truth.to_string(),
            Value::Number(number) => number.to_string(),
            Value::Text(text) => {
                let start: String = text.chars().take(60).collect();
                if start.len() < text.len() { format!("{start:?}…") } else { format!("{text:?}") }
            }
            Value::List(list) if list.len() <= 4 => {
                let parts: Vec<String> = list.iter().map(Value::described).collect();
                format!("[{}]", parts.join(", "))
            }
            Value::List(list) => format!("a list of {}", list.len()),
            Value::Other(_) => "nothing, or a nested value".to_owned(),
        }
    }
}

impl Description {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, MapProblem> {
        let text = std::str::from_utf8(bytes).map_err(|error| {
            MapProblem::syntax(format!(
                "byte {} is not UTF-8 text, expected a YAML file",
                error.valid_up_to()
            ))
        })?;
        let fields: BTreeMap<String, Value> = serde_saphyr::from_str(text).map_err(|error| {
            let message = error.to_string();
            let reason = message.lines().next().unwrap_or_default();
            MapProblem::syntax(format!("not YAML with lines of \"field: value\": {reason}"))
        })?;
        let fields = RawFields(fields);
        let (image, elsewhere) = fields.image()?;
        let description = Description {
            image,
            elsewhere,
            resolution: fields.number("resolution", METRES, |value| value > 0.0)?,
            origin: fields.origin()?,
            negate: fields.truth("negate")?,
            occupied_threshold: fields.probability("occupied_thresh")?,
            free_threshold: fields.probability("free_thresh")?,
            mode: fields.mode()?,
        };
        if description.free_threshold > description.occupied_threshold {
            let found = format!(
                "{} with occupied_thresh {}",
                description.free_threshold, description.occupied_threshold
            );
            let expected = "at most occupied_thresh";
            return Err(MapProblem::field("free_thresh", found, expected));
        }
        Ok(description)
    }

    /// Writes the text of the file.
    pub(super) fn text(&self) -> String {
        let Description { resolution, origin: [x, y, yaw], .. } = self;
        let mode = MODES.iter().find(|(_, mode)| *mode == self.mode).map_or("", |(name, _)| name);
        format!(
            "image: {}\nmode: {mode}\nresolution: {}\norigin: [{}, {}, {}]\nnegate: {}\n\
             occupied_thresh: {}\nfree_thresh: {}\n",
            quoted(&self.image),
            number(*resolution),
            number(*x),
            number(*y),
            number(*yaw),
            u8::from(self.negate),
            self.occupied_threshold,
            self.free_threshold
        )
    }
}

/// Formats a number so that every YAML parser reads a float, with the fewest digits that parse to the same bits.
fn number(value: f64) -> String {
    format!("{value:?}")
}

/// Writes a text plainly if that is safe in YAML, otherwise in double quotes.
fn quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if text.starts_with(|c: char| c.is_ascii_alphabetic()) && text.chars().all(is_plain) {
        return text.to_owned();
    }
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted += &format!("\\u{:04X}", u32::from(c)),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

const METRES: &str = "a positive number of metres per pixel";

/// The fields of the file by name, before they are checked.
struct RawFields(BTreeMap<String, Value>);

impl RawFields {
    fn get(&self, name: &'static str, expected: &'static str) -> Result<&Value, MapProblem> {
        self.0.get(name).ok_or_else(|| {
            let names: Vec<&str> = self.0.keys().map(String::as_str).take(12).collect();
            let found = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            MapProblem::MissingField { field: name, found, expected }
        })
    }

    fn number(
        &self,
        name: &'static str,
        expected: &'static str,
        is_valid: impl Fn(f64) -> bool,
    ) -> Result<f64, MapProblem> {
        let value = self.get(name, expected)?;
        finite(value)
            .filter(|&number| is_valid(number))
            .ok_or_else(|| MapProblem::field(name, value.described(), expected))
    }

    fn probability(&self, name: &'static str) -> Result<f64, MapProblem> {
        self.number(name, "a probability from 0 to 1", |value| (0.0..=1.0).contains(&value))
    }

    fn truth(&self, name: &'static str) -> Result<bool, MapProblem> {
        let expected = "0 or 1";
        match self.get(name, expected)? {
            Value::Truth(truth) => Ok(*truth),
            Value::Number(0.0) => Ok(false),
            Value::Number(1.0) => Ok(true),
            other => Err(MapProblem::field(name, other.described(), expected)),
        }
    }

    fn origin(&self) -> Result<[f64; 3], MapProblem> {
        let expected = "[x, y, yaw] of the lower left corner, in metres and radians";
        let value = self.get("origin", expected)?;
        let is_nan = |value: &Value| match value {
            Value::Number(number) => number.is_nan(),
            Value::Text(text) => {
                text.trim_start_matches(['-', '+', '.']).eq_ignore_ascii_case("nan")
            }
            _ => false,
        };
        if let Value::List(list) = value
            && list.iter().any(is_nan)
        {
            let expected =
                "numbers; some map savers write -nan for a yaw of 0: write 0 in its place";
            return Err(MapProblem::field("origin", value.described(), expected));
        }
        let numbers = match value {
            Value::List(list) => list.iter().map(finite).collect::<Option<Vec<f64>>>(),
            _ => None,
        };
        numbers
            .and_then(|numbers| <[f64; 3]>::try_from(numbers).ok())
            .ok_or_else(|| MapProblem::field("origin", value.described(), expected))
    }

    fn mode(&self) -> Result<Mode, MapProblem> {
        let Some(value) = self.0.get("mode") else { return Ok(Mode::Trinary) };
        let known = |text: &str| MODES.iter().find(|(name, _)| *name == text);
        match value {
            Value::Text(text) if known(text).is_some() => {
                Ok(known(text).map_or(Mode::Trinary, |(_, mode)| *mode))
            }
            _ => Err(MapProblem::field("mode", value.described(), "trinary, scale or raw")),
        }
    }

    /// The name of the image, and the original path if it leads out of the folder. A map may come from an untrusted
    /// source and must not make the program read other files. Map savers often write absolute paths; the file of that
    /// name beside the description is then used.
    fn image(&self) -> Result<(String, Option<String>), MapProblem> {
        let expected = "the name of the image file, within the folder of the .yaml file";
        let value = self.get("image", expected)?;
        let Value::Text(path) = value else {
            return Err(MapProblem::field("image", value.described(), expected));
        };
        // Backslashes separate path components on Windows, and are part of file names elsewhere.
        let is_windows = matches!(path.as_bytes(), [drive, b':', b'\\' | b'/', ..] if drive.is_ascii_alphabetic());
        let is_separator = |c: char| c == '/' || is_windows && c == '\\';
        let name = path.rsplit(is_separator).next().unwrap_or_default();
        let mut parts = Path::new(path).components();
        let stays = parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if matches!(name, "" | "." | "..") {
            return Err(MapProblem::field("image", value.described(), expected));
        }
        Ok(match stays && !is_windows {
            true => (path.clone(), None),
            false => (name.to_owned(), Some(path.clone())),
        })
    }
}

fn finite(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => Some(*number),
        // Such as "5e-2", which is text in YAML 1.1.
        Value::Text(text) => text.trim().parse().ok(),
        _ => None,
    }
    .filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const OLIN: &str = "image: floor.pgm\nmode: trinary\nresolution: 0.03\norigin: [-1.12, -39.4, 0]\n\
        negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25";

    fn message(text: &str) -> String {
        Description::parse(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn fields_as_map_saver_writes_them() {
        let found = Description::parse(OLIN.as_bytes()).unwrap();
        let expected = Description {
            image: "floor.pgm".into(),
            elsewhere: None,
            resolution: 0.03,
            origin: [-1.12, -39.4, 0.0],
            negate: false,
            occupied_threshold: 0.65,
            free_threshold: 0.25,
            mode: Mode::Trinary,
        };
        assert_eq!(found, expected);
        // Nested origin, no mode, true for 1, further keys, a comment.
        let text = "# a map\nimage: \"a b/floor.png\"\nresolution: 5e-2\norigin:\n- 1\n- 2.5\n- -0.1\n\
            negate: true\noccupied_thresh: 1\nfree_thresh: 0\nrobot: {name: none}\nempty:\n";
        let found = Description::parse(text.as_bytes()).unwrap();
        assert_eq!((found.image.as_str(), found.resolution), ("a b/floor.png", 0.05));
        assert_eq!((found.origin, found.negate), ([1.0, 2.5, -0.1], true));
    }

    #[test]
    fn what_is_written_reads_back() {
        let mut description = Description::parse(OLIN.as_bytes()).unwrap();
        for name in ["floor.pgm", "1.pgm", "a b: #\"\\ é.pgm", "-.pgm", "tab\t.pgm"] {
            description.image = name.into();
            description.resolution = 0.1 + 0.2;
            description.origin = [1e-7, -1e9, 3.0_f64.sqrt()];
            let text = description.text();
            assert_eq!(Description::parse(text.as_bytes()).unwrap(), description, "{text}");
        }
    }

    #[test]
    fn only_the_name_of_a_path_out_of_the_folder_is_used() {
        let parsed = |image: &str| {
            let found = Description::parse(OLIN.replace("floor.pgm", image).as_bytes()).unwrap();
            (found.image, found.elsewhere)
        };
        for path in
            ["/home/robot/floor.pgm", "../floor.pgm", "a/../../floor.pgm", "'C:\\maps\\floor.pgm'"]
        {
            let named = Some(path.trim_matches('\'').to_owned());
            assert_eq!(parsed(path), ("floor.pgm".to_owned(), named));
        }
        assert_eq!(parsed("./floor.pgm"), ("./floor.pgm".to_owned(), None));
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (from, to, expected) in [
            ("image: floor.pgm\n", "", "no field \"image\", found free_thresh, mode, negate"),
            ("floor.pgm", "..", "field \"image\": found \"..\", expected the name"),
            ("[-1.12, -39.4, 0]", "[-1.12, -39.4, -nan]", "write -nan for a yaw of 0: write 0"),
            ("floor.pgm", "[1]", "field \"image\": found [1], expected the name"),
            ("0.03", "-0.03", "field \"resolution\": found -0.03, expected a positive number"),
            ("0.03", ".nan", "line 3 column 13: non-finite float"),
            ("0.03", "fine", "field \"resolution\": found \"fine\""),
            ("[-1.12, -39.4, 0]", "[-1.12, -39.4]", "field \"origin\": found [-1.12, -39.4]"),
            ("[-1.12, -39.4, 0]", "[0, 0, .inf]", "line 4 column 16: non-finite float"),
            ("negate: 0", "negate: 2", "field \"negate\": found 2, expected 0 or 1"),
            ("0.65", "1.5", "field \"occupied_thresh\": found 1.5, expected a probability"),
            ("0.25", "0.7", "field \"free_thresh\": found 0.7 with occupied_thresh 0.65"),
            (
                "trinary",
                "binary",
                "field \"mode\": found \"binary\", expected trinary, scale or raw",
            ),
            ("mode: trinary", "mode:", "field \"mode\": found nothing"),
        ] {
            let message = message(&OLIN.replacen(from, to, 1));
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn text_that_is_not_a_description_is_refused() {
        let twice = format!("{OLIN}\nnegate: 1\n");
        for text in ["", "x,y\n1,2\n", "- a\n- b\n", "image: [\n", "\u{0}\u{1}", &twice] {
            let message = message(text);
            assert!(!message.contains('\n') && message.len() < 300, "{text:?}: {message}");
        }
        assert!(Description::parse(b"image: \xff").is_err());
        // Nested aliases that would expand without limit.
        let bomb = "a: &a [1,1,1,1,1,1,1,1,1]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\n\
            c: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\nd: &d [*c,*c,*c,*c,*c,*c,*c,*c,*c]\n\
            e: &e [*d,*d,*d,*d,*d,*d,*d,*d,*d]\nf: &f [*e,*e,*e,*e,*e,*e,*e,*e,*e]\n\
            g: [*f,*f,*f,*f,*f,*f,*f,*f,*f]\n";
        assert!(Description::parse(bomb.as_bytes()).is_err());
    }
}

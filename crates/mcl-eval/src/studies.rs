//! The studies compiled into the program, so that `mcl-eval run likelihood` works in any folder: those of the
//! repository's `experiments/` and of the examples there.

use std::path::{MAIN_SEPARATOR, Path};

use anyhow::{Context, Result, bail};
use mcl_study::study::definition::Study;
use strsim::damerau_levenshtein;

include!(concat!(env!("OUT_DIR"), "/studies.rs"));

/// A built-in study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuiltIn {
    /// Its name: that of its file, without the ending.
    pub name: &'static str,
    /// The text of its file.
    pub text: &'static str,
}

impl BuiltIn {
    /// Its title: the first sentence of the comment at the top of its file.
    pub fn title(&self) -> String {
        let lines = self.text.lines().map_while(|line| line.strip_prefix('#'));
        let comment = lines.map(str::trim).collect::<Vec<_>>().join(" ");
        let mut ends = comment.match_indices(['.', '?']).map(|(at, _)| at + 1);
        // A dot within a word, as in a file name, does not end the sentence.
        let end = ends.find(|&end| comment[end..].is_empty() || comment[end..].starts_with(' '));
        comment[..end.unwrap_or(comment.len())].to_owned()
    }
}

/// The built-in studies, sorted by name.
pub fn built_in() -> &'static [BuiltIn] {
    BUILT_IN
}

/// A list of the built-in studies with their titles, for help texts.
pub(crate) fn listed() -> String {
    let lines = BUILT_IN.iter().map(|study| format!("\n{}: {}", study.name, study.title()));
    format!("Built-in studies, taken by name:{}", lines.collect::<String>())
}

/// Reads and checks a study: the file at `path`, or, where `path` is a plain name and no such file exists,
/// the built-in study of this name.
///
/// # Errors
/// As [`Study::read`]; for a name that is neither a file nor a built-in study; for a built-in study that
/// reads files beside it in the repository.
pub fn read(path: &Path) -> Result<Study> {
    let name = path.to_str().filter(|name| {
        !name.contains(['/', MAIN_SEPARATOR]) && !name.ends_with(".toml") && !path.exists()
    });
    let Some(name) = name else {
        if path.is_dir() {
            bail!("{} is a folder, expected the file of a study", path.display());
        }
        return Study::read(path);
    };
    let Some(BuiltIn { text, .. }) = BUILT_IN.iter().find(|study| study.name == name) else {
        let known: Vec<&str> = BUILT_IN.iter().map(|study| study.name).collect();
        let nearest = known.iter().min_by_key(|known| damerau_levenshtein(name, known));
        let nearest = nearest.filter(|known| 2 * damerau_levenshtein(name, known) < known.len());
        let meant = nearest.map_or(".".to_owned(), |known| format!("; did you mean {known}?"));
        bail!(
            "{name:?} is neither a file nor a built-in study{meant} Built in are: {}",
            known.join(", ")
        );
    };
    let study = Study::parse(text).with_context(|| format!("in the built-in study {name}"))?;
    let mut files = study.programs().iter().flat_map(|program| &program.files);
    if let Some((file, _)) = files.next() {
        bail!(
            "the built-in study {name} runs programs with files that lie beside it, such as {file}: run \
             experiments/{name}.toml in the repository"
        );
    }
    Ok(study)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_study_says_what_it_is_about_in_a_sentence() {
        for study in built_in() {
            let title = study.title();
            assert!(title.len() > 30 && title.len() < 300, "{}: {title}", study.name);
        }
        let find = |name: &str| built_in().iter().find(|study| study.name == name).unwrap().title();
        assert_eq!(find("global"), "How small may a map be to find oneself on it?");
        assert!(find("choices-grid").starts_with("choices.toml for plain grid-based maps"));
    }
}

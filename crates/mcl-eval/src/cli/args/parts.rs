use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use mcl_study::share::Part;

use super::{StudyArgs, positive};

/// Variables that array jobs set, and the number of their first task.
const ARRAYS: [(&str, usize); 4] = [
    ("SLURM_ARRAY_TASK_ID", 1),
    ("JOB_COMPLETION_INDEX", 0),
    ("AWS_BATCH_JOB_ARRAY_INDEX", 0),
    ("BATCH_TASK_INDEX", 0),
];

/// A part of a study, from 1; without a number that of an array job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartOf {
    number: Option<usize>,
    of: usize,
}

impl FromStr for PartOf {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let expected = "expected I/N, as 3/8, or array/N";
        let (number, of) = text.split_once('/').ok_or(expected)?;
        let of = of.parse().map_err(|_| expected.to_owned())?;
        let number = match number {
            "array" => None,
            number => Some(number.parse().map_err(|_| expected.to_owned())?),
        };
        Part::new(number.unwrap_or(1), of)?;
        Ok(PartOf { number, of })
    }
}

impl PartOf {
    /// The part, with its number from the environment where it is that of an array job.
    ///
    /// # Errors
    /// When none or several of the variables are set, or one holds no number of a part.
    pub fn part(self, variable: impl Fn(&str) -> Option<String>) -> Result<Part, String> {
        if let Some(number) = self.number {
            return Part::new(number, self.of);
        }
        let set: Vec<(&str, usize, String)> = ARRAYS
            .iter()
            .filter_map(|&(name, first)| Some((name, first, variable(name)?)))
            .collect();
        let names = || ARRAYS.map(|(name, _)| name).join(", ");
        let (name, first, value) = match set.as_slice() {
            [only] => only,
            [] => {
                return Err(format!(
                    "--part array/{}: none of {} is set; expected to run in an array job",
                    self.of,
                    names()
                ));
            }
            several => {
                let set: Vec<&str> = several.iter().map(|(name, ..)| *name).collect();
                return Err(format!(
                    "--part array/{}: {} are set, expected one; give the part as I/{}",
                    self.of,
                    set.join(" and "),
                    self.of
                ));
            }
        };
        let range = *first..*first + self.of;
        match value.parse() {
            Ok(task) if range.contains(&task) => Part::new(task - first + 1, self.of),
            _ => Err(format!(
                "{name} is {value:?}, expected a number from {} to {}: one task of the array for each of the {} parts",
                range.start,
                range.end - 1,
                self.of
            )),
        }
    }
}

/// What starts parts of a study on several machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// An array job, with the merge behind it.
    Slurm,
    /// GNU parallel over machines that share a file system.
    Parallel,
    /// An Indexed Job.
    Kubernetes,
}

#[derive(Debug, Args)]
pub struct PlanArgs {
    #[command(flatten)]
    pub of: StudyArgs,
    /// Number of parts.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub parts: u32,
    /// Print the script that starts the parts with this, and the merge behind them.
    #[arg(long, value_name = "ENGINE")]
    pub engine: Option<Engine>,
    /// The options of the study as they were given, except data sets and folder: the parts need them, too.
    #[arg(skip)]
    pub given: Vec<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Folder that holds <study>/<data set>/.
    #[arg(value_name = "ROOT", default_value = "results")]
    pub root: PathBuf,
    /// Report again every so many seconds, until all is done.
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = "10", value_parser = positive)]
    pub watch: Option<f64>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_given_or_those_of_an_array_job() {
        let part = |text: &str, set: &[(&str, &str)]| -> Result<String, String> {
            let found = text.parse::<PartOf>()?.part(|name| {
                set.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
            });
            found.map(|part| part.to_string())
        };
        assert_eq!(part("3/8", &[]).unwrap(), "part 3 of 8");
        assert_eq!(part("3/8", &[("SLURM_ARRAY_TASK_ID", "5")]).unwrap(), "part 3 of 8");
        assert_eq!(part("array/8", &[("SLURM_ARRAY_TASK_ID", "8")]).unwrap(), "part 8 of 8");
        for name in ["JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX", "BATCH_TASK_INDEX"] {
            assert_eq!(part("array/8", &[(name, "0")]).unwrap(), "part 1 of 8");
            assert!(part("array/8", &[(name, "8")]).unwrap_err().contains("from 0 to 7"));
        }
        assert!(
            part("array/8", &[("SLURM_ARRAY_TASK_ID", "0")]).unwrap_err().contains("from 1 to 8")
        );
        assert!(part("array/8", &[]).unwrap_err().contains("none of SLURM_ARRAY_TASK_ID"));
        let two = [("SLURM_ARRAY_TASK_ID", "1"), ("BATCH_TASK_INDEX", "0")];
        assert!(part("array/8", &two).unwrap_err().contains("expected one"));
        for text in ["", "3", "0/8", "9/8", "x/8", "3/x", "array", "1/0"] {
            assert!(text.parse::<PartOf>().is_err(), "{text}");
        }
    }
}

use std::fmt::{self, Display};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::words::NumberOrWord;

/// The number of particles: fixed (`500`), or determined by KLD sampling within a range (`"100..20000"`), starting
/// with the maximum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "NumberOrWord<usize>", into = "NumberOrWord<usize>")]
pub struct ParticleNumber {
    /// Smallest number of particles.
    pub least: usize,
    /// Largest number of particles, used at the start.
    pub most: usize,
}

impl ParticleNumber {
    pub(crate) const EXPECTED: &str =
        "a number of particles from 1 to 10,000,000, or a range of them, such as 100..20000";

    /// Whether the number is fixed.
    pub fn is_fixed(&self) -> bool {
        self.least == self.most
    }
}

impl From<usize> for ParticleNumber {
    fn from(number: usize) -> Self {
        ParticleNumber { least: number, most: number }
    }
}

impl FromStr for ParticleNumber {
    type Err = FilterError;

    /// Parses `500` or `100..20000`.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let number = |number: &str| {
            number.parse().map_err(|_| FilterError::Parse {
                field: "particles",
                found: text.into(),
                expected: Self::EXPECTED,
            })
        };
        Ok(match text.split_once("..") {
            Some((least, most)) => ParticleNumber { least: number(least)?, most: number(most)? },
            None => number(text)?.into(),
        })
    }
}

impl Display for ParticleNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.is_fixed() {
            true => write!(f, "{}", self.most),
            false => write!(f, "{}..{}", self.least, self.most),
        }
    }
}

impl TryFrom<NumberOrWord<usize>> for ParticleNumber {
    type Error = FilterError;

    fn try_from(written: NumberOrWord<usize>) -> Result<Self, FilterError> {
        match written {
            NumberOrWord::Number(number) => Ok(number.into()),
            NumberOrWord::Word(text) => text.parse(),
        }
    }
}

impl From<ParticleNumber> for NumberOrWord<usize> {
    fn from(number: ParticleNumber) -> Self {
        match number.is_fixed() {
            true => NumberOrWord::Number(number.most),
            false => NumberOrWord::Word(number.to_string()),
        }
    }
}

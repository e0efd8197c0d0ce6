use std::fmt::{self, Display};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::words::NumberOrWord;

/// The beams of a scan to use, before those without a usable reading are dropped.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "NumberOrWord<usize>", into = "NumberOrWord<usize>")]
pub enum Beams {
    /// Every beam (`"all"`).
    All,
    /// This many beams, evenly spread over the scan (a number); all if the scan has no more.
    Spread(usize),
    /// As many beams as the scan's field of view has steps of this many degrees (`"3deg"`), evenly
    /// spread; all if the scan has no more.
    Degrees(f64),
}

impl TryFrom<NumberOrWord<usize>> for Beams {
    type Error = FilterError;

    fn try_from(text: NumberOrWord<usize>) -> Result<Self, FilterError> {
        match text {
            NumberOrWord::Number(number) => Ok(Beams::Spread(number)),
            NumberOrWord::Word(word) => word.parse(),
        }
    }
}

impl From<Beams> for NumberOrWord<usize> {
    fn from(beams: Beams) -> Self {
        match beams {
            Beams::Spread(number) => NumberOrWord::Number(number),
            word => NumberOrWord::Word(word.to_string()),
        }
    }
}

impl Beams {
    pub(crate) const EXPECTED: &str =
        "\"all\", a number of beams, at least 1, or degrees from one to the next, such as 3deg";

    /// Whether at least one beam is selected.
    pub(crate) fn is_some(&self) -> bool {
        match *self {
            Beams::All => true,
            Beams::Spread(number) => number > 0,
            Beams::Degrees(degrees) => degrees > 0.0 && degrees.is_finite(),
        }
    }
}

impl FromStr for Beams {
    type Err = FilterError;

    /// Parses `all`, a number of beams, or the angle between beams in degrees: `3deg`.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let error =
            || FilterError::Parse { field: "beams", found: text.into(), expected: Beams::EXPECTED };
        let beams = match text.strip_suffix("deg") {
            _ if text == "all" => Beams::All,
            Some(degrees) => Beams::Degrees(degrees.parse().map_err(|_| error())?),
            None => Beams::Spread(text.parse().map_err(|_| error())?),
        };
        if beams.is_some() { Ok(beams) } else { Err(error()) }
    }
}

impl Display for Beams {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Beams::All => f.write_str("all"),
            Beams::Spread(number) => write!(f, "{number}"),
            Beams::Degrees(degrees) => write!(f, "{degrees}deg"),
        }
    }
}

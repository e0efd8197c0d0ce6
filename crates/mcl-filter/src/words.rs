//! Serialization of settings as words, and as numbers or words.

use serde::{Deserialize, Serialize};

/// A number, or a word in its place.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum NumberOrWord<N> {
    Number(N),
    Word(String),
}

/// Implements parsing and display of a setting by the words from `ALL` and `name`. Arguments: the type, the name of
/// the setting, and what is expected.
macro_rules! words {
    ($kind:ident, $field:literal, $expected:literal) => {
        impl std::str::FromStr for $kind {
            type Err = crate::FilterError;

            fn from_str(text: &str) -> Result<Self, crate::FilterError> {
                $kind::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| {
                    crate::FilterError::Parse {
                        field: $field,
                        found: text.into(),
                        expected: $expected,
                    }
                })
            }
        }

        impl std::fmt::Display for $kind {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}
pub(crate) use words;

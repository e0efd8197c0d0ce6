//! Recipes: how a map is built, and how a robot is localized on it.
//!
//! A recipe contains everything that its result depends on, apart from the content of the data and the build
//! of the program. The same recipe gives the same map or run, bit for bit, in every study, on the command
//! line and on every machine: its identity seeds its random draws.

pub mod criterion;
pub mod disturbance;
pub mod kind;
pub mod localizer;
pub mod map;
pub mod run;
pub mod split;

use serde::Serialize;
use sha2::{Digest, Sha256};

/// The identity of the result of a recipe (or several): the [digest] of its JSON.
///
/// # Errors
/// When it cannot be written as JSON.
pub fn identity(recipe: &impl Serialize) -> anyhow::Result<String> {
    Ok(digest(&serde_json::to_vec(recipe)?))
}

/// The first 16 hexadecimal digits of the SHA-256.
pub fn digest(bytes: &[u8]) -> String {
    let digits =
        |byte: &u8| [byte >> 4, byte & 15].map(|digit| b"0123456789abcdef"[usize::from(digit)]);
    let digest = Sha256::digest(bytes);
    digest.iter().take(DIGITS / 2).flat_map(digits).map(char::from).collect()
}

/// Number of digits of a [digest].
pub const DIGITS: usize = 16;

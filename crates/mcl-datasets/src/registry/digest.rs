use std::fmt;
use std::str::FromStr;

use serde::Deserialize;

/// A SHA-256 digest, written as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(try_from = "String")]
pub struct Sha256Digest(pub [u8; 32]);

/// Why a text is not a SHA-256 digest.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{found}` is not a SHA-256 digest, expected 64 hexadecimal digits")]
pub struct ParseDigestError {
    /// The text found.
    pub found: String,
}

impl FromStr for Sha256Digest {
    type Err = ParseDigestError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let error = || ParseDigestError { found: text.to_owned() };
        // Digits only: `from_str_radix` would accept a sign, too.
        if text.len() != 64 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return Err(error());
        }
        let mut bytes = [0; 32];
        for (i, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(&text[2 * i..2 * i + 2], 16).map_err(|_| error())?;
        }
        Ok(Sha256Digest(bytes))
    }
}

impl TryFrom<String> for Sha256Digest {
    type Error = ParseDigestError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl fmt::Display for Sha256Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Sha256Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_read_back_and_anything_else_is_refused() {
        let text = "b066a0e3c62e69901540895017871835169d13c56a4cbb78f42599cf3563484f";
        assert_eq!(text.parse::<Sha256Digest>().unwrap().to_string(), text);
        assert_eq!(text.to_uppercase().parse::<Sha256Digest>().unwrap().to_string(), text);
        for wrong in ["", &text[1..], &format!("{text}0"), &text.replace("b0", "+0")] {
            assert!(wrong.parse::<Sha256Digest>().is_err(), "{wrong}");
        }
        // 64 bytes, but not 64 characters: a character must not be split.
        assert!("é".repeat(32).parse::<Sha256Digest>().is_err());
    }
}

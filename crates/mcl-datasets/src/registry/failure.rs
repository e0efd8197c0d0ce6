use std::io;

use ureq::http::StatusCode;

use super::{Content, FetchError, Sha256Digest, joined};

/// Why an address did not yield the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrlFailure {
    /// No connection, or no complete answer header.
    #[error("no answer: {0}")]
    NoAnswer(ureq::Error),
    /// The server refused.
    #[error("the server answered {0}, expected 200 OK")]
    Status(StatusCode),
    /// The server answered a request to resume with another range.
    #[error("the server answered a request for the rest of the file with range {found:?}")]
    Range {
        /// The `Content-Range` header found, empty when there is none.
        found: String,
    },
    /// The transfer broke off or stalled.
    #[error("the transfer broke off after {received} bytes{}: {reason}", of_total(*total))]
    Broken {
        /// Bytes available.
        received: u64,
        /// Size of the whole file, where the server states it.
        total: Option<u64>,
        /// The network error.
        reason: ureq::Error,
    },
    /// The answer ended without an error, but in the middle of a gzip stream.
    #[error("the answer ended after {received} bytes, within the gzip stream")]
    CutOff {
        /// Bytes available.
        received: u64,
    },
    /// The file is far larger than any known copy.
    #[error("the file is larger than {limit} bytes, expected at most {largest} (unpacked)")]
    TooLarge {
        /// The limit that was exceeded, compressed or decompressed.
        limit: u64,
        /// Size of the largest known copy.
        largest: u64,
    },
    /// The file begins like gzip, or should be an archive, but cannot be decompressed.
    #[error("the file is a broken gzip file or archive: {0}")]
    Gzip(io::Error),
    /// The archive lacks the file.
    #[error("the archive has no file {member:?}")]
    NoMember {
        /// Its path in the archive.
        member: String,
    },
    /// The bytes of an earlier attempt and those received now do not form a known copy.
    #[error(
        "the rest sent now does not match the bytes kept from an earlier attempt; \
         they are dropped, and the next attempt starts over"
    )]
    Unfit,
    /// The file is complete, but is not a known copy.
    #[error(
        "the file is not a known copy: sha256 {} of {} bytes (unpacked), expected {}",
        found.sha256, found.bytes, joined(expected)
    )]
    UnknownCopy {
        /// Digest and size of what was found.
        found: Content,
        /// Digests of the known copies.
        expected: Vec<Sha256Digest>,
    },
}

fn of_total(total: Option<u64>) -> String {
    total.map_or(String::new(), |total| format!(" of {total}"))
}

impl UrlFailure {
    /// Whether a retry of the same address may succeed.
    pub(super) fn is_worth_retrying(&self) -> bool {
        match self {
            UrlFailure::NoAnswer(error) => !matches!(
                error,
                ureq::Error::BadUri(_)
                    | ureq::Error::Http(_)
                    | ureq::Error::HostNotFound
                    | ureq::Error::TooManyRedirects
                    | ureq::Error::RedirectFailed
                    | ureq::Error::RequireHttpsOnly(_)
            ),
            UrlFailure::Status(status) => {
                status.is_server_error()
                    || matches!(
                        *status,
                        StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS
                    )
            }
            UrlFailure::Range { .. }
            | UrlFailure::Broken { .. }
            | UrlFailure::CutOff { .. }
            | UrlFailure::Unfit => true,
            UrlFailure::TooLarge { .. }
            | UrlFailure::Gzip(_)
            | UrlFailure::NoMember { .. }
            | UrlFailure::UnknownCopy { .. } => false,
        }
    }
}

/// Why a step of a fetch ended.
#[derive(Debug)]
pub(super) enum Stop {
    /// This address failed; another attempt or address may succeed.
    Url(UrlFailure),
    /// A failure that no other address could avoid.
    Fetch(FetchError),
}

impl From<UrlFailure> for Stop {
    fn from(failure: UrlFailure) -> Self {
        Stop::Url(failure)
    }
}

impl From<FetchError> for Stop {
    fn from(error: FetchError) -> Self {
        Stop::Fetch(error)
    }
}

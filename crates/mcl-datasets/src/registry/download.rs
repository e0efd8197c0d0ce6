//! One HTTP transfer into a part file, resuming an earlier one.

use std::io::{self, Read};
use std::time::Duration;

use ureq::http::{HeaderMap, StatusCode, header};

use super::UrlFailure;
use super::failure::Stop;
use super::part_file::PartFile;

/// Timeouts and retries of a download.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FetchSettings {
    /// Limit for resolving the host's name, and for connecting.
    pub connect_timeout: Duration,
    /// How long the server may send nothing before the transfer counts as broken.
    pub stall_timeout: Duration,
    /// Limit for one whole attempt: a server that sends a few bytes at a time never stalls.
    pub attempt_timeout: Duration,
    /// Attempts per address; each resumes the one before. At least one is made.
    pub attempts: u32,
    /// Pause before another attempt.
    pub retry_wait: Duration,
}

impl Default for FetchSettings {
    /// 10 s to connect, 15 s without a byte, 15 min per attempt; 3 attempts with 1 s between them.
    fn default() -> Self {
        FetchSettings {
            connect_timeout: Duration::from_secs(10),
            stall_timeout: Duration::from_secs(15),
            attempt_timeout: Duration::from_secs(15 * 60),
            attempts: 3,
            retry_wait: Duration::from_secs(1),
        }
    }
}

/// What a fetch is doing, for progress bars and messages.
#[derive(Debug)]
pub enum FetchEvent<'a> {
    /// An address is about to be requested.
    Connecting {
        /// The address.
        url: &'a str,
        /// Bytes available from an earlier attempt.
        kept: u64,
    },
    /// Bytes have arrived.
    Progress {
        /// Bytes available, including those of earlier attempts.
        downloaded: u64,
        /// Size of the whole file as sent (compressed), where the server states it.
        total: Option<u64>,
    },
    /// An attempt failed.
    Failed {
        /// The address.
        url: &'a str,
        /// What went wrong.
        failure: &'a UrlFailure,
        /// Whether the same address is tried again.
        retrying: bool,
    },
}

/// An answer that ended without an error.
pub(super) struct Received {
    /// Whether some of the bytes are those of an earlier attempt.
    pub(super) resumed: bool,
    /// Whether the server stated the length of the file, so that its end is known.
    pub(super) end_is_known: bool,
}

pub(super) fn agent(settings: &FetchSettings) -> ureq::Agent {
    ureq::Agent::config_builder()
        .http_status_as_error(false)
        .timeout_resolve(Some(settings.connect_timeout))
        .timeout_connect(Some(settings.connect_timeout))
        .timeout_per_read(Some(settings.stall_timeout))
        .timeout_per_write(Some(settings.stall_timeout))
        .timeout_global(Some(settings.attempt_timeout))
        // Offsets of a resumed transfer count bytes of the file itself.
        .accept_encoding("identity")
        .user_agent(concat!("mcl-eval/", env!("CARGO_PKG_VERSION")))
        .build()
        .into()
}

/// Whether only encrypted answers are accepted: a request by `https` must not be redirected to `http`. Any
/// other scheme is refused by the library.
fn is_encrypted(url: &str) -> bool {
    url.starts_with("https://")
}

/// Requests the file, or the rest that the part file lacks, and appends the answer to the part file; stops
/// when that grows beyond `limit` bytes. `largest` is the size of the largest known copy, for messages.
pub(super) fn receive(
    agent: &ureq::Agent,
    url: &str,
    part: &mut PartFile,
    limit: u64,
    largest: u64,
    report: &mut dyn FnMut(FetchEvent<'_>),
) -> Result<Received, Stop> {
    let kept = part.len();
    report(FetchEvent::Connecting { url, kept });
    let mut request = agent.get(url).config().https_only(is_encrypted(url)).build();
    if kept > 0 {
        request = request.header(header::RANGE, format!("bytes={kept}-"));
    }
    let mut response = request.call().map_err(UrlFailure::NoAnswer)?;

    let total = match response.status() {
        StatusCode::OK => {
            // The whole file, although only the rest was requested.
            part.clear()?;
            response.body().content_length()
        }
        StatusCode::PARTIAL_CONTENT if kept > 0 => match content_range(response.headers()) {
            ContentRange::From { first, total } if first == kept => total,
            _ => return Err(wrong_range(part, response.headers())),
        },
        StatusCode::RANGE_NOT_SATISFIABLE if kept > 0 => {
            return match content_range(response.headers()) {
                // The part file was complete already.
                ContentRange::Beyond { total } if total == kept => {
                    Ok(Received { resumed: true, end_is_known: true })
                }
                _ => Err(wrong_range(part, response.headers())),
            };
        }
        status => return Err(UrlFailure::Status(status).into()),
    };
    let too_large = UrlFailure::TooLarge { limit, largest };
    if total.is_some_and(|total| total > limit) {
        part.clear()?;
        return Err(too_large.into());
    }
    let resumed = part.len() > 0;
    report(FetchEvent::Progress { downloaded: part.len(), total });

    let mut body = response.body_mut().as_reader();
    let mut buffer = vec![0; 64 * 1024];
    loop {
        let read = match body.read(&mut buffer) {
            Ok(0) => break,
            Ok(read) => read,
            Err(error) => {
                let reason = ureq::Error::from(error);
                return Err(UrlFailure::Broken { received: part.len(), total, reason }.into());
            }
        };
        if part.len() + read as u64 > limit {
            part.clear()?;
            return Err(too_large.into());
        }
        part.append(&buffer[..read])?;
        report(FetchEvent::Progress { downloaded: part.len(), total });
    }
    if let Some(total) = total
        && part.len() < total
    {
        let reason = ureq::Error::Io(io::ErrorKind::UnexpectedEof.into());
        return Err(UrlFailure::Broken { received: part.len(), total: Some(total), reason }.into());
    }
    Ok(Received { resumed, end_is_known: total.is_some() })
}

/// The part file does not match the server's file, so it is discarded.
fn wrong_range(part: &mut PartFile, headers: &HeaderMap) -> Stop {
    if let Err(error) = part.clear() {
        return error.into();
    }
    UrlFailure::Range { found: content_range_text(headers).to_owned() }.into()
}

/// `Content-Range` of RFC 9110, section 14.4.
#[derive(Debug, PartialEq, Eq)]
enum ContentRange {
    /// `bytes first-last/total`, the total where it is known.
    From { first: u64, total: Option<u64> },
    /// `bytes */total`: the requested range begins beyond the file.
    Beyond { total: u64 },
    /// Missing or unreadable.
    Unknown,
}

fn content_range_text(headers: &HeaderMap) -> &str {
    headers.get(header::CONTENT_RANGE).and_then(|value| value.to_str().ok()).unwrap_or("")
}

fn content_range(headers: &HeaderMap) -> ContentRange {
    parse_content_range(content_range_text(headers)).unwrap_or(ContentRange::Unknown)
}

fn parse_content_range(text: &str) -> Option<ContentRange> {
    let (range, total) = text.trim().strip_prefix("bytes ")?.split_once('/')?;
    if range == "*" {
        return Some(ContentRange::Beyond { total: total.parse().ok()? });
    }
    let (first, _last) = range.split_once('-')?;
    let total = if total == "*" { None } else { Some(total.parse().ok()?) };
    Some(ContentRange::From { first: first.trim().parse().ok()?, total })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Covers the library's redirect from `https`, which uses the same agent and settings.
    #[test]
    fn https_requests_are_never_redirected_to_http() {
        assert!(is_encrypted("https://example.org/lab.log"));
        assert!(!is_encrypted("http://example.org/lab.log"));
        let plain = "http://127.0.0.1:9/lab.log";
        let request = agent(&FetchSettings::default()).get(plain).config().https_only(true).build();
        let error = request.call().unwrap_err();
        assert!(matches!(error, ureq::Error::RequireHttpsOnly(_)), "{error}");
        assert!(!UrlFailure::NoAnswer(error).is_worth_retrying());
    }

    #[test]
    fn content_ranges_are_read() {
        let from = |first, total| Some(ContentRange::From { first, total });
        assert_eq!(parse_content_range("bytes 5-9/10"), from(5, Some(10)));
        assert_eq!(parse_content_range("bytes 5-9/*"), from(5, None));
        assert_eq!(parse_content_range("bytes */10"), Some(ContentRange::Beyond { total: 10 }));
        for wrong in ["", "bytes", "bytes */*", "5-9/10", "bytes 5/10", "bytes a-9/10"] {
            assert_eq!(parse_content_range(wrong), None, "{wrong}");
        }
    }
}

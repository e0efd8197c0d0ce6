//! The last part of a program's output stream.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Number of bytes kept of a stream.
const KEPT_BYTES: usize = 64 << 10;
/// How long to wait for streams after all known processes are gone, where some may have been missed.
const LINGER: Duration = Duration::from_millis(500);

/// The last part of a stream, read by another thread.
pub struct OutputTail {
    kept: Arc<Mutex<VecDeque<u8>>>,
    reader: Option<JoinHandle<()>>,
}

impl OutputTail {
    /// Starts to read a stream to its end.
    ///
    /// # Errors
    /// When no thread can be created.
    pub fn of(mut stream: impl Read + Send + 'static) -> std::io::Result<Self> {
        let kept = Arc::new(Mutex::new(VecDeque::new()));
        let own = kept.clone();
        let read = move || {
            let mut bytes = vec![0; KEPT_BYTES];
            loop {
                let count = match stream.read(&mut bytes) {
                    Ok(0) => break,
                    Ok(count) => count,
                    Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                    Err(_) => break,
                };
                let mut kept = own.lock().unwrap_or_else(PoisonError::into_inner);
                kept.extend(&bytes[..count]);
                let excess = kept.len().saturating_sub(KEPT_BYTES);
                kept.drain(..excess);
            }
        };
        let reader = Some(std::thread::Builder::new().spawn(read)?);
        Ok(OutputTail { kept, reader })
    }

    /// The part kept when the stream has ended. A stream held open by an unknown process is abandoned.
    pub fn end(mut self) -> Vec<u8> {
        if let Some(reader) = self.reader.take() {
            let since = Instant::now();
            while !reader.is_finished() && since.elapsed() < LINGER {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().copied().collect()
    }
}

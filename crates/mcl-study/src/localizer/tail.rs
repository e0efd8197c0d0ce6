//! The end of what a program says.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Of a stream, so many bytes are kept.
const KEPT_BYTES: usize = 64 << 10;
/// How long streams may stay open after all processes are gone, where some may have been missed.
const LINGER: Duration = Duration::from_millis(500);

/// The end of a stream that another thread reads.
pub struct Tail {
    kept: Arc<Mutex<VecDeque<u8>>>,
    reader: Option<JoinHandle<()>>,
}

impl Tail {
    /// Begins to read a stream to its end.
    ///
    /// # Errors
    /// When there is no room for a thread.
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
        Ok(Tail { kept, reader })
    }

    /// What is kept when the stream has ended. One that a process holds open which nobody knows of is left behind.
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

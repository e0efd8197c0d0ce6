//! A scripted HTTP server on 127.0.0.1: each connection gets the next answer of the script, byte for
//! byte, so that the tests can answer what no well-behaved server would.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// What to do with a connection, after its request was read.
pub enum Answer {
    /// Send these bytes and close the connection.
    Send(Vec<u8>),
    /// Send these bytes, then nothing more until the server is dropped.
    Hang(Vec<u8>),
    /// Send these bytes, then one more every 10 ms until the client goes away.
    Drip(Vec<u8>),
}

/// A request as received.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    pub path: String,
    pub range: Option<String>,
}

pub struct Server {
    address: SocketAddr,
    stopping: Arc<AtomicBool>,
    requests: Arc<Mutex<Vec<Request>>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    pub fn start(script: Vec<Answer>) -> Server {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let stopping = Arc::new(AtomicBool::new(false));
        let requests = Arc::new(Mutex::new(Vec::new()));
        let thread = std::thread::spawn({
            let (stopping, requests) = (stopping.clone(), requests.clone());
            move || {
                let mut hanging = Vec::new();
                let mut script = script.into_iter();
                for stream in listener.incoming() {
                    if stopping.load(Ordering::SeqCst) {
                        break;
                    }
                    let mut stream = stream.unwrap();
                    let Some(request) = read_request(&stream) else { continue };
                    requests.lock().unwrap().push(request);
                    match script.next() {
                        // A client that gave up is part of some tests: not an error of the server.
                        Some(Answer::Send(bytes)) => drop(stream.write_all(&bytes)),
                        Some(Answer::Hang(bytes)) => {
                            drop(stream.write_all(&bytes));
                            hanging.push(stream);
                        }
                        Some(Answer::Drip(bytes)) => {
                            let mut sent = stream.write_all(&bytes);
                            while sent.is_ok() {
                                std::thread::sleep(Duration::from_millis(10));
                                sent = stream.write_all(b"1");
                            }
                        }
                        None => drop(stream.write_all(&status("410 Gone", "script is over"))),
                    }
                }
            }
        });
        Server { address, stopping, requests, thread: Some(thread) }
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}/{path}", self.address)
    }

    /// The requests so far.
    pub fn requests(&self) -> Vec<Request> {
        self.requests.lock().unwrap().clone()
    }

    /// The `Range` headers of the requests so far.
    pub fn ranges(&self) -> Vec<Option<String>> {
        self.requests().into_iter().map(|request| request.range).collect()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stopping.store(true, Ordering::SeqCst);
        // Wakes the thread from waiting for a connection.
        drop(TcpStream::connect(self.address));
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the server panicked");
        }
    }
}

fn read_request(stream: &TcpStream) -> Option<Request> {
    let mut lines = BufReader::new(stream).lines();
    let first = lines.next()?.ok()?;
    let path = first.split(' ').nth(1)?.to_owned();
    let mut range = None;
    for line in lines {
        let line = line.ok()?;
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(": ")
            && name.eq_ignore_ascii_case("range")
        {
            range = Some(value.to_owned());
        }
    }
    Some(Request { path, range })
}

/// A whole answer with a status line of one's own.
pub fn status(line: &str, body: &str) -> Vec<u8> {
    with_headers(line, &[("Content-Length", body.len().to_string())], body.as_bytes())
}

/// 200 with the body's true length.
pub fn ok(body: &[u8]) -> Vec<u8> {
    with_headers("200 OK", &[("Content-Length", body.len().to_string())], body)
}

/// 200 that announces the whole body but sends only its first `sent` bytes.
pub fn truncated(body: &[u8], sent: usize) -> Vec<u8> {
    with_headers("200 OK", &[("Content-Length", body.len().to_string())], &body[..sent])
}

/// 200 without a length: the body ends where the connection does.
pub fn ok_without_length(body: &[u8]) -> Vec<u8> {
    with_headers("200 OK", &[], body)
}

/// 206 with the rest of `body` from `first` on.
pub fn rest(body: &[u8], first: usize) -> Vec<u8> {
    let range = format!("bytes {first}-{}/{}", body.len() - 1, body.len());
    let length = (body.len() - first).to_string();
    let headers = [("Content-Range", range), ("Content-Length", length)];
    with_headers("206 Partial Content", &headers, &body[first..])
}

/// Any answer.
pub fn with_headers(line: &str, headers: &[(&str, String)], body: &[u8]) -> Vec<u8> {
    let mut answer = format!("HTTP/1.1 {line}\r\nConnection: close\r\n");
    for (name, value) in headers {
        answer += &format!("{name}: {value}\r\n");
    }
    answer += "\r\n";
    [answer.as_bytes(), body].concat()
}

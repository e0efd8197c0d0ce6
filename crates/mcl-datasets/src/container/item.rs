//! The items of a container: topics and their encoded messages.

use std::io::BufRead;
use std::path::Path;
use std::sync::Arc;

use super::position::Position;
use super::problem::{StreamError, StreamProblem};

/// The description of a message type, as written in the bag.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct SchemaText {
    /// Name of the message type.
    pub name: String,
    /// Language of the text: `ros2msg`, `ros2idl`, `ros1msg`; empty where there is no text.
    pub encoding: String,
    /// The text; empty where the bag has none.
    pub data: Vec<u8>,
}

/// A topic as described in one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Number within this file.
    pub id: u32,
    /// Name of the topic.
    pub topic: String,
    /// The encoding of its messages: `cdr`, `ros1`, …
    pub message_encoding: String,
    /// The description of its messages, if the file has one.
    pub schema: Option<Arc<SchemaText>>,
}

/// One message with its position.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    /// Its topic.
    pub channel: &'a Channel,
    /// Sequence number by the writer; where the format has none, the index among those of its topic.
    pub sequence: u32,
    /// Log time, in nanoseconds.
    pub log_time: u64,
    /// Publish time, in nanoseconds.
    pub publish_time: u64,
    /// The encoded message.
    pub data: &'a [u8],
    /// Its position in the file.
    pub position: Position,
}

/// Skipped messages of a channel, known from the file's index.
#[derive(Debug, Clone, Copy)]
pub struct Passed<'a> {
    /// Their topic.
    pub channel: &'a Channel,
    /// Their number.
    pub count: usize,
    /// Log times of the first and the last of them, in nanoseconds.
    pub log_times: (u64, u64),
}

/// A malformed row.
#[derive(Debug, Clone, Copy)]
pub struct Damaged<'a> {
    /// The table it is part of.
    pub table: &'static str,
    /// Its position in the table.
    pub position: Position,
    /// The field at fault.
    pub field: &'static str,
    /// What was found.
    pub found: &'a str,
    /// What was expected.
    pub expected: &'static str,
}

/// An item passed to the visitor of a container.
#[derive(Debug, Clone, Copy)]
pub enum Item<'a> {
    /// A channel, before its first message.
    Channel(&'a Channel),
    /// A message.
    Message(Message<'a>),
    /// Messages that were skipped.
    Passed(Passed<'a>),
    /// A malformed row, which is skipped.
    Damaged(Damaged<'a>),
    /// A remark on how the file was read, where that is unusual.
    Note(&'a str),
    /// A metadata record: its name, and pairs of keys and values.
    Metadata(&'a str, &'a [(&'a str, &'a str)]),
}

/// What a visitor needs of the following messages on a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wanted {
    /// The messages themselves.
    #[default]
    Shown,
    /// Only their number: they may be skipped.
    Counted,
}

/// Receives the items of a container in order; the answer to a channel, and to each message of it, applies to
/// the following messages on this channel.
pub type Visit<'v> = dyn FnMut(Item<'_>) -> Result<Wanted, StreamProblem> + 'v;

/// The bytes of a container.
pub struct Input<'a> {
    /// From the first one on, decompressed if the file is compressed.
    pub stream: Box<dyn BufRead + 'a>,
    /// The file, if it is a regular, uncompressed one: for formats that need random access, and to skip what
    /// is not wanted.
    pub file: Option<&'a Path>,
}

/// Reads a container from its first message to its last, and passes them to a visitor. A file that ends early
/// is no error: the result says what is missing. Memory is bounded whatever the bytes say.
pub type Read = fn(Input<'_>, &mut Visit<'_>) -> Result<Option<String>, StreamError>;

/// A format that holds messages.
#[derive(Debug)]
pub struct Container {
    /// Its name in messages.
    pub name: &'static str,
    /// Its first bytes.
    pub magic: &'static [u8],
    /// The ending of its file names, without the dot.
    pub ending: &'static str,
    /// `storage_identifier` in the `metadata.yaml` of a rosbag2 folder, where it can occur there.
    pub storage: Option<&'static str>,
    /// Its reader.
    pub read: Read,
}

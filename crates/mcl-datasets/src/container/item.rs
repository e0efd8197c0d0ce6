//! What a container yields: topics and their encoded messages.

use std::io::BufRead;
use std::path::Path;
use std::sync::Arc;

use super::position::Position;
use super::problem::{StreamError, StreamProblem};

/// How messages are laid out, as written in the bag.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct SchemaText {
    /// Name of the message type.
    pub name: String,
    /// Language of the text: `ros2msg`, `ros2idl`, `ros1msg`; empty where there is no text.
    pub encoding: String,
    /// The text; empty where the bag has none.
    pub data: Vec<u8>,
}

/// A topic as one file describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Number in this file.
    pub id: u32,
    /// Name of the topic.
    pub topic: String,
    /// How messages are encoded: `cdr`, `ros1`, …
    pub message_encoding: String,
    /// How messages are laid out, if the file says so.
    pub schema: Option<Arc<SchemaText>>,
}

/// One message, with where it stands.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    /// Its topic.
    pub channel: &'a Channel,
    /// Number the writer gave it; where the format has none, its place among those of its topic.
    pub sequence: u32,
    /// When it was recorded, in nanoseconds.
    pub log_time: u64,
    /// When it was published, in nanoseconds.
    pub publish_time: u64,
    /// The encoded message.
    pub data: &'a [u8],
    /// Where it stands.
    pub position: Position,
}

/// Messages of a channel that nobody wants to see, as the file's index tells of them.
#[derive(Debug, Clone, Copy)]
pub struct Passed<'a> {
    /// Their topic.
    pub channel: &'a Channel,
    /// How many they are.
    pub count: usize,
    /// When the first and the last of them were recorded, in nanoseconds.
    pub log_times: (u64, u64),
}

/// What is wrong with one of many alike.
#[derive(Debug, Clone, Copy)]
pub struct Damaged<'a> {
    /// What it is part of.
    pub table: &'static str,
    /// Its place there.
    pub position: Position,
    /// The field at fault.
    pub field: &'static str,
    /// What stands there.
    pub found: &'a str,
    /// What should.
    pub expected: &'static str,
}

/// What a visitor of a container gets to see.
#[derive(Debug, Clone, Copy)]
pub enum Item<'a> {
    /// A channel, before its first message.
    Channel(&'a Channel),
    /// A message.
    Message(Message<'a>),
    /// Messages that were passed over.
    Passed(Passed<'a>),
    /// A row that is not as it should be, which is passed over.
    Damaged(Damaged<'a>),
    /// How the file was read, where that is not as usual.
    Note(&'a str),
    /// A metadata record: its name, and pairs of keys and values.
    Metadata(&'a str, &'a [(&'a str, &'a str)]),
}

/// What a visitor wants of the messages that follow on a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wanted {
    /// To see them.
    #[default]
    Shown,
    /// To know how many they are: they may be passed over.
    Counted,
}

/// Takes what a container yields, in its order; after a channel and each message of it, the answer is of the
/// messages that follow on this channel.
pub type Visit<'v> = dyn FnMut(Item<'_>) -> Result<Wanted, StreamProblem> + 'v;

/// The bytes of a container.
pub struct Input<'a> {
    /// From the first one on, unpacked if the file is compressed.
    pub stream: Box<dyn BufRead + 'a>,
    /// The file, where it is one and not compressed: for formats that do not stand in order, and to pass over
    /// what is not wanted.
    pub file: Option<&'a Path>,
}

/// Reads a container from its first message to its last, and shows them to a visitor. A file that ends
/// early is no error: the result says what is missing. Memory is bounded whatever the bytes say.
pub type Read = fn(Input<'_>, &mut Visit<'_>) -> Result<Option<String>, StreamError>;

/// A format that holds messages.
#[derive(Debug)]
pub struct Container {
    /// What it is called in messages.
    pub name: &'static str,
    /// Its first bytes.
    pub magic: &'static [u8],
    /// What names of its files end with, without the dot.
    pub ending: &'static str,
    /// `storage_identifier` in the `metadata.yaml` of a rosbag2 folder, if it can be one.
    pub storage: Option<&'static str>,
    /// Its reader.
    pub read: Read,
}

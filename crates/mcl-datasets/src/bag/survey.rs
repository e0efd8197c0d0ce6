//! The contents of a bag, whether or not it can be read as a log.

use mcl_core::Stamp;
use serde::Serialize;

use super::content::{Content, MessageKind, Topic};
use super::layout::ElementType;
use super::topics::{choose, possible_references};
use crate::log::options::ReadOptions;

/// Number of topics whose frames are looked up; a file may have 65,535.
const FRAMES: usize = 1000;

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicFacts {
    /// Its name.
    pub name: String,
    /// Its message type as named in the bag; empty where it is not.
    pub type_name: String,
    /// Number of messages.
    pub messages: usize,
    /// Log times of the first and the last message.
    pub logged: Option<(Stamp, Stamp)>,
    /// `frame_id` of the first message, where it has a header.
    pub frame: Option<String>,
}

/// The choice of a topic for one input of a log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// Which input: scans, odometry, reference.
    pub what: &'static str,
    /// The topic chosen.
    pub taken: Option<String>,
    /// The other candidates.
    pub others: Vec<String>,
    /// Whether the user has to choose.
    pub is_open: bool,
    /// The options that choose another.
    pub options: &'static str,
}

/// The contents of a bag.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Survey {
    /// Its topics, by name.
    pub topics: Vec<TopicFacts>,
    /// The topics that scans, odometry and reference are read from.
    pub choices: Vec<Choice>,
    /// Why the bag ends early, if it does.
    pub truncated: Option<String>,
}

impl Survey {
    pub(crate) fn of(content: &Content, options: &ReadOptions) -> Self {
        let mut topics: Vec<TopicFacts> = content
            .topics
            .iter()
            .enumerate()
            .map(|(index, topic)| TopicFacts {
                name: topic.name.clone(),
                type_name: topic
                    .description
                    .as_ref()
                    .map_or(String::new(), |schema| schema.name.clone()),
                messages: topic.messages,
                logged: topic.logged.map(|(first, last)| (stamp(first), stamp(last))),
                frame: (index < FRAMES).then(|| frame(topic)).flatten(),
            })
            .collect();
        topics.sort_by(|a, b| a.name.cmp(&b.name));
        Survey { topics, choices: choices(content, options), truncated: content.truncated.clone() }
    }
}

impl Survey {
    /// Adds pairs of frames that could be the reference.
    pub(crate) fn with_pairs(mut self, mut pairs: Vec<String>) -> Self {
        for choice in self.choices.iter_mut().filter(|choice| choice.what == "reference") {
            pairs.retain(|pair| choice.taken.as_ref() != Some(pair));
            choice.others.append(&mut pairs);
        }
        self
    }
}

fn stamp(log_time: u64) -> Stamp {
    Stamp::from_nanoseconds(i64::try_from(log_time).unwrap_or(i64::MAX))
}

fn choices(content: &Content, options: &ReadOptions) -> Vec<Choice> {
    let chosen = choose(content, options).ok();
    let choice = |what, options, taken: Option<String>, all: Vec<String>| {
        let others: Vec<String> =
            all.into_iter().filter(|name| taken.as_ref() != Some(name)).collect();
        let is_open = taken.is_none() && others.len() > 1;
        Choice { what, taken, others, is_open, options }
    };
    let owned = |names: Vec<&str>| names.into_iter().map(str::to_owned).collect::<Vec<_>>();
    let taken =
        |of: fn(&super::topics::ChosenTopics<'_>) -> Option<String>| chosen.as_ref().and_then(of);
    let odometry = taken(|chosen| chosen.odometry.map(str::to_owned));
    let scan_kinds: &[MessageKind] = match options.slice {
        Some(_) => &[MessageKind::Cloud],
        None => &[MessageKind::Scan, MessageKind::MultiEcho],
    };
    let mut scans = owned(content.names(scan_kinds));
    let clouds = content.topics.iter().filter(|topic| topic.is_cloud() && topic.messages > 0);
    if options.slice.is_none() {
        scans.extend(clouds.map(|topic| format!("{} (with --slice)", topic.name)));
    }
    let scan = taken(|chosen| Some(chosen.scan.to_owned()));
    let is_scan_open = scan.is_none() && content.names(scan_kinds).len() > 1;
    let references = possible_references(content, odometry.as_deref());
    // Topics named as estimates are only used on request, so they leave nothing open.
    let plain = references.iter().filter(|name| !name.contains(' ')).count();
    let reference = taken(|chosen| chosen.reference.map(str::to_owned));
    let is_reference_open = reference.is_none() && plain > 1;
    vec![
        Choice { is_open: is_scan_open, ..choice("scans", "--scan-topic, --slice", scan, scans) },
        choice(
            "odometry",
            "--odom-topic, --odom-frame",
            odometry.clone(),
            owned(content.names(&[MessageKind::Odometry])),
        ),
        Choice {
            is_open: is_reference_open,
            ..choice(
                "reference",
                "--reference-topic, --reference FILE, --reference-frame",
                reference,
                references,
            )
        },
    ]
}

/// `header.frame_id` of the first message.
fn frame(topic: &Topic) -> Option<String> {
    let schema = topic.schema().0.ok()?;
    let is_header = match schema.root().fields.first()?.element {
        ElementType::Message(index) => schema.definition(index).name == "std_msgs/Header",
        _ => false,
    };
    // Both encodings have eight bytes of time, preceded by a four-byte header or number.
    let length: [u8; 4] = *topic.head.get(12..)?.first_chunk()?;
    let is_big = topic.encoding == "cdr" && topic.head[1] == 0;
    let length = if is_big { u32::from_be_bytes(length) } else { u32::from_le_bytes(length) };
    let bytes = topic.head.get(16..16_usize.checked_add(length as usize)?)?;
    let name = std::str::from_utf8(bytes.strip_suffix(b"\0").unwrap_or(bytes)).ok()?;
    is_header.then(|| name.trim_start_matches('/').to_owned())
}

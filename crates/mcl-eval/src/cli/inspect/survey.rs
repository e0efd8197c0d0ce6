//! The topics of a bag, which of them are read, and other candidates.

use std::path::PathBuf;

use anyhow::{Error, Result};
use mcl_core::text::{counted, printable};
use mcl_datasets::bag::{Choice, Survey, TopicFacts};
use mcl_datasets::carmen::CarmenError;
use mcl_datasets::log::{LogError, survey};
use serde::Serialize;

use crate::cli::Outcome;
use crate::cli::args::InspectArgs;
use crate::cli::output::{input_files, print};
use crate::progress::{error_message, tell};

#[derive(Serialize)]
pub struct Surveyed {
    topics: Vec<Topic>,
    choices: Vec<Choice>,
}

#[derive(Serialize)]
struct Topic {
    name: String,
    /// Null where the bag does not state it.
    r#type: Option<String>,
    messages: usize,
    /// Seconds, exact: when its messages were logged.
    first_s: Option<String>,
    last_s: Option<String>,
    /// Frame in the header of its first message.
    frame: Option<String>,
}

/// A bag that cannot be read as a log.
#[derive(Serialize)]
struct UnreadableBag {
    #[serde(flatten)]
    survey: Surveyed,
    /// Why.
    problem: String,
}

/// A CARMEN log whose scans are of kinds that were not requested.
#[derive(Serialize)]
struct UnreadCarmen {
    lines: usize,
    /// Their kinds, with counts.
    records: String,
    /// Why.
    problem: String,
}

impl Surveyed {
    pub fn of(survey: &Survey) -> Self {
        let topic = |facts: &TopicFacts| Topic {
            name: facts.name.clone(),
            r#type: Some(facts.type_name.clone()).filter(|name| !name.is_empty()),
            messages: facts.messages,
            first_s: facts.logged.map(|(first, _)| first.to_string()),
            last_s: facts.logged.map(|(_, last)| last.to_string()),
            frame: facts.frame.clone(),
        };
        Surveyed {
            topics: survey.topics.iter().map(topic).collect(),
            choices: survey.choices.clone(),
        }
    }

    /// Whether the user has to choose.
    pub fn is_open(&self) -> bool {
        self.choices.iter().any(|choice| choice.is_open)
    }

    /// As lines of text.
    pub fn lines(&self, line: &mut impl FnMut(&str, String)) {
        for topic in &self.topics {
            let mut text = format!(
                "{} ({}, {}",
                printable(&topic.name),
                printable(topic.r#type.as_deref().unwrap_or("no type")),
                counted(topic.messages, "message")
            );
            if let (Some(first), Some(last)) = (&topic.first_s, &topic.last_s) {
                text += &format!(", logged {first} … {last} s");
            }
            if let Some(frame) = &topic.frame {
                text += &format!(", frame {:?}", printable(frame));
            }
            line("topic", text + ")");
        }
        for choice in &self.choices {
            let mut text = format!("{}: ", choice.what);
            text += &match (&choice.taken, choice.is_open) {
                (Some(taken), _) => format!("{} is chosen", printable(taken)),
                (None, true) => "one has to be chosen".to_owned(),
                (None, false) => "no topic is chosen".to_owned(),
            };
            if !choice.others.is_empty() {
                text += &format!(", could be {}", printable(&choice.others.join(", ")));
            }
            line("use", format!("{text} ({})", choice.options));
        }
    }
}

/// Shows what can be read of a bag that cannot be read as a log with these options, or that is damaged; for
/// any other file, the error is returned.
pub fn inspect_unread(error: Error, args: &InspectArgs) -> Result<Outcome> {
    let name = args.data.log.log.as_str();
    if error.downcast_ref::<LogError>().is_none() {
        return Err(error);
    }
    if let Some(LogError::Carmen {
        error: CarmenError::NoScan { lines, kinds, on_request, .. },
        ..
    }) = error.downcast_ref::<LogError>()
        && !on_request.is_empty()
    {
        let unread =
            UnreadCarmen { lines: *lines, records: kinds.clone(), problem: error_message(&error) };
        print(args.json, &unread, |unread| {
            format!(
                "{name}: a CARMEN log, but no scan can be read from it as it is\n  lines         {}\n  \
                 records       {}\n",
                unread.lines,
                printable(&unread.records)
            )
        })?;
        tell!("warning: {}", unread.problem);
        return Ok(Outcome::Incomplete);
    }
    let file = input_files([name]).into_iter().find(|path: &PathBuf| path.exists());
    let found = file.and_then(|path| survey(&path, &args.data.options().read).ok().flatten());
    // A damaged bag without messages has nothing to show.
    let is_shown = |found: &Survey| {
        found.truncated.is_none() || found.topics.iter().any(|topic| topic.messages > 0)
    };
    let Some(found) = found.filter(is_shown) else { return Err(error) };
    let unread = UnreadableBag { survey: Surveyed::of(&found), problem: error_message(&error) };
    print(args.json, &unread, |unread| {
        let mut text = format!("{name}: a bag, but no log can be read from it as it is\n");
        if unread.survey.topics.is_empty() {
            text += "  no topics\n";
        }
        unread.survey.lines(&mut |name, value| text += &format!("  {name:<14}{value}\n"));
        text
    })?;
    tell!("warning: {}", unread.problem);
    Ok(Outcome::Incomplete)
}

//! Numbers of records in a log, by kind.

use std::collections::BTreeMap;

/// Number of kinds counted by name; a file that is not a log has a new kind in each line.
pub(super) const COUNTED_KINDS: usize = 100;
/// Kinds named in a message: the most frequent ones.
const LISTED_KINDS: usize = 20;
/// Longest name of a kind.
const KIND_BYTES: usize = 40;
/// The common name of all other kinds.
const OTHERS: &str = "others";

/// How many records there are of each kind.
#[derive(Default)]
pub(super) struct Kinds {
    counts: BTreeMap<String, usize>,
    others: usize,
}

impl Kinds {
    /// Counts the record of a line.
    pub fn count(&mut self, line: &[u8]) {
        let word = line.split(u8::is_ascii_whitespace).find(|word| !word.is_empty());
        let is_name = |word: &&[u8]| {
            let is_first = |byte: &u8| byte.is_ascii_alphabetic() || b"#@_$".contains(byte);
            word.len() <= KIND_BYTES
                && word.first().is_some_and(is_first)
                && word.iter().all(u8::is_ascii_graphic)
        };
        let name = word.filter(is_name).map(|name| String::from_utf8_lossy(name).into_owned());
        match name {
            Some(name) => self.add(name, 1),
            None => self.others += 1,
        }
    }

    /// Adds to the count of a kind.
    pub fn add(&mut self, name: String, count: usize) {
        if self.counts.len() < COUNTED_KINDS || self.counts.contains_key(&name) {
            *self.counts.entry(name).or_default() += count;
        } else {
            self.others += count;
        }
    }

    pub fn has(&self, kind: &str) -> bool {
        self.counts.contains_key(kind)
    }

    /// All kinds with their counts.
    pub fn named(self) -> BTreeMap<String, usize> {
        let others = (self.others > 0).then(|| (OTHERS.to_owned(), self.others));
        self.counts.into_iter().chain(others).collect()
    }

    /// The most frequent kinds with their counts, as text.
    pub fn list(&self) -> String {
        let mut most: Vec<(&String, &usize)> = self.counts.iter().collect();
        most.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        let unlisted = most.split_off(LISTED_KINDS.min(most.len()));
        most.sort_unstable();
        let mut list: Vec<String> =
            most.into_iter().map(|(name, count)| format!("{name} {count}")).collect();
        let others = self.others + unlisted.into_iter().map(|(_, count)| count).sum::<usize>();
        if others > 0 {
            list.push(format!("{OTHERS} {others}"));
        }
        if list.is_empty() { "no records".to_owned() } else { list.join(", ") }
    }
}

//! What a bag of this suite says of its scans beside its messages: which of them have no stamp, odometry or
//! reference pose where others about them have. Without it, readers take a stamp of 0 for none, the time of logging
//! in its place, and fill gaps by interpolation.
//!
//! In MCAP it is a metadata record; formats that have none hold it as the text of a message, `key: value` in each
//! line.

use std::collections::BTreeSet;

use mcl_core::text::counted;

/// Name of the metadata record.
pub(super) const NAME: &str = "mcl-eval";
/// Topic of the message.
pub(super) const TOPIC: &str = "/mcl_eval";
/// Key of the number of scans on `/scan`: where it differs, another program cut or merged the bag, so that the numbers
/// of the lists are those of other scans.
pub(super) const SCANS: &str = "scans";
/// Key of the scans on `/scan` that have no stamp: their numbers from 0, parted by blanks. In a bag that has the
/// record, a stamp of 0 of any other scan is a time, and scans are in their order, whatever their stamps.
pub(super) const UNSTAMPED: &str = "scans_without_stamp";
/// Keys of the scans that have no odometry, or no reference pose, where others about them have.
pub(super) const NO_ODOMETRY: &str = "scans_without_odometry";
pub(super) const NO_REFERENCE: &str = "scans_without_reference";

/// What is said.
#[derive(Debug, Default)]
pub(super) struct ScanLists {
    /// The number of scans, if that is said.
    pub scans: Option<usize>,
    pub unstamped: BTreeSet<u32>,
    pub without_odometry: BTreeSet<u32>,
    pub without_reference: BTreeSet<u32>,
}

impl ScanLists {
    /// Adds the entries of a record.
    pub fn add<'a>(&mut self, entries: impl Iterator<Item = (&'a str, &'a str)>) {
        for (key, value) in entries {
            let list = match key {
                SCANS => {
                    self.scans = value.trim().parse().ok();
                    continue;
                }
                UNSTAMPED => &mut self.unstamped,
                NO_ODOMETRY => &mut self.without_odometry,
                NO_REFERENCE => &mut self.without_reference,
                _ => continue,
            };
            list.extend(value.split_ascii_whitespace().filter_map(|n| n.parse::<u32>().ok()));
        }
    }

    /// Whether the lists are of other scans than the bag's, of which so many messages were found.
    pub fn are_of_others(&self, found: usize, is_cut: bool) -> bool {
        self.scans.is_some_and(|said| found > said || found < said && !is_cut)
    }

    /// That they are.
    pub fn told(&self, topic: &str, found: usize) -> String {
        format!(
            "{topic}: {TOPIC} or the metadata of the bag tells of {}, found {found}: another program cut or merged the bag, so which scans have no stamp, odometry or reference pose is not known",
            counted(self.scans.unwrap_or_default(), "scan")
        )
    }

    /// Adds the entries of a message.
    pub fn add_text(&mut self, text: &str) {
        self.add(text.lines().filter_map(|line| line.split_once(':')));
    }
}

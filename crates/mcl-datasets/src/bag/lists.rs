//! What this suite's writer records about the scans of a bag beside its messages: which of them lack a stamp,
//! odometry or a reference pose where their neighbours have one. Without it, a reader would take a stamp of 0
//! as missing, use the log time instead, and fill gaps by interpolation.
//!
//! In MCAP it is a metadata record; in formats without metadata it is the text of a message, with `key:
//! value` in each line.

use std::collections::BTreeSet;

use mcl_core::text::counted;

/// Name of the metadata record.
pub(super) const NAME: &str = "mcl-eval";
/// Topic of the message.
pub(super) const TOPIC: &str = "/mcl_eval";
/// Key of the number of scans on `/scan`: where it differs, another program cut or merged the bag, so that
/// the indices in the lists refer to other scans.
pub(super) const SCANS: &str = "scans";
/// Key of the scans on `/scan` that have no stamp: their indices from 0, separated by blanks. In a bag that
/// has the record, a stamp of 0 of any other scan is valid, and scans are in order, whatever their stamps.
pub(super) const UNSTAMPED: &str = "scans_without_stamp";
/// Keys of the scans that lack odometry, or a reference pose, where their neighbours have one.
pub(super) const NO_ODOMETRY: &str = "scans_without_odometry";
pub(super) const NO_REFERENCE: &str = "scans_without_reference";

/// The recorded lists.
#[derive(Debug, Default)]
pub(super) struct ScanLists {
    /// The number of scans, where recorded.
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

    /// Whether the lists refer to other scans than those of the bag, which has `found` messages.
    pub fn are_of_others(&self, found: usize, is_cut: bool) -> bool {
        self.scans.is_some_and(|said| found > said || found < said && !is_cut)
    }

    /// The remark that says so.
    pub fn mismatch(&self, topic: &str, found: usize) -> String {
        format!(
            "{topic}: {TOPIC} or the metadata of the bag lists {}, found {found}: another program cut or merged the bag, so it is not known which scans have no stamp, odometry or reference pose",
            counted(self.scans.unwrap_or_default(), "scan")
        )
    }

    /// Adds the entries of a message.
    pub fn add_text(&mut self, text: &str) {
        self.add(text.lines().filter_map(|line| line.split_once(':')));
    }
}

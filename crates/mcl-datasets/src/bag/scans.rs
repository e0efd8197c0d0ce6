//! Contradictions and repetitions among the scans of a bag, and time that is covered more than once.

use std::collections::{HashMap, HashSet};

use mcl_core::text::counted;

use super::beams;
use super::decoder::{Logged, PublishedTransform, time};
use super::messages::{PoseMessage, ScanMessage};
use super::moment::{Moment, Stretches, TimedMessage};
use super::pairing::shared_stamps;

/// Steps between two beams by which the last direction may be off: scanners of a full turn may count the
/// first beam twice.
const STEPS_OFF: f64 = 1.5;

/// Removes the scans that repeat another of the same stamp, and returns their number.
pub(super) fn drop_repeated(scans: &mut Vec<Logged<ScanMessage>>) -> usize {
    let before = scans.len();
    let mut counts: HashMap<i64, usize> = HashMap::new();
    scans.iter().for_each(|scan| *counts.entry(scan.value.header.stamp).or_default() += 1);
    let mut known: HashSet<(i64, [u8; 32])> = HashSet::new();
    scans.retain(|scan| {
        let stamp = scan.value.header.stamp;
        stamp <= 0 || counts[&stamp] == 1 || known.insert((stamp, scan.value.digest()))
    });
    before - scans.len()
}

/// Where the time of a bag jumps back.
pub(super) fn stretches(
    scans: &[Logged<ScanMessage>],
    scan_topic: &str,
    poses: [(Option<&str>, &[Logged<PoseMessage>]); 2],
    transforms: &[PublishedTransform<'_>],
) -> Stretches {
    let of_scans = scans.iter().map(|scan| TimedMessage {
        place: scan.place,
        of: scan_topic,
        at: time(scan.value.header.stamp, scan.log_time),
        is_even: true,
    });
    // The poses of a path share one place in the bag, and repeat earlier ones.
    let is_path =
        |poses: &[Logged<PoseMessage>]| poses.windows(2).any(|pair| pair[0].place >= pair[1].place);
    let of_poses =
        poses.into_iter().filter(|(_, poses)| !is_path(poses)).flat_map(|(topic, poses)| {
            poses.iter().map(move |pose| TimedMessage {
                place: pose.place,
                of: topic.unwrap_or_default(),
                at: time(pose.value.header.stamp, pose.log_time),
                is_even: true,
            })
        });
    let of_transforms =
        transforms.iter().filter(|published| !published.is_static).map(|published| TimedMessage {
            place: published.transform.place,
            of: published.transform.value.child.as_str(),
            at: time(published.transform.value.header.stamp, published.transform.log_time),
            is_even: false,
        });
    Stretches::of(of_scans.chain(of_poses).chain(of_transforms))
}

/// The time of a scan.
pub(super) fn scan_time(scan: &Logged<ScanMessage>) -> i64 {
    time(scan.value.header.stamp, scan.log_time)
}

/// Remarks on scans, a line each.
#[derive(Default)]
pub(super) struct ScanRemarks {
    pub doubts: Vec<String>,
    pub assumptions: Vec<String>,
    pub notes: Vec<String>,
}

/// What contradicts itself or is left out among the scans of a topic at these times; `is_ours` means that the
/// bag was written by this suite, with the stamps of the original log.
pub(super) fn contradictions(
    topic: &str,
    scans: &[Logged<ScanMessage>],
    moments: &[Moment],
    is_ours: bool,
) -> ScanRemarks {
    let mut remarks = ScanRemarks::default();
    let off: Vec<(usize, f64)> = scans
        .iter()
        .map(|scan| scan.value.steps_off())
        .enumerate()
        .filter(|&(_, steps)| steps > STEPS_OFF)
        .collect();
    if let Some(&(index, _)) = off.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
        let scan = &scans[index].value;
        let geometry = &scan.geometry;
        remarks.doubts.push(format!(
            "{topic}: in {} of {} scans the fields of the directions contradict each other: {} readings with angle_increment {:.6} from angle_min {:.4} end at {:.4} rad, but angle_max is {:.4} (scan {index}); angle_increment is used",
            off.len(),
            scans.len(),
            geometry.beams,
            geometry.angle_step,
            geometry.start_angle,
            geometry.angle(geometry.beams - 1),
            scan.last_angle,
        ));
    }
    let off: Vec<usize> =
        (0..scans.len()).filter(|&scan| beams::contradicts_scan_time(&scans[scan].value)).collect();
    if let Some(&first) = off.first() {
        let scan = &scans[first].value;
        remarks.doubts.push(format!(
            "{topic}: in {} of {} the times contradict each other: by time_increment {:.6} s a scan of {} readings takes {:.4} s, by scan_time a turn takes {:.4} s (scan {first})",
            off.len(),
            counted(scans.len(), "scan"),
            scan.time_increment,
            scan.ranges.len(),
            beams::takes(scan),
            scan.scan_time
        ));
    }
    // The stamps of a recording written as a bag are those of its log.
    if let Some((message, are_many)) = shared_stamps(moments.iter().copied()) {
        let list =
            if is_ours && !are_many { &mut remarks.assumptions } else { &mut remarks.doubts };
        list.push(format!("{topic}: {message}"));
    }
    let at_max: usize = scans.iter().map(|scan| scan.value.at_max).sum();
    if at_max > 0 {
        let readings: usize = scans.iter().map(|scan| scan.value.ranges.len()).sum();
        remarks.notes.push(format!(
            "{topic}: {at_max} of {readings} readings equal range_max: nothing came back there"
        ));
    }
    remarks
}

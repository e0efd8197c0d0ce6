//! The processes of a program, as listed by Linux below `/proc`.

use std::fs;

/// A process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// Its process id.
    pub pid: i32,
    /// Resident memory (kB).
    pub resident_kb: u64,
    /// Peak resident memory (kB).
    pub peak_kb: u64,
}

/// The processes that are alive and belong to a group.
pub fn of_group(group: i32) -> Vec<Member> {
    let processes = processes().filter(|&pid| group_of(pid) == Some(group));
    processes.filter_map(member).collect()
}

/// The processes that are alive and belong to a group, or share a line of their environment, which processes
/// that left the group keep.
pub fn of_group_or_mark(group: i32, mark: &str) -> Vec<i32> {
    let has_mark = |pid: i32| {
        fs::read(format!("/proc/{pid}/environ"))
            .is_ok_and(|lines| lines.split(|&byte| byte == 0).any(|line| line == mark.as_bytes()))
    };
    processes().filter(|&pid| group_of(pid) == Some(group) || has_mark(pid)).collect()
}

/// Peak resident memory of this process (kB).
pub fn own_peak_kb() -> u64 {
    member(std::process::id() as i32).map_or(u64::MAX, |member| member.peak_kb)
}

fn processes() -> impl Iterator<Item = i32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

/// The group of a process that is alive.
fn group_of(pid: i32) -> Option<i32> {
    let text = fs::read(format!("/proc/{pid}/stat")).ok()?;
    // The name is in brackets, and may contain some.
    let end = text.iter().rposition(|&byte| byte == b')')?;
    let text = std::str::from_utf8(&text[end + 1..]).ok()?;
    let mut fields = text.split_whitespace();
    let (state, _parent, group) = (fields.next()?, fields.next()?, fields.next()?);
    (!matches!(state, "Z" | "X")).then(|| group.parse().ok())?
}

fn member(pid: i32) -> Option<Member> {
    let text = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse().ok()
    };
    Some(Member { pid, resident_kb: field("VmRSS:")?, peak_kb: field("VmHWM:")? })
}

//! Files that are neither logs nor bags: what they are, and advice on what to do.

/// A format that is not read, and how to convert it.
pub(crate) struct ForeignFormat {
    /// Its magic bytes, at this offset.
    offset: usize,
    magic: &'static [u8],
    /// What it is.
    pub what: &'static str,
    /// What to do.
    pub advice: &'static str,
}

const UNPACK: &str = "unpack it, and name the log or the folder of the bag in it";

/// Kinds of files that are often mistaken for logs.
static KNOWN: &[ForeignFormat] = &[
    of(
        b"PK\x03\x04",
        "a ZIP archive",
        "unpack it with `unzip FILE`, and name the log or the folder of the bag in it",
    ),
    ForeignFormat {
        offset: 257,
        magic: b"ustar",
        what: "a tar archive",
        advice: "unpack it with `tar -xf FILE`, and name the log or the folder of the bag in it",
    },
    of(b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    of(b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    of(b"\x04\x22\x4d\x18", "an LZ4 file", "unpack it with `lz4 -d FILE`"),
    of(b"#ROSBAG V1", "a ROS 1 bag of version 1", "bring it to version 2.0 with `rosbag fix`"),
    of(
        b"version https://git-lfs",
        "a pointer of Git LFS, not the file itself",
        "fetch the file with `git lfs pull`",
    ),
    of(
        b"<!DOCTYPE",
        "a web page",
        "fetch the file itself: a page that asks to confirm a download was saved in its place",
    ),
    of(
        b"<html",
        "a web page",
        "fetch the file itself: a page that asks to confirm a download was saved in its place",
    ),
    of(b"%PDF-", "a PDF document", "name the log"),
    of(b"\x89PNG", "an image", "name the log; a map goes with --map"),
    of(b"P5", "an image", "name the log; a map goes with --map"),
    of(b"\x89HDF", "an HDF5 file", "convert it to a CARMEN log or a bag"),
    of(
        b"\xd4\xc3\xb2\xa1",
        "a capture of network packets (pcap)",
        "convert it to a bag with the tools of the scanner",
    ),
    of(
        b"\x0a\x0d\x0d\x0a",
        "a capture of network packets (pcapng)",
        "convert it to a bag with the tools of the scanner",
    ),
];

const fn of(magic: &'static [u8], what: &'static str, advice: &'static str) -> ForeignFormat {
    ForeignFormat { offset: 0, magic, what, advice }
}

/// The kind of a file that begins with these bytes, if it is known and unsupported.
pub(crate) fn of_head(head: &[u8]) -> Option<&'static ForeignFormat> {
    KNOWN.iter().find(|foreign| {
        head.get(foreign.offset..).is_some_and(|rest| rest.starts_with(foreign.magic))
    })
}

/// A disk operation of the file layer, which tests can count and make fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    /// A file or folder is created.
    Create,
    /// Bytes are written.
    Write,
    /// Written bytes, or the entries of a folder, are synced to the disk.
    Sync,
    /// A file is truncated.
    Truncate,
    /// A file is renamed.
    Rename,
    /// A file or folder is removed.
    Remove,
}

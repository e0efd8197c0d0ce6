/// What the file layer does to a disk: the operations that can be counted, and made to fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation {
    /// A file or folder is created.
    Create,
    /// Bytes are written.
    Write,
    /// Written bytes, or the entries of a folder, are handed to the disk.
    Sync,
    /// A file is cut.
    Truncate,
    /// A file takes another name.
    Rename,
    /// A file or folder is removed.
    Remove,
}

//! rosbag2's SQLite databases: a table of topics, a table of messages, and, since 2023, one of the
//! descriptions of their types.
//!
//! SQLite needs random access, so a compressed database is decompressed into a temporary file first. A
//! database may come from anywhere: nothing that it defines (views, triggers) is run, no row may be larger
//! than a chunk, and the rows together may be no larger than the file, as is the case when each page belongs
//! to one table. Messages come in the order of their rows, which is that of recording. A row with values of
//! other types is skipped alone.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};
use tempfile::{NamedTempFile, TempDir};

use super::chunk::MAX_CHUNK_BYTES;
use super::item::{
    Channel, Container, Damaged, Input, Item, Message, Passed, SchemaText, Visit, Wanted,
};
use super::position::Position;
use super::problem::{StreamError, StreamProblem};
use crate::packed::damage;

/// Databases of rosbag2, its default format until 2023.
pub static CONTAINER: Container = Container {
    name: "rosbag2 database",
    magic: b"SQLite format 3\0",
    ending: "db3",
    storage: Some("sqlite3"),
    read,
};

/// Largest database decompressed, in bytes, into the folder for temporary files.
const MAX_UNPACKED_BYTES: u64 = 64 << 30;
/// Topics and types accepted, each.
const MAX_TOPICS: usize = u16::MAX as usize;
/// Bytes of the header of a database.
const HEADER_BYTES: usize = 100;
/// Steps of SQLite's virtual machine between two checks of their number.
const STEPS: i32 = 1 << 20;
/// Steps allowed per byte of the file, and in any case: a row takes about ten steps, and at least six bytes.
const STEPS_PER_BYTE: u64 = 16;
const STEPS_FOR_ANY: u64 = 32 << 20;

fn read(input: Input<'_>, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
    let mut database = match input.file {
        Some(path) => Database::of_file(path),
        None => Database::of_stream(input.stream),
    }
    .map_err(StreamError::at_start)?;
    database.read(visit)
}

/// A database opened for reading.
struct Database {
    connection: Connection,
    bytes: u64,
    /// Why its end is missing, if it is.
    cut: Option<String>,
    /// The copy, if one was made.
    _copy: Option<Copied>,
}

/// Removed when dropped.
enum Copied {
    File { _file: NamedTempFile },
    Folder { _folder: TempDir },
}

impl Database {
    fn of_file(path: &Path) -> Result<Self, StreamProblem> {
        // A recorder that was killed leaves the last messages in a file beside the database. SQLite would
        // merge them into it, so that is done with a copy.
        let sidecars: Vec<PathBuf> = ["-wal", "-journal"]
            .into_iter()
            .map(|ending| {
                let mut name = path.as_os_str().to_owned();
                name.push(ending);
                PathBuf::from(name)
            })
            .filter(|path| path.metadata().is_ok_and(|file| file.is_file() && file.len() > 0))
            .collect();
        if sidecars.is_empty() {
            return Self::open(path, None, None);
        }
        let folder = tempfile::tempdir()?;
        let mut copy = PathBuf::new();
        for from in std::iter::once(path).chain(sidecars.iter().map(PathBuf::as_path)) {
            let to = folder.path().join(from.file_name().unwrap_or_default());
            std::fs::copy(from, &to)?;
            if from == path {
                copy = to;
            }
        }
        Self::open(&copy, None, Some(Copied::Folder { _folder: folder }))
    }

    fn of_stream(mut stream: impl Read) -> Result<Self, StreamProblem> {
        let mut file = NamedTempFile::new()?;
        let mut header = Vec::new();
        let outcome = stream.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut header);
        file.write_all(&header)?;
        let declared = Header::of(&header).map_or(0, |header| header.page_size * header.pages);
        if declared > MAX_UNPACKED_BYTES {
            return Err(StreamProblem::DatabaseTooLarge { declared, limit: MAX_UNPACKED_BYTES });
        }
        let limit = if declared == 0 { MAX_UNPACKED_BYTES } else { declared };
        let rest = limit.saturating_sub(HEADER_BYTES as u64);
        let outcome = outcome.and_then(|_| io::copy(&mut stream.take(rest), file.as_file_mut()));
        let cut = match outcome {
            Ok(_) => None,
            Err(error) => Some(damage(&error).ok_or(error)?),
        };
        let path = file.path().to_owned();
        Self::open(&path, cut, Some(Copied::File { _file: file }))
    }

    fn open(path: &Path, cut: Option<String>, copy: Option<Copied>) -> Result<Self, StreamProblem> {
        let mut file = File::open(path)?;
        let bytes = file.metadata()?.len();
        let mut header = Vec::new();
        Read::by_ref(&mut file).take(HEADER_BYTES as u64).read_to_end(&mut header)?;
        let declared = Header::of(&header).map_or(0, |header| header.page_size * header.pages);
        let is_cut = bytes < declared;
        let is_merging = matches!(copy, Some(Copied::Folder { .. }));
        let mut connection = match is_merging {
            true => Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?,
            false => {
                let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI;
                Connection::open_with_flags(unchanging(path), flags)?
            }
        };
        let budget = STEPS_FOR_ANY + bytes.saturating_mul(STEPS_PER_BYTE);
        let mut left = budget / STEPS as u64;
        let is_over = move || {
            left = left.saturating_sub(1);
            left == 0
        };
        connection.progress_handler(STEPS, Some(is_over))?;
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES as i32)?;
        for (setting, value) in [
            (DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false),
            (DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false),
            (DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false),
            // Otherwise SQLite refuses a file that is shorter than stated as a whole.
            (DbConfig::SQLITE_DBCONFIG_WRITABLE_SCHEMA, is_cut),
        ] {
            connection.set_db_config(setting, value)?;
        }
        connection.execute_batch(
            "PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA cache_size = -8192;",
        )?;
        let cut = match cut {
            Some(reason) => Some(format!("{reason} after {bytes} of {declared} unpacked bytes")),
            None => {
                is_cut.then(|| format!("the file has {bytes} bytes, its header says {declared}"))
            }
        };
        Ok(Database { connection, bytes, cut, _copy: copy })
    }

    fn read(&mut self, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
        let mut topics = self.topics(visit).map_err(StreamError::at_start)?;
        for topic in topics.values_mut() {
            topic.wanted = visit(Item::Channel(&topic.channel)).map_err(StreamError::at_start)?;
        }
        let mut rows = Rows::default();
        let end = self.messages(&mut topics, &mut rows, visit);
        match end {
            Ok(()) => Ok(self
                .cut
                .take()
                .map(|cut| format!("{cut}; the messages that are there are used"))),
            Err(Stop::Damage(reason)) => {
                let reason = self.cut.take().unwrap_or(reason);
                Ok(Some(match rows.used {
                    Some(row) => format!("{reason}; the messages up to row {row} are used"),
                    None => format!("{reason}; no message can be read"),
                }))
            }
            Err(Stop::Problem(problem)) => {
                Err(StreamError { position: Position::Row(rows.current), problem })
            }
        }
    }

    /// Whether there is a table of this name, which must be an ordinary table and not a view or virtual.
    fn has_table(&self, name: &str) -> Result<bool, StreamProblem> {
        let found = self.connection.query_row(
            "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = ?1 AND rootpage > 0",
            [name],
            |row| row.get::<_, i64>(0),
        )?;
        Ok(found > 0)
    }

    /// The topics by the id that messages refer to.
    fn topics(&self, visit: &mut Visit<'_>) -> Result<BTreeMap<i64, Topic>, StreamProblem> {
        for table in ["topics", "messages"] {
            if !self.has_table(table)? {
                return Err(StreamProblem::NoTable(table));
            }
        }
        let mut descriptions = BTreeMap::new();
        if self.has_table("message_definitions")? {
            let columns = "topic_type, encoding, encoded_message_definition";
            self.rows("message_definitions", columns, visit, |row| {
                let language = text(row, 2, "encoding")?;
                let description = text(row, 3, "encoded_message_definition")?;
                let name = text(row, 1, "topic_type")?;
                descriptions.insert(name, (language, description.into_bytes()));
                Ok(())
            })?;
        }
        let mut topics = BTreeMap::new();
        self.rows("topics", "id, name, type, serialization_format", visit, |row| {
            let number = integer(row, 1, "id")?;
            let name = text(row, 3, "type")?;
            let (encoding, data) = descriptions.get(&name).cloned().unwrap_or_default();
            // Recorders that do not find a description write "unknown".
            let encoding = if data.is_empty() { String::new() } else { encoding };
            let channel = Channel {
                id: topics.len() as u32,
                topic: text(row, 2, "name")?,
                message_encoding: text(row, 4, "serialization_format")?,
                schema: Some(Arc::new(SchemaText { name, encoding, data })),
            };
            topics.insert(number, Topic { channel, messages: 0, wanted: Wanted::Shown });
            Ok(())
        })?;
        Ok(topics)
    }

    /// Passes on the rows of a table with a row for each topic or type; their id comes before the columns.
    fn rows(
        &self,
        table: &'static str,
        columns: &str,
        visit: &mut Visit<'_>,
        mut take: impl FnMut(&Row<'_>) -> Result<(), Fault>,
    ) -> Result<(), StreamProblem> {
        let query = format!("SELECT rowid, {columns} FROM {table} NOT INDEXED");
        let mut statement = self.connection.prepare(&query)?;
        let mut rows = statement.query([])?;
        let mut count = 0;
        while let Some(row) = rows.next()? {
            count += 1;
            if count > MAX_TOPICS {
                return Err(StreamProblem::Database {
                    table,
                    found: format!("has more than {MAX_TOPICS} rows"),
                });
            }
            let number = row.get(0)?;
            match take(row) {
                Ok(()) => {}
                Err(Fault::Sqlite(error)) => return Err(error.into()),
                Err(Fault::Value(fault)) => fault.report(table, number, visit)?,
            }
        }
        Ok(())
    }

    fn messages(
        &self,
        topics: &mut BTreeMap<i64, Topic>,
        at: &mut Rows,
        visit: &mut Visit<'_>,
    ) -> Result<(), Stop> {
        // The data comes last in a row, and is not read unless selected.
        let query = "SELECT rowid, topic_id, timestamp, length(data) FROM messages NOT INDEXED";
        let mut statement = self.connection.prepare(query).map_err(Stop::of)?;
        let of_row = "SELECT data FROM messages NOT INDEXED WHERE rowid = ?1";
        let mut of_row = self.connection.prepare(of_row).map_err(Stop::of)?;
        let mut rows = statement.query([]).map_err(Stop::of)?;
        let mut left = self.bytes;
        while let Some(row) = rows.next().map_err(Stop::of)? {
            let number = row.get(0).map_err(Stop::of)?;
            at.current = number;
            if at.used.is_some_and(|used| number <= used) {
                return Err(Stop::Damage(format!("row {number} occurs twice")));
            }
            let length: Option<i64> = row.get(3).map_err(Stop::of)?;
            left = left.checked_sub(length.map_or(0, i64::unsigned_abs)).ok_or_else(|| {
                Stop::Damage("the messages take more bytes than the file has".to_owned())
            })?;
            let head = integer(row, 1, "topic_id").and_then(|topic| {
                let log_time = integer(row, 2, "timestamp")?;
                let found = topic.to_string();
                let expected = "the number of a topic that can be read";
                let known = topics.get_mut(&topic);
                let known = known.ok_or(WrongValue { field: "topic_id", found, expected })?;
                Ok((known, log_time))
            });
            let (topic, log_time) = match head {
                Ok(head) => head,
                Err(Fault::Sqlite(error)) => return Err(Stop::of(error)),
                Err(Fault::Value(fault)) => {
                    at.used = Some(number);
                    fault.report("messages", number, visit)?;
                    continue;
                }
            };
            let sequence = topic.messages;
            topic.messages = sequence.wrapping_add(1);
            let channel = &topic.channel;
            let log_time = u64::try_from(log_time).unwrap_or(0);
            if topic.wanted == Wanted::Counted {
                at.used = Some(number);
                let passed = Passed { channel, count: 1, log_times: (log_time, log_time) };
                topic.wanted = visit(Item::Passed(passed))?;
                continue;
            }
            let mut found = of_row.query([number]).map_err(Stop::of)?;
            let row = found.next().map_err(Stop::of)?;
            let data = match row.map(|row| row.get_ref(0)).transpose().map_err(Stop::of)? {
                Some(ValueRef::Blob(data)) => data,
                Some(ValueRef::Null) => &[],
                Some(other) => {
                    at.used = Some(number);
                    WrongValue::of("data", &other, "a BLOB").report("messages", number, visit)?;
                    continue;
                }
                None => {
                    return Err(Stop::Damage(format!("row {number} is not where it should be")));
                }
            };
            at.used = Some(number);
            topic.wanted = visit(Item::Message(Message {
                channel,
                sequence,
                log_time,
                publish_time: log_time,
                data,
                position: Position::Row(number),
            }))?;
        }
        Ok(())
    }
}

/// How far the table of messages is read.
#[derive(Default)]
struct Rows {
    current: i64,
    /// The last row that was passed on.
    used: Option<i64>,
}

struct Topic {
    channel: Channel,
    messages: u32,
    wanted: Wanted,
}

/// Why reading of messages stops.
enum Stop {
    /// The database is damaged or truncated: what came before counts.
    Damage(String),
    Problem(StreamProblem),
}

impl From<StreamProblem> for Stop {
    fn from(problem: StreamProblem) -> Self {
        Stop::Problem(problem)
    }
}

impl Stop {
    fn of(error: rusqlite::Error) -> Self {
        match error.sqlite_error_code() {
            Some(
                ErrorCode::DatabaseCorrupt
                | ErrorCode::NotADatabase
                | ErrorCode::TooBig
                | ErrorCode::OperationInterrupted,
            ) => Stop::Damage(describe(&error)),
            _ => Stop::Problem(error.into()),
        }
    }
}

fn describe(error: &rusqlite::Error) -> String {
    match error.sqlite_error_code() {
        Some(ErrorCode::OperationInterrupted) => {
            "the database takes more steps to read than its size allows for, so it is damaged"
                .to_owned()
        }
        Some(ErrorCode::TooBig) => {
            format!("a row is longer than {MAX_CHUNK_BYTES} bytes, or claims to be")
        }
        _ => format!("the database is damaged ({error})"),
    }
}

impl From<rusqlite::Error> for StreamProblem {
    fn from(error: rusqlite::Error) -> Self {
        StreamProblem::Sqlite(describe(&error))
    }
}

/// The size fields in the header of a database.
struct Header {
    page_size: u64,
    pages: u64,
}

impl Header {
    fn of(bytes: &[u8]) -> Option<Self> {
        let u32_at = |at: usize| Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?));
        let page_size = match u16::from_be_bytes(*bytes.get(16..)?.first_chunk()?) {
            1 => 1 << 16,
            size => u64::from(size),
        };
        // Old versions of SQLite do not update the number of pages; then these two differ.
        let is_valid = u32_at(24)? == u32_at(92)?;
        Some(Header { page_size, pages: if is_valid { u64::from(u32_at(28)?) } else { 0 } })
    }
}

/// A URI that makes SQLite treat the file as immutable: it looks for no other file.
fn unchanging(path: &Path) -> String {
    let mut address = String::from("file:");
    for &byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' => {
                address.push(char::from(byte));
            }
            _ => address += &format!("%{byte:02x}"),
        }
    }
    address + "?immutable=1"
}

/// A value of a row with another type than its column should have.
struct WrongValue {
    field: &'static str,
    found: String,
    expected: &'static str,
}

impl WrongValue {
    fn of(field: &'static str, found: &ValueRef<'_>, expected: &'static str) -> Self {
        WrongValue { field, found: format!("of type {}", found.data_type()), expected }
    }

    fn report(
        &self,
        table: &'static str,
        number: i64,
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        let WrongValue { field, found, expected } = self;
        let position = Position::Row(number);
        visit(Item::Damaged(Damaged { table, position, field, found, expected }))?;
        Ok(())
    }
}

/// Why a row could not be read.
enum Fault {
    Value(WrongValue),
    Sqlite(rusqlite::Error),
}

impl From<WrongValue> for Fault {
    fn from(fault: WrongValue) -> Self {
        Fault::Value(fault)
    }
}

impl From<rusqlite::Error> for Fault {
    fn from(error: rusqlite::Error) -> Self {
        Fault::Sqlite(error)
    }
}

fn integer(row: &Row<'_>, index: usize, column: &'static str) -> Result<i64, Fault> {
    match row.get_ref(index)? {
        ValueRef::Integer(value) => Ok(value),
        other => Err(WrongValue::of(column, &other, "INTEGER").into()),
    }
}

fn text(row: &Row<'_>, index: usize, column: &'static str) -> Result<String, Fault> {
    match row.get_ref(index)? {
        ValueRef::Text(text) => Ok(String::from_utf8_lossy(text).into_owned()),
        other => Err(WrongValue::of(column, &other, "TEXT").into()),
    }
}

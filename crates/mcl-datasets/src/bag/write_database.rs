//! Writes databases of rosbag2 in the layout of its storage plugin `sqlite3`.

use std::fs::File;
use std::io::{self, Write};

use rusqlite::{Connection, params};
use tempfile::TempDir;

use super::encode::Encoder;
use super::sink::{Delivery, Sink, TopicId, WriteBagError, qos};
use super::types::MessageType;

const NAME: &str = "bag.db3";
/// Version 4 of the schema, since 2023. A database with a single user needs no journal.
const TABLES: &str = "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN;
    CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
    INSERT INTO schema VALUES (4, '');
    CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
        serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
        type_description_hash TEXT NOT NULL);
    CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,
        encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,
        type_description_hash TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
        data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);";

/// Writes a database. SQLite writes to files only, so it is kept in a temporary folder.
pub(super) struct DatabaseWriter {
    folder: TempDir,
    database: Connection,
    topics: u16,
    types: Vec<&'static str>,
}

impl From<rusqlite::Error> for WriteBagError {
    fn from(error: rusqlite::Error) -> Self {
        WriteBagError::Database(error.to_string())
    }
}

impl DatabaseWriter {
    pub fn new() -> Result<Self, WriteBagError> {
        let folder = tempfile::tempdir()?;
        let database = Connection::open(folder.path().join(NAME))?;
        database.execute_batch(TABLES)?;
        Ok(DatabaseWriter { folder, database, topics: 0, types: Vec::new() })
    }

    /// Finishes the database, and copies it to the sink.
    pub fn finish<W: Write>(self, mut sink: W) -> Result<W, WriteBagError> {
        self.database.execute_batch("COMMIT;")?;
        self.database.close().map_err(|(_, error)| error)?;
        io::copy(&mut File::open(self.folder.path().join(NAME))?, &mut sink)?;
        sink.flush()?;
        Ok(sink)
    }
}

impl Sink for DatabaseWriter {
    fn topic(
        &mut self,
        name: &str,
        message: &MessageType,
        delivery: Delivery,
    ) -> Result<TopicId, WriteBagError> {
        self.topics += 1;
        let insert = "INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr', ?4, '')";
        self.database.execute(insert, params![self.topics, name, message.name, qos(delivery)])?;
        if !self.types.contains(&message.name) {
            self.types.push(message.name);
            let insert = "INSERT INTO message_definitions VALUES (NULL, ?1, 'ros2msg', ?2, '')";
            self.database.execute(insert, params![message.name, message.description()])?;
        }
        Ok(TopicId(self.topics))
    }

    fn message(
        &mut self,
        topic: TopicId,
        log_time: u64,
        message: Encoder,
    ) -> Result<(), WriteBagError> {
        let log_time = i64::try_from(log_time).unwrap_or(i64::MAX);
        let mut insert = self.database.prepare("INSERT INTO messages VALUES (NULL, ?1, ?2, ?3)")?;
        insert.execute(params![topic.0, log_time, message.into_bytes()])?;
        Ok(())
    }
}

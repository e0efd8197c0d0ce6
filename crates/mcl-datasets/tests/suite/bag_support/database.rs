//! The same messages as a database of rosbag2.

use std::path::Path;

use rusqlite::{Connection, params};

use super::Entry;

/// Writes a database of these messages; with the descriptions of their types, as since 2023, or without.
pub fn write_database(path: &Path, entries: &[Entry], has_descriptions: bool) {
    let database = Connection::open(path).unwrap();
    database
        .execute_batch(
            "PRAGMA page_size = 1024; PRAGMA journal_mode = MEMORY; BEGIN;
             CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
                serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, \
                timestamp INTEGER NOT NULL, data BLOB NOT NULL);
             CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
        )
        .unwrap();
    if has_descriptions {
        database
            .execute_batch(
                "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, \
                 encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL);",
            )
            .unwrap();
    }
    let mut topics: Vec<&str> = Vec::new();
    for entry in entries {
        if !topics.contains(&entry.topic) {
            topics.push(entry.topic);
            let insert = "INSERT INTO topics VALUES (?1, ?2, ?3, ?4, '')";
            let row = params![topics.len() as i64, entry.topic, entry.schema.0, entry.encoding];
            database.execute(insert, row).unwrap();
            if has_descriptions {
                let insert = "INSERT INTO message_definitions VALUES (NULL, ?1, ?2, ?3)";
                let text = std::str::from_utf8(&entry.schema.2).unwrap();
                database.execute(insert, params![entry.schema.0, entry.schema.1, text]).unwrap();
            }
        }
        let topic = topics.iter().position(|topic| *topic == entry.topic).unwrap() as i64 + 1;
        let row = params![topic, entry.log_time as i64, entry.data];
        database.execute("INSERT INTO messages VALUES (NULL, ?1, ?2, ?3)", row).unwrap();
    }
    database.execute_batch("COMMIT;").unwrap();
    database.close().unwrap();
}

/// The bytes of such a database.
pub fn database(entries: &[Entry], has_descriptions: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    write_database(&path, entries, has_descriptions);
    std::fs::read(path).unwrap()
}

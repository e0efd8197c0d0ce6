//! Containers of messages: MCAP, ROS 1 bags, and rosbag2's SQLite databases.
//!
//! A container does not interpret messages: it yields topics (with the names and descriptions of their types,
//! as far as it holds them) and encoded messages, one after the other. Formats are recognized by their first
//! bytes. To add one, write its file and a line in [`CONTAINERS`].

pub(crate) mod chunk;
pub mod folder;
#[cfg(feature = "bags")]
mod index;
#[cfg(feature = "bags")]
mod input;
pub mod item;
#[cfg(not(feature = "sqlite"))]
mod left_out;
#[cfg(feature = "bags")]
pub mod mcap;
pub mod position;
pub mod problem;
#[cfg(feature = "bags")]
pub(crate) mod ros1;
#[cfg(feature = "sqlite")]
mod sqlite;

use std::io::BufRead;

use item::{Container, Input, Visit};
use problem::{StreamError, StreamProblem};

#[cfg(not(feature = "sqlite"))]
use left_out::sqlite;
#[cfg(not(feature = "bags"))]
use left_out::{mcap, ros1};

/// All formats that are recognized. Those not compiled into this build give an error that names the feature.
pub static CONTAINERS: &[&Container] = &[&mcap::CONTAINER, &ros1::CONTAINER, &sqlite::CONTAINER];

/// The container that begins with these bytes; also for a file that ends within its magic bytes, or before
/// them.
pub fn of(head: &[u8]) -> Option<&'static Container> {
    CONTAINERS.iter().copied().find(|container| {
        let length = head.len().min(container.magic.len());
        head[..length] == container.magic[..length]
    })
}

/// Reads a container of any format; see [`item::Read`].
///
/// # Errors
/// [`StreamError`] for bytes that are not a container or are damaged, and the errors of `visit`.
pub fn read(mut input: Input<'_>, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
    let head = input.stream.fill_buf().map_err(StreamError::at_start)?;
    match of(head) {
        Some(container) => (container.read)(input, visit),
        None => Err(StreamError::at_start(StreamProblem::Magic)),
    }
}

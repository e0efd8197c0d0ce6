//! Placeholders for formats that this build was compiled without. They are recognized, so that the error
//! names the feature.

#[cfg(not(feature = "bags"))]
pub mod mcap {
    /// MCAP.
    pub static CONTAINER: super::Container = super::Container {
        name: "MCAP",
        magic: b"\x89MCAP0\r\n",
        ending: "mcap",
        storage: Some("mcap"),
        read: |_, _| super::left_out("MCAP files", "bags"),
    };
}

#[cfg(not(feature = "bags"))]
pub mod ros1 {
    /// Bags of ROS 1.
    pub static CONTAINER: super::Container = super::Container {
        name: "ROS 1 bag",
        magic: b"#ROSBAG V2.0\n",
        ending: "bag",
        storage: None,
        read: |_, _| super::left_out("ROS 1 bags", "bags"),
    };
}

pub mod sqlite {
    /// Databases of rosbag2.
    pub static CONTAINER: super::Container = super::Container {
        name: "rosbag2 database",
        magic: b"SQLite format 3\0",
        ending: "db3",
        storage: Some("sqlite3"),
        read: |_, _| super::left_out("databases (.db3)", "sqlite"),
    };
}

use super::item::Container;
use super::problem::{StreamError, StreamProblem};

fn left_out(format: &'static str, feature: &'static str) -> Result<Option<String>, StreamError> {
    Err(StreamError::at_start(StreamProblem::LeftOut { format, feature }))
}

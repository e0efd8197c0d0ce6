//! The tests of the crate as one program: each further one would be linked on its own.

mod bag_clouds;
mod bag_damage;
mod bag_database;
mod bag_index;
mod bag_others;
mod bag_poses;
mod bag_read;
mod bag_ros1;
mod bag_round_trip;
mod bag_support;
mod carmen_field_cases;
mod carmen_kinds;
mod carmen_records;
mod carmen_write;
mod field_cases;
mod field_cases_beams;
mod field_cases_names;
mod field_cases_time;
mod field_cases_tree;
mod http_server;
mod open_log;
mod real_logs;
mod registry;
mod registry_fetch;
mod support;

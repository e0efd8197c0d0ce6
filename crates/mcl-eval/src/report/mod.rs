//! The report: one page for the content of result folders. [`gather`] reads folder after folder, and [`page`]
//! makes a single HTML file that sends no request to any server. Everything on it is from rows or, where
//! there are no rows (as in folders that are committed), from the tables beside them.

pub mod answer;
pub mod at_hand;
pub mod compare_maps;
pub mod exhibits;
pub mod files;
pub mod folder;
pub mod gather;
pub mod localized;
pub mod matrix;
pub mod pack;
pub mod page;
pub mod payload;
pub mod record;
pub mod slot;
pub mod text;
pub mod watch;

//! Studies: what is compared, on which data, and how it is measured.
//!
//! Everything that is compared is a row of one tidy table. A [`recipe`] defines how a map is built and how a
//! robot is localized on it; a *trial* is a map and the runs on it; measures ([`measure`]) are computed of
//! either. A [`study`] is a file that lists recipes, measures, and the views that its tables and figures
//! show.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod auto;
pub mod data;
pub mod localizer;
pub mod measure;
pub mod recipe;
pub mod run;
pub mod share;
pub mod store;
pub mod study;
pub mod table;
pub mod trial;
pub mod view;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

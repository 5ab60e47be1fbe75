//! The walkthrough viewer: `voxsight view`.
//!
//! # The map, in the order data flows
//!
//! [`load`] opens a scene, or makes one of a model, on a thread of its own. [`document`] is the opened scene and what a user has done
//! with it: what is hidden, looked through, moved, cut, selected; every change can be undone. [`tree`] lists the assembly's rows,
//! [`search`] finds nodes as one types. [`navigate`] moves the camera; [`pick`] finds what is under the cursor, [`measure`] measures
//! it, [`handles`] drag it, the [`cube`] shows and chooses where one looks from (all project with `screen`). [`bookmarks`], [`route`] and [`preferences`] are what is kept on disk.
//!
//! A [`session`] is all of that for one scene; an [`action`] is what a user, a button or a line of a script can ask of it. None of
//! these knows a window.
//!
//! [`app`] is the window: [`panels`] around the [`viewport`], which asks [`crate::walkthrough`] for frames; a [`script`] does without
//! hands.

pub mod action;
pub mod app;
pub mod bookmarks;
pub mod cube;
pub mod document;
pub mod handles;
pub mod load;
pub mod measure;
pub mod navigate;
pub mod panels;
pub mod pick;
pub mod preferences;
pub mod route;
mod screen;
pub mod script;
pub mod search;
pub mod session;
pub mod tree;
pub mod viewport;

pub use app::{Interrupt, ViewerError, ViewerOptions, run};

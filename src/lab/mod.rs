//! The accuracy laboratory: what each way of culling costs, and what it loses, over many views of a scene.
//!
//! In the order of a comparison:
//!
//! - [`views`] draws seeded views inside the model, [`walk`] a seeded path through it, [`keyframes`] reads a path from
//!   a file; [`space`] tells them where there is room.
//! - [`methods`] lists what can be compared; a line each.
//! - [`run`] asks the reference and every method, times them, and counts both errors ([`crate::visibility::Accuracy`])
//!   and which parts were [`lost`].
//! - [`statistics`] makes distributions over views of these figures, [`report`] everything that is told.
//! - [`csv`], [`plots`] ([`chart`], [`svg`]), [`picture`] and [`page`] ([`html`]) write it down; [`folder`] puts it into
//!   a folder, all of it or nothing.
//!
//! The same scene, settings and seed give the same report but for times, which have fields of their own.

pub mod chart;
pub mod csv;
pub mod folder;
pub mod html;
pub mod keyframes;
pub mod lost;
pub mod methods;
pub mod page;
pub mod picture;
pub mod plots;
pub mod report;
pub mod run;
pub mod shadows;
pub mod space;
pub mod statistics;
pub mod svg;
pub mod views;
pub mod walk;

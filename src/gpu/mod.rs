//! The GPU runtime: pages of quantized geometry in one memory, decoded by the vertex shader, into a deferred picture.
//!
//! # The map, in the order data flows
//!
//! [`context`] (adapter, device, errors) -> [`memory`] (where [`streaming`](crate::streaming) puts pages) -> [`instance`] (what a
//! frame draws, relative to the eye) and [`view`] (its camera), `clip` (what is cut away) -> `geometry` (`pages` into depth,
//! drawable, normal, colour: [`target`]) -> [`shadow`] (rays through the [`dag`], but for voxels that are [`clear`]; its [`twin`]
//! on the CPU) -> `glass` -> `shade` ([`light`] on it, [`marks`] around what is selected). [`frame`] does all of a frame, [`timer`]
//! tells what each pass took.
//!
//! [`query`] asks what is visible, on the GPU too: rays through the [`dag`], then the [`owners`] of the voxels they meet. [`check`] compares
//! a frame with what `exact` sees.
//!
//! Shader texts are in `shaders/`, put together by [`shader`]. Structures that both sides read have the same names and fields; a
//! test compares their layouts.

pub mod check;
pub mod clear;
mod clip;
pub mod context;
pub mod dag;
pub mod frame;
mod geometry;
mod glass;
pub mod instance;
pub mod light;
pub mod marks;
pub mod memory;
pub mod owners;
mod pages;
pub mod query;
mod shade;
pub mod shader;
pub mod shadow;
pub mod target;
pub mod timer;
pub mod twin;
pub mod view;

pub use context::{Context, ContextSettings, GpuError};

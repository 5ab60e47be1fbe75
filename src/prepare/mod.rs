//! prepare
mod chunk;
mod deviation;
pub mod localise;
mod lod;
pub mod part;
mod quantize;
mod weld;

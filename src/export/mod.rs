//! Writing models in formats that other programs read.

pub mod glb;
mod glb_json;

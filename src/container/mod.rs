//! The container file (`.vxs`): layout, writing, checked reading.
//!
//! Writing: [`part::encode_part`] packs a part (in parallel), [`part::GeometryWriter`] streams it to a
//! [`write::ContainerWriter`], [`tree::SceneRecords`] makes the records of the rest, and nothing is at the target's
//! place until [`write::ContainerWriter::finish`] renames the complete file.
//!
//! Reading: [`Container::open`] trusts nothing. Every offset, count and index is checked once (`check`); after that
//! sections are read in place. [`verify()`] decodes the geometry, too.

mod check;
pub mod error;
pub mod layout;
mod map;
pub mod meta;
pub mod page;
pub mod part;
pub mod read;
mod table;
pub mod tree;
pub mod verify;
mod voxels;
pub mod write;

pub use error::{ContainerError, Damage, Problem};
pub use meta::{
    Axis, Bounds, BuildReport, Counts, DagMeta, Generator, GridMeta, Meta, ReferredFile, Settings, Source,
};
pub use part::{EncodedPart, GeometryRecords, GeometryWriter, PartError, encode_part};
pub use read::Container;
pub use tree::SceneRecords;
pub use verify::{VerifyReport, verify};
pub use write::ContainerWriter;

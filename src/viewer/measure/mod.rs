//! Measuring: what of a part is near the cursor, and what lies between two such points.

mod features;
mod measurement;
mod snap;

pub use features::Features;
pub use measurement::{LengthUnit, Measurement};
pub use snap::{Snap, SnapKind, SnapView, snap};

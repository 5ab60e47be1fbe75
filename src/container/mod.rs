//! The container file (`.vxs`): layout, writing, checked reading.

pub mod layout;

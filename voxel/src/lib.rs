//! The CPU voxel core of Voxsight.

//! What is under the cursor: first in the image of drawables that was drawn, then exactly, by rays through triangles.

mod image;
mod refine;

pub use image::{PickError, PickImage, PixelPick, pick_pixel, pick_rectangle};
pub use refine::{Picked, refine};

//! Depth images.

use crate::occlusion::view::FARTHEST;

/// Pixels that a fill may write beyond the right and the lower border.
const BEYOND_RIGHT: usize = 15;
const BEYOND_BOTTOM: usize = 3;

/// Nearness of every pixel ([`crate::occlusion::view`]).
#[derive(Clone, Debug)]
pub struct DepthImage {
    width: u32,
    height: u32,
    /// From one row to the next; rows have room beyond the right border, whose values mean nothing.
    pub(super) stride: usize,
    pub(super) texels: Vec<f32>,
    /// Rows that may hold something: from, to before.
    pub(super) touched: (usize, usize),
}

impl DepthImage {
    /// With nothing in it.
    pub fn new(width: u32, height: u32) -> Self {
        let stride = (width as usize + BEYOND_RIGHT).next_multiple_of(16);
        let rows = height as usize + BEYOND_BOTTOM;
        let texels = vec![FARTHEST; stride * rows + BEYOND_RIGHT];
        DepthImage { width, height, stride, texels, touched: (rows, 0) }
    }

    /// Columns, rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The nearness of a pixel: never nearer than the nearest triangle over its centre.
    #[inline]
    pub fn at(&self, column: u32, row: u32) -> f32 {
        self.row(row)[column as usize]
    }

    /// A row of pixels.
    #[inline]
    pub fn row(&self, row: u32) -> &[f32] {
        let start = row as usize * self.stride;
        &self.texels[start..start + self.width as usize]
    }

    /// Makes it `width` x `height` and empty. Costs only what was drawn where the size stays.
    pub fn clear(&mut self, width: u32, height: u32) {
        if self.size() != (width, height) {
            *self = DepthImage::new(width, height);
            return;
        }
        let (from, to) = self.touched;
        if from < to {
            self.texels[from * self.stride..to * self.stride].fill(FARTHEST);
            self.touched = (self.height as usize + BEYOND_BOTTOM, 0);
        }
        // What a fill wrote beyond the last row stays: it means nothing.
    }

    /// Rows `from..=to` are about to be written.
    #[inline(always)]
    pub(super) fn touch(&mut self, from: usize, to: usize) {
        self.touched = (self.touched.0.min(from), self.touched.1.max(to + 1));
    }
}

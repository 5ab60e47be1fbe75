//! The hierarchical Z-map: ever coarser images of the farthest depth (Greene et al. 1993; Peng and Cao 2013, section 6.3).
//!
//! Level l + 1 has half the columns and rows of level l, rounded down; what is left over belongs to the last texel, so that
//! pixel x is in texel min(x >> l, width_l - 1) of any level, whatever the size of the image.

use rayon::prelude::*;

use super::boxes::ScreenBox;
use super::raster::DepthImage;
use super::view::FARTHEST;

/// A depth image and its coarser levels.
#[derive(Clone, Debug)]
pub struct Pyramid {
    pixels: DepthImage,
    /// Level 1 and on, down to one texel.
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    texels: Vec<f32>,
}

/// Rows of a level that a thread makes at a time.
const BAND: usize = 16;
/// Levels of fewer texels are made by one thread.
const ALONE_BELOW: usize = 1 << 14;

impl Pyramid {
    /// Over an empty image.
    pub fn new(width: u32, height: u32) -> Self {
        let mut pyramid = Pyramid { pixels: DepthImage::new(width, height), levels: Vec::new() };
        pyramid.shape();
        pyramid
    }

    fn shape(&mut self) {
        let (width, height) = self.pixels.size();
        let (mut width, mut height) = (width as usize, height as usize);
        self.levels.clear();
        while width > 1 || height > 1 {
            (width, height) = ((width / 2).max(1), (height / 2).max(1));
            self.levels.push(Level { width, height, texels: vec![FARTHEST; width * height] });
        }
    }

    /// Empties the image, of this size from now on. The levels follow with [`Pyramid::build`].
    pub fn clear(&mut self, width: u32, height: u32) {
        let reshape = self.pixels.size() != (width, height);
        self.pixels.clear(width, height);
        if reshape {
            self.shape();
        }
    }

    /// Level 0.
    pub fn pixels(&self) -> &DepthImage {
        &self.pixels
    }

    /// Level 0, to draw into; [`Pyramid::build`] brings the others up to date.
    pub fn pixels_mut(&mut self) -> &mut DepthImage {
        &mut self.pixels
    }

    /// Levels, the pixels among them.
    pub fn level_count(&self) -> u32 {
        self.levels.len() as u32 + 1
    }

    /// Columns and rows of a level.
    pub fn level_size(&self, level: u32) -> (u32, u32) {
        match self.coarse(level) {
            None => self.pixels.size(),
            Some(level) => (level.width as u32, level.height as u32),
        }
    }

    /// The farthest of the pixels of a texel.
    #[inline]
    pub fn texel(&self, level: u32, column: u32, row: u32) -> f32 {
        match self.coarse(level) {
            None => self.pixels.at(column, row),
            Some(level) => level.texels[row as usize * level.width + column as usize],
        }
    }

    #[inline]
    fn coarse(&self, level: u32) -> Option<&Level> {
        self.levels.get((level as usize).checked_sub(1)?)
    }

    /// Makes all levels from the pixels.
    pub fn build(&mut self) {
        let Pyramid { pixels, levels } = self;
        let mut finer: Option<&Level> = None;
        for level in levels {
            let finer_height = finer.map_or(pixels.size().1 as usize, |finer| finer.height);
            let finer_row = |row: usize| match finer {
                None => pixels.row(row as u32),
                Some(finer) => &finer.texels[row * finer.width..(row + 1) * finer.width],
            };
            let (width, height) = (level.width, level.height);
            let make = |(row, texels): (usize, &mut [f32])| {
                let rows = if row + 1 == height { finer_height - 2 * row } else { 2 };
                let second = if rows > 1 { finer_row(2 * row + 1) } else { finer_row(2 * row) };
                halve(finer_row(2 * row), second, texels);
                if rows > 2 {
                    let mut more = vec![FARTHEST; width];
                    halve(finer_row(2 * row + 2), second, &mut more);
                    texels.iter_mut().zip(&more).for_each(|(texel, other)| *texel = texel.min(*other));
                }
            };
            if width * height < ALONE_BELOW {
                level.texels.chunks_mut(width).enumerate().for_each(make);
            } else {
                level.texels.par_chunks_mut(width).with_min_len(BAND).enumerate().for_each(make);
            }
            finer = Some(level);
        }
    }

    /// Is everything within the box's pixels nearer than the box? `finer` levels below the one where the box spans at most
    /// 2 x 2 texels are asked where the answer there is no.
    #[inline]
    pub fn hides(&self, seen: &ScreenBox, finer: u32) -> bool {
        let level = self.level_of(seen);
        let (columns, rows) = self.texels(level, seen);
        self.hidden(level, columns, rows, seen, finer)
    }

    /// The finest level where the box spans at most 2 x 2 texels.
    fn level_of(&self, seen: &ScreenBox) -> u32 {
        let span = (seen.right - seen.left).max(seen.bottom - seen.top);
        // From n pixels on, two texels of n pixels suffice wherever they lie; half of that may do.
        let enough = if span <= 1 { 0 } else { u32::BITS - (span - 1).leading_zeros() };
        let enough = enough.min(self.level_count() - 1);
        let Some(finer) = enough.checked_sub(1) else { return enough };
        let (columns, rows) = self.texels(finer, seen);
        if columns.1 - columns.0 <= 1 && rows.1 - rows.0 <= 1 { finer } else { enough }
    }

    /// First and last column and row of the box's texels.
    #[inline]
    fn texels(&self, level: u32, seen: &ScreenBox) -> ((u32, u32), (u32, u32)) {
        let (width, height) = self.level_size(level);
        let of = |pixel: u32, size: u32| (pixel >> level).min(size - 1);
        ((of(seen.left, width), of(seen.right, width)), (of(seen.top, height), of(seen.bottom, height)))
    }

    fn hidden(
        &self,
        level: u32,
        columns: (u32, u32),
        rows: (u32, u32),
        seen: &ScreenBox,
        finer: u32,
    ) -> bool {
        for row in rows.0..=rows.1 {
            for column in columns.0..=columns.1 {
                if self.texel(level, column, row) > seen.nearest {
                    continue;
                }
                if finer == 0 || level == 0 {
                    return false;
                }
                // Its children, as far as the box reaches.
                let (all_columns, all_rows) = self.texels(level - 1, seen);
                let (width, height) = self.level_size(level);
                let last = |texel: u32, size: u32| if texel + 1 == size { u32::MAX } else { 2 * texel + 1 };
                let columns = (all_columns.0.max(2 * column), all_columns.1.min(last(column, width)));
                let rows = (all_rows.0.max(2 * row), all_rows.1.min(last(row, height)));
                if !self.hidden(level - 1, columns, rows, seen, finer - 1) {
                    return false;
                }
            }
        }
        true
    }
}

/// The least of 2 x 2 texels, of 3 x 2 in the last column of an odd row.
fn halve(first: &[f32], second: &[f32], texels: &mut [f32]) {
    if let ([only], [other], [texel]) = (first, second, &mut *texels) {
        *texel = only.min(*other);
        return;
    }
    let pairs = first.chunks_exact(2).zip(second.chunks_exact(2));
    for (texel, (a, b)) in texels.iter_mut().zip(pairs) {
        *texel = a[0].min(a[1]).min(b[0].min(b[1]));
    }
    if first.len() % 2 == 1
        && let (Some(texel), Some(a), Some(b)) = (texels.last_mut(), first.last(), second.last())
    {
        *texel = texel.min(a.min(*b));
    }
}

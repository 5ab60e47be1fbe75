//! Steps that both methods take in a frame.

use rayon::prelude::*;

use super::boxes::Sight;
use super::pyramid::Pyramid;
use super::raster::Rasterizer;
use super::scene::OcclusionScene;
use super::view::View;
use crate::filter::Filter;
use crate::visibility::VisibleSet;

/// Drawables that a thread tests at a time.
const AT_A_TIME: usize = 512;

/// Working memory of a method, kept from frame to frame.
#[derive(Debug)]
pub(super) struct Workspace {
    pub rasterizer: Rasterizer,
    pub pyramid: Pyramid,
    pub sights: Vec<Sight>,
}

impl Workspace {
    pub fn new() -> Self {
        Workspace { rasterizer: Rasterizer::default(), pyramid: Pyramid::new(1, 1), sights: Vec::new() }
    }

    /// Adds occluders to the depth image.
    pub fn draw(
        &mut self,
        scene: &OcclusionScene,
        occluders: impl IntoIterator<Item = u32>,
        view: &View,
        filter: &Filter,
    ) {
        scene.draw(&mut self.rasterizer, occluders, view, filter, self.pyramid.pixels_mut());
    }

    /// Keeps of `visible` those that the pyramid does not hide.
    pub fn test(&self, finer: u32, visible: &mut [bool]) {
        visible.par_iter_mut().zip(&self.sights).with_min_len(AT_A_TIME).for_each(|(visible, sight)| {
            if let (true, Sight::Covers(seen)) = (*visible, sight) {
                *visible = !self.pyramid.hides(seen, finer);
            }
        });
    }
}

/// The answer of a method that casts no rays.
pub(super) fn answer(visible: Vec<bool>) -> VisibleSet {
    VisibleSet { samples: vec![0; visible.len()], visible, ..VisibleSet::default() }
}

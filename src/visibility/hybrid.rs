//! The query `hybrid`: counts the nearest hits that [`super::nearest`] finds, which are those of `exact`.

use super::nearest::{TileHits, TileTracer};
use super::tally::Tally;
use super::{QueryScene, RayQuery};
use crate::ray::Ray;

pub(super) struct HybridQuery<'a>(TileTracer<'a>);

impl<'a> HybridQuery<'a> {
    pub fn new(scene: &QueryScene<'a>) -> Self {
        HybridQuery(TileTracer::new(scene))
    }
}

impl RayQuery for HybridQuery<'_> {
    type Scratch = TileHits;

    fn trace(&self, rays: &[Ray], tally: &mut Tally, hits: &mut TileHits) {
        self.0.trace(rays, hits);
        for (number, ray) in rays.iter().enumerate() {
            tally.count_ray(number, ray, hits.through(), hits.opaque(number));
        }
    }
}

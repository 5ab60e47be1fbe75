//! The query `exact`: triangles only, ray by ray. The reference.

use super::tally::{Passed, Tally};
use super::{QueryScene, RayQuery};
use crate::ray::Ray;

pub(super) struct ExactQuery<'a>(pub QueryScene<'a>);

impl RayQuery for ExactQuery<'_> {
    /// Hits with transparent drawables.
    type Scratch = Vec<Passed>;

    fn trace(&self, rays: &[Ray], tally: &mut Tally, through: &mut Vec<Passed>) {
        let ExactQuery(QueryScene { exact, filter, .. }) = self;
        for (number, ray) in rays.iter().enumerate() {
            through.clear();
            let opaque = exact.closest_through(ray, filter, |hit| {
                through.push(Passed { ray: number, drawable: hit.drawable, t: hit.t });
            });
            tally.count_ray(number, ray, through, opaque.map(|hit| (hit.drawable, hit.t)));
        }
    }
}

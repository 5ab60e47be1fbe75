//! The queries over frames on trial, and the query that spares rays: they cast rays of their own, which are no picture's
//! centres, and are asked after the same rays.

use voxsight::camera::CameraRays;
use voxsight::progress::Silent;
use voxsight::visibility::coherent::CoherentQuery;
use voxsight::visibility::culling::Culling;
use voxsight::visibility::{Method, QueryScene, QuerySettings, RayMethod, RaysPerPixel, VisibleSet, query};

/// Fractions of a ray in the counts of a coherent query of few rays.
const PER_RAY: u64 = 256;

/// The coherent methods, asked one camera after the other.
pub struct OverFrames {
    moving: Vec<(&'static str, Method, CoherentQuery)>,
    /// Frames that they have had since they were reset.
    frames: u32,
}

impl Default for OverFrames {
    fn default() -> Self {
        let of = |method| CoherentQuery::of(method, RaysPerPixel::ONE);
        OverFrames {
            moving: vec![
                ("coherent", Method::Hybrid, of(RayMethod::Hybrid)),
                ("coherent-voxel", Method::Voxel, of(RayMethod::Voxel)),
            ],
            frames: 0,
        }
    }
}

/// The counts of an answer in parts of a ray.
fn in_parts(found: &VisibleSet) -> VisibleSet {
    let samples = found.samples.iter().map(|n| n * PER_RAY as u32).collect();
    let (weight, hits) = (found.weight * PER_RAY, found.hits * PER_RAY);
    VisibleSet { rays: found.rays, weight, hits, samples, visible: found.visible.clone() }
}

impl OverFrames {
    /// Checks what is promised, and returns all answers.
    pub fn look(
        &mut self,
        name: &str,
        scene: &QueryScene,
        camera: &CameraRays,
    ) -> Vec<(&'static str, VisibleSet)> {
        let ask = |method, settings| query(scene, camera, method, &settings);
        let once = |first_sample| QuerySettings { first_sample, ..QuerySettings::default() };
        let frustum = ask(Method::Frustum, once(0));
        let mut answers = Vec::new();
        for (method, alone, culling) in &mut self.moving {
            let mut next = || culling.frame(scene, camera, &Silent).unwrap().found;
            // With all that the cameras before have seen: nothing that this frame's rays met is missing, and nothing is
            // kept that cannot be in view.
            let kept = next();
            let met = ask(*alone, once(self.frames));
            assert!((0..met.visible.len()).all(|d| kept.visible[d] || !met.visible[d]), "{name}: {method}");
            for d in (0..kept.visible.len()).filter(|&d| kept.visible[d]) {
                // (A voxel in view shows all its owners, those beside the view, too.)
                let is_in = frustum.visible[d] || *alone == Method::Voxel;
                assert!(is_in, "{name}: {method} keeps {d}, which is out of view");
            }
            culling.reset();
            let mut next = || culling.frame(scene, camera, &Silent).unwrap().found;
            let first = next();
            assert_eq!(first, in_parts(&ask(*alone, once(0))), "{name}: {method}, first frame");
            // The second casts the same rays as a query of the second sample.
            let (second, alone) = (next(), ask(*alone, once(1)));
            let both = |d: usize| first.visible[d] || alone.visible[d];
            assert!((0..first.visible.len()).all(|d| second.visible[d] == both(d)), "{name}: {method}");
            assert_eq!((second.rays, second.weight), (alone.rays, 2 * first.weight), "{name}: {method}");
            answers.extend([(*method, kept), (*method, first), (*method, second)]);
        }
        self.frames = 2;
        for rays in [1, 4] {
            let settings = QuerySettings { rays_per_pixel: RaysPerPixel::rays(rays), ..once(0) };
            let all = ask(Method::Hybrid, settings);
            let adapted = ask(Method::Hybrid, QuerySettings { adaptive: true, ..settings });
            assert_eq!(adapted.weight, all.weight, "{name}: adaptive, {rays} rays a pixel");
            assert!(adapted.rays <= all.rays && 4 * adapted.rays >= all.rays / 2, "{name}: {}", adapted.rays);
            for d in 0..all.visible.len() {
                assert!(all.visible[d] || !adapted.visible[d], "{name}: adaptive makes {d} up");
                // A drawable that is spared is smaller than a tile, or so thin that a quarter of the rays pass it.
                assert!(
                    adapted.visible[d] || all.samples[d] < 48 * rays,
                    "{name}: adaptive loses {d} of {} samples, {rays} rays a pixel",
                    all.samples[d]
                );
            }
            answers.push(("adaptive", adapted));
        }
        answers
    }
}

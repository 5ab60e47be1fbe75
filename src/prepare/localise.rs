//! Moves every part's origin to the low corner of its box, and finds parts that are then equal.
//!
//! Exporters bake placements into vertices: the same bolt comes as many meshes that differ by a translation only.
//! Made local they are the same bits (as far as the exporter's own rounding lets them), and one copy is kept.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use xxhash_rust::xxh3::Xxh3;

use crate::model::{Mesh, Model, Part, PartId};
use crate::report::Findings;

/// What [`localise`] counts in the findings.
pub const PARTS_MERGED: &str = "parts merged: geometry equal to an earlier part's but for its place";

/// Makes every part local and merges those with equal geometry: equal triangles, and positions whose differences
/// from their box's low corner are equal as f64 numbers.
///
/// Objects keep their place: `world_from_part` gets the translation that the part lost. Of equal parts the first is
/// kept, with the first name that is not empty. A part so large that its extent is not a finite number stays as it is,
/// for [`super::part::prepare_part`] to refuse.
///
/// A coordinate moves by rounding only: at most 2^-53 of its distance from the low corner, 2^-35 quantization steps.
/// The result depends on the model alone, not on the number of threads. The indices in `model` must be in range, as
/// the importer promises.
pub fn localise(mut model: Model, findings: &mut Findings) -> Model {
    let localised: Vec<(DVec3, u64)> = model
        .parts
        .par_iter_mut()
        .map(|part| {
            let origin = make_local(&mut part.mesh);
            (origin, fingerprint(&part.mesh))
        })
        .collect();

    let mut kept: Vec<Part> = Vec::new();
    let mut kept_by_fingerprint: HashMap<u64, Vec<PartId>> = HashMap::new();
    let mut new_ids: Vec<PartId> = Vec::with_capacity(model.parts.len());
    for (part, &(_, fingerprint)) in model.parts.into_iter().zip(&localised) {
        let alike = kept_by_fingerprint.entry(fingerprint).or_default();
        if let Some(&id) = alike.iter().find(|&&id| kept[id as usize].mesh == part.mesh) {
            let first = &mut kept[id as usize];
            findings.add(PARTS_MERGED, 1, || format!("part \"{}\", equal to \"{}\"", part.name, first.name));
            if first.name.is_empty() {
                first.name = part.name;
            }
            new_ids.push(id);
        } else {
            // There are at most as many as before, whose ids were u32.
            let id = kept.len() as PartId;
            alike.push(id);
            kept.push(part);
            new_ids.push(id);
        }
    }
    model.parts = kept;

    for object in &mut model.objects {
        let (origin, _) = localised[object.part as usize];
        object.part = new_ids[object.part as usize];
        object.world_from_part *= DAffine3::from_translation(origin);
    }
    model
}

/// Subtracts the low corner of the box, which is returned.
fn make_local(mesh: &mut Mesh) -> DVec3 {
    let min = mesh.positions.iter().copied().reduce(DVec3::min).unwrap_or(DVec3::ZERO);
    let max = mesh.positions.iter().copied().reduce(DVec3::max).unwrap_or(DVec3::ZERO);
    if !(max - min).is_finite() {
        return DVec3::ZERO;
    }
    for position in &mut mesh.positions {
        *position -= min;
    }
    min
}

/// XXH3-64 of the geometry. Equal geometry has equal bits: a difference that is zero is always +0.
fn fingerprint(mesh: &Mesh) -> u64 {
    let mut hasher = Xxh3::new();
    // The count parts positions from triangles.
    hasher.update(&(mesh.positions.len() as u64).to_le_bytes());
    hasher.update(bytemuck::cast_slice(&mesh.positions));
    hasher.update(bytemuck::cast_slice(&mesh.triangles));
    hasher.digest()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Node, Object};

    /// A model of one object per mesh, all in one flat tree, each object displaced by `(0, 0, index)`.
    fn model(meshes: Vec<(&str, Mesh)>) -> Model {
        let mut model = Model::default();
        for (i, (name, mesh)) in meshes.into_iter().enumerate() {
            model.nodes.push(Node { name: format!("node {i}"), ..Node::default() });
            model.parts.push(Part { name: name.to_owned(), mesh });
            model.objects.push(Object {
                node: i as u32,
                part: i as u32,
                world_from_part: DAffine3::from_translation(DVec3::new(0.0, 0.0, i as f64)),
                colour: Default::default(),
            });
        }
        model
    }

    fn random_mesh(seed: u64) -> Mesh {
        let mut random = oorandom::Rand64::new(seed.into());
        // Multiples of 2^-20, so that moving them by a whole number is exact.
        let mut coordinate = || random.rand_range(0..1 << 20) as f64 / f64::from(1 << 20);
        let positions = (0..60).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect();
        Mesh { positions, triangles: (0..20).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() }
    }

    fn moved(mesh: &Mesh, by: DVec3) -> Mesh {
        Mesh { positions: mesh.positions.iter().map(|&p| p + by).collect(), ..mesh.clone() }
    }

    fn world_points(model: &Model) -> Vec<Vec<DVec3>> {
        let points = |o: &Object| {
            let mesh = &model.parts[o.part as usize].mesh;
            mesh.positions.iter().map(|&p| o.world_from_part.transform_point3(p)).collect()
        };
        model.objects.iter().map(points).collect()
    }

    #[test]
    fn moved_copies_become_one_part_and_nothing_moves_in_world() {
        for seed in 0..16 {
            let (bolt, nut) = (random_mesh(seed), random_mesh(seed + 1_000));
            let before = model(vec![
                ("", bolt.clone()),
                ("nut", nut.clone()),
                ("bolt", moved(&bolt, DVec3::new(1e7, -3.0, 12.0))),
                ("nut 2", moved(&nut, DVec3::new(-5e6, 0.0, 0.0))),
                ("bolt 2", moved(&bolt, DVec3::new(0.0, 1.0, 0.0))),
            ]);
            let mut findings = Findings::default();
            let after = localise(before.clone(), &mut findings);
            assert_eq!(after.parts.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["bolt", "nut"]);
            assert_eq!(
                after.objects.iter().map(|o| o.part).collect::<Vec<_>>(),
                [0, 1, 0, 1, 0],
                "seed {seed}"
            );
            assert_eq!(findings.0[PARTS_MERGED].count, 3);
            // All numbers are multiples of 2^-20 below 2^24, so that every sum is exact.
            assert_eq!(world_points(&before), world_points(&after), "seed {seed}");
        }
    }

    #[test]
    fn one_changed_bit_or_corner_keeps_parts_apart() {
        let mesh = random_mesh(7);
        let mut other_bit = mesh.clone();
        other_bit.positions[13].y = other_bit.positions[13].y.next_up();
        let mut other_corner = mesh.clone();
        other_corner.triangles[3].rotate_left(1);
        let before = model(vec![("a", mesh), ("b", other_bit), ("c", other_corner)]);
        let mut findings = Findings::default();
        assert_eq!(localise(before, &mut findings).parts.len(), 3);
        assert_eq!(findings, Findings::default());
    }

    #[test]
    fn rotated_placements_get_the_translation_in_their_own_axes() {
        let mut before = model(vec![("a", moved(&random_mesh(1), DVec3::new(10.0, 20.0, 30.0)))]);
        before.objects[0].world_from_part =
            DAffine3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z * 2.0, DVec3::new(1.0, 2.0, 3.0));
        let after = localise(before.clone(), &mut Findings::default());
        assert_eq!(world_points(&before), world_points(&after));
        assert_eq!(after.parts[0].mesh.positions.iter().copied().reduce(DVec3::min), Some(DVec3::ZERO));
    }

    #[test]
    fn the_result_is_the_same_for_any_number_of_threads() {
        let meshes = || (0..200).map(|i| ("m", random_mesh(i % 17))).collect();
        let localise_on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| localise(model(meshes()), &mut Findings::default()))
        };
        let one = localise_on(1);
        assert_eq!(one.parts.len(), 17);
        assert_eq!(one, localise_on(3));
    }

    #[test]
    fn an_extent_beyond_f64_is_left_alone() {
        let mut mesh = random_mesh(2);
        mesh.positions[0].x = f64::MAX;
        mesh.positions[1].x = -f64::MAX;
        let before = model(vec![("huge", mesh)]);
        assert_eq!(localise(before.clone(), &mut Findings::default()), before);
    }
}

//! What smooths shadows, against the same on the CPU.

use glam::{DVec3, IVec2, Vec2, Vec3};
use voxsight::camera::Camera;
use voxsight::gpu::shadow::ShadowSettings;
use voxsight::gpu::target::NOBODY;
use voxsight::gpu::view::ViewUniform;
use voxsight::render::{KeyLight, Lighting, Sky, Sun};
use voxsight::sample::{PlantSettings, plant};

use super::common::{build_model, load};
use super::context;
use super::pictures::{Shadowed, draw_with_shadows};

/// `octahedral_unpack` of `shaders/octahedral.wgsl`.
fn octahedral_unpack(packed: u32) -> Vec3 {
    let part = |bits: u32| (f32::from(bits as u16 as i16) / 32767.0).max(-1.0);
    let e = Vec2::new(part(packed), part(packed >> 16));
    let z = 1.0 - e.x.abs() - e.y.abs();
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    let xy = if z < 0.0 { (1.0 - Vec2::new(e.y, e.x).abs()) * Vec2::new(sign(e.x), sign(e.y)) } else { e };
    xy.extend(z).normalize_or_zero()
}

/// `smooth_shares` of `shaders/filter.wgsl` for one pixel. The second is whether a neighbour is so close to a limit that rounding
/// decides.
fn smooth_shares(view: &ViewUniform, shadowed: &Shadowed, radius: i32, pixel: IVec2) -> (Vec2, bool) {
    let size = IVec2::new(view.width as i32, view.height as i32);
    let index = |at: IVec2| (at.y * size.x + at.x) as usize;
    let place = |at: IVec2| {
        let [x, y] = (at.as_vec2() + 0.5).to_array();
        let at_pixel = |constant: [f32; 3], column: [f32; 3], row: [f32; 3]| {
            Vec3::from(constant) + Vec3::from(column) * x + Vec3::from(row) * y
        };
        let start = at_pixel(view.start, view.start_column, view.start_row);
        let direction = at_pixel(view.direction, view.direction_column, view.direction_row);
        start + direction * (view.near / shadowed.reversed[index(at)])
    };
    if shadowed.frame.drawables[index(pixel)] == NOBODY {
        return (Vec2::ONE, false);
    }
    let free = |at: IVec2| Vec2::from(shadowed.free[index(at)].map(|count| count as f32));
    let normal = octahedral_unpack(shadowed.normals[index(pixel)]);
    let (mut sum, mut count, mut is_close) = (Vec2::ZERO, 0.0, false);
    for y in -radius..=radius {
        for x in -radius..=radius {
            let at = pixel + IVec2::new(x, y);
            if at.cmplt(IVec2::ZERO).any() || at.cmpge(size).any() {
                continue;
            }
            if shadowed.frame.drawables[index(at)] == NOBODY {
                continue;
            }
            let facing = normal.dot(octahedral_unpack(shadowed.normals[index(at)]));
            let away = place(at) - place(pixel);
            let (off, slack) = (normal.dot(away).abs(), 0.1 * away.length());
            is_close |= (facing - 0.95).abs() < 1e-4 || (off - slack).abs() < 1e-2 * slack;
            if at == pixel || (facing >= 0.95 && off <= slack) {
                sum += free(at);
                count += 1.0;
            }
        }
    }
    (sum / (count * shadowed.samples as f32), is_close)
}

#[test]
fn few_samples_are_smoothed_within_a_surface() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let settings = PlantSettings { objects: 500, triangles: 50_000, ..PlantSettings::default() };
    build_model(plant(&settings), 9, &path);
    let scene = load(&path);
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let camera = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, 160, 120).rays().unwrap();
    let view = ViewUniform::new(&camera, min, max);
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 8.0 };
    let sky = Sky::Occluded { reach: 0.1 * (max - min).length() };
    let lighting = Lighting { key: KeyLight::Sun(sun), sky, areas: Vec::new(), fill: 1.0 };
    // Samples that are there at the end, and how far they are smoothed then.
    for (samples, smooth, radius) in [(3, true, 2), (20, true, 1), (64, true, 0), (3, false, 0)] {
        let shadows = ShadowSettings { samples, smooth };
        let shadowed = draw_with_shadows(context, &scene, &camera, &lighting, shadows, 1);
        assert_eq!(shadowed.samples, samples);
        let (mut compared, mut close, mut smoothed) = (0, 0, 0);
        for (index, found) in shadowed.reached.iter().enumerate() {
            let pixel = IVec2::new(index as i32 % 160, index as i32 / 160);
            let (expected, is_close) = smooth_shares(&view, &shadowed, radius, pixel);
            if is_close {
                close += 1;
                continue;
            }
            let error = (expected - Vec2::from(*found)).abs().max_element();
            assert!(error < 1e-5, "{samples} samples, pixel {pixel}: {found:?} instead of {expected}");
            compared += 1;
            let own = shadowed.free[index].map(|count| count as f32 / samples as f32);
            smoothed += u32::from(shadowed.frame.drawables[index] != NOBODY && own != *found);
        }
        println!(
            "{samples} samples, radius {radius}: {compared} pixels, {smoothed} smoothed, {close} left to rounding"
        );
        assert!(compared > 15_000 && (smoothed > 500) == (radius > 0), "{compared} {smoothed}");
    }
}

//! The shadow pass against the CPU's voxel shadows.

use glam::DVec3;
use voxsight::camera::{Camera, Plane, Projection};
use voxsight::filter::Filter;
use voxsight::gpu::shadow::ShadowSettings;
use voxsight::gpu::target::NOBODY;
use voxsight::progress::Silent;
use voxsight::render::{KeyLight, LightKind, Lighting, RenderSettings, Renderer, Shadows, Sky, Sun};
use voxsight::sample::{PlantSettings, plant};

use super::common::{build_model, load};
use super::context;
use super::pictures::{Shadowed, draw_with_shadows, hide_glass};

#[test]
fn hard_shadows_are_those_of_the_cpus_voxels() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let settings = PlantSettings { objects: 3000, triangles: 300_000, ..PlantSettings::default() };
    build_model(plant(&settings), 11, &path);
    let mut scene = load(&path);
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let size = (384, 256);
    let outside = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, size.0, size.1);
    let centre = 0.5 * (min + max);
    let inside = Camera {
        eye: (centre + DVec3::new(0.3, 0.1, 0.2)).into(),
        target: (centre + DVec3::new(10.0, -1.0, 4.0)).into(),
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 70.0 },
        ..outside
    };
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 0.0 };
    let lighting = Lighting { key: KeyLight::Sun(sun), sky: Sky::Plain, areas: Vec::new(), fill: 1.0 };
    for (name, camera, is_cut) in [
        ("outside", outside, false),
        ("inside", inside, false),
        ("outside, cut", outside, true),
        ("inside, cut", inside, true),
    ] {
        let camera = camera.rays().unwrap();
        let shadows = ShadowSettings { samples: 1, smooth: false };
        *scene.filter_mut() = Filter::default();
        if is_cut {
            // Towards the sun something is taken away, and something at the side.
            scene.filter_mut().clip_by(Plane { normal: DVec3::NEG_Y, point: centre + 2.0 * DVec3::Y });
            scene.filter_mut().clip_by(Plane { normal: DVec3::new(1.0, 0.1, 0.2), point: centre });
        }
        let Shadowed { frame, reached, .. } =
            draw_with_shadows(context, &scene, &camera, &lighting, shadows, 1);
        hide_glass(&mut scene, |scene| {
            let settings = RenderSettings {
                samples_per_pixel: 1,
                lighting: lighting.clone(),
                shadows: Shadows::Voxel,
                up: DVec3::Y,
                seed: 0,
            };
            let picture = scene.picture();
            let (film, _) = Renderer::new(&picture, &camera, &settings).rows(0..size.1, &Silent).unwrap();
            let (mut compared, mut dark, mut differ) = (0, 0, 0);
            for (index, pixel) in film.pixels.iter().enumerate() {
                let rays = pixel.shadow[LightKind::Sun as usize];
                if rays.cast == 0
                    || frame.drawables[index] == NOBODY
                    || frame.drawables[index] != pixel.drawable
                {
                    continue;
                }
                compared += 1;
                dark += u32::from(rays.free == 0);
                differ += u32::from((reached[index][0] > 0.5) != (rays.free > 0));
            }
            let share = f64::from(differ) / f64::from(compared);
            println!(
                "{name}: {compared} pixels face the sun, {dark} in shadow, {differ} differ: {:.4} %",
                100.0 * share
            );
            assert!(compared > 5000 && dark > 1000, "{name}: {compared} {dark}");
            assert!(share <= 0.001, "{name}: {share}");
        });
    }
}

#[test]
fn soft_light_gathers_to_the_shares_of_the_cpu() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let settings = PlantSettings { objects: 300, triangles: 30_000, ..PlantSettings::default() };
    build_model(plant(&settings), 9, &path);
    let mut scene = load(&path);
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let size = (64, 48);
    let camera =
        Camera::around(min, max, DVec3::new(1.0, 0.6, 0.7), DVec3::Y, size.0, size.1).rays().unwrap();
    let sun = Sun { direction: DVec3::new(0.4, 1.0, 0.3), angle_deg: 12.0 };
    let reach = 0.1 * (max - min).length();
    let lighting =
        Lighting { key: KeyLight::Sun(sun), sky: Sky::Occluded { reach }, areas: Vec::new(), fill: 1.0 };
    let samples = 256;
    let shadows = ShadowSettings { samples: 32, smooth: true };
    // Frame after frame of a still camera.
    let Shadowed { frame, reached, .. } =
        draw_with_shadows(context, &scene, &camera, &lighting, shadows, samples / 32);
    hide_glass(&mut scene, |scene| {
        let settings = RenderSettings {
            samples_per_pixel: 1,
            lighting: lighting.clone(),
            shadows: Shadows::Voxel,
            up: DVec3::Y,
            seed: 0,
        };
        let picture = scene.picture();
        // The same pixels' middles many times, with other seeds.
        let mut sums = vec![[0f64; 4]; (size.0 * size.1) as usize];
        let mut middle = Vec::new();
        for seed in 0..samples {
            let settings = RenderSettings { seed, ..settings.clone() };
            let (film, _) = Renderer::new(&picture, &camera, &settings).rows(0..size.1, &Silent).unwrap();
            for (sums, pixel) in sums.iter_mut().zip(&film.pixels) {
                let (sun, sky) =
                    (pixel.shadow[LightKind::Sun as usize], pixel.shadow[LightKind::Sky as usize]);
                sums[0] += f64::from(sun.free);
                sums[1] += f64::from(sun.cast);
                sums[2] += f64::from(sky.free);
                sums[3] += f64::from(sky.cast);
            }
            middle = film.pixels;
        }
        let (mut compared, mut squares) = ([0; 2], [0f64; 2]);
        for (index, sums) in sums.iter().enumerate() {
            if frame.drawables[index] == NOBODY || frame.drawables[index] != middle[index].drawable {
                continue;
            }
            for (kind, (free, cast)) in [(sums[0], sums[1]), (sums[2], sums[3])].into_iter().enumerate() {
                // Where all rays are cast: surfaces that the whole sun sees.
                if cast == f64::from(samples) {
                    compared[kind] += 1;
                    squares[kind] += (free / cast - f64::from(reached[index][kind])).powi(2);
                }
            }
        }
        let rms = [0, 1].map(|kind| (squares[kind] / f64::from(compared[kind])).sqrt());
        println!("sun: rms {:.4} over {}, sky: rms {:.4} over {}", rms[0], compared[0], rms[1], compared[1]);
        assert!(compared.iter().all(|&count| count > 500), "{compared:?}");
        // Half a point of each of 256 samples is 0.002; low-discrepancy points are about as good as that, pixel by pixel.
        assert!(rms.iter().all(|&rms| rms < 0.02), "{rms:?}");
    });
}

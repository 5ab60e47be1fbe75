// Smooths what few shadow rays leave grainy, within a surface: neighbours count as far as they lie in this pixel's plane and face
// its way.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> filtered: Filter;
@group(0) @binding(2) var depths: texture_depth_2d;
@group(0) @binding(3) var drawables: texture_2d<u32>;
@group(0) @binding(4) var normals: texture_2d<u32>;
@group(0) @binding(5) var<storage, read> free: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> reached: array<vec2f>;

// `gpu::shadow::FilterUniform`.
struct Filter {
    // Samples of each pixel so far.
    samples: u32,
    // Pixels to each side; 0: nothing is smoothed.
    radius: i32,
    // Kinds of light that cast shadows.
    has_sun: u32,
    has_sky: u32,
}

const NOBODY: u32 = 0xffffffffu;
// How far off a plane a neighbour may lie, in its distance from the pixel.
const SLACK: f32 = 0.1;

fn place(pixel: vec2i) -> vec3f {
    return point_at(view, vec2f(pixel) + 0.5, depth_of(view, textureLoad(depths, pixel, 0)));
}

@compute @workgroup_size(8, 8)
fn smooth_shares(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= view.width || id.y >= view.height {
        return;
    }
    let index = id.y * view.width + id.x;
    let pixel = vec2i(id.xy);
    let drawable = textureLoad(drawables, pixel, 0).x;
    var shares = vec2f(1.0);
    if drawable != NOBODY {
        var sum = vec2f(free[index]);
        var count = 1.0;
        if filtered.radius > 0 {
            let normal = octahedral_unpack(textureLoad(normals, pixel, 0).x);
            let here = place(pixel);
            let size = vec2i(i32(view.width), i32(view.height));
            for (var y = -filtered.radius; y <= filtered.radius; y++) {
                for (var x = -filtered.radius; x <= filtered.radius; x++) {
                    let at = pixel + vec2i(x, y);
                    if (x == 0 && y == 0) || any(at < vec2i(0)) || any(at >= size) {
                        continue;
                    }
                    if textureLoad(drawables, at, 0).x == NOBODY {
                        continue;
                    }
                    let facing = dot(normal, octahedral_unpack(textureLoad(normals, at, 0).x));
                    let away = place(at) - here;
                    if facing < 0.95 || abs(dot(normal, away)) > SLACK * length(away) {
                        continue;
                    }
                    sum += vec2f(free[u32(at.y) * view.width + u32(at.x)]);
                    count += 1.0;
                }
            }
        }
        shares = sum / (count * f32(filtered.samples));
    }
    let casts = vec2<bool>(filtered.has_sun != 0u, filtered.has_sky != 0u);
    reached[index] = select(vec2f(1.0), shares, casts);
}

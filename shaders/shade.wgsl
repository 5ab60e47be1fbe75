// The shading pass: light on what the geometry pass saw, as `render::shade` puts it on the CPU; marks around what is selected.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var drawables: texture_2d<u32>;
@group(0) @binding(2) var normals: texture_2d<u32>;
@group(0) @binding(3) var colours: texture_2d<f32>;
// Share of the sun, share of the sky that reach a pixel; row by row; one element where nothing casts shadows.
@group(0) @binding(4) var<storage, read> reached: array<vec2f>;
// Sum of what transparent surfaces shine with, weighted, and of their weights; share of what lies behind them that comes through.
// (Binding 5 is that of `clip.wgsl`.)
@group(0) @binding(6) var glass_sum: texture_2d<f32>;
@group(0) @binding(7) var glass_through: texture_2d<f32>;

const NOBODY: u32 = 0xffffffffu;
// Of `geometry.wgsl`: the inside of something that is cut.
const INSIDE_ALPHA: f32 = 254.0;
// Pixels from one line of a hatching to the next.
const HATCH: i32 = 7;

fn srgb_from_linear(linear: vec3f) -> vec3f {
    let c = clamp(linear, vec3f(0.0), vec3f(1.0));
    return select(1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055, c * 12.92, c <= vec3f(0.0031308));
}

// The sky itself.
fn sky_radiance(direction: vec3f) -> vec3f {
    let height = max(dot(normalize(direction), light.up), 0.0);
    return mix(vec3f(0.86, 0.89, 0.93), vec3f(0.42, 0.58, 0.80), sqrt(height));
}

// Is a pixel on the border of what is selected?
fn is_outline(pixel: vec2i) -> bool {
    let size = vec2i(i32(view.width), i32(view.height));
    var inside = 0;
    var outside = 0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let at = clamp(pixel + vec2i(x, y), vec2i(0), size - 1);
            if (mark_of(textureLoad(drawables, at, 0).x) & SELECTED) != 0u {
                inside++;
            } else {
                outside++;
            }
        }
    }
    return inside > 0 && outside > 0;
}

// Does a pixel show what a clip plane cuts open? There the inside of a surface is seen, and the ray to it comes out of what is cut
// away: it is within something solid. (Of closed surfaces; an open one looks solid from its inside, too.)
fn is_cap(pixel: vec2i) -> bool {
    let is_inside = abs(textureLoad(colours, pixel, 0).w - INSIDE_ALPHA / 255.0) < 0.5 / 255.0;
    if !is_inside || textureLoad(drawables, pixel, 0).x == NOBODY {
        return false;
    }
    let at = vec2f(pixel) + 0.5;
    return kept(point_at(view, at, 0.0), direction_at(view, at), 1e30, 1.0).x > 0.0;
}

// Is a capped pixel on the border of the cap of one drawable?
fn is_cap_border(pixel: vec2i, drawable: u32) -> bool {
    let size = vec2i(i32(view.width), i32(view.height));
    for (var side = 0; side < 4; side++) {
        let away = vec2i(select(0, 1 - (side & 2), (side & 1) == 0), select(0, 1 - (side & 2), (side & 1) == 1));
        let at = clamp(pixel + away, vec2i(0), size - 1);
        if textureLoad(drawables, at, 0).x != drawable || !is_cap(at) {
            return true;
        }
    }
    return false;
}

// A drawable's own colour, hatched as sections are in drawings; dark on its border.
fn cap_colour(pixel: vec2i, drawable: u32, albedo: vec3f) -> vec3f {
    if is_cap_border(pixel, drawable) {
        return albedo * 0.08;
    }
    let is_line = ((pixel.x + pixel.y) % HATCH) == 0;
    return albedo * select(0.8, 0.35, is_line);
}

@vertex
fn vertex_main(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    // One triangle over the whole picture.
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fragment_main(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(position.xy);
    let drawable = textureLoad(drawables, pixel, 0).x;
    let direction = direction_at(view, position.xy);
    var colour: vec3f;
    if drawable == NOBODY {
        // Black where no sky shines, but under a headlight.
        colour = select(sky_radiance(direction), vec3f(0.0), light.sky == 0u && light.key != 0u);
    } else {
        let normal = octahedral_unpack(textureLoad(normals, pixel, 0).x);
        let albedo = linear_from_srgb(textureLoad(colours, pixel, 0).xyz);
        var shares = vec2f(1.0);
        if light.has_shadows != 0u {
            shares = reached[u32(pixel.y) * view.width + u32(pixel.x)];
        }
        colour = albedo * reflected(normal, normalize(-direction), view.forward, shares);
        if light.has_caps != 0u && is_cap(pixel) {
            colour = cap_colour(pixel, drawable, albedo);
        }
        if (mark_of(drawable) & HIGHLIGHTED) != 0u {
            colour = mix(colour, HIGHLIGHT, 0.45);
        }
    }
    if light.has_glass != 0u {
        let sum = textureLoad(glass_sum, pixel, 0);
        let through = textureLoad(glass_through, pixel, 0).x;
        colour = mix(sum.xyz / max(sum.w, 1e-5), colour, through);
    }
    if is_outline(pixel) {
        colour = SELECTION;
    }
    return vec4f(srgb_from_linear(colour), 1.0);
}

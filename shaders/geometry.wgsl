// The geometry pass: pages of triangles into depth, drawable, normal and colour.

@group(0) @binding(4) var<uniform> view: View;

struct Seen {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) drawable: u32,
    @location(1) @interpolate(flat) normal: u32,
    @location(2) @interpolate(flat) colour: u32,
    // How much nearer it is drawn, but for rounding of depths; negative: it is drawn where it is.
    @location(3) @interpolate(flat) nearer: f32,
}

struct Pixel {
    @location(0) drawable: u32,
    @location(1) normal: u32,
    @location(2) colour: vec4f,
}

// Taken away from the alpha of what a clip plane cuts, 255 (`gpu::instance`), where the inside of a surface is seen: `shade.wgsl` caps
// what is cut open there.
const INSIDE: u32 = 0x01000000u;

// The inside of what is cut is drawn nearer by so many steps of its grid, as it is rounded, and by so much of depths, as they are: where
// two parts touch but for that, the one that is left is seen, not the one that begins there.
const NEARER_STEPS: f32 = 0.5;
const NEARER: f32 = 2e-6;

// Is the inside of a surface seen that is opaque and cut? By its winding, which mirrored parts turn about.
fn is_inside(instance: Instance, normal: vec3f, towards: vec3f) -> bool {
    let is_mirrored = dot(cross(instance.column_x, instance.column_y), instance.column_z) < 0.0;
    let may_be_capped = (instance.colour >> 24u) == 255u;
    return HAS_CLIP && may_be_capped && (dot(normal, towards) > 0.0) != is_mirrored;
}

// Three vertices a triangle, fetched and decoded here: nothing is indexed, so that each knows its triangle's normal.
@vertex
fn vertex_main(@builtin(vertex_index) vertex: u32, fetched: Instance) -> Seen {
    var instance = fetched;
    var q = corners_of(&instance, vertex / 3u);
    let normal = face_normal(&instance, q);
    let point = position_of(&instance, q[vertex % 3u]);
    // What has no area covers no pixel, but its normal must be one.
    let is_flat = any(normal != vec3f(0.0));
    // Drawn from both sides: CAD files are careless about winding, so the side that is seen is the outside.
    let towards = select(point, view.forward, view.near == 0.0);
    let facing = select(normal, -normal, dot(normal, towards) > 0.0);
    var seen: Seen;
    seen.position = clip_from_relative(view, point);
    seen.drawable = instance.page.w;
    seen.normal = octahedral_pack(select(vec3f(0.0, 0.0, 1.0), facing, is_flat));
    seen.colour = instance.colour;
    seen.nearer = -1.0;
    if is_inside(instance, normal, towards) {
        seen.colour &= ~INSIDE;
        let step = max(max(length(instance.column_x), length(instance.column_y)), length(instance.column_z));
        // Along the view a slanted face is farther off.
        let slant = abs(dot(normal, towards)) / max(length(towards), 1e-30);
        seen.nearer = NEARER_STEPS * step / max(slant, 0.2);
    }
    return seen;
}

// The point that a fragment shows.
fn shown_at(position: vec4f) -> vec3f {
    return point_at(view, position.xy, depth_of(view, position.z));
}

@fragment
fn fragment_main(seen: Seen) -> Pixel {
    // Never, where this is used; but so both have the same bindings.
    if HAS_CLIP && is_cut(shown_at(seen.position)) {
        discard;
    }
    return Pixel(seen.drawable, seen.normal, unpack4x8unorm(seen.colour));
}

// The depth that is drawn, as the depth buffer holds it. By pixels: what is drawn nearer by vertices is not flat any more.
fn drawn_depth(seen: Seen) -> f32 {
    if seen.nearer < 0.0 {
        return seen.position.z;
    }
    let depth = depth_of(view, seen.position.z);
    // In perspective depths are rounded to a share of themselves, in parallel projections to a share of all.
    let rounding = NEARER * select(view.far, depth, view.near > 0.0);
    let by = min(seen.nearer + rounding, 0.5 * depth);
    // Reverse-Z, as `depth_of` reads it.
    return min(select(seen.position.z + by / view.far, view.near / (depth - by), view.near > 0.0), 1.0);
}

struct CutPixel {
    @location(0) drawable: u32,
    @location(1) normal: u32,
    @location(2) colour: vec4f,
    @builtin(frag_depth) depth: f32,
}

// The same where clip planes cut something away.
@fragment
fn fragment_cut(seen: Seen) -> CutPixel {
    if is_cut(shown_at(seen.position)) {
        discard;
    }
    return CutPixel(seen.drawable, seen.normal, unpack4x8unorm(seen.colour), drawn_depth(seen));
}

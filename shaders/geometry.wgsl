// The geometry pass: pages of triangles into depth, drawable, normal and colour.

@group(0) @binding(4) var<uniform> view: View;

struct Seen {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) drawable: u32,
    @location(1) @interpolate(flat) normal: u32,
    @location(2) @interpolate(flat) colour: u32,
}

struct Pixel {
    @location(0) drawable: u32,
    @location(1) normal: u32,
    @location(2) colour: vec4f,
}

// Taken away from the alpha of what a clip plane cuts, 255 (`gpu::instance`), where the inside of a surface is seen: `shade.wgsl` caps
// what is cut open there.
const INSIDE: u32 = 0x01000000u;

// The inside of what is cut is drawn nearer by so many steps of its grid, and by so much of its distance (of the depth of the view, in
// parallel projections): where two parts touch but for rounding, the one that is left is seen, not the one that begins there.
const NEARER_STEPS: f32 = 1.0;
const NEARER: f32 = 2e-6;

// As much nearer, as a share of the distance (of the depth of the view).
fn nearer(instance: Instance, distance: f32) -> f32 {
    let step = max(max(length(instance.column_x), length(instance.column_y)), length(instance.column_z));
    return NEARER + NEARER_STEPS * step / select(view.far, distance, view.near > 0.0);
}

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
    if is_inside(instance, normal, towards) {
        seen.colour &= ~INSIDE;
        // Reverse-Z: in perspective the near plane's depth over the distance, else what is left of the depth.
        seen.position.z += select(seen.position.w, seen.position.z, view.near > 0.0) * nearer(instance, seen.position.w);
    }
    return seen;
}

// The point that a fragment shows.
fn shown_at(position: vec4f) -> vec3f {
    return point_at(view, position.xy, depth_of(view, position.z));
}

@fragment
fn fragment_main(seen: Seen) -> Pixel {
    if HAS_CLIP && is_cut(shown_at(seen.position)) {
        discard;
    }
    return Pixel(seen.drawable, seen.normal, unpack4x8unorm(seen.colour));
}

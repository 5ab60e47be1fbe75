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

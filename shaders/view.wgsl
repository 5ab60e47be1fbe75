// The camera of a frame: `gpu::view::ViewUniform`.

struct View {
    // Rows of clip space from relative space.
    clip_x: vec4f,
    clip_y: vec4f,
    clip_z: vec4f,
    clip_w: vec4f,
    // Where the ray of a pixel starts and goes: `start + column x + row y`, and likewise; relative space.
    start: vec3f,
    // Depth of the near plane; 0 in a parallel projection.
    near: f32,
    start_column: vec3f,
    // Depth at which a parallel projection ends.
    far: f32,
    start_row: vec3f,
    width: u32,
    direction: vec3f,
    height: u32,
    direction_column: vec3f,
    padding_0: u32,
    direction_row: vec3f,
    padding_1: u32,
    forward: vec3f,
    padding_2: u32,
}

// Clip position of a point.
fn clip_from_relative(view: View, point: vec3f) -> vec4f {
    let p = vec4f(point, 1.0);
    return vec4f(dot(view.clip_x, p), dot(view.clip_y, p), dot(view.clip_z, p), dot(view.clip_w, p));
}

// Depth along the view from what the depth buffer holds (reverse-Z: 1 at the near plane, 0 at its end).
fn depth_of(view: View, reversed: f32) -> f32 {
    if view.near > 0.0 {
        return view.near / reversed;
    }
    return (1.0 - reversed) * view.far;
}

// Direction of the ray through a point in pixels; of length 1 along the view.
fn direction_at(view: View, pixel: vec2f) -> vec3f {
    return view.direction + view.direction_column * pixel.x + view.direction_row * pixel.y;
}

// The point that a pixel shows.
fn point_at(view: View, pixel: vec2f, depth: f32) -> vec3f {
    let start = view.start + view.start_column * pixel.x + view.start_row * pixel.y;
    return start + direction_at(view, pixel) * depth;
}

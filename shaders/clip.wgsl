// Clip planes: only what is on the inner side of all of them is there.

// Are there any? Without, no pixel is looked at twice.
override HAS_CLIP: bool;

// Inward normals of length 1, and how far inside the eye is.
@group(0) @binding(5) var<storage, read> clip_planes: array<vec4f>;

fn is_cut(point: vec3f) -> bool {
    for (var i = 0u; i < arrayLength(&clip_planes); i++) {
        if dot(clip_planes[i].xyz, point) + clip_planes[i].w < 0.0 {
            return true;
        }
    }
    return false;
}

// From where to where along a ray all planes keep what is there, from 0 to `end`; nothing where the first is larger.
fn kept(start: vec3f, direction: vec3f, end: f32, per_unit: f32) -> vec2f {
    var range = vec2f(0.0, end);
    for (var i = 0u; i < arrayLength(&clip_planes); i++) {
        let height = dot(clip_planes[i].xyz, start) + clip_planes[i].w * per_unit;
        let slope = dot(clip_planes[i].xyz, direction);
        if slope == 0.0 {
            if height < 0.0 {
                return vec2f(1.0, 0.0);
            }
        } else if slope > 0.0 {
            range.x = max(range.x, -height / slope);
        } else {
            range.y = min(range.y, -height / slope);
        }
    }
    return range;
}

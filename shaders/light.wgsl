// Light on a surface, as `render::shade` puts it there on the CPU.

@group(1) @binding(0) var<uniform> light: Light;

// `gpu::light::LightUniform`.
struct Light {
    up: vec3f,
    // 0 headlight, 1 sun, 2 none.
    key: u32,
    sun: vec3f,
    fill: f32,
    across: vec3f,
    // 0 none, 1 plain, 2 occluded.
    sky: u32,
    // What a white surface that faces it reflects of the sun.
    sun_reflected: vec3f,
    // There is a share for each pixel.
    has_shadows: u32,
    // Something transparent was drawn.
    has_glass: u32,
    // What clip planes cut open is drawn as solid.
    has_caps: u32,
    padding_0: u32,
    padding_1: u32,
}

fn linear_from_srgb(c: vec3f) -> vec3f {
    return select(pow((c + 0.055) / 1.055, vec3f(2.4)), c / 12.92, c <= vec3f(0.04045));
}

// What a surface reflects of a plain sky.
fn sky_reflected(normal: vec3f) -> vec3f {
    let above = 0.5 + 0.5 * dot(normal, light.up);
    return vec3f(0.30, 0.31, 0.34) * (0.35 + 0.65 * above);
}

// Light that a white surface reflects.
fn reflected(normal: vec3f, to_eye: vec3f, forward: vec3f, shares: vec2f) -> vec3f {
    if light.key == 0u {
        return vec3f(0.12 + 0.88 * max(dot(normal, to_eye), 0.0));
    }
    let eye = 0.14 * max(-dot(normal, forward), 0.0);
    let side = 0.10 * abs(dot(normal, light.across));
    var sum = vec3f(light.fill * (eye + side));
    if light.key == 1u {
        sum += light.sun_reflected * (max(dot(normal, light.sun), 0.0) * shares.x);
    }
    if light.sky != 0u {
        sum += sky_reflected(normal) * shares.y;
    }
    return sum;
}

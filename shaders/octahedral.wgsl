// Directions in two numbers of 16 bits (Cigolle et al. 2014): within 0.005 degrees.

fn sign_not_zero(v: vec2f) -> vec2f {
    return select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0));
}

// Any length but 0.
fn octahedral_pack(direction: vec3f) -> u32 {
    let n = direction / (abs(direction.x) + abs(direction.y) + abs(direction.z));
    let folded = select(n.xy, (1.0 - abs(n.yx)) * sign_not_zero(n.xy), n.z < 0.0);
    return pack2x16snorm(folded);
}

// Of length 1.
fn octahedral_unpack(packed: u32) -> vec3f {
    let e = unpack2x16snorm(packed);
    let z = 1.0 - abs(e.x) - abs(e.y);
    let xy = select(e, (1.0 - abs(e.yx)) * sign_not_zero(e), z < 0.0);
    return normalize(vec3f(xy, z));
}

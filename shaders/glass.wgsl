// Transparent surfaces, in any order (McGuire and Bavoil 2013): weighted sums, composed by the shading pass. One layer is exact; of
// several, nearer ones count more. Nothing shades them. What is selected is tinted: it has no outline.

struct Glass {
    @location(0) sum: vec4f,
    @location(1) through: f32,
}

@fragment
fn fragment_glass(seen: Seen) -> Glass {
    if HAS_CLIP && is_cut(shown_at(seen.position)) {
        discard;
    }
    var colour = unpack4x8unorm(seen.colour);
    let to_eye = normalize(-direction_at(view, seen.position.xy));
    var lit = linear_from_srgb(colour.xyz) * reflected(octahedral_unpack(seen.normal), to_eye, view.forward, vec2f(1.0));
    let mark = mark_of(seen.drawable);
    if mark != 0u {
        lit = mix(lit, select(HIGHLIGHT, SELECTION, (mark & SELECTED) != 0u), 0.6);
        colour.w = max(colour.w, 0.5);
    }
    let nearness = view.far / depth_of(view, seen.position.z);
    // Within the range of 16-bit floats, for many layers.
    let weight = colour.w * clamp(0.1 * nearness * nearness, 0.01, 500.0);
    return Glass(vec4f(lit, 1.0) * weight, colour.w);
}

// A lamp near the hair as the SRBF that it is from a place. Twin: src/lamp.rs, which states how.

struct LampLobe {
    direction: vec3f,
    lambda: f32,
    solid_angle: f32,   // 0 where it does not shine
}

// `center` and `p` count from the middle of the hair. `size`: a sphere's radius, or half a side of a square across
// `center`. `side`: along a level side of the square, of unit length; 0 of a sphere.
fn lamp_lobe(center: vec3f, size: f32, side: vec3f, p: vec3f) -> LampLobe {
    let to = center - p;
    let sin2 = size * size / max(dot(to, to), 1e-30);
    var solid_angle = TWO_PI * select(sin2 / (1.0 + sqrt(max(1.0 - sin2, 0.0))), 2.0, sin2 >= 1.0);
    var direction = to * inverseSqrt(max(dot(to, to), 1e-30));
    // Loops that run once: see resolve.wgsl.
    for (var square = dot(side, side) > 0.0; square; square = false) {
        let normal = normalize(center);
        let x = size * side;
        let y = size * cross(normal, side);
        let triple = 4.0 * size * size * max(dot(to, normal), 0.0);
        solid_angle = lamp_triangle(to - x - y, to + x - y, to + x + y, triple)
            + lamp_triangle(to - x - y, to + x + y, to - x + y, triple);
        let g = inverseSqrt(3.0);
        direction = normalize(lamp_node(to - g * (x + y)) + lamp_node(to + g * (x - y)) + lamp_node(to + g * (x + y))
            + lamp_node(to - g * (x - y)));
    }
    return LampLobe(direction, lamp_bandwidth(solid_angle / (2.0 * TWO_PI)), solid_angle);
}

fn lamp_triangle(a: vec3f, b: vec3f, c: vec3f, triple: f32) -> f32 {
    let la = length(a);
    let lb = length(b);
    let lc = length(c);
    return 2.0 * atan2_accurate(triple, la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
}

// The direction of a node, weighted by the solid angle about it.
fn lamp_node(to: vec3f) -> vec3f {
    let inverse2 = 1.0 / max(dot(to, to), 1e-30);
    return to * (inverse2 * inverse2);
}

// Of the mean cosine 1 − spread.
fn lamp_bandwidth(spread: f32) -> f32 {
    let s = max(spread, 1e-9);
    let t = exp(-2.0 / s);
    let over = 2.0 * t / (1.0 - t);
    let slope = s * s - 4.0 * t / ((1.0 - t) * (1.0 - t));
    let kappa = 1.0 / s - over / max(slope, 1e-30);
    return clamp(sqrt(2.0 / max(kappa, 0.1)), 0.01, 2.0);
}

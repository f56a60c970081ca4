// Which rays are drawn for a light. Twin: src/transport/draws.rs.

// A ray that starts on a fibre misses its own strand over a path of so many radii.
const CLEAR_RADII = 4.0;

// Where light along unit `direction` leaves a fibre about `axis_point` along unit `u`.
fn fibre_surface(axis_point: vec3f, radius: f32, u: vec3f, direction: vec3f) -> vec3f {
    let aside = direction - dot(direction, u) * u;
    return axis_point + radius * (aside * inverseSqrt(max(dot(aside, aside), 1e-20)));
}

struct TracedLight {
    direction: vec3f,   // of a lamp near the hair: its centre
    lambda: f32,        // of a lamp: its size
    side: vec3f,        // as lamp_lobe has it
    lamp: u32,          // whether it is one
    column: u32,        // among the words of a slot, in pairs
    rays: u32,          // to be added
    fresh: u32,         // whether to forget what is kept
    pad: u32,
}

// A direction to look for a light in, and how far.
struct Aim {
    direction: vec3f,
    distance: f32,      // 0 where the light is dark
}

// Where to look for a light from `p`.
fn aim_at(light: TracedLight, p: vec3f, u: vec2f) -> Aim {
    if (light.lamp != 0u) {
        return lamp_aim(light.direction, light.lambda, light.side, p, u);
    }
    return Aim(lobe_direction(light.direction, light.lambda, u), 1e29);
}

// The direction of a lobe at which its distribution is u.x, at azimuth 2πu.y about its centre.
fn lobe_direction(centre: vec3f, lambda: f32, u: vec2f) -> vec3f {
    let half_lambda2 = 0.5 * lambda * lambda;
    let drop = clamp(-half_lambda2 * log(1.0 - u.x * (1.0 - exp(-2.0 / half_lambda2))), 0.0, 2.0);
    return about(centre, drop, u.y);
}

// At 1 − cosine `drop` and azimuth 2πu about `axis`.
fn about(axis: vec3f, drop: f32, u: f32) -> vec3f {
    let x = any_normal(axis);
    let y = cross(axis, x);
    let across = sqrt(max(drop * (2.0 - drop), 0.0));
    return normalize(axis * (1.0 - drop) + across * (x * cos(TWO_PI * u) + y * sin(TWO_PI * u)));
}

// A direction in which a lamp near the hair shines on `p`, evenly over the solid angle that it covers.
fn lamp_aim(center: vec3f, size: f32, side: vec3f, p: vec3f, u: vec2f) -> Aim {
    let to = center - p;
    let distance2 = max(dot(to, to), 1e-30);
    let sin2 = size * size / distance2;
    let all = select(sin2 / (1.0 + sqrt(max(1.0 - sin2, 0.0))), 2.0, sin2 >= 1.0);
    let direction = about(to * inverseSqrt(distance2), all * u.x, u.y);
    let along = dot(to, direction);
    let aside = to - along * direction;
    let deep = sqrt(max(size * size - dot(aside, aside), 0.0));
    var aim = Aim(direction, select(along - deep, along + deep, sin2 >= 1.0));
    for (var square = dot(side, side) > 0.0; square; square = false) {
        let normal = normalize(center);
        let up = cross(normal, side);
        let depth = dot(to, normal);
        // Evenly over the square, but for what the solid angle of a place there is less than that of the nearest.
        let nearest = clamp(vec2f(dot(-to, side), dot(-to, up)), vec2f(-size), vec2f(size));
        let least = length(to + nearest.x * side + nearest.y * up);
        var draw = u;
        for (var tries = 0u; tries < 8u; tries++) {
            let place = size * (2.0 * draw - 1.0);
            let toward = to + place.x * side + place.y * up;
            let distance = length(toward);
            aim = Aim(toward / distance, select(0.0, distance, depth > 0.0));
            let share = least / distance;
            // Another number for each try, of the same draw.
            if (fract(97.0 * (draw.x + draw.y) + 0.618034 * f32(tries)) < share * share * share) {
                break;
            }
            draw = fract(draw + vec2f(0.7548777, 0.5698403));
        }
    }
    return aim;
}

// Numbers in [0, 1) for ray `k` of a block: two for the direction, one for the place.
fn draw_of(strand: u32, block: u32, k: u32) -> vec3f {
    let own = vec3u(hashed(strand), hashed(strand ^ 0x55555555u), hashed(strand ^ 0xaaaaaaaau));
    let bits = own + block * vec3u(3518319155u, 2882110345u, 2360945575u)
        + k * vec3u(3242174889u, 2447445413u, 2654435769u);
    return vec3f(bits >> vec3u(8u)) * 5.9604645e-8;
}

// PCG's permutation (O'Neill 2014).
fn hashed(key: u32) -> u32 {
    let state = key * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

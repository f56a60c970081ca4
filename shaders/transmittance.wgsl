// T̃ at strand points, by rays: for each pair of a point and a light, a few directions drawn from the light's lobe. Points
// that follow each other on a strand form a block; the fainter a light, the more points of a block share its rays.
//
// The draws are a lattice that is fixed to the strand, so that a frame of another view, or of turned light, has the same
// noise: blocks along a strand continue each other, and so do the rays of a block; lights share it. Twin of the draws:
// src/transport/draws.rs.

struct Block {
    point: u32,         // the first, seen or not
    members: u32,       // its first place among `slots`, and the number of its seen points in the lower 5 bits
    own: vec2u,         // first point of its strand, and its last
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

struct Tracing {
    blocks: u32,
    points: u32,        // of a block
    stride: u32,        // words of a slot
    lights: u32,
    lights_a_thread: u32,
    pad: u32,
    head: vec2u,        // root of its tree, and first of its shapes; 0 without one
    light: array<TracedLight>,
}

@group(0) @binding(4) var<storage, read> blocks: array<Block>;
@group(0) @binding(5) var<storage, read> slots: array<u32>;
// Of a pair: rays that were open in the lower half, all in the upper half. Where strands are counted a second word: the
// mean over rays of what the head leaves, in 8 bits, of that times 0.75^strands before the light in 12, and of
// 0.5^strands behind the point in 12.
@group(0) @binding(6) var<storage, read_write> words: array<u32>;
@group(0) @binding(7) var<storage, read> tracing: Tracing;

// A block a thread, and some lights one after the other.
@compute @workgroup_size(64)
fn transmittance(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= tracing.blocks) {
        return;
    }
    let block = blocks[id.x];
    let members = block.members >> 5u;
    let row = slots[members] * tracing.stride;
    let end = min((id.y + 1u) * tracing.lights_a_thread, tracing.lights);
    for (var next = id.y * tracing.lights_a_thread; next < end; next++) {
        let light = tracing.light[next];
        let place = select(1u, 2u, COUNT_STRANDS) * light.column;
        var word = 0u;
        var means = vec3f();
        if (light.fresh == 0u) {
            word = words[row + place];
            if COUNT_STRANDS {
                means = unpack_means(words[row + place + 1u]);
            }
        }
        for (var left = light.rays; left > 0u; left--) {
            let draw = draw_of(block.own.x, (block.point - block.own.x) / tracing.points, word >> 16u);
            // Somewhere on the block, from half a segment before its first point to half a segment beyond its last.
            let way = f32(tracing.points) * draw.z - 0.5;
            let point = min(block.point + u32(max(round(way), 0.0)), block.own.y);
            let at = strand_points[2u * point];
            let u = strand_points[2u * point + 1u].xyz;
            let aside = way - f32(point - block.point);
            let back = (aside < 0.0 && point > block.own.x) || point == block.own.y;
            let other = select(point + 1u, point - 1u, back);
            let origin = mix(at.xyz, strand_points[2u * other].xyz, min(abs(aside), 0.5));
            var aim = Aim(lobe_direction(light.direction, light.lambda, draw.xy), 1e29);
            if (light.lamp != 0u) {
                aim = lamp_aim(light.direction, light.lambda, light.side, origin, draw.xy);
            }
            let met = trace(ray_leaving(origin, 0.5 * at.w, u, block.own, aim.direction, aim.distance), tracing.head);
            let seen = !met.head && aim.distance > 0.0;
            word += 0x10000u + u32(seen && met.strands == 0u);
            if COUNT_STRANDS {
                let share = select(0.0, 1.0, seen);
                let own = vec3f(share, share * pow(0.75, f32(met.strands)), pow(0.5, f32(met.behind)));
                means += (own - means) / f32(word >> 16u);
            }
        }
        for (var k = 0u; k < (block.members & 31u); k++) {
            let at = slots[members + k] * tracing.stride + place;
            words[at] = word;
            if COUNT_STRANDS {
                words[at + 1u] = pack_means(means);
            }
        }
    }
}

fn pack_means(means: vec3f) -> u32 {
    let kept = vec3u(round(means * vec3f(255.0, 4095.0, 4095.0)));
    return kept.x | (kept.y << 8u) | (kept.z << 20u);
}

fn unpack_means(kept: u32) -> vec3f {
    return vec3f(f32(kept & 255u) / 255.0, f32((kept >> 8u) & 4095u) / 4095.0, f32(kept >> 20u) / 4095.0);
}

// A direction to look for a light in, and how far.
struct Aim {
    direction: vec3f,
    distance: f32,      // 0 where the light is dark
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

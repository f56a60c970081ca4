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
            let aim = aim_at(light, origin, draw.xy);
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

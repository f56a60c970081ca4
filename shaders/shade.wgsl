// Radiance of each needed strand point towards the eye: the sum over SRBF lights of what the method makes of
// their arrival. Where COUNT holds, what was done for it in its place. A method's file defines
//
//   struct Strand, strand_at(fibre, θ_o)                       what all lights share at a point
//   light_scattering(fibre, strand, arrival, parts) -> vec3f   towards the eye
//
//   FORWARD                          whether a light brings along what came forward through other strands
//
// and nothing else is called from here.

struct Shading {
    eye: vec3f,
    parts: u32,         // of those that the pipeline has
    first_light: u32,   // lights arrive in groups that keep a buffer under 128 MiB
    lights: u32,
    slots: u32,         // points whose T̃ is known
    first_ordinate: u32,
    grid: FieldGrid,
    lamps: u32,
    stride: u32,        // words of a slot
    last_column: u32,   // place that light 0 would have among a slot's words, in pairs
    gathered: u32,      // 1 where `radiance` holds what gather.wgsl found
}

struct NeededPoints {
    count: u32,
    shaded: u32,
    points: array<u32>,
}

@group(1) @binding(0) var<uniform> shading: Shading;
@group(1) @binding(1) var<storage, read> strand_points: array<vec4f>;
@group(1) @binding(2) var<storage, read> needed: NeededPoints;
@group(1) @binding(3) var<storage, read> lights: array<Light>;
// Slot by slot, light by light from the last to the first: as transmittance.wgsl writes them.
@group(1) @binding(4) var<storage, read> words: array<u32>;
@group(1) @binding(5) var<storage, read_write> radiance: array<vec4f>;
@group(1) @binding(6) var<storage, read> slots: array<u32>;    // of each point
// field::Field: RGB and a cell's weight, premultiplied by it, ordinate by ordinate along z.
@group(1) @binding(7) var field: texture_3d<f32>;
@group(1) @binding(8) var field_sampler: sampler;
@group(1) @binding(9) var painted: texture_2d<u32>;             // paint::PointFibre of each point, row by row

@compute @workgroup_size(64)
fn shade(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let item = needed.shaded + 64u * group.x + lane;
    if (item >= needed.count) {
        return;
    }
    let point = needed.points[item];
    let slot = slots[point];
    if (slot >= shading.slots) {
        return;
    }
    let position = strand_points[2u * point].xyz;
    let u = strand_points[2u * point + 1u].xyz;
    let to_eye = normalize(shading.eye - position);

    let frame = fibre_frame(u, strand_points[2u * point + 1u].w);
    let theta_o = inclination(frame, to_eye);
    let o = across(frame, to_eye);
    let own = fibre_of(point);
    let strand = strand_at(own, theta_o);
    let parts = shading.parts & PARTS;
    let cell = field_cell(shading.grid, position);

    var total = vec3f(0.0);
    for (var j = 0u; j < shading.lights; j++) {
        let index = shading.first_light + j;
        var light = lights[index];
        if LAMPS {
            for (var near = index < shading.lamps; near; near = false) {
                light = lamp_from(light, position);
            }
        }
        let place = slot * shading.stride + select(1u, 2u, FORWARD) * (shading.last_column - index);
        let known = transmittance_of(words[place], words[place + select(0u, 1u, FORWARD)]);
        var scattered = vec3f();
        if (!FORWARD && (PARTS & (GLOBAL | LOCAL)) != 0u && index >= shading.first_ordinate) {
            scattered = field_at(shading.grid, cell, index - shading.first_ordinate);
        }
        // What comes forward through other strands is judged by what they leave of it at s = ¼.
        let through = select(known.t1, known.t_quarter, FORWARD && (PARTS & (GLOBAL | LOCAL)) != 0u);
        let most = max(through * light.rgb, scattered);
        if (max(most.x, max(most.y, most.z)) < light.least) {
            continue;
        }
        if COUNT {
            done.lights += 1u;
        }
        let d = across(frame, light.direction);
        let arrival = Arrival(
            inclination(frame, light.direction),
            atan2_accurate(o.y * d.x - o.x * d.y, dot(o, d)),
            o.x * d.x - o.y * d.y,
            light.lambda,
            light.energy,
            light.rgb,
            light.least,
            known,
            scattered,
        );
        total += light_scattering(own, strand, arrival, parts);
    }
    var shown = vec4f(total, 1.0);
    if COUNT {
        shown = vec4f(vec4u(done.lights, done.single, done.global, done.lobes));
    }
    if (shading.first_light > 0u || shading.gathered == 1u) {
        shown += radiance[point];
    }
    radiance[point] = shown;
}

// Radiance of each needed strand point towards the eye: the sum over SRBF lights of what the method makes of
// their arrival. Where COUNT holds, what was done for it in its place. A method's file defines
//
//   struct Strand, strand_at(fibre, θ_o)                       what all lights share at a point
//   light_scattering(fibre, strand, arrival, parts) -> vec3f   towards the eye
//
//   FORWARD                          whether a light brings along what came forward through other strands
//
// and nothing else is called from here.

// Whether the first lights are lamps near the hair: set when the pipeline is made.
override LAMPS: bool = true;

// Of a lamp: its centre, its size, its radiance; least for E_j = 1; and `side` as lamp_lobe has it.
struct Light {
    direction: vec3f,
    lambda: f32,
    rgb: vec3f,
    energy: f32,        // E_j = ∫G_j dω
    least: f32,         // radiance that must arrive for the light to matter
    side: array<f32, 3>,
}

struct Shading {
    eye: vec3f,
    parts: u32,         // of those that the pipeline has
    first_light: u32,   // lights arrive in groups that keep a buffer under 128 MiB
    lights: u32,
    slots: u32,         // points whose T̃ is known
    first_ordinate: u32,
    field_origin: vec3f,
    field_cell: f32,
    field_dims: vec3f,
    field_scale: f32,
    lamps: u32,
    stride: u32,        // words of a slot
    last_column: u32,   // place that light 0 would have among a slot's words, in pairs
    pad: u32,
}

struct NeededPoints {
    count: u32,
    shaded: u32,
    dispatch: vec3u,
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
    let item = needed.shaded + (group.y * 4096u + group.x) * 64u + lane;
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

    // The fibre's frame: its ellipse's minor axis lies at the stored twist from a fixed normal.
    let sin_o = clamp(dot(u, to_eye), -1.0, 1.0);
    let theta_o = asin_accurate(sin_o);
    let normal = any_normal(u);
    let twist = strand_points[2u * point + 1u].w;
    let axis_x = cos(twist) * normal + sin(twist) * cross(u, normal);
    let axis_y = cross(u, axis_x);
    let o = across(to_eye, axis_x, axis_y);
    let own = fibre_of(point);
    let strand = strand_at(own, theta_o);
    let parts = shading.parts & PARTS;
    // Between the centres of cells, so that no ordinate's cells mix with another's.
    let cell = clamp((position - shading.field_origin) / shading.field_cell, vec3f(0.5), shading.field_dims - 0.5);

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
            scattered = field_at(cell, index - shading.first_ordinate);
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
        let sin_j = clamp(dot(u, light.direction), -1.0, 1.0);
        let d = across(light.direction, axis_x, axis_y);
        let arrival = Arrival(
            asin_accurate(sin_j),
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
    if (shading.first_light > 0u) {
        shown += radiance[point];
    }
    radiance[point] = shown;
}

// A lamp as the light that it is from a place.
fn lamp_from(lamp: Light, position: vec3f) -> Light {
    let side = vec3f(lamp.side[0], lamp.side[1], lamp.side[2]);
    let lobe = lamp_lobe(lamp.direction, lamp.lambda, side, position);
    let energy = srbf_integral(lobe.lambda);
    let rgb = lamp.rgb * (lobe.solid_angle / energy);
    return Light(lobe.direction, lobe.lambda, rgb, energy, lamp.least / energy, lamp.side);
}

fn fibre_of(point: u32) -> Fibre {
    if PAINTED {
        let width = textureDimensions(painted).x;
        let texel = textureLoad(painted, vec2u(point % width, point / width), 0);
        return painted_fibre(fibre, unpack(texel.xy), unpack(texel.zw));
    }
    return fibre;
}

// Radiance that other strands have scattered along an ordinate, at a place in cells.
fn field_at(cell: vec3f, ordinate: u32) -> vec3f {
    let dims = shading.field_dims;
    let place = vec3f(cell.xy, cell.z + f32(ordinate) * dims.z);
    let size = vec3f(dims.xy, f32(textureDimensions(field).z));
    let texel = textureSampleLevel(field, field_sampler, place / size, 0.0);
    return texel.rgb * (shading.field_scale / max(texel.a, 1e-4));
}

// Unit vector across the fibre, as (cos φ, sin φ); along the fibre any will do.
fn across(direction: vec3f, axis_x: vec3f, axis_y: vec3f) -> vec2f {
    let v = vec2f(dot(direction, axis_x), dot(direction, axis_y));
    let l = length(v);
    return select(vec2f(1.0, 0.0), v / max(l, 1e-20), l > 1e-6);
}

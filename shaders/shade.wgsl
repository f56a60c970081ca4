// Radiance of each needed strand point towards the eye: the sum over SRBF lights of what the method makes of
// their arrival. Where COUNT holds, what was done for it in its place. A method's file defines
//
//   struct Strand, strand(fibre, θ_o, around)      what all lights share at a point
//   light_scattering(fibre, strand, arrival) -> Lit
//   field_scattering(fibre, strand, field)         of the light that lingers around the point
//
// and nothing else is called from here.

struct Light {
    direction: vec3f,
    lambda: f32,
    rgb: vec3f,
    energy: f32,        // E_j = ∫G_j dω
    least: f32,         // share that must arrive for the light to matter
    pad: array<f32, 3>,
}

struct Shading {
    eye: vec3f,
    parts: u32,         // of those that the pipeline has
    first_light: u32,   // lights arrive in groups that keep a buffer under 128 MiB
    lights: u32,
    slots: u32,         // points whose reach is known
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
@group(1) @binding(4) var<storage, read> reach: array<u32>;    // light by light, slot by slot: transport::Reach
@group(1) @binding(5) var<storage, read_write> radiance: array<vec4f>;
@group(1) @binding(6) var<storage, read> slots: array<vec2u>;   // of each point, and transport::surroundings

@compute @workgroup_size(64)
fn shade(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let item = needed.shaded + (group.y * 4096u + group.x) * 64u + lane;
    if (item >= needed.count) {
        return;
    }
    let point = needed.points[item];
    let slot = slots[point].x;
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
    let strand = strand_at(fibre, theta_o, depth_of(slots[point].y));
    let parts = shading.parts & PARTS;

    var total = vec3f(0.0);
    var field = vec3f(0.0);
    for (var j = 0u; j < shading.lights; j++) {
        let light = lights[shading.first_light + j];
        let bits = reach[j * shading.slots + slot];
        let direct = square(f32(bits & 1023u) / 1023.0);
        let quarter = square(f32((bits >> 10u) & 255u) / 255.0);
        // What comes through other strands is judged by the mean at s = ¼.
        let most = select(direct, max(direct, quarter), (PARTS & (GLOBAL | LOCAL)) != 0u);
        if (most < light.least) {
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
            light.least,
            direct,
            square(f32(bits >> 24u) / 255.0),
            depth_of(bits),
        );
        let lit = light_scattering(fibre, strand, arrival, parts);
        total += light.rgb * lit.radiance;
        field += light.rgb * lit.field;
    }
    if ((parts & LOCAL) != 0u) {
        total += field_scattering(strand, field);
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

// Unit vector across the fibre, as (cos φ, sin φ); along the fibre any will do.
fn across(direction: vec3f, axis_x: vec3f, axis_y: vec3f) -> vec2f {
    let v = vec2f(dot(direction, axis_x), dot(direction, axis_y));
    let l = length(v);
    return select(vec2f(1.0, 0.0), v / max(l, 1e-20), l > 1e-6);
}

// A unit normal of unit u, as `normals` of src/gpu/frame.rs has it (Duff et al. 2017).
fn any_normal(u: vec3f) -> vec3f {
    let s = select(-1.0, 1.0, u.z >= 0.0);
    let a = -1.0 / (s + u.z);
    return vec3f(1.0 + s * u.x * u.x * a, s * u.x * u.y * a, -s * u.x);
}

// Radiance of each needed strand point towards the eye: the sum over SRBF lights of single and dual
// scattering (Xu 2011, Eq 2–4), with transport's means in place of T̃ and T_f.
//
//   L = Σ_j L_j [ direct · (M_j + d_b b M_j^L,direct) + E_j forward · (M_j^G + d_b b M_j^L) ]
//
// direct = T̃; forward = d_f (mean e^{−τ(1−ā_f)} − T̃), for Poisson crossings; E_j = ∫G_j dω, since ψ_f is
// normalised and G_j is not; b = 1 − e^{−2(1−ā_f)τ′}, the share of the endless medium's back scattering that
// the hair beyond the point can give. With the factor 2 dropped from M and from S_back alike, and with
// s̃_f = 1/π in M^L, no further π belongs before d_b.

const D_B = 0.7;
const D_F = 0.7;

const SINGLE = 1u;
const GLOBAL = 2u;
const LOCAL = 4u;

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
    parts: u32,         // SINGLE | GLOBAL | LOCAL
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
@group(1) @binding(6) var<storage, read> slots: array<u32>;     // of each point

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
    let energy_o = averages(theta_o).energy;

    var total = vec3f(0.0);
    for (var j = 0u; j < shading.lights; j++) {
        let light = lights[shading.first_light + j];
        let bits = reach[j * shading.slots + slot];
        let direct = square(f32(bits & 1023u) / 1023.0);
        let quarter = square(f32((bits >> 10u) & 255u) / 255.0);
        let open = square(f32((bits >> 18u) & 63u) / 63.0);
        let beyond = square(f32(bits >> 24u) / 255.0);
        if (max(direct, quarter) < light.least) {
            continue;
        }
        let sin_j = clamp(dot(u, light.direction), -1.0, 1.0);
        let theta_j = asin_accurate(sin_j);
        let d = across(light.direction, axis_x, axis_y);
        let phi = atan2_accurate(o.y * d.x - o.x * d.y, dot(o, d));     // φ_o − φ_j
        let cos_sum = o.x * d.x - o.y * d.y;                            // cos(φ_o + φ_j)
        let a = averages(theta_j);

        // ln of the mean of V e^{−sτ}, quadratic in s through its values at 0, ¼ and 1.
        let ln_quarter = log(max(quarter, 1e-6) / open);
        let ln_direct = log(max(direct, 2e-7) / open);
        let p = (16.0 * ln_quarter - ln_direct) / 3.0;
        let q = ln_direct - p;
        let s = 1.0 - a.a_f;
        let arriving = min(open * exp(min(s * (p + q * s), vec3f(0.0))), vec3f(open));
        let forward = D_F * max(arriving - direct, vec3f(0.0));

        // The mean optical depth of what arrives, and from it the mean number of forward scatterings,
        // given that there was one.
        let scatterings = max(-(p + 2.0 * q * s) * a.a_f, vec3f(1e-4));
        let mean_count = scatterings / (1.0 - exp(-scatterings));
        let spread2 = dot(mean_count * a.beta_f2, vec3f(1.0 / 3.0));
        let sigma_f = sqrt(light.lambda * light.lambda + spread2);
        let back = D_B * (1.0 - exp(4.0 * s * log(max(beyond, 1e-6))));

        // Loops that run once: see resolve.wgsl.
        var scattered = vec3f(0.0);
        for (var lit = direct >= light.least; lit; lit = false) {
            if ((shading.parts & SINGLE) != 0u) {
                let m = single_scattering(fibre, theta_o, theta_j, phi, cos_sum, light.lambda);
                scattered += direct * (energy_o.x * m.r + energy_o.y * m.tt + energy_o.z * m.trt);
            }
            if ((shading.parts & LOCAL) != 0u) {
                scattered += back * direct * local_scattering_direct(fibre, theta_o, theta_j, phi, light.lambda);
            }
        }
        let forward_energy = light.energy * forward;
        for (var lit = any(forward >= vec3f(light.least)); lit; lit = false) {
            if ((shading.parts & GLOBAL) != 0u) {
                let m = global_scattering(fibre, theta_o, theta_j, phi, sigma_f);
                scattered += forward_energy * (energy_o.x * m.r + energy_o.y * m.tt + energy_o.z * m.trt);
            }
            if ((shading.parts & LOCAL) != 0u) {
                scattered += back * forward_energy
                    * local_scattering_forward(fibre, theta_o, theta_j, phi, sigma_f);
            }
        }
        total += light.rgb * scattered;
    }
    if (shading.first_light > 0u) {
        total += radiance[point].rgb;
    }
    radiance[point] = vec4f(total, 1.0);
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

fn square(x: f32) -> f32 {
    return x * x;
}

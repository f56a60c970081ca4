// Marschner's fibre along the strand, for fast.wgsl. Twin: src/scattering/model.rs.

// Taper::MARSCHNER; the modes of three lobes.
const SLOPE = vec4f(1.7, 1.0, 1.0, 0.0);
const COMPENSATION_MAX: f32 = 4.0;

// M_t over θ_i.
struct Lengthwise {
    centre: f32,
    lambda: f32,
}

fn lengthwise(fibre: Fibre, theta_o: f32, t: u32) -> Lengthwise {
    return Lengthwise(2.0 * fibre.alpha[t] - theta_o, fibre.lambda[t]);
}

// 1−⟨cos⟩ of a mode's own blur.
fn own_blur(fibre: Fibre, t: u32) -> f32 {
    return select(0.0, fibre.blur, t == 2u);
}

// M_t cos²θ_i/cos²θ_d at a node.
fn sight(theta_o: f32, m: Lengthwise, node: Node, exponent: f32) -> Sight {
    let cos_i = max(cos_near(node.theta), 0.0);
    let cos_d = max(cos_near(0.5 * (theta_o - node.theta)), 1e-6);
    let ratio = cos_i / cos_d;
    let x = (node.theta - m.centre) / m.lambda;
    let weight = node.weight * exp(exponent - x * x) / (SQRT_PI * m.lambda) * min(ratio * ratio, 4.0);
    return Sight(cos_i, cos_d, weight);
}

// C_t(θ_o) of R, TT, TRT.
fn energy_compensation(fibre: Fibre, theta_o: f32) -> vec3f {
    var energy = vec3f();
    for (var t = 0u; t < 3u; t++) {
        let eta = mean_eta(fibre, t);
        let m = lengthwise(fibre, theta_o, t);
        let place = node_place(lobe_of(theta_o, 0.0, 1e3, m.centre, m.lambda, SLOPE[t]));
        var kept = 0.0;
        for (var k = 0u; k < NODES; k++) {
            let at = sight(theta_o, m, node_at(place, k), 0.0);
            kept += at.weight * clear_energy(eta, t, at.cos_path);
        }
        energy[t] = min(clear_energy(eta, t, cos(theta_o)) / max(kept, 1e-30), COMPENSATION_MAX);
    }
    return energy;
}

fn clear_energy(eta: EtaPlace, t: u32, cos_theta: f32) -> f32 {
    return max(dot(energy_weights(eta, t, max(cos_theta, 0.0)), vec4f(1.0)), 1e-9);
}

// θ_i by M_t (Box and Muller 1958), and what its weight is multiplied by; 0 past a pole.
fn draw_inclination(fibre: Fibre, t: u32, theta_o: f32, u: vec2f) -> vec2f {
    let m = lengthwise(fibre, theta_o, t);
    let theta = m.centre + m.lambda * sqrt(-log(max(1.0 - u.x, 1e-20))) * cos(TWO_PI * u.y);
    let inside = abs(theta) < HALF_PI;
    return vec2f(clamp(theta, -HALF_PI, HALF_PI), select(0.0, projection(theta, theta_o), inside));
}

// Cosine of the inclination that A_t and Φ_t follow from.
fn draw_cos_path(theta_i: f32, theta_o: f32) -> f32 {
    return max(cos(0.5 * (theta_o - theta_i)), 0.0);
}

// Standard deviation of a mode's own blur over azimuth.
fn draw_blur(fibre: Fibre, t: u32) -> f32 {
    return select(0.0, SQRT_HALF * fibre.w_c, t == 2u);
}

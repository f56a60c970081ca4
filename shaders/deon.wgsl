// d'Eon's fibre along the strand, A_p at θ_o, for fast.wgsl. Twin: src/scattering/model.rs.

// Taper::DEON.
const SLOPE = vec4f(0.3, 0.75, 0.1, 0.1);

// M_p over θ_i; p = 3 are all paths longer than TRT.
struct Lengthwise {
    centre: f32,
    lambda: f32,        // √(2v)
    concentration: f32, // cos(centre)/v
    scale: f32,         // 1/2πv(1−e^{−2/v})
}

fn lengthwise(fibre: Fibre, theta_o: f32, p: u32) -> Lengthwise {
    // Longer paths have TRT's width and no shift.
    let shift = select(2.0 * fibre.alpha[min(p, 2u)], 0.0, p > 2u);
    let centre = over_the_pole(shift - theta_o);
    let lambda = fibre.lambda[min(p, 2u)];
    let v = 0.5 * lambda * lambda;
    return Lengthwise(centre, lambda, max(cos_near(centre), 0.0) / v, von_mises_scale(v));
}

// 1−⟨cos⟩ of a lobe's own blur.
fn own_blur(fibre: Fibre, p: u32) -> f32 {
    return fibre.blur;
}

// M_p cosθ_i at a node.
fn sight(theta_o: f32, m: Lengthwise, node: Node, exponent: f32) -> Sight {
    let cos_i = max(cos_near(node.theta), 0.0);
    let s = 2.0 * sin_near(0.5 * (node.theta - m.centre)) / m.lambda;
    let weight = node.weight * exp(exponent - s * s) * m.scale * circular_integral(m.concentration * cos_i) * cos_i;
    return Sight(cos_i, max(cos_near(theta_o), 0.0), weight);
}

// It loses nothing.
fn energy_compensation(fibre: Fibre, theta_o: f32) -> vec3f {
    return vec3f(1.0);
}

// θ_i of a Gaussian on the sphere about a place of the cone (d'Eon et al. 2013), and what its weight is multiplied by.
fn draw_inclination(fibre: Fibre, t: u32, theta_o: f32, u: vec2f) -> vec2f {
    let m = lengthwise(fibre, theta_o, t);
    let v = 0.5 * m.lambda * m.lambda;
    let drop = clamp(-v * log(max(1.0 - u.x * (1.0 - exp(-2.0 / v)), 1e-20)), 0.0, 2.0);
    let across = sqrt(max(drop * (2.0 - drop), 0.0));
    let sine = across * cos(TWO_PI * u.y) * cos(m.centre) + (1.0 - drop) * sin(m.centre);
    return vec2f(asin_accurate(clamp(sine, -1.0, 1.0)), 1.0);
}

// Cosine of the inclination that A_t and Φ_t follow from.
fn draw_cos_path(theta_i: f32, theta_o: f32) -> f32 {
    return max(cos(theta_o), 0.0);
}

// Standard deviation of a mode's own blur over azimuth.
fn draw_blur(fibre: Fibre, t: u32) -> f32 {
    return SQRT_HALF * fibre.w_c;
}

// The longitudinal side of a mode. Twin: src/scattering/longitudinal.rs.

const SPREAD_MAX: f32 = 1.25;

// cos²θ_i/cos²θ_d, at most 4.
fn projection(theta_i: f32, theta_o: f32) -> f32 {
    let ratio = cos(theta_i) / max(cos(0.5 * (theta_o - theta_i)), 1e-6);
    return min(ratio * ratio, 4.0);
}

// One node of a quadrature over θ_i.
struct Node {
    theta: f32,
    weight: f32,
}

// ∫g^u(θ; θ_j, σ_f) cosθ dθ over [−π/2, π/2].
fn spread_normaliser(theta_j: f32, sigma_f: f32) -> f32 {
    let a = erf_and_gauss((HALF_PI - theta_j) / sigma_f);
    let b = erf_and_gauss((HALF_PI + theta_j) / sigma_f);
    let s2 = sigma_f * sigma_f;
    return 0.5 * max(cos(theta_j), 0.0) * (a.x + b.x) * exp(-0.25 * s2)
        + 0.5 / SQRT_PI * sigma_f * exp(-s2 / 6.0) * (a.y + b.y);
}

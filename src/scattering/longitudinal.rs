//! The longitudinal side of a mode: M_t and the quadrature over θ_i (Xu 2011, Eq 7 and §4.2.2).
//!
//! Where we deviate from the print:
//! - Eq 7 carries Marschner's doubling (∫M_t dθ_i = 2). M_t here has unit integral over θ_i, so that a
//!   clear fibre does not create light.
//! - Nodes outside [−π/2, π/2] are clamped to it. There cos²θ_i/cos²θ_d is 0, so the two end nodes and
//!   the clamped ones cost nothing: m segments take m−1 evaluations.
//! - A unit Gaussian still loses energy, since ∫M_t cos²θ_i/cos²θ_d dθ_i < 1: 9 % for β_TT = 10° at
//!   θ_o = 0. [`energy_compensation`] gives it back; the renderer multiplies by it.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

use super::gaussian::{erf, g_unit};

/// Bandwidth λ_M = 2√2·β of M_t as a function of θ_i, from the standard deviation β of θ_h.
pub fn longitudinal_bandwidth(beta: f64) -> f64 {
    2.0 * SQRT_2 * beta
}

/// M_t(θ_i) = g^u(θ_i; 2α_t−θ_o, 2√2 β_t).
pub fn longitudinal(theta_i: f64, theta_o: f64, alpha: f64, beta: f64) -> f64 {
    g_unit(theta_i, 2.0 * alpha - theta_o, longitudinal_bandwidth(beta))
}

/// cos²θ_i/cos²θ_d with θ_d = (θ_o−θ_i)/2: at most 4, and 0 at θ_i = ±π/2.
pub fn projection(theta_i: f64, theta_o: f64) -> f64 {
    let cos_d = (0.5 * (theta_o - theta_i)).cos();
    (theta_i.cos() / cos_d.max(f64::MIN_POSITIVE)).powi(2).min(4.0)
}

/// One node of the quadrature: its θ_i and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    pub theta: f64,
    pub weight: f64,
}

/// The m−1 inner nodes of ∫_{−π/2}^{π/2} g(θ; μ, λ) f(θ) dθ ≈ Σ weight·f(theta), for an f that
/// vanishes at ±π/2 and is taken as piecewise linear between μ + (k − (m−2)/2)λ, k = 0…m−2, and the
/// two ends. `segments` is m ≥ 2.
pub fn linear_quadrature(mu: f64, lambda: f64, segments: u32) -> impl Iterator<Item = Node> {
    let (low, high) = ((-FRAC_PI_2 - mu) / lambda, (FRAC_PI_2 - mu) / lambda);
    let at = move |k: i64| {
        if k < 0 {
            low
        } else if k >= i64::from(segments) - 1 {
            high
        } else {
            (k as f64 - 0.5 * (f64::from(segments) - 2.0)).clamp(low, high)
        }
    };
    (0..i64::from(segments) - 1).map(move |k| {
        let (before, t, after) = (at(k - 1), at(k), at(k + 1));
        let weight = lambda * (hat_side(before, t) + hat_side(-after, -t));
        Node { theta: (mu + lambda * t).clamp(-FRAC_PI_2, FRAC_PI_2), weight }
    })
}

/// ∫_a^b e^{−t²} (t−a)/(b−a) dt: the rising side of a hat against the unit Gaussian.
fn hat_side(a: f64, b: f64) -> f64 {
    let width = b - a;
    if width < 1e-2 {
        // The closed form cancels here (in f32 by 1e-7/width); a short side is linear anyway.
        return 0.5 * width.max(0.0) * (-b * b).exp();
    }
    let mass = 0.5 * PI.sqrt() * (erf(b) - erf(a));
    let moment = 0.5 * ((-a * a).exp() - (-b * b).exp());
    (moment - a * mass) / width
}

/// The most that [`energy_compensation`] gives back. It is reached only where the tilt throws most of
/// the lobe past ±π/2, and a mode that has lost three quarters of itself has no shape left to scale.
pub const COMPENSATION_MAX: f64 = 4.0;

/// C_t(θ_o) = E_t(θ_o) / ∫_{−π/2}^{π/2} M_t cos²θ_i/cos²θ_d E_t(θ_d) dθ_i, E_t = `clear_energy` the energy ∫N_t dφ of a
/// clear fibre: under even light S_t times this sends on E_t(θ_o), and Σ_t E_t ≤ 1 since all are of one θ. At most
/// [`COMPENSATION_MAX`].
///
/// Without E_t, each mode by itself loses nothing, but of θ_d that differ by mode: a clear fibre of β_R = 7°,
/// α_R = −7° then makes light towards grazing, and ten thousand such strands under a unit map return 1.09.
///
/// The integral is taken by the method's own quadrature with `segments`, so that this also gives back what that
/// rule's straight pieces cut off a bulging integrand (3 % at β_R = 20°).
pub fn energy_compensation(
    segments: u32,
    theta_o: f64,
    alpha: f64,
    beta: f64,
    clear_energy: impl Fn(f64) -> f64,
) -> f64 {
    let lambda_m = longitudinal_bandwidth(beta);
    let kept: f64 = linear_quadrature(2.0 * alpha - theta_o, lambda_m, segments)
        .map(|node| {
            let energy = clear_energy(0.5 * (theta_o - node.theta));
            node.weight * projection(node.theta, theta_o) * energy
        })
        .sum();
    let whole = PI.sqrt() * lambda_m * clear_energy(theta_o);
    (whole / kept.max(f64::MIN_POSITIVE)).min(COMPENSATION_MAX)
}

/// The part of [−π/2, π/2] where M_t against θ_o is above e^{−16} of its peak.
pub fn lobe_range(theta_o: f64, alpha: f64, beta: f64) -> (f64, f64) {
    let (centre, reach) = (2.0 * alpha - theta_o, 4.0 * longitudinal_bandwidth(beta));
    let inside = |x: f64| x.clamp(-FRAC_PI_2, FRAC_PI_2);
    (inside(centre - reach), inside(centre + reach))
}

/// The widest forward spread σ_f told apart: a Gaussian of bandwidth 1.25 rad covers all θ.
pub const SPREAD_MAX: f64 = 1.25;

/// ∫_{−π/2}^{π/2} g^u(θ; θ_j, σ_f) cosθ dθ, by which ψ_f of Eq 5 is divided. The paper divides by
/// cosθ_j, which is its limit for σ_f → 0 and diverges for a light along the fibre. This closed form
/// is never below the integral by more than 0.6 % and above by at most 0.5 % for σ_f = 0.5,
/// 2.2 % for 1 and 5.3 % for [`SPREAD_MAX`].
pub fn spread_normaliser(theta_j: f64, sigma_f: f64) -> f64 {
    let (a, b) = ((FRAC_PI_2 - theta_j) / sigma_f, (FRAC_PI_2 + theta_j) / sigma_f);
    let s2 = sigma_f * sigma_f;
    0.5 * theta_j.cos() * (erf(a) + erf(b)) * (-0.25 * s2).exp()
        + 0.5 * sigma_f / PI.sqrt() * (-s2 / 6.0).exp() * ((-a * a).exp() + (-b * b).exp())
}

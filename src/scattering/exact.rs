//! ∫G_j S_t cosθ_i dω of the exact Marschner model, by quadrature over θ_i and h: what `xu.rs`
//! approximates. A round fibre; TRT is convolved with the normalised circular Gaussian of
//! bandwidth w_c. No roots of Eq 8 are needed: ∫N_t(φ)f(φ)dφ = ½∫A_t(h) f(φ(p, h))dh.

use std::f64::consts::FRAC_PI_2;

use super::{
    azimuthal::{attenuation, effective_absorption, exit_azimuth, inverse_eta_prime, wrap},
    fibre::Fibre,
    gaussian::{concentration, g_circular, g_circular_integral, g_circular_product},
    longitudinal::{longitudinal, longitudinal_bandwidth, projection},
    quadrature::GaussLegendre,
};

/// 𝓜_t for R, TT, TRT in channel `channel`, relative error near 1e-6 for λ_j ≥ 0.05.
pub fn single_scattering(
    fibre: &Fibre,
    channel: usize,
    theta_o: f64,
    theta_j: f64,
    phi: f64,
    lambda_j: f64,
) -> [f64; 3] {
    let rule = GaussLegendre::new(16);
    [0, 1, 2].map(|t| {
        let reach = 6.0 * longitudinal_bandwidth(fibre.beta[t]);
        let centre = 2.0 * fibre.alpha[t] - theta_o;
        let low = (centre - reach).max(-FRAC_PI_2).max(theta_j - 6.0 * lambda_j);
        let high = (centre + reach).min(FRAC_PI_2).min(theta_j + 6.0 * lambda_j);
        panels(&rule, low, high, 6, |theta_i| {
            let kappa = concentration(lambda_j) * (theta_i.cos() * theta_j.cos()).max(0.0);
            let theta_d = 0.5 * (theta_o - theta_i);
            g_circular(theta_i - theta_j, concentration(lambda_j))
                * longitudinal(theta_i, theta_o, fibre.alpha[t], fibre.beta[t])
                * projection(theta_i, theta_o)
                * azimuthal_integral(&rule, fibre, channel, t, theta_d, phi, kappa)
        })
    })
}

/// 𝒩_t of Eq 12 at one θ_d.
pub fn azimuthal_integral(
    rule: &GaussLegendre,
    fibre: &Fibre,
    channel: usize,
    mode: usize,
    theta_d: f64,
    phi: f64,
    kappa: f64,
) -> f64 {
    let absorption = effective_absorption(fibre.sigma_a[channel], fibre.eta, theta_d);
    let q = inverse_eta_prime(fibre.eta, theta_d);
    let kappa_c = concentration(fibre.w_c);
    panels(rule, -FRAC_PI_2, FRAC_PI_2, 24, |gamma| {
        let a = attenuation(fibre.eta, theta_d, gamma, absorption)[mode];
        let apart = wrap(phi - exit_azimuth(mode as u32, gamma, q));
        let light = if mode == 2 {
            g_circular_product(apart, kappa, kappa_c) / g_circular_integral(kappa_c)
        } else {
            g_circular(apart, kappa)
        };
        0.5 * gamma.cos() * a * light
    })
}

/// A composite rule of `n` equal panels; 0 for an empty range.
fn panels(rule: &GaussLegendre, low: f64, high: f64, n: usize, f: impl Fn(f64) -> f64) -> f64 {
    if high <= low {
        return 0.0;
    }
    let step = (high - low) / n as f64;
    (0..n)
        .map(|i| {
            let from = low + i as f64 * step;
            rule.integrate(from, from + step, &f)
        })
        .sum()
}

//! Dual scattering's averages of any fibre model, exactly as defined (Zinke et al. 2008; Xu 2011, §4.4).
//!
//! The light's inclination θ is fixed; it comes from a half circle of azimuths and leaves into the half of
//! the sphere that it heads for (forward, f) or that it came from (backward, b):
//!
//! > ā_f(θ) = (1/π) ∫_{Ω_f} ∫_{−π/2}^{π/2} S(θ, φ, ω_o) cosθ dφ dω_o
//!
//! With φ the azimuth between light and view both azimuths make one, (1/π)∫|φ| N_p dφ for f and the rest of
//! ∫N_p dφ for b. As in `integral.rs` N_p is never formed: |φ|/π is averaged over the detector instead.
//!
//! The weight, cosθ cosθ_o/cos²θ_d, is not flux: that would be cos²θ_o/cos²θ_d, and ā_f+ā_b the albedo. Where a
//! lobe is wide at grazing, far more goes to steeper θ_o than the definition's cosθ lets count. For white hair
//! (η 1.55, β_R 7.5°, no tilt) ā_f+ā_b by the definition, the albedo, and the renderer's averages
//! (`scattering::dual`: flux of unit integral), measured: 0.984, 0.969, 0.992 at 0°; 0.909, 0.907, 0.950 at 60°;
//! 0.397, 0.880, 0.793 at 85°. The definition is what other work means by these names; it is no bound on what a
//! fibre sends on.

use std::f64::consts::{FRAC_PI_2, PI};

use super::{
    adaptive::{Integral, Tolerance, integrate},
    integral::{blur, depends_on_phi_h, inclination_breaks, offset_breaks},
    model::{Detector, FibreModel, Section},
};
use crate::scattering::{
    azimuthal::wrap,
    dual::{backward_series, backward_shift, backward_spread, lost},
};

/// How exact the shares are, of which 1 is the most; then the mean over azimuth and the one over a detector.
const OUTER: Tolerance = Tolerance { relative: 1e-9, absolute: 1e-15 };
const INNER: Tolerance = Tolerance { relative: 1e-10, absolute: 1e-17 };
const BLUR: f64 = 1e-11;

/// Orientations of an eccentric fibre about which its shares are averaged.
const ORIENTATIONS: usize = 16;

/// The averages at one inclination, RGB. α, β, Δ̄_b and σ̄_b are angles of θ_h in radians; β and σ̄_b
/// standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct Averages {
    /// ā_f and ā_b of each lobe.
    pub lobes: Vec<[[f64; 3]; 2]>,
    pub a_f: [f64; 3],
    pub a_b: [f64; 3],
    /// ᾱ and β̄: means of α_p and, squared, of β_p, weighted by the lobes' ā_f or ā_b.
    pub alpha_f: [f64; 3],
    pub alpha_b: [f64; 3],
    pub beta_f: [f64; 3],
    pub beta_b: [f64; 3],
    /// Ā_b by the whole series of crossings.
    pub big_a_b: [f64; 3],
    /// Ā_b by Zinke's Ā_1 + Ā_3, its first two terms.
    pub big_a_b_two_terms: [f64; 3],
    pub delta_b: [f64; 3],
    pub sigma_b: [f64; 3],
}

/// The averages at inclination `theta` of a model whose lobe p has shift and width `shape[p]` = (α_p, β_p),
/// radians of θ_h.
pub fn averages(model: &dyn FibreModel, shape: &[(f64, f64)], theta: f64) -> Averages {
    let lobes: Vec<[[f64; 3]; 2]> = (0..model.lobes())
        .map(|p| lobe_shares(model, p, theta).value)
        .map(|v| [[v[0], v[1], v[2]], [v[3], v[4], v[5]]])
        .collect();
    let sum = |side: usize| [0, 1, 2].map(|c| lobes.iter().map(|lobe| lobe[side][c]).sum::<f64>());
    // The smallest number is a weight where all lobes have none.
    let mean = |side: usize, of: fn(&(f64, f64)) -> f64| {
        [0, 1, 2].map(|c| {
            let weights = lobes.iter().map(|lobe| lobe[side][c] + f64::MIN_POSITIVE);
            let whole: f64 = weights.clone().sum();
            weights.zip(shape).map(|(weight, shape)| weight * of(shape)).sum::<f64>() / whole
        })
    };
    let (a_f, a_b) = (sum(0), sum(1));
    let alpha = [0, 1].map(|side| mean(side, |(alpha, _)| *alpha));
    let beta2 = [0, 1].map(|side| mean(side, |(_, beta)| beta * beta));
    let each = |of: &dyn Fn(usize) -> f64| [0, 1, 2].map(of);
    Averages {
        alpha_f: alpha[0],
        alpha_b: alpha[1],
        beta_f: beta2[0].map(f64::sqrt),
        beta_b: beta2[1].map(f64::sqrt),
        big_a_b: each(&|c| backward_series(a_f[c], a_b[c])),
        big_a_b_two_terms: each(&|c| two_terms(a_f[c], a_b[c])),
        delta_b: each(&|c| backward_shift(a_f[c], a_b[c], alpha[0][c], alpha[1][c])),
        sigma_b: each(&|c| backward_spread(a_f[c], a_b[c], beta2[0][c], beta2[1][c])),
        lobes,
        a_f,
        a_b,
    }
}

/// Ā_1 + Ā_3.
fn two_terms(a_f: f64, a_b: f64) -> f64 {
    let d = lost(a_f);
    a_f * a_f * (a_b / d + (a_b / d).powi(3))
}

/// ā_f (RGB), then ā_b (RGB), of lobe p at inclination `theta`; an eccentric fibre's are the mean over its
/// orientations.
pub fn lobe_shares(model: &dyn FibreModel, p: usize, theta: f64) -> Integral<6> {
    let weight = |theta_o: f64| model.longitudinal(p, theta, theta_o) * theta_o.cos().max(0.0);
    integrate(&inclination_breaks(weight), OUTER, |theta_o| {
        let weight = weight(theta_o);
        let at = |phi_h| Section { theta_i: theta, theta_o, phi_h };
        let count = if depends_on_phi_h(model, p, at) { ORIENTATIONS } else { 1 };
        let mut mean = [0.0; 6];
        for i in 0..count {
            let phi_h = FRAC_PI_2 * (i as f64 + 0.5) / count as f64;
            let shares = azimuthal_shares(model, p, &at(phi_h));
            mean = std::array::from_fn(|k| mean[k] + weight * shares[k] / count as f64);
        }
        mean
    })
}

/// (1/π)∫|φ| N_p dφ (RGB) and the rest of ∫N_p dφ (RGB).
fn azimuthal_shares(model: &dyn FibreModel, p: usize, section: &Section) -> [f64; 6] {
    let detector = model.detector(p);
    // |φ| has kinks at 0 and π, which the detector rounds.
    let width = blur(&detector);
    let targets: Vec<f64> = [0.0, PI]
        .into_iter()
        .flat_map(|kink| [-3.0, 0.0, 3.0].map(|x| kink + x * width))
        .filter(|_| width < 0.3)
        .collect();
    let breaks = offset_breaks(|gamma| model.path(p, gamma.sin(), section).azimuth, &targets);
    integrate(&breaks, INNER, |gamma: f64| {
        let path = model.path(p, gamma.sin(), section);
        let forward = forward_share(&detector, path.azimuth);
        let energy = path.attenuation.map(|a| 0.5 * gamma.cos() * a);
        let [f, b] = [forward, 1.0 - forward].map(|share| energy.map(|e| share * e));
        [f[0], f[1], f[2], b[0], b[1], b[2]]
    })
    .value
}

/// The mean of |φ|/π over a detector about Φ: |Φ|/π, and what the detector carries past the kinks at 0
/// and π, by E(y) = ∫_y^π (x−y) D(x) dx.
fn forward_share(detector: &Detector, azimuth: f64) -> f64 {
    let phi = wrap(azimuth).abs();
    let width = blur(detector).min(PI);
    let reach = (24.0 * width).min(PI);
    let past = |y: f64| {
        if y >= reach || *detector == Detector::Delta {
            return 0.0;
        }
        let breaks = [y, y + 4.0 * width, y + 10.0 * width, reach].map(|x| x.min(reach));
        let tolerance = Tolerance { relative: 0.0, absolute: BLUR };
        integrate(&breaks, tolerance, |x| [(x - y) * detector.density(x)]).value[0]
    };
    (phi + 2.0 * (past(phi) - past(PI - phi))) / PI
}

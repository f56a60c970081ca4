//! The azimuthal side of a mode: N_t, its energy and its circular Gaussians (Xu 2011 §4.1, §4.2.1,
//! §4.2.3, §4.2.4; Marschner 2003 for the paths).
//!
//! [`Fit`] holds what Eq 16 and Eq 20 need at one θ_d: b_tt, λ_tt, b_1, λ_1, b_2, φ*. It depends on the
//! fibre and θ_d alone, so [`FitTable`] samples it once per edit and the shader only interpolates.
//!
//! Where we deviate from the print:
//! - Energies (Eq 19, Eq 23) by a Gauss–Legendre rule over γ = asin h instead of the fourth-order
//!   Taylor expansion of T, which at θ_d = 0, η = 1.55 is off by −4.3 % at σ_a = 1, −15 % at 1.78,
//!   −46 % at 3.35 and −99 % at 10.96 for TRT (TT: −0.5, −1.7, −7.2, −69 %). The Taylor form stays as
//!   [`Energy::Taylor`].
//! - Bandwidths from the exact ∫g^c (see `gaussian.rs`).
//! - b_2 is limited so that b_1 ≥ 0: the printed residual turns negative at σ_a = 3.
//! - For η′ > 2 the single Gaussian is kept as the pair of Eq 20 with φ* = 0 and half of b_3 each,
//!   and b_3 = E/∫g^c(λ₃′) comes from the energy, never from b_3·λ₃, since N_TRT(0) → ∞ at η′ = 2.
//!   All six parameters then run continuously through η′ = 2. One λ₃ serves all channels: the mean
//!   weighted by energy.
//! - Δη′ = 0.3, the middle of the paper's 0.2 to 0.4; the smoothstep ends at 2+Δη′, not 2+η′.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rayon::prelude::*;

use super::{
    fibre::Fibre,
    fresnel::{fresnel, fresnel_normal},
    gaussian::{
        KAPPA_MAX, KAPPA_MIN, concentration, concentration_of_integral, g_circular,
        g_circular_integral,
    },
    quadrature::GaussLegendre,
    tables::{AbsorptionMoments, pack, place},
};

/// Range of η′ above 2 over which λ₃′ goes from w_c to λ₃.
const DELTA_ETA_PRIME: f64 = 0.3;

/// Nodes over γ for energies: relative error below 1e-6 for σ_a ≤ 30 (see tests).
const ENERGY_NODES: usize = 24;

/// 1/η′ = cosθ_d/√(η²−sin²θ_d), in [0, 1]: finite at grazing, where η′ is not.
pub fn inverse_eta_prime(eta: f64, theta_d: f64) -> f64 {
    let (sin, cos) = theta_d.sin_cos();
    (cos.abs() / (eta * eta - sin * sin).max(1e-30).sqrt()).min(1.0)
}

/// σ_a′ = σ_a/√(1−sin²θ_d/η²).
pub fn effective_absorption(sigma_a: f64, eta: f64, theta_d: f64) -> f64 {
    sigma_a / (1.0 - (theta_d.sin() / eta).powi(2)).max(1e-12).sqrt()
}

/// φ(p, h) of Eq 8, not wrapped, with h = sin γ.
pub fn exit_azimuth(p: u32, gamma: f64, inverse_eta_prime: f64) -> f64 {
    let p = f64::from(p);
    2.0 * p * (gamma.sin() * inverse_eta_prime).asin() - 2.0 * gamma + p * PI
}

/// φ wrapped to [−π, π].
pub fn wrap(phi: f64) -> f64 {
    phi - TAU * (phi / TAU).round()
}

/// A_t(h) of Eq 10 for R, TT, TRT with exact Fresnel, h = sin γ, `absorption` = σ_a′.
pub fn attenuation(eta: f64, theta_d: f64, gamma: f64, absorption: f64) -> [f64; 3] {
    let f = fresnel(theta_d.cos() * gamma.cos(), eta);
    let h_t = gamma.sin() * inverse_eta_prime(eta, theta_d);
    let t = (-2.0 * absorption * (1.0 - h_t * h_t).max(0.0).sqrt()).exp();
    let inside = (1.0 - f) * (1.0 - f) * t;
    [f, inside, inside * f * t]
}

/// E_t = ∫_{−π}^{π} N_t dφ = ½∫_{−1}^{1} A_t dh for R, TT, TRT: the share of the light that crosses
/// the fibre's width and leaves by each mode.
pub fn energies(rule: &GaussLegendre, eta: f64, theta_d: f64, absorption: f64) -> [f64; 3] {
    let mut energy = [0.0; 3];
    for (gamma, weight) in rule.on(0.0, FRAC_PI_2) {
        let a = attenuation(eta, theta_d, gamma, absorption);
        for t in 0..3 {
            energy[t] += weight * gamma.cos() * a[t];
        }
    }
    energy
}

/// [`energies`] of a clear fibre over |θ_d| in [0, π/2], for energy compensation.
#[derive(Clone, Debug)]
pub struct ClearEnergies {
    rows: Vec<[f64; 3]>,
}

impl ClearEnergies {
    const ROWS: usize = 513;
    /// A mode that has no energy (R and TRT at η = 1) is compensated as if it had this much.
    const LEAST: f64 = 1e-9;

    pub fn new(eta: f64) -> ClearEnergies {
        let rule = GaussLegendre::new(ENERGY_NODES);
        let last = (Self::ROWS - 1) as f64;
        let row = |i| energies(&rule, eta, FRAC_PI_2 * i as f64 / last, 0.0);
        ClearEnergies { rows: (0..Self::ROWS).map(row).collect() }
    }

    /// E_t at θ_d in [−π/2, π/2], interpolated linearly; above 0.
    pub fn at(&self, theta_d: f64) -> [f64; 3] {
        let (low, f) = place(theta_d.abs() / FRAC_PI_2, Self::ROWS);
        let (a, b) = (self.rows[low], self.rows[low + 1]);
        [0, 1, 2].map(|t| (a[t] + f * (b[t] - a[t])).max(Self::LEAST))
    }
}

/// [`ClearEnergies`] over a range of η, linear between steps of 1/64: within 2e-4 of what is exact from η = 1.1 on.
#[derive(Clone, Debug)]
pub struct ClearRange {
    low: f64,
    steps: Vec<ClearEnergies>,
}

impl ClearRange {
    const PER_ETA: f64 = 64.0;

    pub fn new([low, high]: [f64; 2]) -> ClearRange {
        let low = low.max(1.0);
        let count = ((high - low).max(0.0) * Self::PER_ETA).ceil() as usize + 2;
        let step = |k: usize| ClearEnergies::new(low + k as f64 / Self::PER_ETA);
        ClearRange { low, steps: (0..count).into_par_iter().map(step).collect() }
    }

    /// E_t at η within the range and θ_d.
    pub fn at(&self, eta: f64, theta_d: f64) -> [f64; 3] {
        let last = self.steps.len() - 1;
        let (low, f) = place((eta - self.low) * Self::PER_ETA / last as f64, self.steps.len());
        let [a, b] = [low, low + 1].map(|k| self.steps[k].at(theta_d));
        [0, 1, 2].map(|t| a[t] + f * (b[t] - a[t]))
    }
}

/// C_k(θ_d, η), k = 0…6, of Eq 13: N_R ≈ Σ C_k |cos^k(φ/2)| with Schlick's Fresnel.
pub fn r_coefficients(eta: f64, theta_d: f64) -> [f64; 7] {
    let (f0, c) = (fresnel_normal(eta), -theta_d.cos());
    let s = 0.25 * (1.0 - f0);
    [
        0.0,
        0.25,
        5.0 * s * c,
        10.0 * s * c.powi(2),
        10.0 * s * c.powi(3),
        5.0 * s * c.powi(4),
        s * c.powi(5),
    ]
}

/// How ∫N_TT and ∫N_TRT are found.
#[derive(Clone, Copy, Debug)]
pub enum Energy<'a> {
    /// By quadrature over h; holds for every σ_a.
    Quadrature,
    /// As printed (Eq 18, 19, 22, 23): a fourth-order Taylor expansion of T against the tables
    /// ℋ_k. Fit for σ_a ≤ 1 only.
    Taylor(&'a AbsorptionMoments),
}

/// Coefficients a_0, a_2, a_4 of T^n = exp(−2nσ_a′√(1−h²/η′²)) about h = 0 (Eq 18, n = 1; Eq 22, n = 2).
pub fn taylor_coefficients(n: f64, absorption: f64, inverse_eta_prime: f64) -> [f64; 3] {
    let (s, q2) = (n * absorption, inverse_eta_prime.powi(2));
    let a0 = (-2.0 * s).exp();
    [a0, a0 * s * q2, a0 * (0.25 * s + 0.5 * s * s) * q2 * q2]
}

/// The circular Gaussians of N_TT (Eq 16) and N_TRT (Eq 20) at one θ_d, per channel:
/// N_TT = b_tt g^c(φ−π; κ_tt), N_TRT = b_1 (g^c(φ−φ*; κ_1) + g^c(φ+φ*; κ_1)) + b_2 g^c(φ; 2/φ*²).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    pub b_tt: [f64; 3],
    pub kappa_tt: [f64; 3],
    pub b_1: [f64; 3],
    /// One for all channels.
    pub kappa_1: f64,
    pub b_2: [f64; 3],
    pub phi_star: f64,
}

impl Fit {
    /// Eq 16 with its lobe integrated by `lobe(offset, κ)`.
    pub fn tt(&self, phi: f64, lobe: impl Fn(f64, f64) -> f64) -> [f64; 3] {
        [0, 1, 2].map(|c| self.b_tt[c] * lobe(phi - PI, self.kappa_tt[c]))
    }

    /// Eq 20 with its three lobes integrated by `lobe(offset, κ)`.
    pub fn trt(&self, phi: f64, lobe: impl Fn(f64, f64) -> f64) -> [f64; 3] {
        let centre = if self.phi_star > 0.0 {
            lobe(phi, concentration(self.phi_star).min(KAPPA_MAX))
        } else {
            0.0
        };
        let pair =
            lobe(phi - self.phi_star, self.kappa_1) + lobe(phi + self.phi_star, self.kappa_1);
        [0, 1, 2].map(|c| self.b_1[c] * pair + self.b_2[c] * centre)
    }
}

/// What all fits of one fibre share.
pub struct Fitter<'a> {
    fibre: &'a Fibre,
    energy: Energy<'a>,
    rule: GaussLegendre,
}

impl<'a> Fitter<'a> {
    /// Fits of `fibre`, with energies found by `energy`.
    pub fn new(fibre: &'a Fibre, energy: Energy<'a>) -> Self {
        Self { fibre, energy, rule: GaussLegendre::new(ENERGY_NODES) }
    }

    /// The fit at θ_d for a round fibre of index `eta` (Eq 25 puts η̄* there for TRT).
    pub fn fit(&self, eta: f64, theta_d: f64) -> Fit {
        let q = inverse_eta_prime(eta, theta_d);
        let absorption = self.fibre.sigma_a.map(|s| effective_absorption(s, eta, theta_d));
        let energy = absorption.map(|a| self.energies(eta, theta_d, a));
        let centre = absorption.map(|a| attenuation(eta, theta_d, 0.0, a));
        let mut fit = Fit { phi_star: phi_star(eta, theta_d), ..Fit::default() };

        // TT: b_tt = N_TT(π) (h = 0), the bandwidth from the energy (Eq 17).
        for c in 0..3 {
            fit.kappa_tt[c] = kappa_of_peak(energy[c][0], centre[c][1], 4.0 * (1.0 - q));
            fit.b_tt[c] = energy[c][0] / g_circular_integral(fit.kappa_tt[c]);
        }

        let w_c = self.fibre.w_c;
        let eta_prime = 1.0 / q.max(1e-9);
        if eta_prime < 2.0 {
            fit.kappa_1 = concentration(w_c).min(KAPPA_MAX);
            let ring = 1.0 - g_circular(fit.phi_star, fit.kappa_1);
            let middle = g_circular_integral(concentration(fit.phi_star).min(KAPPA_MAX));
            for c in 0..3 {
                let zero = trt_at_zero(eta, theta_d, absorption[c], centre[c][2]);
                fit.b_2[c] = (zero * ring * ring).min(energy[c][1] / middle);
            }
            let left = [0, 1, 2].map(|c| (energy[c][1] - fit.b_2[c] * middle).max(0.0));
            fit.b_1 = left.map(|e| e / (2.0 * g_circular_integral(fit.kappa_1)));
        } else {
            // λ₃ from b_3 = N_TRT(0) and the energy, its mean over channels weighted by energy, then
            // eased from w_c to it.
            let (mut sum, mut weights) = (0.0, 0.0);
            for c in 0..3 {
                let kappa = kappa_of_peak(energy[c][1], centre[c][2], 2.0 * (2.0 - 4.0 * q));
                let weight = energy[c][1] + 1e-12;
                sum += weight * (2.0 / kappa).sqrt();
                weights += weight;
            }
            let s = ((eta_prime - 2.0) / DELTA_ETA_PRIME).clamp(0.0, 1.0);
            let lambda = w_c + (sum / weights - w_c) * s * s * (3.0 - 2.0 * s);
            fit.kappa_1 = concentration(lambda).clamp(KAPPA_MIN, KAPPA_MAX);
            fit.b_1 = energy.map(|e| e[1] / (2.0 * g_circular_integral(fit.kappa_1)));
        }
        fit
    }

    /// ∫N_TT and ∫N_TRT.
    fn energies(&self, eta: f64, theta_d: f64, absorption: f64) -> [f64; 2] {
        match self.energy {
            Energy::Quadrature => {
                let [_, tt, trt] = energies(&self.rule, eta, theta_d, absorption);
                [tt, trt]
            }
            Energy::Taylor(moments) => {
                let q = inverse_eta_prime(eta, theta_d);
                let sum = |n, h: [f64; 3]| {
                    let a = taylor_coefficients(n, absorption, q);
                    0.5 * (a[0] * h[0] + a[1] * h[1] + a[2] * h[2])
                };
                let (h_tt, h_trt) = moments.sample(eta, theta_d);
                [sum(1.0, h_tt), sum(2.0, h_trt)]
            }
        }
    }
}

/// κ of the circular Gaussian with the given energy and the peak `attenuation`/`spread`, where
/// `spread` = 2|dφ/dh| at h = 0 may be 0 (an infinite peak).
fn kappa_of_peak(energy: f64, attenuation: f64, spread: f64) -> f64 {
    let integral = energy * spread / attenuation.max(f64::MIN_POSITIVE);
    concentration_of_integral(integral.max(1e-9))
}

/// The caustic φ* = |φ(2, h*)|, h*² = (4−η′²)/3; 0 for η′ ≥ 2.
fn phi_star(eta: f64, theta_d: f64) -> f64 {
    let q = inverse_eta_prime(eta, theta_d);
    let h2 = (4.0 - (q * q).recip()) / 3.0;
    if h2 <= 0.0 { 0.0 } else { wrap(exit_azimuth(2, h2.min(1.0).sqrt().asin(), q)).abs() }
}

/// N_TRT(φ = 0) for η′ < 2: Eq 9 over its three roots, h = 0 and h² = η′² − η′⁴/4.
fn trt_at_zero(eta: f64, theta_d: f64, absorption: f64, at_centre: f64) -> f64 {
    let q = inverse_eta_prime(eta, theta_d);
    let centre = at_centre / (2.0 * (4.0 * q - 2.0)).max(1e-9);
    let eta_prime_2 = (q * q).recip();
    let cos_gamma = (1.0 - 0.5 * eta_prime_2).abs();
    let [_, _, at_side] = attenuation(eta, theta_d, cos_gamma.min(1.0).acos(), absorption);
    // dφ/dh·cosγ = 8q²cosγ − 2, since √(1−h²q²) = 1/(2q) there.
    let side = at_side * cos_gamma / (2.0 * (8.0 * q * q * cos_gamma - 2.0).abs()).max(1e-9);
    centre + 2.0 * side
}

/// 1/√(1+κ) in (0, 1]: like λ where a Gaussian is narrow, bounded where it is wide. The coordinate in
/// which bandwidths are interpolated.
pub fn width_of(kappa: f64) -> f64 {
    (1.0 + kappa).sqrt().recip()
}

/// The inverse of [`width_of`].
pub fn kappa_of(width: f64) -> f64 {
    (1.0 / (width * width) - 1.0).max(0.0)
}

/// η* of Eq 24 as (mean, half difference): η*(φ_h) = mean + half·cos 2φ_h.
pub fn eccentric_eta(eta: f64, eccentricity: f64) -> (f64, f64) {
    let a2 = eccentricity * eccentricity;
    let (rise, base) = (2.0 * (eta - 1.0), 2.0 - eta);
    let (eta_1, eta_2) = (rise * a2 + base, rise / a2 + base);
    (0.5 * (eta_1 + eta_2), 0.5 * (eta_1 - eta_2))
}

/// φ_h by which the mean over a fibre's turn is taken: exact for the first seven harmonics of 2φ_h.
pub const TURNS: [f64; 4] = [0.0625 * PI, 0.1875 * PI, 0.3125 * PI, 0.4375 * PI];

/// The range of η̄* that an eccentric fibre's fits are sampled over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitLayers {
    /// η*(φ_h) = mean + half·cos 2φ_h.
    pub mean: f64,
    /// See `mean`.
    pub half: f64,
    /// η of the first layer and of the last, at least 1.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Layers, 1 for a round fibre.
    pub count: usize,
}

impl FitLayers {
    /// Layers over η̄* of an eccentric fibre.
    const ECCENTRIC: usize = 32;

    /// The layers a fibre needs.
    pub fn new(fibre: &Fibre) -> Self {
        let (mean, half) = eccentric_eta(fibre.eta, fibre.eccentricity);
        let (low, high) = ((mean - half.abs()).max(1.0), (mean + half.abs()).max(1.0));
        let count = if high - low > 1e-6 { Self::ECCENTRIC } else { 1 };
        Self { mean, half, low, high, count }
    }

    /// Layers of fibres that differ from point to point, η* within `range`, `base` among them: a step of 1/32 or less,
    /// and ends that stay where they are while little is painted.
    pub fn over(base: &Fibre, [low, high]: [f64; 2]) -> Self {
        let own = Self::new(base);
        if high - low < 1e-6 {
            return own;
        }
        let low = ((low / Self::ROUND).floor() * Self::ROUND).max(1.0);
        let high = (high / Self::ROUND).ceil() * Self::ROUND;
        let count = ((high - low) * Self::PER_ETA).ceil() as usize + 1;
        let count = count.min(Self::MOST).max(own.count);
        Self { low, high, count, ..own }
    }

    const ROUND: f64 = 0.125;
    const PER_ETA: f64 = 32.0;
    const MOST: usize = 64;

    /// Layers per unit of η̄*; 0 for a round fibre.
    pub fn per_eta(&self) -> f64 {
        if self.count > 1 { (self.count - 1) as f64 / (self.high - self.low) } else { 0.0 }
    }
}

/// [`Fit`] sampled over |θ_d| in [0, π/2] (rows) and η̄* (layers).
#[derive(Clone, Debug)]
pub struct FitTable {
    /// `fits[layer * ROWS + row]`.
    fits: Vec<Fit>,
}

impl FitTable {
    /// Rows over |θ_d|, ends included.
    pub const ROWS: usize = 256;
    /// Packed entries of one fit in [`Self::to_gpu`].
    pub const SIZE: usize = 2;

    /// Samples the fits of a fibre.
    pub fn new(fibre: &Fibre, energy: Energy) -> FitTable {
        let layers = FitLayers::new(fibre);
        let fitter = Fitter::new(fibre, energy);
        let theta_of = |i: usize| FRAC_PI_2 * (i % Self::ROWS) as f64 / (Self::ROWS - 1) as f64;
        // TT takes η as it is: only TRT knows eccentricity (§4.2.5).
        let round: Vec<Fit> = (0..Self::ROWS)
            .into_par_iter()
            .map(|row| fitter.fit(fibre.eta, theta_of(row)))
            .collect();
        if layers.count == 1 {
            return FitTable { fits: round };
        }
        let fits = (0..layers.count * Self::ROWS)
            .into_par_iter()
            .map(|i| {
                let eta = layers.low + (i / Self::ROWS) as f64 / layers.per_eta();
                let Fit { b_tt, kappa_tt, .. } = round[i % Self::ROWS];
                Fit { b_tt, kappa_tt, ..fitter.fit(eta, theta_of(i)) }
            })
            .collect();
        FitTable { fits }
    }

    /// [`Self::SIZE`] packed entries a fit: (b_tt, width_tt, 0, 0), (b_1, φ*, b_2, width_1).
    pub fn to_gpu(&self) -> Vec<[u32; 4]> {
        self.fits
            .iter()
            .flat_map(|f| {
                let (b, w) = (f.b_tt, f.kappa_tt.map(width_of));
                let (b_1, b_2, w_1) = (f.b_1, f.b_2, width_of(f.kappa_1));
                [
                    pack([b[0], b[1], b[2], w[0], w[1], w[2], 0.0, 0.0]),
                    pack([b_1[0], b_1[1], b_1[2], f.phi_star, b_2[0], b_2[1], b_2[2], w_1]),
                ]
            })
            .collect()
    }
}

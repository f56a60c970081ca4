//! Dual scattering's averages (Xu 2011, Eq 29–33; Zinke et al. 2008).
//!
//! An average at inclination θ is over light that comes along θ from a half circle and leaves into
//! the forward (f) or the backward (b) half of the sphere.
//!
//! Where we deviate from the print:
//! - Eq 33 freezes θ_d to separate the integrals and reads N_t from the fits; Eq 32 weighs with
//!   cosθ_d cosθ_o, which is no flux. Here the azimuthal weight (1/π)∫|φ| N_t dφ is integrated
//!   over h with exact Fresnel at every θ_d, and averaged over θ_o with M_t's flux, M_t cos²θ_o/cos²θ_d, scaled as
//!   [`energy_compensation`] scales the modes, so that ā_f+ā_b < 1 is the albedo of a fibre whose lobes lose
//!   nothing (Eq 33 gives 1.020 for white hair). The exact averages with Eq 32's weight (reference/averages.rs)
//!   lose light at grazing: white hair's sum to 0.984 at 0°, 0.909 at 60° and 0.397 at 85° (β_R = 7.5°).
//! - Ā_b sums the whole series. Zinke's Ā_1+Ā_3 are its first terms and keep 0.39 of 0.47 at
//!   ā_f = 0.78, ā_b = 0.2, and less for a clear fibre. The light that a stack of fibres returns obeys R = ā_b + ā_f²R/(1−ā_b R), whose solution
//!   less the first fibre's own ā_b, which is single scattering, is Ā_b.
//! - α and β belong to θ_h, and θ_i+θ_o = 2θ_h: a lobe's shift in θ is 2α, its bandwidth 2√2β. Xu's
//!   Eq 29 takes Δ̄_b and σ̄_b from them without the 2. All angles in [`AverageTable`] are those of θ.
//! - The leading 2 of S_back is Marschner's doubling and goes with it: ∫S_back is Ā_b.
//! - One Δ̄_b and one σ̄_b serve all three channels, their means weighted by Ā_b.
//! - Tints count up to 1: averages are of light that goes on to other strands ([`Fibre::passed_on`]).

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

use rayon::prelude::*;

use super::{
    azimuthal::{
        ClearEnergies, attenuation, effective_absorption, exit_azimuth, inverse_eta_prime, wrap,
    },
    fibre::Fibre,
    longitudinal::{energy_compensation, lobe_range, longitudinal, projection},
    quadrature::GaussLegendre,
    tables::{pack, place},
};

/// Zinke's density factors d_f, d_b: the share of the hemisphere that neighbouring strands fill.
pub const D_F: f64 = 0.7;
/// See [`D_F`].
pub const D_B: f64 = 0.7;

/// ā_f is kept below this in Δ̄_b, which diverges at 1.
const FORWARD_MAX: f64 = 0.95;

/// Δ̄_b, a shift of θ_i+θ_o, is kept within this: a lobe has no meaning further off.
const SHIFT_MAX: f64 = 0.25 * PI;

/// The averages at one inclination.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Averages {
    /// ā_f, ā_b: shares of the light scattered forward and backward, RGB.
    pub a_f: [f64; 3],
    pub a_b: [f64; 3],
    /// Ā_b: share returned by the strands behind, after any number of crossings, RGB.
    pub big_a_b: [f64; 3],
    /// β̄_f² as the square of a **bandwidth of θ**, radians², RGB: what one forward crossing adds to σ_f².
    pub beta_f2: [f64; 3],
    /// Δ̄_b, the centre of S_back in θ_i+θ_o, radians.
    pub delta_b: f64,
    /// σ̄_b, the bandwidth of S_back in θ_i+θ_o, radians.
    pub sigma_b: f64,
    /// Energy compensation 1/Z_t at θ_o = θ for R, TT, TRT.
    pub energy: [f64; 3],
}

/// Forward and backward shares of ∫N_t dφ at one θ_d for R, TT, TRT: (1/π)∫|φ| N_t dφ over the circle
/// and the rest (Xu 2011, after Eq 33), by quadrature over h with exact Fresnel.
pub fn azimuthal_shares(
    rule: &GaussLegendre,
    eta: f64,
    theta_d: f64,
    sigma_a: f64,
) -> [[f64; 2]; 3] {
    let absorption = effective_absorption(sigma_a, eta, theta_d);
    let q = inverse_eta_prime(eta, theta_d);
    let mut shares = [[0.0; 2]; 3];
    for (gamma, weight) in rule.on(0.0, FRAC_PI_2) {
        let a = attenuation(eta, theta_d, gamma, absorption);
        for t in 0..3 {
            let forward = wrap(exit_azimuth(t as u32, gamma, q)).abs() / PI;
            let energy = weight * gamma.cos() * a[t];
            shares[t][0] += energy * forward;
            shares[t][1] += energy * (1.0 - forward);
        }
    }
    shares
}

/// Ā_b from ā_f, ā_b ≥ 0 with ā_f+ā_b ≤ 1: the whole series.
pub fn backward_series(a_f: f64, a_b: f64) -> f64 {
    let apart = ((1.0 - a_b).powi(2) - a_f * a_f).max(0.0) * ((1.0 + a_b).powi(2) - a_f * a_f);
    2.0 * a_b / (1.0 + a_b * a_b - a_f * a_f + apart.sqrt()).max(1e-12) - a_b
}

/// 1 − ā_f², which vanishes only for a fibre that lets all light through; kept above 0 so that such a fibre,
/// which has no backward light, yields large numbers but no infinite ones.
pub fn lost(a_f: f64) -> f64 {
    (1.0 - a_f * a_f).max(f64::EPSILON)
}

/// Zinke's Δ̄_b from the shifts ᾱ_f, ᾱ_b; any unit of angle. It diverges at ā_f = 1.
pub fn backward_shift(a_f: f64, a_b: f64, alpha_f: f64, alpha_b: f64) -> f64 {
    let (d, a_f2, a_b2) = (lost(a_f), a_f * a_f, a_b * a_b);
    alpha_b * (1.0 - 2.0 * a_b2 / (d * d))
        + alpha_f * (2.0 * d * d + 4.0 * a_f2 * a_b2) / (d * d * d)
}

/// Zinke's σ̄_b from the variances β̄_f², β̄_b² of θ_h, as a standard deviation of θ_h in radians.
/// Divided through by ā_b, so that a fibre that scatters nothing back is no 0/0.
pub fn backward_spread(a_f: f64, a_b: f64, beta_f2: f64, beta_b2: f64) -> f64 {
    let a_b2 = a_b * a_b;
    let width = (2.0 * beta_f2 + beta_b2).sqrt() + a_b2 * (2.0 * beta_f2 + 3.0 * beta_b2).sqrt();
    let mass = 1.0 + a_b2 * (2.0 * beta_f2.sqrt() + 3.0 * beta_b2.sqrt());
    (1.0 + D_F * a_f * a_f) * width / mass
}

/// [`Averages`] over θ in [−π/2, π/2], ends included.
#[derive(Clone, Debug)]
pub struct AverageTable {
    rows: Vec<Averages>,
}

impl AverageTable {
    /// Rows over θ.
    pub const ROWS: usize = 129;
    /// Packed entries of one row in [`Self::to_gpu`].
    pub const SIZE: usize = 3;

    /// The averages of a fibre; a few milliseconds. An eccentric fibre counts as round here.
    /// `segments` is the m that [`energy_compensation`] compensates.
    pub fn new(fibre: &Fibre, segments: u32) -> AverageTable {
        let rule = GaussLegendre::new(40);
        let last = (Self::ROWS - 1) as f64;
        let theta_of = |row: usize| PI * (row as f64 / last - 0.5);
        // Shares over |θ_d|, which the averages below are made of: of the channels and of a clear fibre.
        let [r, g, b] = fibre.sigma_a;
        let shares: Vec<[[[f64; 2]; 3]; 4]> = (0..Self::ROWS)
            .into_par_iter()
            .map(|row| {
                let theta_d = FRAC_PI_2 * row as f64 / last;
                [r, g, b, 0.0].map(|s| azimuthal_shares(&rule, fibre.eta, theta_d, s))
            })
            .collect();
        let clear = ClearEnergies::new(fibre.eta);
        let rows = (0..Self::ROWS)
            .into_par_iter()
            .map(|row| average(fibre, &rule, segments, theta_of(row), &shares, &clear))
            .collect();
        AverageTable { rows }
    }

    /// The averages at θ, interpolated linearly.
    pub fn sample(&self, theta: f64) -> Averages {
        let (low, f) = place(theta / PI + 0.5, Self::ROWS);
        let (a, b) = (&self.rows[low], &self.rows[low + 1]);
        let mix = |a: f64, b: f64| a + f * (b - a);
        let mix3 = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| mix(a[c], b[c]));
        Averages {
            a_f: mix3(a.a_f, b.a_f),
            a_b: mix3(a.a_b, b.a_b),
            big_a_b: mix3(a.big_a_b, b.big_a_b),
            beta_f2: mix3(a.beta_f2, b.beta_f2),
            delta_b: mix(a.delta_b, b.delta_b),
            sigma_b: mix(a.sigma_b, b.sigma_b),
            energy: mix3(a.energy, b.energy),
        }
    }

    /// [`Self::SIZE`] packed entries a row: (ā_f, Δ̄_b, β̄_f², σ̄_b), (Ā_b, 0, ā_b, 0), (energy, 0 …).
    pub fn to_gpu(&self) -> Vec<[u32; 4]> {
        self.rows
            .iter()
            .flat_map(|r| {
                let (f, v, a, b, e) = (r.a_f, r.beta_f2, r.big_a_b, r.a_b, r.energy);
                [
                    pack([f[0], f[1], f[2], r.delta_b, v[0], v[1], v[2], r.sigma_b]),
                    pack([a[0], a[1], a[2], 0.0, b[0], b[1], b[2], 0.0]),
                    pack([e[0], e[1], e[2], 0.0, 0.0, 0.0, 0.0, 0.0]),
                ]
            })
            .collect()
    }
}

/// The averages at one θ from the shares over |θ_d|.
fn average(
    fibre: &Fibre,
    rule: &GaussLegendre,
    segments: u32,
    theta: f64,
    shares: &[[[[f64; 2]; 3]; 4]],
    clear: &ClearEnergies,
) -> Averages {
    let shares_at = |theta_d: f64, c: usize, t: usize| {
        let (d, f) = place(2.0 * theta_d.abs() / PI, shares.len());
        let (near, far) = (shares[d][c][t], shares[d + 1][c][t]);
        [0, 1].map(|side: usize| near[side] + f * (far[side] - near[side]))
    };
    let passed_on = fibre.passed_on();
    // a[c][t][f, b], the clear fibre last.
    let mut a = [[[0.0; 2]; 3]; 4];
    for t in 0..3 {
        let (low, high) = lobe_range(theta, fibre.alpha[t], fibre.beta[t]);
        for (theta_o, weight) in rule.on(low, high) {
            let flux = weight
                * longitudinal(theta_o, theta, fibre.alpha[t], fibre.beta[t])
                * projection(theta_o, theta);
            for (c, a) in a.iter_mut().enumerate() {
                let shares = shares_at(0.5 * (theta_o - theta), c, t);
                a[t] = [0, 1].map(|side: usize| a[t][side] + flux * shares[side]);
            }
        }
        // A lobe thrown past ±π/2 as a whole scatters nothing.
        let kept = a[3][t].iter().sum::<f64>().max(1e-12);
        let scale = shares_at(theta, 3, t).iter().sum::<f64>() / kept;
        let [r, g, b] = passed_on.tint[t];
        let tints = [r, g, b, 1.0];
        a.iter_mut().zip(tints).for_each(|(c, tint)| c[t] = c[t].map(|x| tint * scale * x));
    }

    let energy = [0, 1, 2].map(|t| {
        energy_compensation(segments, theta, fibre.alpha[t], fibre.beta[t], |d| clear.at(d)[t])
    });
    let mut averages = Averages { energy, ..Averages::default() };
    let (mut weight_sum, mut delta_sum, mut sigma_sum) = (0.0, 0.0, 0.0);
    for (c, modes) in a[..3].iter().enumerate() {
        let sum = |side: usize| modes.iter().map(|t| t[side]).sum::<f64>();
        let (a_f, a_b) = (sum(0), sum(1));
        // The mean of a quantity of the modes; all modes alike where the fibre is black.
        let mean = |side: usize, of: [f64; 3]| {
            let weights = modes.map(|t| t[side] + 1e-9);
            (0..3).map(|t| weights[t] * of[t]).sum::<f64>() / weights.iter().sum::<f64>()
        };
        let beta2 = fibre.beta.map(|b| b * b);
        let (beta_f2, beta_b2) = (mean(0, beta2), mean(1, beta2));
        let (alpha_f, alpha_b) = (mean(0, fibre.alpha), mean(1, fibre.alpha));
        let shift = backward_shift(a_f.min(FORWARD_MAX), a_b, alpha_f, alpha_b);
        let spread = backward_spread(a_f, a_b, beta_f2, beta_b2);
        averages.a_f[c] = a_f;
        averages.a_b[c] = a_b;
        averages.big_a_b[c] = backward_series(a_f, a_b);
        averages.beta_f2[c] = 8.0 * beta_f2;
        let weight = averages.big_a_b[c] + 1e-9;
        weight_sum += weight;
        delta_sum += weight * (2.0 * shift).clamp(-SHIFT_MAX, SHIFT_MAX);
        sigma_sum += weight * 2.0 * SQRT_2 * spread;
    }
    averages.delta_b = delta_sum / weight_sum;
    averages.sigma_b = sigma_sum / weight_sum;
    averages
}

//! The quadrature over θ_i of the `fast` method: Gauss rules for what the integrand nearly is, a Gaussian that
//! ends at ±π/2. Twin: shaders/nodes.wgsl.
//!
//! > ∫_{−π/2}^{π/2} F(θ_i) dθ_i ≈ Σ_k weight_k F(θ_k),  F = G_j M_t cos²θ_i/cos²θ_d · (the inner integral over φ)
//!
//! is exact for F = exp(−(θ_i−μ)²/λ²) cos^q θ_i times a polynomial of degree 2n−1. [`Lobe`] gives μ and λ,
//! [`NodeTable`] the rule. F is taken as it is at the nodes, the Gaussian only places them, so that G_j stays an
//! SRBF, and M_t may as well be d'Eon's M_p.
//!
//! Where we deviate from Xu 2011 §4.2.2, which takes F over the Gaussian as straight between nodes λ apart, and
//! what it buys: relative L2 error in % of the integral over θ_i alone, rms over settings / the worst setting
//! (η 1.45–1.65, σ_a 0–3, λ_j 0.1–1, β_R 5–10°, θ_o and θ_j to ±75°; tests/nodes.rs), 16-bit table included:
//!
//! | | R | TT | TRT | d'Eon R | TT | TRT |
//! | --- | --- | --- | --- | --- | --- | --- |
//! | m = 4 segments | 7.2 / 14 | 0.89 / 1.5 | 4.1 / 12 | 9.8 / 15 | 1.3 / 2.8 | 4.6 / 11 |
//! | 2 nodes | 0.51 / 0.87 | 0.06 / 0.11 | 0.57 / 1.6 | 0.84 / 1.3 | 0.22 / 0.42 | 1.5 / 3.3 |
//! | 3 nodes | 0.23 / 0.39 | 0.02 / 0.04 | 0.14 / 0.47 | 0.34 / 0.51 | 0.06 / 0.15 | 0.44 / 1.0 |
//! | 4 nodes | 0.11 / 0.18 | 0.02 / 0.02 | 0.06 / 0.19 | 0.20 / 0.30 | 0.03 / 0.06 | 0.24 / 0.89 |
//!
//! - The ends are in the weight, and so are F's zeros there ([`Taper`]). With the Gaussian's ends alone, q = 0 and no
//!   slope, 2 nodes leave 3.2, 0.2 and 2.2 % and 3 nodes 0.8, 0.03 and 0.7 %.
//! - Two cut-offs and a power make a rule of (μ, λ): a table of 24×32 entries, 12 KB, of no fibre. Interpolation and
//!   16 bits cost a tenth of the error of 2 nodes, a quarter of that of 3.
//! - β_R 0.05–45°, λ_j 0.003–3: |θ_o| ≤ 80° as above; closer to the pole 2 / 3 nodes leave at most 1 / 0.3 % but for
//!   R, 8.5 / 5.2 % (m = 4: 19 %), whose tilt throws it past the pole; d'Eon 2 / 0.5 %, TT 6.0 / 1.8 %.

use std::f64::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::{
    longitudinal::Node,
    quadrature::GaussLegendre,
    tables::{bilinear, pack},
};

/// How F leaves its Gaussian towards grazing: as cos^q θ_i, q = `exponent`, and beside that as e^{−s tanθ_d θ_i},
/// s = `slope` of each lobe R, TT, TRT, ….
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taper {
    pub exponent: f64,
    pub slope: [f64; 4],
}

impl Taper {
    /// Of M_t cos²θ_i/cos²θ_d: the light's 2π I₀e goes as 1/√cosθ_i, 1/cos²θ_d is a slope of 1, and R's Fresnel
    /// rises on top of it.
    pub const MARSCHNER: Self = Self { exponent: 1.5, slope: [1.7, 1.0, 1.0, 1.0] };
    /// Of d'Eon's M_p cosθ_i: M_p itself goes as 1/√cosθ_i while its lobe is narrow. By measurement.
    pub const DEON: Self = Self { exponent: 0.75, slope: [0.3, 0.75, 0.1, 0.1] };
}

/// The Gaussian that places a lobe's nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    pub mu: f64,
    pub lambda: f64,
    /// G_j M_t is about e^{−exponent} of what it would be were the light at M_t's centre.
    pub exponent: f64,
}

/// A lobe of greater [`Lobe::exponent`] is left out.
pub const EXPONENT_MAX: f64 = 8.0;

/// The tangent by which a lobe is tilted is taken at a μ within this.
const TILT_MAX: f64 = 1.4;

impl Lobe {
    /// Of the SRBF of bandwidth `lambda_j` at `theta_j` and M_t of bandwidth `lambda_m` about `centre` = 2α_t−θ_o
    /// (d'Eon's M_p: √(2v), and [`over_the_pole`] of the centre). Angles in radians, θ_o and θ_j in
    /// [−π/2, π/2]; `slope` is [`Taper::slope`].
    ///
    /// G_j's Gaussian is stretched to equal the SRBF exp(−4 sin²(x/2)/λ_j²) at M_t's centre. The slope
    /// turns exp(−t²) into exp(−t²)e^{slope t}, which is a Gaussian too, moved by one bandwidth at most.
    pub fn new(
        theta_o: f64,
        theta_j: f64,
        lambda_j: f64,
        centre: f64,
        lambda_m: f64,
        slope: f64,
    ) -> Self {
        let apart = theta_j - centre;
        let x = theta_j - centre.clamp(-FRAC_PI_2, FRAC_PI_2);
        // (sin(x/2)/(x/2))² within 0.006 for |x| ≤ π.
        let x2 = x * x;
        let stretch = 1.0 - x2 * (1.0 / 12.0 - x2 * (1.0 / 360.0 - x2 / 20160.0));
        let (sharp_j, sharp_m) = (stretch / (lambda_j * lambda_j), 1.0 / (lambda_m * lambda_m));
        let sharp = sharp_j + sharp_m;
        let share = sharp_j / sharp;
        let (mu, lambda) = (centre + apart * share, sharp.sqrt().recip());
        let tangent = (0.5 * (theta_o - mu.clamp(-TILT_MAX, TILT_MAX))).tan();
        let tilt = (-0.5 * slope * tangent * lambda).clamp(-1.0, 1.0);
        Self { mu: mu + lambda * tilt, lambda, exponent: apart * apart * share * sharp_m }
    }

    /// By which the integral is multiplied: 1, and from e^{−7} of its peak on down to 0 at [`EXPONENT_MAX`], so
    /// that a lobe is left out without a step.
    pub fn share(&self) -> f64 {
        (EXPONENT_MAX - self.exponent).clamp(0.0, 1.0)
    }
}

/// The centre of d'Eon's M_p for 2α_p−θ_o in [−π, π]: past a pole it comes down on the far side.
pub fn over_the_pole(centre: f64) -> f64 {
    (FRAC_PI_2 - (FRAC_PI_2 - centre.abs()).abs()).copysign(centre)
}

/// The Gauss rules of n ≤ 4 nodes for exp(−t²) cos^q θ, θ = μ+λt in [−π/2, π/2], over μ ≥ 0 and λ.
#[derive(Clone, Debug)]
pub struct NodeTable {
    count: usize,
    /// `entries[row * COLUMNS + column]` = t_k, weight_k/λ of node after node, as 16 bits hold them.
    entries: Vec<[f64; 8]>,
}

/// The λ of the middle row.
const LAMBDA_MIDDLE: f64 = 0.25 * PI;
/// |μ| is told apart to this many λ past π/2: beyond, less than e^{−9} of the Gaussian is inside.
const OUTSIDE: f64 = 3.0;
/// Columns lie evenly in 1/(the distance of |μ| from the last column + this many λ).
const CROWDING: f64 = 6.0;

impl NodeTable {
    /// Rows over λ, from 0 to ∞.
    pub const ROWS: usize = 24;
    /// Columns over |μ|, from 0 to where the Gaussian is outside.
    pub const COLUMNS: usize = 32;

    /// The rules of `count` nodes, 1 to 4 (others are clamped), for cos^q, q = `exponent` ≥ 0.
    pub fn new(count: usize, exponent: f64) -> Self {
        let count = count.clamp(1, 4);
        let fine = GaussLegendre::new(64);
        let entries = (0..Self::ROWS * Self::COLUMNS)
            .into_par_iter()
            .map(|i| {
                let u = (i / Self::COLUMNS) as f64 / (Self::ROWS - 1) as f64;
                let v = (i % Self::COLUMNS) as f64 / (Self::COLUMNS - 1) as f64;
                let (mu, lambda) = Self::uv_to_x([u, v]);
                let mut entry = [0.0; 8];
                let nodes = rule(&fine, count, mu, lambda, exponent);
                for (slot, (t, weight)) in entry.chunks_exact_mut(2).zip(nodes) {
                    slot.copy_from_slice(&[t, weight]);
                }
                entry.map(|x| half::f16::from_f64(x).to_f64())
            })
            .collect();
        Self { count, entries }
    }

    /// (|μ| ≤ π/2+3λ, λ > 0) to coordinates in [0, 1]² of row and column.
    pub fn x_to_uv(mu: f64, lambda: f64) -> [f64; 2] {
        let last = FRAC_PI_2 + OUTSIDE * lambda;
        let crowding = CROWDING * lambda;
        [lambda / (lambda + LAMBDA_MIDDLE), crowding * mu / (last * (last - mu + crowding))]
    }

    /// The inverse of [`Self::x_to_uv`], λ kept within [1e-6, 1e3].
    pub fn uv_to_x(uv: [f64; 2]) -> (f64, f64) {
        let lambda = (LAMBDA_MIDDLE * uv[0] / (1.0 - uv[0]).max(1e-9)).clamp(1e-6, 1e3);
        let last = FRAC_PI_2 + OUTSIDE * lambda;
        let crowding = CROWDING * lambda;
        (uv[1] * last * (last + crowding) / (crowding + uv[1] * last), lambda)
    }

    /// The nodes of a Gaussian: θ_k in [−π/2, π/2], weight_k > 0 in radians. λ > 0.
    pub fn nodes(&self, mu: f64, lambda: f64) -> impl Iterator<Item = Node> {
        // Of a Gaussian farther outside, the last column's nodes: what is inside is next to nothing.
        let near = mu.abs().min(FRAC_PI_2 + OUTSIDE * lambda);
        let size = [Self::ROWS, Self::COLUMNS];
        let rule = bilinear(Self::x_to_uv(near, lambda), size, |i| self.entries[i]);
        (0..self.count).map(move |k| {
            let theta = near + lambda * rule[2 * k];
            Node {
                theta: theta.clamp(-FRAC_PI_2, FRAC_PI_2) * mu.signum(),
                weight: lambda * rule[2 * k + 1],
            }
        })
    }

    /// As the shader reads it: an entry's component k is node k, (t_k, weight_k/λ) as 16-bit floats.
    pub fn to_gpu(&self) -> Vec<[u32; 4]> {
        self.entries.iter().map(|&entry| pack(entry)).collect()
    }
}

/// The Gauss rule for exp(−t²) cos^q(μ+λt), q = `exponent`, where the cosine is positive; each weight over that
/// function at its node.
fn rule(
    fine: &GaussLegendre,
    count: usize,
    mu: f64,
    lambda: f64,
    exponent: f64,
) -> Vec<(f64, f64)> {
    let end = (FRAC_PI_2 - mu) / lambda;
    // Six bandwidths from its greatest the Gaussian is below e^{−36}.
    let (low, high) = ((end - PI / lambda).max(end.min(0.0) - 6.0), end.min(6.0));
    let density = |t: f64| {
        let outside = end.min(0.0);
        // cosθ, without the cancellation.
        let cos = (lambda * (end - t)).sin().max(0.0);
        (outside * outside - t * t).exp() * cos.powf(exponent)
    };
    // p = (t−low)/(high−low) = sin²u, which makes the power smooth at both ends.
    let samples: Vec<(f64, f64)> = fine
        .on(0.0, FRAC_PI_2)
        .map(|(u, weight)| {
            let (sin, cos) = u.sin_cos();
            let p = sin * sin;
            (p, 2.0 * weight * sin * cos * density(low + p * (high - low)))
        })
        .collect();
    let recurrence = recurrence(&samples, count);
    // The roots of each orthogonal polynomial lie between those of the one before.
    let mut roots = Vec::new();
    for degree in 1..=count {
        let brackets: Vec<f64> =
            [0.0].into_iter().chain(roots.iter().copied()).chain([1.0]).collect();
        roots = brackets
            .windows(2)
            .map(|pair| bisect(pair[0], pair[1], |p| evaluate(&recurrence[..degree], p).0))
            .collect();
    }
    roots
        .iter()
        .map(|&p| {
            let t = low + p * (high - low);
            (t, (high - low) / (evaluate(&recurrence, p).1 * density(t)))
        })
        .collect()
}

/// (a_k, b_k) of π_{k+1} = (p − a_k) π_k − b_k π_{k−1}, b_0 = ∫1, orthogonal over the samples (p, weight):
/// Stieltjes' procedure.
fn recurrence(samples: &[(f64, f64)], count: usize) -> Vec<(f64, f64)> {
    let mut before = vec![0.0; samples.len()];
    let mut now = vec![1.0; samples.len()];
    let mut last = 1.0;
    (0..count)
        .map(|_| {
            let sum = |of: &dyn Fn(f64) -> f64| {
                samples.iter().zip(&now).map(|(s, y)| s.1 * of(s.0) * y * y).sum::<f64>()
            };
            let norm = sum(&|_| 1.0);
            let (a, b) = (sum(&|p| p) / norm, norm / last);
            last = norm;
            for (sample, (before, now)) in samples.iter().zip(before.iter_mut().zip(&mut now)) {
                (*before, *now) = (*now, (sample.0 - a) * *now - b * *before);
            }
            (a, b)
        })
        .collect()
}

/// π_n(p), and Σ_{k<n} π_k²/∫π_k², whose inverse is the Gauss weight at a root.
fn evaluate(recurrence: &[(f64, f64)], p: f64) -> (f64, f64) {
    let (mut before, mut now, mut norm, mut sum) = (0.0, 1.0, 1.0, 0.0);
    for &(a, b) in recurrence {
        norm *= b;
        sum += now * now / norm;
        (before, now) = (now, (p - a) * now - b * before);
    }
    (now, sum)
}

/// The sign change of `f` between `low` and `high`.
fn bisect(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let rising = f(high) > 0.0;
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        if (f(middle) > 0.0) == rising { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest relative error for t^0 … t^degree against the rule's own function, t = (θ−μ)/λ.
    fn error(nodes: &[(f64, f64)], mu: f64, lambda: f64, exponent: f64, degree: usize) -> f64 {
        let low = ((-FRAC_PI_2 - mu) / lambda).max(-7.0);
        let high = ((FRAC_PI_2 - mu) / lambda).min(7.0);
        let function = |t: f64| (-t * t).exp() * (mu + lambda * t).cos().max(0.0).powf(exponent);
        let dense = GaussLegendre::new(200);
        // In t² = s the power is as smooth as it gets; monomials about the window's middle.
        let middle = 0.5 * (low + high);
        let integrate = |f: &dyn Fn(f64) -> f64| {
            dense.integrate(0.0, FRAC_PI_2, |u| {
                let t = low + (high - low) * u.sin().powi(2);
                (high - low) * (2.0 * u).sin() * f(t) * function(t)
            })
        };
        (0..=degree as i32)
            .map(|k| {
                let exact = integrate(&|t| (t - middle).powi(k));
                let scale = integrate(&|t| (t - middle).abs().powi(k));
                let sum: f64 =
                    nodes.iter().map(|&(t, w)| w * function(t) * (t - middle).powi(k)).sum();
                ((sum - exact) / scale).abs()
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn rules_are_exact_to_their_degree_and_no_further() {
        let fine = GaussLegendre::new(64);
        let (mut worst, mut beyond) = (0f64, f64::INFINITY);
        for (mu, lambda) in [(0.0, 0.1), (0.3, 0.6), (1.5, 0.3), (1.7, 0.2), (0.4, 3.0), (0.0, 1e3)]
        {
            for exponent in [0.0, 0.75, 1.5] {
                for count in 1..=4 {
                    let nodes = rule(&fine, count, mu, lambda, exponent);
                    worst = worst.max(error(&nodes, mu, lambda, exponent, 2 * count - 1));
                    beyond = beyond.min(error(&nodes, mu, lambda, exponent, 2 * count));
                }
            }
        }
        println!("to degree 2n−1 {worst:.1e}, to 2n {beyond:.1e}");
        assert!(worst < 1e-8);
        assert!(beyond > 1e-7);
    }

    #[test]
    fn an_even_weight_gives_gauss_legendre_and_a_narrow_one_gauss_hermite() {
        let fine = GaussLegendre::new(64);
        for (t, w) in rule(&fine, 2, 0.0, 1e4, 0.0) {
            assert!((1e4 * t.abs() - FRAC_PI_2 / 3f64.sqrt()).abs() < 1e-6, "{t}");
            assert!((1e4 * w - FRAC_PI_2).abs() < 1e-6, "{w}");
        }
        for (t, w) in rule(&fine, 2, 0.4, 1e-6, 1.5) {
            assert!((t.abs() - 0.5f64.sqrt()).abs() < 1e-5, "{t}");
            assert!((w * (-0.5f64).exp() - 0.5 * PI.sqrt()).abs() < 1e-5, "{w}");
        }
    }

    #[test]
    fn coordinates_are_inverse() {
        for k in 0..400 {
            let uv = [f64::from(k % 20 + 1) / 21.0, f64::from(k / 20) / 19.0];
            let (mu, lambda) = NodeTable::uv_to_x(uv);
            let back = NodeTable::x_to_uv(mu, lambda);
            assert!((back[0] - uv[0]).abs() < 1e-12 && (back[1] - uv[1]).abs() < 1e-12);
        }
    }
}

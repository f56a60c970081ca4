//! The tables that depend on no fibre: 𝒞_k of Eq 14 with the half-circle integral beside it, and
//! ℋ_k^TT, ℋ_k^TRT of Eq 19 and Eq 23. Built once, in f64.
//!
//! Where we deviate from the paper's 128 log-spaced λ′ in [0.001, 10] × 64 φ:
//! - 𝒞_k is stored as its ratio to 𝒞_0 = 2π I₀e(κ), which the shader knows in closed form, over
//!   v = 1/√(1+κ) (κ = 2/λ′²), which takes every λ′ from 0 to ∞ to (0, 1] and in which the ratio is
//!   nearly straight at both ends.
//! - ℋ_k lies over 1−1/η in [0, 1) instead of log η in [1, 10], of whose 128 rows hair uses 11.
//!
//! Bilinear interpolation error, worst of 4096 points between the rows (tests/scattering.rs): 𝒞_k/𝒞_0
//! 0.0017 of 1, half circle 0.0002 of 1, ℋ_k 0.0027 of 2 for η from 1.2 to 5 (at η = 1 it jumps at
//! grazing).

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

use rayon::prelude::*;

use super::{
    azimuthal::{kappa_of, width_of, wrap},
    fresnel::fresnel,
    gaussian::{erf, g_circular},
    quadrature::GaussLegendre,
};

/// What the table of the circle holds at one (κ, φ), as shares of 𝒞_0(κ) = 2π I₀e(κ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CircularMoments {
    /// 𝒞_k/𝒞_0, k = 0…6, with 𝒞_k = ∫_{−π}^{π} |cos^k((φ−φ′)/2)| g^c(φ′; 0, κ) dφ′.
    pub cosines: [f64; 7],
    /// ∫_{|φ′−φ| < π/2} g^c(φ′; 0, κ) dφ′ / 𝒞_0: the half circle around φ.
    pub half: f64,
}

/// The moments by quadrature, relative error below 1e-8.
pub fn circular_moments(rule: &GaussLegendre, kappa: f64, phi: f64) -> CircularMoments {
    let phi = wrap(phi).abs();
    // Beyond this g^c is below e^{−36}.
    let reach = if kappa > 18.0 { 2.0 * (18.0 / kappa).sqrt().asin() } else { PI };
    // Between these the integrands are smooth: the peak, the kink of |cos|, the half circle's edges.
    let mut breaks = [-reach, reach, 0.0, phi - PI, phi - FRAC_PI_2, wrap(phi + FRAC_PI_2)]
        .map(|x: f64| x.clamp(-reach, reach));
    breaks.sort_by(f64::total_cmp);
    let (mut cosines, mut half) = ([0.0; 7], 0.0);
    for pair in breaks.windows(2).filter(|pair| pair[1] > pair[0]) {
        let inside = wrap(phi - 0.5 * (pair[0] + pair[1])).abs() < FRAC_PI_2;
        for (x, weight) in rule.on(pair[0], pair[1]) {
            let mut term = weight * g_circular(x, kappa);
            half += if inside { term } else { 0.0 };
            let cos = (0.5 * (phi - x)).cos().abs();
            for moment in &mut cosines {
                *moment += term;
                term *= cos;
            }
        }
    }
    let whole = cosines[0];
    CircularMoments { cosines: cosines.map(|c| c / whole), half: half / whole }
}

/// The closed-form part of the half-circle share, right for narrow Gaussians:
/// ½(erf s₊ + erf s₋), s± = √2 κv sin(π/4 ± φ/2). The table holds the rest.
fn half_circle_narrow(kappa: f64, phi: f64) -> f64 {
    let s = SQRT_2 * kappa * width_of(kappa);
    let side = |sign: f64| erf(s * (0.25 * PI + sign * 0.5 * phi).sin());
    0.5 * (side(1.0) + side(-1.0))
}

/// ∫_{−π/2}^{π/2} |cos^k((φ−x)/2)| dx, k = 0…6: what Eq 28 needs for R.
pub fn half_circle_cosines(phi: f64) -> [f64; 7] {
    let phi = wrap(phi).abs();
    let (from, to) = (powers_integral(phi - FRAC_PI_2), powers_integral((phi + FRAC_PI_2).min(PI)));
    let beyond = powers_integral((1.5 * PI - phi).min(PI));
    let whole = powers_integral(PI);
    std::array::from_fn(|k| to[k] - from[k] + whole[k] - beyond[k])
}

/// ∫_0^x cos^k(t/2) dt, k = 0…6, |x| ≤ π.
fn powers_integral(x: f64) -> [f64; 7] {
    let (sin, cos) = (0.5 * x).sin_cos();
    let mut s = [x, 2.0 * sin, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut power = cos;
    for k in 2..7 {
        s[k] = (2.0 * power * sin + (k - 1) as f64 * s[k - 2]) / k as f64;
        power *= cos;
    }
    s
}

/// [`CircularMoments`] over (v, |φ|/π), both in [0, 1].
#[derive(Clone, Debug)]
pub struct CircleTable {
    /// `rows[v * COLUMNS + phi]` = [half − narrow half, 𝒞_1/𝒞_0 … 𝒞_6/𝒞_0, 0].
    rows: Vec<[f64; 8]>,
}

impl CircleTable {
    /// Rows over v.
    pub const ROWS: usize = 64;
    /// Columns over |φ|.
    pub const COLUMNS: usize = 96;

    fn build() -> CircleTable {
        let rule = GaussLegendre::new(24);
        let rows = (0..Self::ROWS * Self::COLUMNS)
            .into_par_iter()
            .map(|i| {
                let u = (i / Self::COLUMNS) as f64 / (Self::ROWS - 1) as f64;
                let w = (i % Self::COLUMNS) as f64 / (Self::COLUMNS - 1) as f64;
                let (kappa, phi) = Self::uv_to_x([u, w]);
                if kappa > 1e12 {
                    let c = (0.5 * phi).cos().abs();
                    return std::array::from_fn(
                        |k| if k % 7 == 0 { 0.0 } else { c.powi(k as i32) },
                    );
                }
                let m = circular_moments(&rule, kappa, phi);
                let rest = m.half - half_circle_narrow(kappa, phi);
                let c = m.cosines;
                [rest, c[1], c[2], c[3], c[4], c[5], c[6], 0.0]
            })
            .collect();
        CircleTable { rows }
    }

    /// (κ ≥ 0, φ in [−π, π]) to table coordinates in [0, 1]².
    pub fn x_to_uv(kappa: f64, phi: f64) -> [f64; 2] {
        [width_of(kappa), phi.abs() / PI]
    }

    /// The inverse of [`Self::x_to_uv`] for φ ≥ 0; v = 0 is a κ of 1e30.
    pub fn uv_to_x(uv: [f64; 2]) -> (f64, f64) {
        (kappa_of(uv[0].max(1e-15)), uv[1] * PI)
    }

    /// The half circle's share alone, interpolated bilinearly.
    pub fn half(&self, kappa: f64, phi: f64) -> f64 {
        let phi = wrap(phi);
        let size = [Self::ROWS, Self::COLUMNS];
        let [rest] = bilinear(Self::x_to_uv(kappa, phi), size, |i| [self.rows[i][0]]);
        (rest + half_circle_narrow(kappa, phi)).clamp(0.0, 1.0)
    }

    /// The moments, interpolated bilinearly.
    pub fn sample(&self, kappa: f64, phi: f64) -> CircularMoments {
        let phi = wrap(phi);
        let s = bilinear(Self::x_to_uv(kappa, phi), [Self::ROWS, Self::COLUMNS], |i| self.rows[i]);
        CircularMoments {
            cosines: [1.0, s[1], s[2], s[3], s[4], s[5], s[6]],
            half: self.half(kappa, phi),
        }
    }
}

/// ℋ_k^TT = ∫_{−1}^{1} (1−F)² h^k dh and ℋ_k^TRT = ∫_{−1}^{1} (1−F)² F h^k dh, k = 0, 2, 4, with exact
/// Fresnel, over (1−1/η, θ_d).
#[derive(Clone, Debug)]
pub struct AbsorptionMoments {
    /// `rows[eta * COLUMNS + theta]` = TT k = 0, 2, 4, then TRT.
    rows: Vec<[f64; 6]>,
}

impl AbsorptionMoments {
    /// Rows over 1−1/η.
    pub const ROWS: usize = 128;
    /// Columns over |θ_d|.
    pub const COLUMNS: usize = 128;

    fn build() -> AbsorptionMoments {
        let rule = GaussLegendre::new(32);
        let rows = (0..Self::ROWS * Self::COLUMNS)
            .into_par_iter()
            .map(|i| {
                let u = (i / Self::COLUMNS) as f64 / (Self::ROWS - 1) as f64;
                let w = (i % Self::COLUMNS) as f64 / (Self::COLUMNS - 1) as f64;
                let (eta, theta_d) = Self::uv_to_x([u, w]);
                absorption_moments(&rule, eta, theta_d)
            })
            .collect();
        AbsorptionMoments { rows }
    }

    /// (η ≥ 1, θ_d) to table coordinates in [0, 1]².
    pub fn x_to_uv(eta: f64, theta_d: f64) -> [f64; 2] {
        [1.0 - 1.0 / eta, theta_d.abs() / FRAC_PI_2]
    }

    /// The inverse of [`Self::x_to_uv`] for θ_d ≥ 0; the last row is an η of 1e6.
    pub fn uv_to_x(uv: [f64; 2]) -> (f64, f64) {
        (1.0 / (1.0 - uv[0]).max(1e-6), uv[1] * FRAC_PI_2)
    }

    /// (ℋ_k^TT, ℋ_k^TRT), k = 0, 2, 4, interpolated bilinearly.
    pub fn sample(&self, eta: f64, theta_d: f64) -> ([f64; 3], [f64; 3]) {
        let uv = Self::x_to_uv(eta, theta_d);
        let s = bilinear(uv, [Self::ROWS, Self::COLUMNS], |i| self.rows[i]);
        ([s[0], s[1], s[2]], [s[3], s[4], s[5]])
    }
}

/// The six ℋ_k at one (η, θ_d), TT then TRT.
pub fn absorption_moments(rule: &GaussLegendre, eta: f64, theta_d: f64) -> [f64; 6] {
    let mut h = [0.0; 6];
    for (gamma, weight) in rule.on(0.0, FRAC_PI_2) {
        let (sin, cos) = gamma.sin_cos();
        let f = fresnel(theta_d.cos() * cos, eta);
        let mut term = 2.0 * weight * cos * (1.0 - f) * (1.0 - f);
        for k in 0..3 {
            h[k] += term;
            h[k + 3] += term * f;
            term *= sin * sin;
        }
    }
    h
}

/// Bilinear interpolation on a grid of `size` [rows, columns] whose ends lie at 0 and 1.
pub(super) fn bilinear<const N: usize>(
    uv: [f64; 2],
    size: [usize; 2],
    at: impl Fn(usize) -> [f64; N],
) -> [f64; N] {
    let place = |x: f64, n: usize| {
        let x = x.clamp(0.0, 1.0) * (n - 1) as f64;
        let low = (x as usize).min(n - 2);
        (low, x - low as f64)
    };
    let ((i, fi), (j, fj)) = (place(uv[0], size[0]), place(uv[1], size[1]));
    let first = i * size[1] + j;
    let corners = [at(first), at(first + 1), at(first + size[1]), at(first + size[1] + 1)];
    std::array::from_fn(|k| {
        let low = corners[0][k] + fj * (corners[1][k] - corners[0][k]);
        let high = corners[2][k] + fj * (corners[3][k] - corners[2][k]);
        low + fi * (high - low)
    })
}

/// All tables.
#[derive(Clone, Debug)]
pub struct Tables {
    pub circle: CircleTable,
    pub absorption: AbsorptionMoments,
}

/// Builds the tables: below 0.1 s on two cores.
pub fn build() -> Tables {
    Tables { circle: CircleTable::build(), absorption: AbsorptionMoments::build() }
}

impl Tables {
    /// The circle table as the shader reads it, one packed entry each: (half − narrow half, 𝒟_0, 𝒟_1,
    /// 𝒟_2), (𝒟_3, 𝒟_4, 𝒟_5, 0), where 𝒟_k/𝒞_0 belongs to |cos(φ/2)|(1−|cos(φ/2)|)^k. In these all terms
    /// of N_R are positive, so that nothing cancels in 16 bits. ℋ_k stays on the CPU, where fits are made.
    pub fn to_gpu(&self) -> Vec<[u32; 4]> {
        self.circle
            .rows
            .iter()
            .map(|r| {
                // Differences of neighbours, again and again: 𝒟_k from 𝒞_1 … 𝒞_6.
                let mut d = [r[1], r[2], r[3], r[4], r[5], r[6]];
                for k in 1..6 {
                    for i in (k..6).rev() {
                        d[i] = d[i - 1] - d[i];
                    }
                }
                pack([r[0], d[0], d[1], d[2], d[3], d[4], d[5], 0.0])
            })
            .collect()
    }
}

/// The row below x in [0, 1] of `rows` that span it, and the part of the way to the next.
pub fn place(x: f64, rows: usize) -> (usize, f64) {
    let x = x.clamp(0.0, 1.0) * (rows - 1) as f64;
    let low = (x as usize).min(rows - 2);
    (low, x - low as f64)
}

/// Eight numbers as 16-bit floats, the entry of every table on the GPU (shaders/packed.wgsl): loads are
/// half of the shader's time on lavapipe, and 2e-4 of a value is well below the method's own error.
pub fn pack(values: [f64; 8]) -> [u32; 4] {
    let half = |x: f64| u32::from(half::f16::from_f64(x).to_bits());
    std::array::from_fn(|i| half(values[2 * i]) | half(values[2 * i + 1]) << 16)
}

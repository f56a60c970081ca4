//! The paper's method, `--method xu`: ∫G_j S_t cosθ_i dω and its dual-scattering kin in closed form
//! (Xu 2011, Eq 11, Eq 27–33). shaders/xu.wgsl is its twin, name for name.
//!
//! Angles: θ_o, θ_j in [−π/2, π/2]; φ = φ_o−φ_j in [−π, π]; `cos_sum` = cos(φ_o+φ_j), which only an
//! eccentric fibre feels (azimuths count from the axis of the ellipse at which η* = η₁* of Eq 24).
//! Every result is per unit of light coefficient L_j, cosθ_i included, with unit-integral M (no energy
//! compensation, no tint: [`Modes::factors`]). On lavapipe a point and light costs 1.0 to 1.6 µs of one core for all
//! four integrals.
//!
//! Relative L2 error against the exact model (reference/integral.rs; η 1.45–1.65, σ_a 0–3, λ_j 0.1–1, β_R 7.5°,
//! m = 4): R 10 %, TT 3.5 %, TRT 9 %. An independent oracle gives the print 9, 11 and 22 %.
//!
//! Deviations are listed where they are made: `gaussian.rs`, `longitudinal.rs`, `azimuthal.rs`,
//! `tables.rs`, `global.rs`, `dual.rs`. Here:
//! - Eq 30 has |φ_j−φ_o|: φ_i is integrated out.
//! - Eq 31's means are taken by Simpson's rule over three look-ups instead of a summed-area table,
//!   whose interpolation steps at every row when σ_f is small.
//! - A mode whose product with the light has an amplitude below [`AMPLITUDE_MIN`] is left out: less
//!   than that share of what the same light gives at the mode's centre.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{
    azimuthal::{ClearEnergies, Energy, FitTable, Fitter, TURNS, eccentric_eta, r_coefficients},
    dual::{AverageTable, Averages},
    fibre::Fibre,
    gaussian::{
        Product, concentration, g_circular, g_circular_integral, g_circular_product, product,
    },
    global::{GlobalAzimuth, GlobalTable},
    longitudinal::{
        SPREAD_MAX, energy_compensation, linear_quadrature, longitudinal as gaussian,
        longitudinal_bandwidth, projection, spread_normaliser,
    },
    quadrature::GaussLegendre,
    tables::{Tables, circular_moments},
};

/// Products of Gaussians below this amplitude are skipped.
pub const AMPLITUDE_MIN: f64 = 1e-3;

/// What shaders/fibre.wgsl binds as `fibre_table`: the averages, then 𝒩^G, then the fits. To be made
/// anew when the fibre changes: 23 ms of one core's time over all cores, some 60 for an eccentric one.
pub fn fibre_table(fibre: &Fibre, segments: u32, energy: Energy, tables: &Tables) -> Vec<[u32; 4]> {
    let mut table = AverageTable::new(fibre, segments).to_gpu();
    table.extend(GlobalTable::new(fibre, energy, &tables.circle).to_gpu());
    table.extend(FitTable::new(fibre, energy).to_gpu());
    table
}

/// RGB for each mode.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Modes {
    pub r: [f64; 3],
    pub tt: [f64; 3],
    pub trt: [f64; 3],
    /// TRRT and all longer paths, of fibres that have them.
    pub longer: [f64; 3],
}

impl Modes {
    /// By what modes are multiplied: their energy compensation, and tint. Twin: `factors` of shaders/fibre.wgsl.
    pub fn factors(fibre: &Fibre, energy: [f64; 3]) -> Self {
        let [r, tt, trt] = std::array::from_fn(|t| fibre.tint[t].map(|tint| energy[t] * tint));
        Self { r, tt, trt, longer: fibre.tint[2] }
    }

    pub fn times(&self, factors: &Self) -> Self {
        let each = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c| a[c] * b[c]);
        Self {
            r: each(self.r, factors.r),
            tt: each(self.tt, factors.tt),
            trt: each(self.trt, factors.trt),
            longer: each(self.longer, factors.longer),
        }
    }

    /// Of all modes.
    pub fn sum(&self) -> [f64; 3] {
        [0, 1, 2].map(|c| self.r[c] + self.tt[c] + self.trt[c] + self.longer[c])
    }
}

/// N_t(φ) of the fits on the specular cone of `theta`, tinted, per radian: what the method takes for a light of no
/// width.
pub fn azimuthal(fibre: &Fibre, energy: Energy, theta: f64, phi: f64, cos_sum: f64) -> Modes {
    let fitter = Fitter::new(fibre, energy);
    let cos = (0.5 * phi).cos().abs();
    let powers = [0, 1, 2, 3, 4, 5, 6].map(|k| cos.powi(k));
    let (mean, half) = eccentric_eta(fibre.eta, fibre.eccentricity);
    let bare = Modes {
        r: [dot(&r_coefficients(fibre.eta, theta), &powers).max(0.0); 3],
        tt: fitter.fit(fibre.eta, theta).tt(phi, g_circular),
        trt: fitter.fit((mean + half * cos_sum).max(1.0), theta).trt(phi, g_circular),
        longer: [0.0; 3],
    };
    bare.times(&Modes::factors(fibre, [1.0; 3]))
}

/// ∫S_t cosθ_i dφ of the fits, tinted, energy compensation included, per radian of θ_i: what of light at θ_i goes to
/// θ_o, whatever its azimuth. Of an eccentric fibre the mean over its turn. `clear` is of the fibre's η.
pub fn longitudinal(
    fibre: &Fibre,
    segments: u32,
    energy: Energy,
    clear: &ClearEnergies,
    [theta_i, theta_o]: [f64; 2],
) -> Modes {
    let theta_d = 0.5 * (theta_o - theta_i);
    let fitter = Fitter::new(fibre, energy);
    let whole = |_: f64, kappa: f64| g_circular_integral(kappa);
    let even = circular_moments(&GaussLegendre::new(24), 0.0, 0.0).cosines;
    let r = TAU * dot(&r_coefficients(fibre.eta, theta_d), &even);
    let (mean, half) = eccentric_eta(fibre.eta, fibre.eccentricity);
    let trt = TURNS.map(|phi_h| {
        let eta = (mean + half * (2.0 * phi_h).cos()).max(1.0);
        fitter.fit(eta, theta_d).trt(0.0, whole)
    });
    let trt = [0, 1, 2].map(|c| 0.25 * trt.iter().map(|x| x[c]).sum::<f64>());
    let along = |t: usize, energy: [f64; 3]| {
        let m = gaussian(theta_i, theta_o, fibre.alpha[t], fibre.beta[t]);
        energy.map(|e| m * projection(theta_i, theta_o) * e)
    };
    let compensation = [0, 1, 2].map(|t| {
        let energy = |theta: f64| clear.at(theta)[t];
        energy_compensation(segments, theta_o, fibre.alpha[t], fibre.beta[t], energy)
    });
    let bare = Modes {
        r: along(0, [r; 3]),
        tt: along(1, fitter.fit(fibre.eta, theta_d).tt(0.0, whole)),
        trt: along(2, trt),
        longer: [0.0; 3],
    };
    bare.times(&Modes::factors(fibre, compensation))
}

/// The method for one fibre, evaluated without tables.
pub struct Xu<'a> {
    fibre: Fibre,
    segments: u32,
    energy: Energy<'a>,
    averages: AverageTable,
    rule: GaussLegendre,
}

impl<'a> Xu<'a> {
    /// `segments` is m ≥ 2 of §4.2.2; the paper takes 4.
    pub fn new(fibre: &Fibre, segments: u32, energy: Energy<'a>) -> Self {
        Self {
            fibre: *fibre,
            segments,
            energy,
            averages: AverageTable::new(fibre, segments),
            rule: GaussLegendre::new(24),
        }
    }

    /// 𝓜_t of Eq 11.
    pub fn single_scattering(
        &self,
        theta_o: f64,
        theta_j: f64,
        phi: f64,
        cos_sum: f64,
        lambda_j: f64,
    ) -> Modes {
        let kappa_at =
            |theta_i: f64| concentration(lambda_j) * (theta_i.cos() * theta_j.cos()).max(0.0);
        let r = self.outer(theta_o, theta_j, lambda_j, 0, |theta_i, theta_d| {
            let kappa = kappa_at(theta_i);
            let moments = circular_moments(&self.rule, kappa, phi).cosines;
            let sum = dot(&r_coefficients(self.fibre.eta, theta_d), &moments);
            [(sum * g_circular_integral(kappa)).max(0.0); 3]
        });
        let tt = self.outer(theta_o, theta_j, lambda_j, 1, |theta_i, theta_d| {
            let kappa = kappa_at(theta_i);
            let fit = Fitter::new(&self.fibre, self.energy).fit(self.fibre.eta, theta_d);
            fit.tt(phi, |delta, of| g_circular_product(delta, kappa, of))
        });
        let trt = self.outer(theta_o, theta_j, lambda_j, 2, |theta_i, theta_d| {
            let kappa = kappa_at(theta_i);
            // ⟨cos φ′⟩ = 2𝒞_2/𝒞_0 − 1 at φ = 0.
            let mean_cos = 2.0 * circular_moments(&self.rule, kappa, 0.0).cosines[2] - 1.0;
            // η̄* of Eq 24–26.
            let (mean, half) = eccentric_eta(self.fibre.eta, self.fibre.eccentricity);
            let eta = (mean + half * mean_cos * cos_sum).max(1.0);
            let fit = Fitter::new(&self.fibre, self.energy).fit(eta, theta_d);
            fit.trt(phi, |delta, of| g_circular_product(delta, kappa, of))
        });
        Modes { r, tt, trt, longer: [0.0; 3] }
    }

    /// 𝓜_t^G of Eq 27: light that came forward through other strands, of spread σ_f (a bandwidth of
    /// θ, cut at [`SPREAD_MAX`]) about θ_j, per unit of its radiance integrated over direction. For an
    /// SRBF multiply by `gaussian::srbf_integral`.
    pub fn global_scattering(&self, theta_o: f64, theta_j: f64, phi: f64, sigma_f: f64) -> Modes {
        let sigma_f = sigma_f.min(SPREAD_MAX);
        let scale = 1.0 / (PI.sqrt() * sigma_f * spread_normaliser(theta_j, sigma_f));
        let half = |delta: f64, kappa: f64| circular_moments(&self.rule, kappa, delta).half;
        let mode = |t: usize, of: fn(Modes) -> [f64; 3]| {
            let sum = self.outer(theta_o, theta_j, sigma_f, t, |_, theta_d| {
                of(GlobalAzimuth::new(&self.fibre, theta_d, self.energy).at(phi, half))
            });
            sum.map(|x| scale * x)
        };
        Modes {
            r: mode(0, |m| m.r),
            tt: mode(1, |m| m.tt),
            trt: mode(2, |m| m.trt),
            longer: [0.0; 3],
        }
    }

    /// ∫G_j S_back cosθ_i dω: what strands behind return of light that reached this one directly.
    pub fn local_scattering_direct(
        &self,
        theta_o: f64,
        theta_j: f64,
        phi: f64,
        lambda_j: f64,
    ) -> [f64; 3] {
        self.local(theta_o, theta_j, lambda_j, |theta_i| {
            let kappa = concentration(lambda_j) * (theta_i.cos() * theta_j.cos()).max(0.0);
            let half = circular_moments(&self.rule, kappa, phi).half;
            g_circular_integral(kappa) * half / PI
        })
    }

    /// 𝓜^L of Eq 29: the same of light that came forward through other strands; units as in
    /// [`Self::global_scattering`].
    pub fn local_scattering_forward(
        &self,
        theta_o: f64,
        theta_j: f64,
        phi: f64,
        sigma_f: f64,
    ) -> [f64; 3] {
        let sigma_f = sigma_f.min(SPREAD_MAX);
        let azimuth = (PI - phi.abs()) / (PI * PI);
        let scale = azimuth / (PI.sqrt() * sigma_f * spread_normaliser(theta_j, sigma_f));
        self.local(theta_o, theta_j, sigma_f, |_| scale)
    }

    /// The averages at θ.
    pub fn averages(&self, theta: f64) -> Averages {
        self.averages.sample(theta)
    }

    /// ∫g(θ_i; θ_j, width) M_t cos²θ_i/cos²θ_d inner(θ_i, θ_d) dθ_i.
    fn outer(
        &self,
        theta_o: f64,
        theta_j: f64,
        width: f64,
        mode: usize,
        inner: impl Fn(f64, f64) -> [f64; 3],
    ) -> [f64; 3] {
        let lambda_m = longitudinal_bandwidth(self.fibre.beta[mode]);
        let lobe = product(theta_j, width, 2.0 * self.fibre.alpha[mode] - theta_o, lambda_m);
        self.integrate(lobe, lambda_m, theta_o, inner)
    }

    /// ∫ lobe(θ_i)/(√π λ_M) cos²θ_i/cos²θ_d inner(θ_i, θ_d) dθ_i by §4.2.2.
    fn integrate(
        &self,
        lobe: Product,
        lambda_m: f64,
        theta_o: f64,
        inner: impl Fn(f64, f64) -> [f64; 3],
    ) -> [f64; 3] {
        let mut sum = [0.0; 3];
        if lobe.amplitude < AMPLITUDE_MIN {
            return sum;
        }
        for node in linear_quadrature(lobe.mu, lobe.lambda, self.segments) {
            let weight = node.weight * projection(node.theta, theta_o);
            if weight > 0.0 {
                let value = inner(node.theta, 0.5 * (theta_o - node.theta));
                sum = [0, 1, 2].map(|c| sum[c] + weight * value[c]);
            }
        }
        sum.map(|s| s * lobe.amplitude / (PI.sqrt() * lambda_m))
    }

    /// Eq 29's integral over θ_i of a Gaussian light against S_back, with `azimuth(θ_i)` inside.
    fn local(
        &self,
        theta_o: f64,
        theta_j: f64,
        width: f64,
        azimuth: impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        // Eq 31 over θ_i in [θ_j−σ_f, θ_j+σ_f], at (θ_i−θ_o)/2.
        let at = |offset: f64| {
            let theta_i = (theta_j + offset * width).clamp(-FRAC_PI_2, FRAC_PI_2);
            self.averages.sample(0.5 * (theta_i - theta_o))
        };
        let ends = [at(-1.0), at(0.0), at(1.0)];
        let mean =
            |of: fn(&Averages) -> f64| (of(&ends[0]) + 4.0 * of(&ends[1]) + of(&ends[2])) / 6.0;
        let (delta_b, sigma_b) = (mean(|a| a.delta_b), mean(|a| a.sigma_b));
        let lobe = product(theta_j, width, delta_b - theta_o, sigma_b);
        self.integrate(lobe, sigma_b, theta_o, |theta_i, theta_d| {
            let azimuth = azimuth(theta_i);
            self.averages.sample(-theta_d).big_a_b.map(|a| a * azimuth)
        })
    }
}

fn dot(a: &[f64; 7], b: &[f64; 7]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

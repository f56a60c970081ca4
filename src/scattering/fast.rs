//! The method `--method fast`: ∫G_j S_t cosθ_i dω and its dual-scattering kin for Marschner's fibre by Gauss
//! nodes over θ_i and a table over azimuth that knows η alone. shaders/fast.wgsl is its twin, name for name.
//!
//! > ∫G_j S_t cosθ_i dω = Σ_k weight_k G_j(θ_k) M_t(θ_k) cos²θ_k/cos²θ_d · 2πI₀e(κ_k) · P_t(φ; θ_d, κ_k)
//!
//! with the nodes of `nodes.rs` and the P_t of `azimuth_table.rs`; κ_k = 2 cosθ_k cosθ_j/λ_j². Absorption,
//! roughness, tilt and w_c are no axes of a table: a fibre may differ from point to point, and an edit of it
//! makes nothing anew; only another η does ([`Tables::new`]). Angles and units as in `xu.rs`.
//!
//! Relative L2 error against the exact model over (θ_o, θ_j to ±75°, φ), root mean square / worst over settings
//! (η 1.45, 1.65; σ_a 0, 1, 3; λ_j 0.1, 0.3, 0.6, 1; β_R 7.5°), two nodes, tests/fast.rs: R 0.28 / 0.39 %,
//! TT 0.16 / 0.30 %, TRT 0.76 / 1.2 %. On lavapipe, in one run, a light costs a point 0.6 µs of a core for single and
//! 0.6 for global scattering and 0.09 for the shares, where `xu` with m = 4 takes 0.7, 0.7 and 0.7.
//!
//! **Dual scattering**, beyond Xu 2011 and Zinke et al. 2008. Light that crosses strands forward arrives as there,
//! with mean e^{−(1−ā_f)τ}, less what comes directly. What is scattered back at least once is no lobe S_back of
//! the strands behind with their densities d_f, d_b, but a field around the point: of the J that arrives, a strand
//! returns ϖ = ā_b/χ(1−ā_f) of what it takes from the forward light; a share q of that leaves the hair without
//! another return, the mean over all directions of e^{−χ(1−ā_f)τ} (`transport::Occluders::surroundings`), and
//! the rest is scattered again:
//!
//! > L_field = (1−q) ϖ J / (1 − ϖ(1−q)),
//!
//! taken to be the same from everywhere. With χ = 1 a fibre that loses nothing would see exactly 1 under even
//! light (J = q), whatever the shape of the hair; but the strands that a seen point gets its field from lie
//! deeper and darker than itself. [`DIFFUSIVITY`] stands for that; it was chosen by the path tracer.

use std::sync::OnceLock;

use super::{
    azimuth_table::{AzimuthTable, Mode, deficit, joined, transmitted},
    azimuthal::{FitLayers, eccentric_eta},
    fibre::Fibre,
    gaussian::{concentration, g_circular, g_circular_integral, i0e},
    longitudinal::{COMPENSATION_MAX, longitudinal, longitudinal_bandwidth, projection},
    nodes::{Lobe, NodeTable, Taper},
    xu::Modes,
};

/// χ: by how much returned light is thinned out more than light that goes forward. On sintel and the builtin bob,
/// white and blond hair under studio, overcast and sunset, frames have 0.85 to 1.09 of the truth's mean; with
/// χ = 1, 1.0 to 1.45.
pub const DIFFUSIVITY: f64 = 1.3;

/// Share of what a fibre scatters that is seen, and inclinations at which it is looked for.
const VISIBLE: f64 = 1.0 / 512.0;
const VISIBLE_STEPS: usize = 32;

/// R, TT, TRT.
const MODES: [Mode; 3] = [Mode::R, Mode::Tt, Mode::Trt];

/// What the method looks up.
pub struct Tables {
    pub azimuth: AzimuthTable,
    /// Of no fibre: made once.
    pub nodes: &'static NodeTable,
}

impl Tables {
    /// Tables for a fibre's η and cross section with `nodes` (2 to 4; others are clamped) nodes over θ_i.
    pub fn new(fibre: &Fibre, nodes: usize) -> Self {
        static RULES: [OnceLock<NodeTable>; 3] = [const { OnceLock::new() }; 3];
        let count = nodes.clamp(2, 4);
        let layers = FitLayers::new(fibre);
        Self {
            azimuth: AzimuthTable::over(layers.low, layers.high, layers.count),
            nodes: RULES[count - 2]
                .get_or_init(|| NodeTable::new(count, Taper::MARSCHNER.exponent)),
        }
    }
}

/// Shares of the light that a strand scatters, RGB.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// ā_f, into the half space that it heads for.
    pub a_f: [f64; 3],
    /// ā_b, back.
    pub a_b: [f64; 3],
    /// β̄_f² as the square of a bandwidth of θ, radians²: what one forward crossing adds to σ_f².
    pub beta_f2: [f64; 3],
}

/// The method for one fibre.
pub struct Fast<'a> {
    fibre: Fibre,
    tables: &'a Tables,
    /// 1−⟨cos⟩ of TRT's own blur.
    blur: f64,
}

impl<'a> Fast<'a> {
    pub fn new(fibre: &Fibre, tables: &'a Tables) -> Self {
        Self { fibre: *fibre, tables, blur: deficit(concentration(fibre.w_c)) }
    }

    /// 𝓜_t of Eq 11, without energy compensation.
    pub fn single_scattering(
        &self,
        theta_o: f64,
        theta_j: f64,
        phi: f64,
        cos_sum: f64,
        lambda_j: f64,
    ) -> Modes {
        let sharpness = concentration(lambda_j);
        modes(|mode| {
            self.outer(theta_o, theta_j, lambda_j, mode, |theta_i, cos_d| {
                let kappa = sharpness * (theta_i.cos() * theta_j.cos()).max(0.0);
                let light = g_circular(theta_i - theta_j, sharpness) * g_circular_integral(kappa);
                let (mut eta, mut width) = (self.fibre.eta, deficit(kappa));
                if mode == Mode::Trt {
                    // η̄* of Eq 24–26, ⟨cos φ′⟩ = 1 − deficit.
                    let (mean, half) = eccentric_eta(eta, self.fibre.eccentricity);
                    eta = (mean + half * (1.0 - width) * cos_sum).max(1.0);
                    width = joined(width, self.blur);
                }
                let weights = self.tables.azimuth.azimuth(mode, eta, cos_d, phi, width);
                self.fibre.sigma_a.map(|s| light * transmitted(weights, mode, eta, cos_d, s))
            })
        })
    }

    /// 𝓜_t^G of Eq 27, without energy compensation: light that came forward through other strands, of spread σ_f
    /// (a bandwidth of θ) about θ_j, per unit of its radiance integrated over direction.
    pub fn global_scattering(&self, theta_o: f64, theta_j: f64, phi: f64, sigma_f: f64) -> Modes {
        modes(|mode| {
            let eta = self.mean_eta(mode);
            self.outer(theta_o, theta_j, sigma_f, mode, |theta_i, cos_d| {
                let light = spread(theta_i, theta_j, sigma_f);
                let weights = self.tables.azimuth.global(mode, eta, cos_d, phi);
                self.fibre.sigma_a.map(|s| light * transmitted(weights, mode, eta, cos_d, s))
            })
        })
    }

    /// C_t(θ_o) of R, TT, TRT: what [`super::longitudinal::energy_compensation`] says, by this method's nodes.
    pub fn energy_compensation(&self, theta_o: f64) -> [f64; 3] {
        MODES.map(|mode| {
            let eta = self.mean_eta(mode);
            let clear = |cos_d: f64| {
                let [whole, _] = self.tables.azimuth.energy(mode, eta, cos_d);
                whole.iter().sum::<f64>().max(1e-9)
            };
            let lobe = self.lobe(theta_o, 0.0, 1e3, mode);
            let kept: f64 = self
                .tables
                .nodes
                .nodes(lobe.mu, lobe.lambda)
                .map(|node| {
                    let cos_d = (0.5 * (theta_o - node.theta)).cos();
                    node.weight * self.longitudinal(mode, node.theta, theta_o) * clear(cos_d)
                })
                .sum();
            (clear(theta_o.cos()) / kept.max(f64::MIN_POSITIVE)).min(COMPENSATION_MAX)
        })
    }

    /// ā_f, ā_b and β̄_f² of light that comes along inclination `theta`. A lobe is taken to be narrow: its energy
    /// is that at θ_d = θ, where energy compensation makes its integral right for a clear fibre. An eccentric
    /// fibre counts as round.
    pub fn shares(&self, theta: f64) -> Shares {
        let cos = theta.cos();
        let mut shares = Shares::default();
        for (t, mode) in MODES.into_iter().enumerate() {
            let eta = self.fibre.eta;
            let [whole, forward] = self.tables.azimuth.energy(mode, eta, cos);
            for c in 0..3 {
                let at = |weights| transmitted(weights, mode, eta, cos, self.fibre.sigma_a[c]);
                let (whole, forward) = (at(whole), at(forward));
                shares.a_f[c] += forward;
                shares.a_b[c] += whole - forward;
                shares.beta_f2[c] += forward * 8.0 * self.fibre.beta[t].powi(2);
            }
        }
        // At η = 1 nothing is scattered back but 16 bits' rounding.
        shares.a_b = shares.a_b.map(|a| a.max(0.0));
        shares.beta_f2 = [0, 1, 2].map(|c| shares.beta_f2[c] / shares.a_f[c].max(1e-9));
        shares
    }

    /// Bits of the modes that can be seen: those that hold [`VISIBLE`] of what the fibre scatters in some channel at
    /// some inclination. Hair loses TRT and then TT as it darkens.
    pub fn visible_modes(&self) -> u32 {
        let mut visible = 0;
        for k in 0..VISIBLE_STEPS {
            let cos = (k as f64 + 0.5) / VISIBLE_STEPS as f64;
            let energy = MODES.map(|mode| {
                let [whole, _] = self.tables.azimuth.energy(mode, self.fibre.eta, cos);
                self.fibre.sigma_a.map(|s| transmitted(whole, mode, self.fibre.eta, cos, s))
            });
            for c in 0..3 {
                let all: f64 = energy.iter().map(|e| e[c]).sum();
                for (t, e) in energy.iter().enumerate() {
                    visible |= u32::from(e[c] >= VISIBLE * all) << t;
                }
            }
        }
        visible
    }

    /// What the field around a point is multiplied by, J to radiance towards the eye: see the head of this
    /// file. `lost(s)` is the mean over all directions of e^{−sτ}.
    pub fn field_gain(&self, theta_o: f64, lost: impl Fn(f64) -> f64) -> [f64; 3] {
        let mean = self.shares(MEAN_INCLINATION);
        let here = self.shares(theta_o);
        [0, 1, 2].map(|c| {
            let s = (1.0 - mean.a_f[c]).max(1e-6);
            let q = lost((DIFFUSIVITY * s).min(1.0));
            let back = (mean.a_b[c] / (DIFFUSIVITY * s)).min(1.0);
            let albedo = here.a_f[c] + here.a_b[c];
            albedo * (1.0 - q) * back / (1.0 - back * (1.0 - q)).max(1e-6)
        })
    }

    /// η, or of an eccentric fibre's TRT the mean of η*(φ_h).
    fn mean_eta(&self, mode: Mode) -> f64 {
        match mode {
            Mode::Trt => eccentric_eta(self.fibre.eta, self.fibre.eccentricity).0.max(1.0),
            _ => self.fibre.eta,
        }
    }

    fn lobe(&self, theta_o: f64, theta_j: f64, width: f64, mode: Mode) -> Lobe {
        let t = mode as usize;
        let (centre, lambda_m) =
            (2.0 * self.fibre.alpha[t] - theta_o, longitudinal_bandwidth(self.fibre.beta[t]));
        Lobe::new(theta_o, theta_j, width, centre, lambda_m, Taper::MARSCHNER.slope[t])
    }

    /// M_t cos²θ_i/cos²θ_d.
    fn longitudinal(&self, mode: Mode, theta_i: f64, theta_o: f64) -> f64 {
        let t = mode as usize;
        longitudinal(theta_i, theta_o, self.fibre.alpha[t], self.fibre.beta[t])
            * projection(theta_i, theta_o)
    }

    /// ∫M_t cos²θ_i/cos²θ_d inner(θ_i, cosθ_d) dθ_i, `inner` a Gaussian of bandwidth `width` about θ_j times
    /// what is smooth.
    fn outer(
        &self,
        theta_o: f64,
        theta_j: f64,
        width: f64,
        mode: Mode,
        inner: impl Fn(f64, f64) -> [f64; 3],
    ) -> [f64; 3] {
        let lobe = self.lobe(theta_o, theta_j, width, mode);
        let share = lobe.share();
        let mut sum = [0.0; 3];
        if share == 0.0 {
            return sum;
        }
        for node in self.tables.nodes.nodes(lobe.mu, lobe.lambda) {
            let weight = share * node.weight * self.longitudinal(mode, node.theta, theta_o);
            let value = inner(node.theta, (0.5 * (theta_o - node.theta)).cos().max(0.0));
            sum = [0, 1, 2].map(|c| sum[c] + weight * value[c]);
        }
        sum
    }
}

/// ψ_f over θ_i: forward-scattered light of bandwidth σ_f about θ_j. Xu's Gaussian over its normaliser (Eq 5)
/// piles up even light about θ = 0, by e^{σ_f²/4}; this is d'Eon's M_p (2011, Eq 7, v = σ_f²/2), as wide, whose
/// integral with cosθ is 1 over θ_i and over θ_j, so that even light stays even.
pub fn spread(theta_i: f64, theta_j: f64, sigma_f: f64) -> f64 {
    let v = 0.5 * sigma_f * sigma_f;
    let apart = 2.0 * (0.5 * (theta_i - theta_j)).sin().powi(2);
    i0e((theta_i.cos() * theta_j.cos()).max(0.0) / v) * (-apart / v).exp()
        / -(v * (-2.0 / v).exp_m1())
}

fn modes(of: impl Fn(Mode) -> [f64; 3]) -> Modes {
    let [r, tt, trt] = MODES.map(of);
    Modes { r, tt, trt }
}

/// The inclination that stands for light from everywhere, radians.
pub const MEAN_INCLINATION: f64 = 0.5;

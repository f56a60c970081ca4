//! The method `--method fast`: ∫G_j S_t cosθ_i dω and its dual-scattering kin by Gauss nodes over θ_i and a table
//! over azimuth that knows η alone. shaders/fast.wgsl is its twin, name for name.
//!
//! > ∫G_j S_t cosθ_i dω = Σ_k weight_k G_j(θ_k) M_t(θ_k) cos²θ_k/cos²θ_d · 2πI₀e(κ_k) · P_t(φ; θ_d, κ_k)
//!
//! for Marschner's fibre, and with M_p cosθ_k and θ_o in place of θ_d for d'Eon's (`model.rs`); the nodes are those
//! of `nodes.rs` and P_t is that of `azimuth_table.rs`; κ_k = 2 cosθ_k cosθ_j/λ_j². Absorption,
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

use std::f64::consts::TAU;
use std::sync::OnceLock;

use super::{
    azimuth_table::{AzimuthTable, Mode, deficit, joined, transmitted, transmitted_rest},
    azimuthal::{FitLayers, eccentric_eta},
    fibre::Fibre,
    gaussian::{concentration, g_circular, g_circular_integral},
    longitudinal::COMPENSATION_MAX,
    model::{Model, von_mises},
    nodes::NodeTable,
    xu::Modes,
};

/// χ: by how much returned light is thinned out more than light that goes forward. On sintel and the builtin bob,
/// white and blond hair under studio, overcast and sunset, frames have 0.85 to 1.09 of the truth's mean; with
/// χ = 1, 1.0 to 1.45.
pub const DIFFUSIVITY: f64 = 1.3;

/// What the method looks up.
pub struct Tables {
    pub azimuth: AzimuthTable,
    /// Of no fibre: made once.
    pub nodes: &'static NodeTable,
}

impl Tables {
    /// Tables for a fibre's η and cross section with `nodes` (2 to 4; others are clamped) nodes over θ_i.
    pub fn new(fibre: &Fibre, model: Model, nodes: usize) -> Self {
        static RULES: [[OnceLock<NodeTable>; 3]; 2] = [const { [const { OnceLock::new() }; 3] }; 2];
        let count = nodes.clamp(2, 4);
        let layers = FitLayers::new(fibre);
        Self {
            azimuth: AzimuthTable::over(layers.low, layers.high, layers.count),
            nodes: RULES[model as usize][count - 2]
                .get_or_init(|| NodeTable::new(count, model.taper().exponent)),
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
    model: Model,
    tables: &'a Tables,
}

impl<'a> Fast<'a> {
    /// `tables` of the same model.
    pub fn new(fibre: &Fibre, model: Model, tables: &'a Tables) -> Self {
        Self { fibre: *fibre, model, tables }
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
        self.modes(|mode| {
            let blur = self.model.blur_of(&self.fibre, mode);
            self.outer(theta_o, theta_j, lambda_j, mode, |theta_i, cos_path| {
                let kappa = sharpness * (theta_i.cos() * theta_j.cos()).max(0.0);
                let light = g_circular(theta_i - theta_j, sharpness) * g_circular_integral(kappa);
                let mut eta = self.fibre.eta;
                if mode == Mode::Trt {
                    // η̄* of Eq 24–26, ⟨cos φ′⟩ = 1 − deficit.
                    let (mean, half) = eccentric_eta(eta, self.fibre.eccentricity);
                    eta = (mean + half * (1.0 - deficit(kappa)) * cos_sum).max(1.0);
                }
                let width = joined(deficit(kappa), blur);
                let weights = self.tables.azimuth.azimuth(mode, eta, cos_path, phi, width);
                self.with_rest(weights, mode, eta, cos_path).map(|p| light * p)
            })
        })
    }

    /// 𝓜_t^G of Eq 27, without energy compensation: light that came forward through other strands, of spread σ_f
    /// (a bandwidth of θ) about θ_j, per unit of its radiance integrated over direction.
    /// ψ_f is [`von_mises`]: Xu's Gaussian over its normaliser (Eq 5) piles up even light about θ = 0, by e^{σ_f²/4}.
    pub fn global_scattering(&self, theta_o: f64, theta_j: f64, phi: f64, sigma_f: f64) -> Modes {
        self.modes(|mode| {
            let eta = self.mean_eta(mode);
            self.outer(theta_o, theta_j, sigma_f, mode, |theta_i, cos_path| {
                let light = von_mises(theta_i, theta_j, sigma_f);
                let weights = self.tables.azimuth.global(mode, eta, cos_path, phi);
                self.with_rest(weights, mode, eta, cos_path).map(|p| light * p)
            })
        })
    }

    /// C_t(θ_o) of R, TT, TRT: what [`super::longitudinal::energy_compensation`] says, by this method's nodes; 1 of
    /// d'Eon's fibre.
    pub fn energy_compensation(&self, theta_o: f64) -> [f64; 3] {
        [Mode::R, Mode::Tt, Mode::Trt].map(|mode| {
            if self.model == Model::Deon {
                return 1.0;
            }
            let eta = self.mean_eta(mode);
            let clear = |cos_d: f64| {
                let [whole, _] = self.tables.azimuth.energy(mode, eta, cos_d);
                whole.iter().sum::<f64>().max(1e-9)
            };
            let [kept, _, _] = self.outer(theta_o, 0.0, 1e3, mode, |_, cos_d| [clear(cos_d); 3]);
            (clear(theta_o.cos()) / kept.max(f64::MIN_POSITIVE)).min(COMPENSATION_MAX)
        })
    }

    /// ā_f, ā_b and β̄_f² of light that comes along inclination `theta`. A lobe is taken to be narrow: its energy
    /// is that at θ_d = θ, where energy compensation makes its integral right for a clear fibre. An eccentric
    /// fibre counts as round, and no blur of the fibre's own turns light back.
    pub fn shares(&self, theta: f64) -> Shares {
        let cos = theta.cos();
        let eta = self.fibre.eta;
        let mut shares = Shares::default();
        for &mode in self.model.modes() {
            let [whole, forward] = self.tables.azimuth.energy(mode, eta, cos);
            for c in 0..3 {
                let at = |weights| transmitted(weights, mode, eta, cos, self.fibre.sigma_a[c]);
                let (mut whole, mut forward) = (at(whole), at(forward));
                if mode == Mode::Trrt {
                    let rest = self.rest_energy(cos, c);
                    (whole, forward) = (whole + rest, forward + 0.5 * rest);
                }
                shares.a_f[c] += forward;
                shares.a_b[c] += whole - forward;
                let beta = self.fibre.beta[(mode as usize).min(2)];
                shares.beta_f2[c] += forward * 8.0 * beta.powi(2);
            }
        }
        // At η = 1 nothing is scattered back but 16 bits' rounding.
        shares.a_b = shares.a_b.map(|a| a.max(0.0));
        shares.beta_f2 = [0, 1, 2].map(|c| shares.beta_f2[c] / shares.a_f[c].max(1e-9));
        shares
    }

    /// The most that a mode has of what the fibre scatters, over inclinations and channels; TRRT counts with all that
    /// is longer.
    pub fn share_of(&self, mode: Mode) -> f64 {
        if !self.model.modes().contains(&mode) {
            return 0.0;
        }
        let mut most = 0.0f64;
        for cos in (1..=16).map(|k| f64::from(k) / 16.0) {
            let [weights, _] = self.tables.azimuth.energy(mode, self.fibre.eta, cos);
            let all = self.shares(cos.acos());
            for c in 0..3 {
                let mut own =
                    transmitted(weights, mode, self.fibre.eta, cos, self.fibre.sigma_a[c]);
                if mode == Mode::Trrt {
                    own += self.rest_energy(cos, c);
                }
                most = most.max(own / (all.a_f[c] + all.a_b[c]).max(f64::MIN_POSITIVE));
            }
        }
        most
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

    /// E of all paths longer than TRRT.
    fn rest_energy(&self, cos_path: f64, channel: usize) -> f64 {
        let weights = self.tables.azimuth.rest_energy(self.fibre.eta, cos_path);
        transmitted_rest(weights, self.fibre.eta, cos_path, self.fibre.sigma_a[channel])
    }

    /// A mode's value from its weights; TRRT's with all longer paths over an even azimuth.
    fn with_rest(&self, weights: [f64; 4], mode: Mode, eta: f64, cos_path: f64) -> [f64; 3] {
        std::array::from_fn(|c| {
            let own = transmitted(weights, mode, eta, cos_path, self.fibre.sigma_a[c]);
            match mode {
                Mode::Trrt => own + self.rest_energy(cos_path, c) / TAU,
                _ => own,
            }
        })
    }

    fn modes(&self, of: impl Fn(Mode) -> [f64; 3]) -> Modes {
        let has_longer = self.model.modes().contains(&Mode::Trrt);
        Modes {
            r: of(Mode::R),
            tt: of(Mode::Tt),
            trt: of(Mode::Trt),
            longer: if has_longer { of(Mode::Trrt) } else { [0.0; 3] },
        }
    }

    /// ∫M inner(θ_i, cos of the path) dθ_i, M with its projection, `inner` a Gaussian of bandwidth `width` about
    /// θ_j times what is smooth.
    fn outer(
        &self,
        theta_o: f64,
        theta_j: f64,
        width: f64,
        mode: Mode,
        inner: impl Fn(f64, f64) -> [f64; 3],
    ) -> [f64; 3] {
        let (fibre, model) = (&self.fibre, self.model);
        let lobe = model.lobe(fibre, mode, theta_o, theta_j, width);
        let share = lobe.share();
        let mut sum = [0.0; 3];
        if share == 0.0 {
            return sum;
        }
        for node in self.tables.nodes.nodes(lobe.mu, lobe.lambda) {
            let along = model.longitudinal(fibre, mode, node.theta, theta_o);
            let weight = share * node.weight * along;
            let value = inner(node.theta, model.cos_path(node.theta, theta_o));
            sum = [0, 1, 2].map(|c| sum[c] + weight * value[c]);
        }
        sum
    }
}

/// The inclination that stands for light from everywhere, radians.
pub const MEAN_INCLINATION: f64 = 0.5;

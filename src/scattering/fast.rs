//! The method `--method fast`: ∫G_j S_t cosθ_i dω by Gauss nodes over θ_i and a table
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
//! TT 0.16 / 0.30 %, TRT 0.76 / 1.2 %. On lavapipe, in one run, a light costs a point 0.6 µs of a core, where `xu`
//! with m = 4 takes 0.7.
//!
//! **Light that other strands have scattered** is no lobe of its own, as the forward and backward scattering of Xu
//! 2011 and Zinke et al. 2008 are, but radiance along the ordinates (`crate::field`), and scatters like any light.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use super::{
    azimuth_table::{AzimuthTable, Mode, deficit, joined, transmitted, transmitted_rest},
    azimuthal::{FitLayers, TURNS, eccentric_eta},
    fibre::Fibre,
    gaussian::{concentration, g_circular, g_circular_integral},
    longitudinal::COMPENSATION_MAX,
    model::Model,
    nodes::NodeTable,
    xu::Modes,
};

/// What the method looks up.
pub struct Tables {
    pub azimuth: AzimuthTable,
    /// Of no fibre: made once.
    pub nodes: &'static NodeTable,
}

impl Tables {
    /// Tables for a fibre's η and cross section with `nodes` (2 to 4; others are clamped) nodes over θ_i.
    pub fn new(fibre: &Fibre, model: Model, nodes: usize) -> Self {
        Self::over(&FitLayers::new(fibre), model, nodes)
    }

    /// The same for all fibres within `layers`.
    pub fn over(layers: &FitLayers, model: Model, nodes: usize) -> Self {
        static RULES: [[OnceLock<NodeTable>; 3]; 2] = [const { [const { OnceLock::new() }; 3] }; 2];
        let count = nodes.clamp(2, 4);
        Self {
            azimuth: AzimuthTable::over(layers.low, layers.high, layers.count),
            nodes: RULES[model as usize][count - 2]
                .get_or_init(|| NodeTable::new(count, model.taper().exponent)),
        }
    }
}

/// The method for one fibre.
pub struct Fast<'a> {
    pub(super) fibre: Fibre,
    pub(super) model: Model,
    tables: &'a Tables,
}

impl<'a> Fast<'a> {
    /// `tables` of the same model.
    pub fn new(fibre: &Fibre, model: Model, tables: &'a Tables) -> Self {
        Self { fibre: *fibre, model, tables }
    }

    /// 𝓜_t of Eq 11, without energy compensation or tint: see [`Self::factors`].
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
                // η̄* of Eq 24–26, ⟨cos φ′⟩ = 1 − deficit.
                let eta = self.eta_star(mode, (1.0 - deficit(kappa)) * cos_sum);
                let width = joined(deficit(kappa), blur);
                let weights = self.tables.azimuth.azimuth(mode, eta, cos_path, phi, width);
                self.with_rest(weights, mode, eta, cos_path).map(|p| light * p)
            })
        })
    }

    /// N_t(φ) on the specular cone of `theta`, tinted, per radian: what is looked up for a light of no width. `cos_sum`
    /// as in [`Self::single_scattering`].
    pub fn azimuthal(&self, theta: f64, phi: f64, cos_sum: f64) -> Modes {
        let cos_path = theta.cos().max(0.0);
        let bare = self.modes(|mode| {
            let eta = self.eta_star(mode, cos_sum);
            let width = self.model.blur_of(&self.fibre, mode);
            let weights = self.tables.azimuth.azimuth(mode, eta, cos_path, phi, width);
            self.with_rest(weights, mode, eta, cos_path)
        });
        bare.times(&Modes::factors(&self.fibre, [1.0; 3]))
    }

    /// ∫S_t cosθ_i dφ, tinted, energy compensation included, per radian of θ_i: what of light at θ_i goes to θ_o,
    /// whatever its azimuth. Of an eccentric fibre the mean over its turn.
    pub fn longitudinal(&self, theta_i: f64, theta_o: f64) -> Modes {
        let bare = self.modes(|mode| {
            let cos_path = self.model.cos_path(theta_i, theta_o);
            let energies = TURNS.map(|phi_h| {
                self.energy_at(mode, self.eta_star(mode, (2.0 * phi_h).cos()), cos_path)
            });
            let along = self.model.longitudinal(&self.fibre, mode, theta_i, theta_o);
            let mean = |c: usize| 0.25 * energies.iter().map(|energy| energy[c]).sum::<f64>();
            [0, 1, 2].map(|c| along * mean(c))
        });
        bare.times(&self.factors(theta_o))
    }

    /// By what [`Self::single_scattering`] is multiplied: energy compensation and tint.
    pub fn factors(&self, theta_o: f64) -> Modes {
        Modes::factors(&self.fibre, self.energy_compensation(theta_o))
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
                self.tables.azimuth.energy(mode, eta, cos_d).iter().sum::<f64>().max(1e-9)
            };
            let [kept, _, _] = self.outer(theta_o, 0.0, 1e3, mode, |_, cos_d| [clear(cos_d); 3]);
            (clear(theta_o.cos()) / kept.max(f64::MIN_POSITIVE)).min(COMPENSATION_MAX)
        })
    }

    /// What becomes of even light, RGB: ∫S cosθ_i dω_i of all modes, tinted. A lobe is taken to be narrow: its energy is
    /// that at θ_d = θ_o, where energy compensation makes its integral right for a clear fibre. An eccentric fibre
    /// counts as round.
    pub fn albedo(&self, theta_o: f64) -> [f64; 3] {
        let modes = self.model.modes().iter().map(|&mode| self.energy(mode, theta_o.cos()));
        modes.fold([0.0; 3], |sum, energy| [0, 1, 2].map(|c| sum[c] + energy[c]))
    }

    /// E_t of a round fibre, tinted, RGB; TRRT's with all longer paths.
    fn energy(&self, mode: Mode, cos_path: f64) -> [f64; 3] {
        let bare = self.energy_at(mode, self.fibre.eta, cos_path);
        let tint = self.fibre.tints()[mode as usize];
        [0, 1, 2].map(|c| tint[c] * bare[c])
    }

    /// Untinted, at an η of the mode's own.
    fn energy_at(&self, mode: Mode, eta: f64, cos_path: f64) -> [f64; 3] {
        let own = self.own_energy(mode, eta, cos_path);
        [0, 1, 2].map(|c| {
            let rest = if mode == Mode::Trrt { self.rest_energy(cos_path, c) } else { 0.0 };
            own[c] + rest
        })
    }

    /// The same, but TRRT's without longer paths.
    fn own_energy(&self, mode: Mode, eta: f64, cos_path: f64) -> [f64; 3] {
        let weights = self.tables.azimuth.energy(mode, eta, cos_path);
        self.fibre.sigma_a.map(|sigma_a| transmitted(weights, mode, eta, cos_path, sigma_a))
    }

    /// The most that a mode has of what the fibre scatters, over inclinations and channels; TRRT counts with all that
    /// is longer.
    pub fn share_of(&self, mode: Mode) -> f64 {
        if !self.model.modes().contains(&mode) {
            return 0.0;
        }
        let mut most = 0.0f64;
        for theta in (0..16).map(|k| (f64::from(k + 1) / 16.0).acos()) {
            let (own, all) = (self.energy(mode, theta.cos()), self.albedo(theta));
            for c in 0..3 {
                most = most.max(own[c] / all[c].max(f64::MIN_POSITIVE));
            }
        }
        most
    }

    /// η, or of an eccentric fibre's TRT η* where cos 2φ_h is `cos` (Eq 24).
    pub(super) fn eta_star(&self, mode: Mode, cos: f64) -> f64 {
        match mode {
            Mode::Trt => {
                let (mean, half) = eccentric_eta(self.fibre.eta, self.fibre.eccentricity);
                (mean + half * cos).max(1.0)
            }
            _ => self.fibre.eta,
        }
    }

    /// η, or of an eccentric fibre's TRT the mean of η*(φ_h).
    pub(super) fn mean_eta(&self, mode: Mode) -> f64 {
        self.eta_star(mode, 0.0)
    }

    /// E of all paths longer than TRRT.
    pub(super) fn rest_energy(&self, cos_path: f64, channel: usize) -> f64 {
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

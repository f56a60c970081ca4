//! The fibre as people describe it, and its resolution to the parameters of Xu 2011.
//!
//! **Absorption is per fibre radius**: Xu's and pbrt's chord 2 cos γ_t / cos θ_t counts radii.
//! d'Eon 2011 §6.1 states its melanin cross-sections in units of R², so that at R = 1 a
//! concentration near 1 is "black"; but his path, exp(−2μ(1 + cos 2γ_t)) = exp(−4μ cos² γ_t), is
//! twice Xu's chord at h = 0. We take the cross-sections as per radius under Xu's chord, as pbrt-v4
//! and Mitsuba do, so that their customary concentrations (8, 1.3 and 0.3 for black, brown and
//! blond) mean the same here; under d'Eon's printed path, half of them would.

use super::Bcsdf;
use super::preset::PRESETS;
use crate::scattering::fibre::{BETA_DEG, Fibre, linked_alpha, linked_beta};

/// d'Eon 2011 §6.1, linear sRGB, per radius and unit of concentration.
const EUMELANIN_CROSS_SECTION: [f64; 3] = [0.419, 0.697, 1.37];
/// d'Eon 2011 §6.1, linear sRGB, per radius and unit of concentration.
const PHEOMELANIN_CROSS_SECTION: [f64; 3] = [0.187, 0.4, 1.05];

/// The greatest concentration that a scene may have.
pub(super) const MOST_MELANIN: f64 = 100.0;

/// What gives the hair its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pigment {
    /// σ_a per radius, linear RGB.
    Absorption([f64; 3]),
    /// Concentrations of the two melanins.
    Melanin { eumelanin: f64, pheomelanin: f64 },
    /// The colour that an assembly of fibres shall have, linear RGB in (0, 1).
    Color([f64; 3]),
}

/// One fibre. Angles in degrees; widths β are standard deviations of θ_h.
#[derive(Clone, Debug, PartialEq)]
pub struct FibreSpec {
    pub model: Bcsdf,
    /// The preset that the other values started from.
    pub preset: String,
    pub eta: f64,
    pub pigment: Pigment,
    pub beta_r_deg: f64,
    /// `None`: β_R / 2.
    pub beta_tt_deg: Option<f64>,
    /// `None`: 2 β_R.
    pub beta_trt_deg: Option<f64>,
    pub alpha_r_deg: f64,
    /// `None`: −α_R / 2.
    pub alpha_tt_deg: Option<f64>,
    /// `None`: −3 α_R / 2.
    pub alpha_trt_deg: Option<f64>,
    /// Colour of each lobe, linear RGB in [0, 1], on top of what the fibre makes of it; longer paths follow TRT.
    pub tint_r: [f64; 3],
    pub tint_tt: [f64; 3],
    pub tint_trt: [f64; 3],
    /// Times as bright as a physical fibre's, 0 to 4.
    pub intensity_r: f64,
    pub intensity_tt: f64,
    pub intensity_trt: f64,
    /// Bandwidth of the TRT caustic, radians.
    pub w_c: f64,
    pub eccentricity: f64,
    /// In the hair's unit after `hair.scale`; 0 is automatic.
    pub diameter: f64,
    pub chiang: ChiangSpec,
}

/// What the model of Chiang et al. 2016 takes in place of β, w_c and α (pbrt-v4 §9.9); the reference alone
/// has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChiangSpec {
    /// In (0, 1]; `None`: as wide as β_R.
    pub beta_m: Option<f64>,
    /// In (0, 1]; `None`: as wide as w_c.
    pub beta_n: Option<f64>,
    /// Tilt of the scales; `None`: α_R, whose highlight it moves alike.
    pub alpha_deg: Option<f64>,
}

impl Default for FibreSpec {
    /// The first preset on a round fibre of keratin.
    fn default() -> Self {
        let mut fibre = Self {
            model: Bcsdf::Marschner,
            preset: String::new(),
            eta: 1.55,
            pigment: Pigment::Absorption([0.0; 3]),
            beta_r_deg: 0.0,
            beta_tt_deg: None,
            beta_trt_deg: None,
            alpha_r_deg: 0.0,
            alpha_tt_deg: None,
            alpha_trt_deg: None,
            tint_r: [1.0; 3],
            tint_tt: [1.0; 3],
            tint_trt: [1.0; 3],
            intensity_r: 1.0,
            intensity_tt: 1.0,
            intensity_trt: 1.0,
            w_c: 0.0,
            eccentricity: 1.0,
            diameter: 0.0,
            chiang: ChiangSpec::default(),
        };
        fibre.set_preset(&PRESETS[0]);
        fibre
    }
}

impl FibreSpec {
    /// The parameters that the scattering maths takes: radians, σ_a per radius, links resolved by
    /// Marschner's ratios (2003, Table 1).
    pub fn resolve(&self) -> Fibre {
        let [beta_r, beta_tt, beta_trt] = linked_beta(self.beta_r_deg);
        let [alpha_r, alpha_tt, alpha_trt] = linked_alpha(self.alpha_r_deg);
        let [least, most] = BETA_DEG;
        let beta = |own: Option<f64>, linked: f64| own.unwrap_or(linked.clamp(least, most));
        let beta = [beta_r, beta(self.beta_tt_deg, beta_tt), beta(self.beta_trt_deg, beta_trt)];
        let alpha = [
            alpha_r,
            self.alpha_tt_deg.unwrap_or(alpha_tt),
            self.alpha_trt_deg.unwrap_or(alpha_trt),
        ];
        Fibre {
            eta: self.eta,
            sigma_a: self.pigment.sigma_a(),
            alpha: alpha.map(f64::to_radians),
            beta: beta.map(f64::to_radians),
            w_c: self.w_c,
            eccentricity: self.eccentricity,
            tint: [
                self.tint_r.map(|c| self.intensity_r * c),
                self.tint_tt.map(|c| self.intensity_tt * c),
                self.tint_trt.map(|c| self.intensity_trt * c),
            ],
        }
    }

    /// Whether β_TT, β_TRT, α_TT and α_TRT follow R's.
    pub fn links(&self) -> [bool; 4] {
        [self.beta_tt_deg, self.beta_trt_deg, self.alpha_tt_deg, self.alpha_trt_deg]
            .map(|own| own.is_none())
    }

    /// Both concentrations, zero where the pigment is no melanin.
    pub(super) fn melanin(&self) -> [f64; 2] {
        match self.pigment {
            Pigment::Melanin { eumelanin, pheomelanin } => [eumelanin, pheomelanin],
            _ => [0.0; 2],
        }
    }
}

impl Pigment {
    /// σ_a per radius, linear RGB.
    pub fn sigma_a(&self) -> [f64; 3] {
        match *self {
            Pigment::Absorption(sigma_a) => sigma_a,
            Pigment::Melanin { eumelanin, pheomelanin } => std::array::from_fn(|c| {
                eumelanin * EUMELANIN_CROSS_SECTION[c] + pheomelanin * PHEOMELANIN_CROSS_SECTION[c]
            }),
            Pigment::Color(color) => color.map(sigma_a_from_color),
        }
    }

    /// The two melanins whose absorption is nearest to `sigma_a` (per radius, linear RGB), by least squares.
    pub fn melanin_near(sigma_a: [f64; 3]) -> Self {
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (e, p) = (EUMELANIN_CROSS_SECTION, PHEOMELANIN_CROSS_SECTION);
        let (ee, ep, pp) = (dot(e, e), dot(e, p), dot(p, p));
        let (es, ps) = (dot(e, sigma_a), dot(p, sigma_a));
        let det = ee * pp - ep * ep;
        let [mut eumelanin, mut pheomelanin] =
            [pp * es - ep * ps, ee * ps - ep * es].map(|x| x / det);
        // Where one of them would be less than none, it is none, and the other alone comes nearest.
        if eumelanin < 0.0 {
            (eumelanin, pheomelanin) = (0.0, ps / pp);
        } else if pheomelanin < 0.0 {
            (eumelanin, pheomelanin) = (es / ee, 0.0);
        }
        let [eumelanin, pheomelanin] = [eumelanin, pheomelanin].map(|x| x.min(MOST_MELANIN));
        Pigment::Melanin { eumelanin, pheomelanin }
    }

    /// An absorption stated as this one is, as near as that way has it.
    pub fn restate(&self, sigma_a: [f64; 3]) -> Self {
        match self {
            Pigment::Absorption(_) => Pigment::Absorption(sigma_a),
            Pigment::Melanin { .. } => Self::melanin_near(sigma_a),
            Pigment::Color(_) => Pigment::Color(assembly_color(sigma_a)),
        }
    }
}

/// What fibres reflect before light enters them: the colour of an assembly that absorbs all else.
const SHEEN: f64 = 0.0236;
/// −d ln(C − sheen)/d√σ_a.
const DEEPENING: f64 = 4.51;

/// The colour of dense hair under even light, of the absorption per radius of its untinted fibres, linear RGB:
/// C = r + (1 − r) e^(−k √σ_a), r = 0.0236 and k = 4.51.
///
/// k is Chiang et al. 2016's f(β_n), Eq 9, fitted to the builtin bob as it is rendered here under a map of radiance 1
/// (tests/color.rs). Between C = 0.04 and 0.35 its frames are within 5 %, Marschner or d'Eon; β_R from 3.5 to 15° changes 1 %. Looser hair is brighter: sintel by a quarter at C = 0.3. Paler hair
/// is as pale as the head below lets it be: the bob of clear fibres has 0.66.
pub fn assembly_color(sigma_a: [f64; 3]) -> [f64; 3] {
    sigma_a.map(|s| SHEEN + (1.0 - SHEEN) * (-DEEPENING * s.sqrt()).exp())
}

/// The inverse of [`assembly_color`]; a colour that is darker than the sheen is as dark as can be.
fn sigma_a_from_color(color: f64) -> f64 {
    /// Of what enters the fibres, what still comes out of hair that is black.
    const BLACK: f64 = 1e-3;
    let body = ((color - SHEEN) / (1.0 - SHEEN)).max(BLACK);
    (body.ln() / DEEPENING).powi(2)
}

//! The Marschner model of a smooth fibre without approximation (Marschner et al. 2003; Xu 2011, Eq 6–10):
//! M_p a Gaussian of unit integral over θ_i, N_p from the roots of Eq 8 with exact Fresnel, N_TRT convolved
//! with the circular Gaussian of bandwidth w_c, an elliptic cross section through η*(φ_h) (Eq 24) in TRT.
//!
//! - N_R and N_TT are closed forms: sinγ_t = q sinγ with γ_t = γ−y, y = (π−|φ|)/2, q = 1/η′ gives
//!   tanγ = sin y/(cos y−q), so TT needs no root finder, and Eq 8's cubic fit is needed nowhere.
//! - N_TRT with w_c = 0 has the 1 or 3 roots of the exact φ(2, h), true to the caustic's square-root law
//!   within 3e-6 from 1e-6 to 1e-11 beside it. With w_c > 0 it is an integral over γ = asin h, in panels that
//!   follow w_c and the nearest singularity of the integrand: 3e-13 of its peak.
//! - Eq 7's doubling is left out, as in `scattering::longitudinal`. A clear fibre of β_R = 7.5° under even
//!   light then returns 0.969, 0.949, 0.815 and 1.368 at θ_o = 0°, 45°, 75° and 89.5°, where cos²θ_i/cos²θ_d
//!   rises to 4; [`Marschner::compensated`] 0.993, 0.982, 0.862 and 0.812, the rest being TRRT and on.
//! - For one h, R and TT stand for their means over h, which are smooth where a delta is not, and TRT is
//!   A(h)·D(φ−Φ(h)). The mean over h is the model all the same.
//!
//! Beyond the papers: sampling, whose density is exact and whose f_cos/pdf stays near the albedo. A lobe is
//! drawn by its energy, TRT's at the h given; θ_i by M_p cos²θ_i/cos²θ_d times the energy at θ_d, through a
//! table over the share of M_p's Gaussian below θ_i, the Gaussian cut off at ±π/2; φ by an h that follows A_p(h)
//! for R and TT, and by Φ(h) and a draw of D for TRT. For clear fibres of β_R = 2–20° and |θ_o| up to
//! 85° f_cos/pdf has a relative variance of 0.001–0.01 and is at most 2.7; θ_i by the Gaussian alone, R by
//! cos(φ/2) and TT by an even h have 0.04–0.42 and 12. Paths through clear hair meet tens of fibres, and
//! weights multiply: a white furnace of 10,000 clear strands, at 64 samples 1.33 ± 0.38 with those, is
//! 0.947 ± 0.002.
//! An eccentric fibre's TRT is drawn with more blur instead: f_cos/pdf is about e^½√(1+Δ²/σ²) times as much, Δ
//! half of the range of Φ and σ = w_c/√2, and without bound if w_c is 0.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_8, PI, TAU};
use std::sync::Arc;

use rayon::prelude::*;

use super::model::{Detector, Direction, Evaluation, FibreModel, Path, Sample, Section};
use crate::scattering::{
    azimuthal::{ClearEnergies, ClearRange, eccentric_eta, exit_azimuth, wrap},
    fibre::Fibre,
    fresnel::fresnel,
    gaussian::{concentration, g_circular, g_circular_integral},
    longitudinal::{COMPENSATION_MAX, longitudinal, projection},
    quadrature::GaussLegendre,
    tables::place,
};

/// Rows over cosθ_d in [0, 1] of the densities of |h|.
const OFFSET_ROWS: usize = 33;

/// Stands for cosθ_d = 0 there, where a fibre of η = 1 would reflect all light, and from where on none.
const COS_GRAZING: f64 = 1e-3;

/// A lobe of less energy is drawn as if it had this much everywhere: R has none at η = 1, but at its rim.
const ENERGY_LEAST: f64 = 1e-9;

/// Rows over θ_o in [−π/2, π/2] of the densities of θ_i, see [`theta_to_x`].
const INCLINATION_ROWS: usize = 129;

/// Rows of Z_p over θ_o in [−π/2, π/2], see [`theta_to_x`].
const KEPT_ROWS: usize = 2049;

/// Every lobe that is not tinted black is drawn at least this often, relative to the whole.
const SHARE_MIN: f64 = 0.01;

/// A lobe of which less than this lies within ±π/2 is not drawn: it holds no light.
const INSIDE_MIN: f64 = 1e-12;

/// q = 1/η′ is kept below 1 by this much in TT, which is a delta at η = 1.
const TT_WIDTH_MIN: f64 = 1e-9;

/// |dφ/dγ| at a root of TRT is kept above this: N_TRT is finite on the caustic.
const CAUSTIC_SLOPE_MIN: f64 = 1e-12;

/// The exact Marschner model of one fibre.
#[derive(Clone, Debug)]
pub struct Marschner {
    fibre: Fibre,
    /// TRT's.
    detector: Detector,
    /// D(0) of [`Self::detector`]; 0 for a delta.
    detector_peak: f64,
    /// η*(φ_h) = mean + half·cos 2φ_h.
    eta_star: (f64, f64),
    compensated: bool,
    drawing: Arc<Drawing>,
    kept: Kept,
}

/// What samples are drawn by. The density is that of the draw whichever fibre this was made for.
#[derive(Debug)]
struct Drawing {
    /// A_p over |h|, tinted, the sum over RGB of a round fibre; rows over cosθ_d.
    offsets: [Densities; 3],
    /// cos²θ_i/cos²θ_d times the mean of A_p over h, over the cumulative share of M_p's Gaussian; rows over θ_o.
    inclinations: [Densities; 3],
    /// The mean over θ_i of TRT's A over |h|, by which it is chosen at a given h; rows over θ_o.
    trt_offsets: Densities,
    rule: GaussLegendre,
}

/// Z_p(θ_o) = ∫M_p cos²θ_i/cos²θ_d E_p(θ_d) dθ_i / E_p(θ_o), E_p the energy of a clear fibre's lobe.
#[derive(Clone, Debug)]
enum Kept {
    Rows(Arc<Vec<[f64; 3]>>),
    /// At the θ_o that the model was made for.
    There([f64; 3]),
}

/// How lobes and inclinations are drawn for one ω_o.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Choice {
    /// Probability of each lobe; all 0 where there is no light.
    pub(super) share: [f64; 3],
    gaussian: [TruncatedGaussian; 3],
    /// Of [`Drawing::inclinations`].
    row: Row,
    /// What their values times M_p are multiplied by to be densities, the lobe's probability included.
    scale: [f64; 3],
    /// C_p.
    compensation: [f64; 3],
}

impl Choice {
    /// The lobe for a uniform `u` in [0, 1).
    pub(super) fn lobe(&self, u: f64) -> Option<usize> {
        let drawn = (0..3).scan(0.0, |sum, p| {
            *sum += self.share[p];
            Some(*sum)
        });
        // Rounding may leave the sum just below u.
        let last = (0..3).rev().find(|&p| self.share[p] > 0.0)?;
        Some(drawn.take_while(|&sum| sum <= u).count().min(last))
    }
}

/// N_p at one φ and the density of its samples there, both per radian.
#[derive(Clone, Copy, Debug, Default)]
struct Azimuth {
    value: [f64; 3],
    density: f64,
}

impl Marschner {
    /// M_p of unit integral over θ_i: a fibre loses what cos²θ_i/cos²θ_d and the ends at ±π/2 take away.
    pub fn new(fibre: &Fibre) -> Self {
        Self::build(fibre, false)
    }

    /// Each lobe times C_p = 1/Z_p, at most [`COMPENSATION_MAX`], so that a clear fibre sends on what even light
    /// gives it but for the paths past TRT: the model that the renderer shades with
    /// (`scattering::longitudinal::energy_compensation`).
    pub fn compensated(fibre: &Fibre) -> Self {
        Self::build(fibre, true)
    }

    fn build(fibre: &Fibre, compensated: bool) -> Self {
        let rule = GaussLegendre::new(16);
        let offsets = [0, 1, 2].map(|p| {
            Densities::new(OFFSET_ROWS, |y| {
                let cross = CrossSection::new(fibre, fibre.eta, y.max(COS_GRAZING).powi(2));
                move |h| {
                    tinted(fibre, p, cross.attenuation(p, h)).iter().sum::<f64>().max(ENERGY_LEAST)
                }
            })
        });
        // cos²θ_i/cos²θ_d and the row of θ_d, by the share of lobe p below θ_i.
        let met = |p: usize, y: f64| {
            let theta_o = x_to_theta(y);
            let gaussian = TruncatedGaussian::of(fibre, p, theta_o);
            move |share: f64| {
                let theta_i = gaussian.sample(share);
                let cos_d = (0.5 * (theta_o - theta_i)).cos();
                (projection(theta_i, theta_o), Row::at(cos_d, OFFSET_ROWS))
            }
        };
        let inclinations = [0, 1, 2].map(|p| {
            Densities::new(INCLINATION_ROWS, |y| {
                let (met, offsets) = (met(p, y), &offsets[p]);
                move |share| {
                    let (projection, row) = met(share);
                    projection * offsets.integral(row)
                }
            })
        });
        let trt_offsets = Densities::new(INCLINATION_ROWS, |y| {
            let met = met(2, y);
            let nodes: Vec<(f64, Row)> = rule
                .on(0.0, 1.0)
                .map(|(share, weight)| {
                    let (projection, row) = met(share);
                    (weight * projection, row)
                })
                .collect();
            let offsets = &offsets[2];
            move |h| nodes.iter().map(|&(weight, row)| weight * offsets.value(row, h)).sum()
        });
        let clear = ClearEnergies::new(fibre.eta);
        let kept = (0..KEPT_ROWS)
            .into_par_iter()
            .map(|row| {
                let theta_o = x_to_theta(row as f64 / (KEPT_ROWS - 1) as f64);
                [0, 1, 2].map(|p| {
                    let energy = |theta_d: f64| clear.at(theta_d)[p];
                    kept_share(&rule, theta_o, fibre.alpha[p], fibre.beta[p], energy)
                })
            })
            .collect();
        let (detector, detector_peak) = if fibre.w_c > 0.0 {
            let kappa = concentration(fibre.w_c);
            (Detector::Circular { kappa }, g_circular_integral(kappa).recip())
        } else {
            (Detector::Delta, 0.0)
        };
        Self {
            fibre: *fibre,
            detector,
            detector_peak,
            eta_star: eccentric_eta(fibre.eta, fibre.eccentricity),
            compensated,
            drawing: Arc::new(Drawing { offsets, inclinations, trt_offsets, rule }),
            kept: Kept::Rows(Arc::new(kept)),
        }
    }

    /// The model of another fibre of the same w_c, to be seen from `theta_o` alone: its values are exact, its samples
    /// are drawn by what this one's are. `clear` knows the fibre's η.
    pub fn alike(&self, fibre: &Fibre, theta_o: f64, clear: &ClearRange) -> Self {
        let own = &self.fibre;
        let same = (own.eta, own.alpha, own.beta) == (fibre.eta, fibre.alpha, fibre.beta);
        let kept = match self.compensated && !same {
            true => Kept::There([0, 1, 2].map(|p| {
                let energy = |theta_d: f64| clear.at(fibre.eta, theta_d)[p];
                let (alpha, beta) = (fibre.alpha[p], fibre.beta[p]);
                kept_share(&self.drawing.rule, theta_o, alpha, beta, energy)
            })),
            false => self.kept.clone(),
        };
        Self {
            fibre: *fibre,
            detector: self.detector,
            detector_peak: self.detector_peak,
            eta_star: eccentric_eta(fibre.eta, fibre.eccentricity),
            compensated: self.compensated,
            drawing: self.drawing.clone(),
            kept,
        }
    }

    /// The fibre that this is the model of.
    pub fn fibre(&self) -> &Fibre {
        &self.fibre
    }

    /// Z_p(θ_o), interpolated.
    fn kept(&self, theta_o: f64) -> [f64; 3] {
        match &self.kept {
            Kept::Rows(rows) => interpolate(rows, theta_to_x(theta_o)),
            Kept::There(kept) => *kept,
        }
    }

    /// C_p for Z_p = `kept`.
    fn compensation(&self, kept: f64) -> f64 {
        if self.compensated { kept.max(1e-9).recip().min(COMPENSATION_MAX) } else { 1.0 }
    }

    fn eccentric(&self) -> bool {
        self.eta_star.1 != 0.0
    }

    /// The cross section that lobe p sees: of η*(φ_h) for TRT (Eq 24).
    fn cross_section(&self, p: usize, cos2_d: f64, phi_h: f64) -> CrossSection {
        let eta = if p == 2 && self.eccentric() {
            (self.eta_star.0 + self.eta_star.1 * (2.0 * phi_h).cos()).max(1.0)
        } else {
            self.fibre.eta
        };
        CrossSection::new(&self.fibre, eta, cos2_d)
    }

    /// How sampling divides between the lobes for one ω_o, whatever h.
    pub(super) fn choice(&self, o: &Direction) -> Choice {
        self.choice_at(o, None)
    }

    /// The same at h.
    fn choice_at(&self, o: &Direction, h: Option<f64>) -> Choice {
        let theta_o = o.theta();
        let kept = self.kept(theta_o);
        let row = Row::at(theta_to_x(theta_o), INCLINATION_ROWS);
        let mut choice = Choice { row, ..Choice::default() };
        let mut inside = [0.0; 3];
        for p in 0..3 {
            choice.gaussian[p] = TruncatedGaussian::of(&self.fibre, p, theta_o);
            choice.compensation[p] = self.compensation(kept[p]);
            inside[p] = choice.gaussian[p].inside * self.drawing.inclinations[p].integral(row);
            choice.share[p] = choice.compensation[p] * inside[p];
        }
        if let (Some(h), Detector::Circular { .. }) = (h, self.detector) {
            choice.share[2] *= self.drawing.trt_offsets.density(row, h.abs());
        }
        let floor = SHARE_MIN * choice.share.iter().sum::<f64>();
        for (p, &inside) in inside.iter().enumerate() {
            let lit = self.fibre.tint[p] != [0.0; 3];
            let drawn = lit && choice.gaussian[p].inside > INSIDE_MIN && inside > 0.0;
            choice.share[p] = if drawn { choice.share[p] + floor } else { 0.0 };
        }
        let total = choice.share.iter().sum::<f64>();
        for (p, &inside) in inside.iter().enumerate().filter(|(_, inside)| **inside > 0.0) {
            choice.share[p] /= total.max(f64::MIN_POSITIVE);
            choice.scale[p] = choice.share[p] / inside;
        }
        choice
    }

    /// [`FibreModel::evaluate`] with the choice for `o` at hand.
    pub(super) fn evaluate_by(
        &self,
        choice: &Choice,
        o: &Direction,
        i: &Direction,
        h: f64,
    ) -> Evaluation {
        let phi = wrap(i.phi - o.phi);
        let cos2_d = cos2_d(o, i);
        let cross = CrossSection::new(&self.fibre, self.fibre.eta, cos2_d);
        let row = Row::at(cross.cos_d, OFFSET_ROWS);
        let (sin_half, cos_half) = (0.5 * phi).sin_cos();
        let azimuths = [
            r(&cross, sin_half, cos_half, |h| self.drawing.offsets[0].density(row, h)),
            tt(&cross, sin_half.abs(), cos_half, |h| self.drawing.offsets[1].density(row, h)),
            self.trt(phi, 0.5 * (i.phi + o.phi), cos2_d, h),
        ];
        let theta_i = i.theta();
        let cos_i = i.cos_theta.max(1e-17);
        let projection = cos_i * cos_i / cos2_d;
        let mut evaluation = Evaluation::default();
        for (p, azimuth) in azimuths.iter().enumerate() {
            let (density, u) = choice.gaussian[p].density_and_share(theta_i);
            let m = density / cos_i;
            let drawn = choice.scale[p] * self.drawing.inclinations[p].value(choice.row, u);
            evaluation.pdf += drawn * m * azimuth.density;
            let value = choice.compensation[p] * projection * m;
            let n = tinted(&self.fibre, p, azimuth.value);
            evaluation.f_cos = [0, 1, 2].map(|c| evaluation.f_cos[c] + value * n[c]);
        }
        evaluation
    }

    /// TRT at h, or the mean over h where nothing blurs it.
    fn trt(&self, phi: f64, phi_h: f64, cos2_d: f64, h: f64) -> Azimuth {
        let cross = self.cross_section(2, cos2_d, phi_h);
        let Detector::Circular { kappa } = self.detector else {
            let row = Row::at(cross.cos_d, OFFSET_ROWS);
            let bare = caustic(&cross, phi, |h| self.drawing.offsets[2].density(row, h));
            let density = if self.eccentric() { 1.0 / TAU } else { bare.density };
            return Azimuth { density, ..bare };
        };
        let blur = self.detector_peak * cross.trt_blur(phi, h, kappa);
        let density = if self.eccentric() {
            let (centre, detector) = self.eccentric_proposal(cos2_d, h);
            detector.density(wrap(phi - centre))
        } else {
            blur
        };
        Azimuth { value: cross.attenuation(2, h).map(|a| a * blur), density }
    }

    /// Φ_2 of an eccentric fibre follows from the φ_i to be drawn. So φ is drawn about the middle of Φ_2's
    /// range, by a D whose variance is that of the fibre's own plus the square of half the range.
    fn eccentric_proposal(&self, cos2_d: f64, h: f64) -> (f64, Detector) {
        let (mean, half) = self.eta_star;
        let [a, b] = [mean - half, mean + half]
            .map(|eta| CrossSection::new(&self.fibre, eta.max(1.0), cos2_d).azimuth(2, h));
        let detector = match self.detector {
            Detector::Circular { kappa } => {
                Detector::Circular { kappa: (kappa.recip() + 0.25 * (a - b).powi(2)).recip() }
            }
            // The bare caustic may lie anywhere.
            _ => Detector::Uniform,
        };
        (0.5 * (a + b), detector)
    }

    /// φ of lobe p drawn by a uniform `u`.
    fn draw_azimuth(&self, p: usize, cos2_d: f64, h: f64, u: f64) -> f64 {
        let cross = CrossSection::new(&self.fibre, self.fibre.eta, cos2_d);
        let side = 2.0 * u - 1.0;
        let offset = || {
            let row = Row::at(cross.cos_d, OFFSET_ROWS);
            self.drawing.offsets[p].sample(row, side.abs()).copysign(side)
        };
        match (p, self.detector) {
            (0, _) => 2.0 * offset().asin(),
            (1, _) => cross.azimuth(1, offset()),
            _ if self.eccentric() => {
                let (centre, detector) = self.eccentric_proposal(cos2_d, h);
                centre + detector.sample(u)
            }
            (_, Detector::Delta) => cross.azimuth(2, offset()),
            _ => cross.azimuth(2, h) + self.detector.sample(u),
        }
    }
}

impl FibreModel for Marschner {
    fn lobes(&self) -> usize {
        3
    }

    fn longitudinal(&self, p: usize, theta_i: f64, theta_o: f64) -> f64 {
        self.compensation(self.kept(theta_o)[p])
            * longitudinal(theta_i, theta_o, self.fibre.alpha[p], self.fibre.beta[p])
            * projection(theta_i, theta_o)
            / theta_i.cos().max(1e-17)
    }

    fn path(&self, p: usize, h: f64, section: &Section) -> Path {
        let cross = self.cross_section(p, section_cos2_d(section), section.phi_h);
        let attenuation = tinted(&self.fibre, p, cross.attenuation(p, h));
        Path { attenuation, azimuth: cross.azimuth(p, h) }
    }

    fn detector(&self, p: usize) -> Detector {
        if p == 2 { self.detector } else { Detector::Delta }
    }

    fn azimuthal(&self, p: usize, phi: f64, section: &Section) -> [f64; 3] {
        let cross = self.cross_section(p, section_cos2_d(section), section.phi_h);
        let (sin_half, cos_half) = (0.5 * wrap(phi)).sin_cos();
        let bare = match (p, self.detector) {
            (0, _) => r(&cross, sin_half, cos_half, |_| 1.0).value,
            (1, _) => tt(&cross, sin_half.abs(), cos_half, |_| 1.0).value,
            (_, Detector::Circular { kappa }) => {
                blurred_trt(&self.drawing.rule, &cross, phi, kappa).map(|n| n * self.detector_peak)
            }
            _ => caustic(&cross, phi, |_| 1.0).value,
        };
        tinted(&self.fibre, p, bare)
    }

    fn evaluate(&self, o: &Direction, i: &Direction, h: f64) -> Evaluation {
        self.evaluate_by(&self.choice_at(o, Some(h)), o, i, h)
    }

    fn sample(&self, o: &Direction, h: f64, u: [f64; 4]) -> Option<Sample> {
        let choice = self.choice_at(o, Some(h));
        let p = choice.lobe(u[0])?;
        let share = self.drawing.inclinations[p].sample(choice.row, u[1]);
        let theta_i = choice.gaussian[p].sample(share);
        let level = Direction::new(theta_i, 0.0);
        let phi = self.draw_azimuth(p, cos2_d(o, &level), h, u[2]);
        let direction = Direction { phi: wrap(o.phi + phi), ..level };
        let value = self.evaluate_by(&choice, o, &direction, h);
        (value.pdf > 0.0).then_some(Sample { direction, value })
    }

    fn near_field(&self) -> bool {
        false
    }
}

fn section_cos2_d(section: &Section) -> f64 {
    (0.5 * (section.theta_o - section.theta_i)).cos().powi(2)
}

/// cos²θ_d without an angle; below cos²θ_i/4 only by rounding.
fn cos2_d(o: &Direction, i: &Direction) -> f64 {
    let cos_2d = i.cos_theta * o.cos_theta + i.sin_theta * o.sin_theta;
    (0.5 + 0.5 * cos_2d).max(0.25 * i.cos_theta * i.cos_theta).max(1e-34)
}

/// What lobe p of a fibre has, times its tint.
fn tinted(fibre: &Fibre, p: usize, rgb: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| fibre.tint[p][c] * rgb[c])
}

/// The cross section at one θ_d: what A_p and Φ_p depend on.
#[derive(Clone, Copy, Debug)]
struct CrossSection {
    eta: f64,
    cos_d: f64,
    /// 1/η′.
    q: f64,
    /// σ_a′.
    absorption: [f64; 3],
}

impl CrossSection {
    fn new(fibre: &Fibre, eta: f64, cos2_d: f64) -> Self {
        // √(η²−sin²θ_d)
        let slant = (eta * eta - 1.0 + cos2_d).max(1e-30).sqrt();
        let cos_d = cos2_d.sqrt();
        let absorption = fibre.sigma_a.map(|sigma_a| sigma_a * eta / slant);
        Self { eta, cos_d, q: (cos_d / slant).min(1.0), absorption }
    }

    /// A_p at h: as `scattering::azimuthal::attenuation`, but for three channels with one Fresnel term.
    fn attenuation(&self, p: usize, h: f64) -> [f64; 3] {
        let f = fresnel(self.cos_d * (1.0 - h * h).max(0.0).sqrt(), self.eta);
        if p == 0 {
            return [f; 3];
        }
        let surface = (1.0 - f) * (1.0 - f) * if p == 1 { 1.0 } else { f };
        let chord = 2.0 * p as f64 * (1.0 - (self.q * h).powi(2)).max(0.0).sqrt();
        self.absorption.map(|a| surface * (-a * chord).exp())
    }

    /// g^c(φ−Φ_2(h); κ), from the distance of e^{iφ} to e^{iΦ_2} = e^{4iγ_t}/e^{2iγ} instead of angles,
    /// which takes no inverse sines.
    fn trt_blur(&self, phi: f64, h: f64, kappa: f64) -> f64 {
        let square = |[x, y]: [f64; 2]| [x * x - y * y, 2.0 * x * y];
        let cosine = |sine: f64| (1.0 - sine * sine).max(0.0).sqrt();
        let [x, y] = square([cosine(h), h]);
        let h_t = self.q * h;
        let [x_t, y_t] = square(square([cosine(h_t), h_t]));
        let (sin_phi, cos_phi) = phi.sin_cos();
        let apart_x = x_t * x + y_t * y - cos_phi;
        let apart_y = y_t * x - x_t * y - sin_phi;
        (-0.5 * kappa * (apart_x * apart_x + apart_y * apart_y)).exp()
    }

    /// Φ_p at h.
    fn azimuth(&self, p: usize, h: f64) -> f64 {
        exit_azimuth(p as u32, h.clamp(-1.0, 1.0).asin(), self.q)
    }
}

/// N_R, whose root is h = −sin(φ/2). Here as below `drawn` is the density of |h| where φ is drawn by h.
fn r(cross: &CrossSection, sin_half: f64, cos_half: f64, drawn: impl Fn(f64) -> f64) -> Azimuth {
    let even = 0.25 * cos_half;
    let f = fresnel(cross.cos_d * cos_half, cross.eta);
    Azimuth { value: [f * even; 3], density: even * drawn(sin_half.abs()) }
}

/// N_TT from sin and cos of |φ|/2, that is cos y and sin y.
fn tt(cross: &CrossSection, cos_y: f64, sin_y: f64, drawn: impl Fn(f64) -> f64) -> Azimuth {
    let q = cross.q.min(1.0 - TT_WIDTH_MIN);
    // 1−cos y without the cancellation.
    let versine = sin_y * sin_y / (1.0 + cos_y);
    let inside = 1.0 - q - versine;
    if inside <= 0.0 {
        return Azimuth::default();
    }
    let d = (1.0 - q).powi(2) + 2.0 * q * versine;
    let even = 0.25 * inside * (1.0 - q * cos_y) / (d * d.sqrt());
    let h = sin_y / d.sqrt();
    let value = cross.attenuation(1, h).map(|a| a * even);
    Azimuth { value, density: even * drawn(h) }
}

/// N_TRT without blur: Eq 9 over all roots of φ(2, h) = φ.
fn caustic(cross: &CrossSection, phi: f64, drawn: impl Fn(f64) -> f64) -> Azimuth {
    let q = cross.q;
    let phi = wrap(phi).abs();
    let over = |gamma: f64| 4.0 * (q * gamma.sin()).asin() - 2.0 * gamma - phi;
    let slope = |gamma: f64| {
        let (sin, cos) = gamma.sin_cos();
        4.0 * q * cos / (1.0 - (q * sin).powi(2)).max(1e-30).sqrt() - 2.0
    };
    // φ(2, h) turns at ±h*, h*² = (4−η′²)/3.
    let turn = ((4.0 - (q * q).recip()) / 3.0).clamp(0.0, 1.0).sqrt().asin();
    let ends = [-FRAC_PI_2, -turn, turn, FRAC_PI_2];
    let mut sum = Azimuth::default();
    for piece in ends.windows(2) {
        if let Some(gamma) = root(piece[0], piece[1], over, slope) {
            let even = 0.5 * gamma.cos() / slope(gamma).abs().max(CAUSTIC_SLOPE_MIN);
            let h = gamma.sin();
            let a = cross.attenuation(2, h);
            sum.density += even * drawn(h.abs());
            sum.value = [0, 1, 2].map(|c| sum.value[c] + a[c] * even);
        }
    }
    sum
}

/// The zero of a monotone f between `low` and `high`, where there is one: Newton's method kept between
/// them by bisection.
fn root(
    mut low: f64,
    mut high: f64,
    f: impl Fn(f64) -> f64,
    slope: impl Fn(f64) -> f64,
) -> Option<f64> {
    let rising = f(high) >= 0.0;
    if (f(low) >= 0.0) == rising {
        return None;
    }
    let mut x = 0.5 * (low + high);
    for _ in 0..80 {
        let y = f(x);
        if (y >= 0.0) == rising {
            high = x;
        } else {
            low = x;
        }
        let newton = x - y / slope(x);
        let next = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= f64::EPSILON {
            break;
        }
        x = next;
    }
    Some(x)
}

/// N_TRT/D(0): ½∫A(h) g^c(φ−Φ(h); κ) dh over γ, to 1e-10 of its peak.
fn blurred_trt(rule: &GaussLegendre, cross: &CrossSection, phi: f64, kappa: f64) -> [f64; 3] {
    let phi = wrap(phi);
    // Where g^c falls to e^{−40}, and the standard deviation that Φ(γ), of slope 2 at most, gives it in γ.
    let reach = 2.0 * (20.0 / kappa).min(1.0).sqrt().asin();
    let width = 0.5 * kappa.sqrt().recip();
    // A and Φ are singular at sinγ = η′, beside π/2.
    let beside = cross.q.recip().acosh();
    let judge = |gamma: f64, half: f64| {
        let azimuth = cross.azimuth(2, gamma.sin());
        let away = wrap(phi - azimuth).abs().min(wrap(phi + azimuth).abs());
        if away > reach + 2.0 * half {
            Panel::Skip
        } else if half > (2.0 * width).min(FRAC_PI_8).min(beside.hypot(FRAC_PI_2 - gamma)) {
            Panel::Halve
        } else {
            Panel::Take
        }
    };
    let mut sum = [0.0; 3];
    panels(0.0, FRAC_PI_2, &judge, &mut |low, high| {
        for (gamma, weight) in rule.on(low, high) {
            let (h, cos_gamma) = gamma.sin_cos();
            let azimuth = cross.azimuth(2, h);
            let blur = g_circular(phi - azimuth, kappa) + g_circular(phi + azimuth, kappa);
            let a = cross.attenuation(2, h);
            for c in 0..3 {
                sum[c] += 0.5 * weight * cos_gamma * blur * a[c];
            }
        }
    });
    sum
}

/// Z_p(θ_o) of one Gaussian lobe, by quadrature.
fn kept_share(
    rule: &GaussLegendre,
    theta_o: f64,
    alpha: f64,
    beta: f64,
    clear_energy: impl Fn(f64) -> f64,
) -> f64 {
    let (centre, sigma) = (2.0 * alpha - theta_o, 2.0 * beta);
    let judge = |theta: f64, half: f64| {
        // cosθ_d is 0 at θ_o ± π, beside the ends.
        let pole = PI - (theta - theta_o).abs();
        if (theta - centre).abs() > 8.5 * sigma + half {
            Panel::Skip
        } else if half > (2.0 * sigma).min(0.7 * pole) && half > 1e-6 {
            Panel::Halve
        } else {
            Panel::Take
        }
    };
    let mut sum = 0.0;
    panels(-FRAC_PI_2, FRAC_PI_2, &judge, &mut |low, high| {
        sum += rule.integrate(low, high, |theta_i| {
            longitudinal(theta_i, theta_o, alpha, beta)
                * projection(theta_i, theta_o)
                * clear_energy(0.5 * (theta_o - theta_i))
        });
    });
    sum / clear_energy(theta_o)
}

/// What is to be done with a part of a range of integration.
enum Panel {
    Skip,
    Halve,
    Take,
}

/// Halves [low, high] until `judge`, given a part's centre and half its width, is content, and hands the
/// parts to `take`.
fn panels(
    low: f64,
    high: f64,
    judge: &impl Fn(f64, f64) -> Panel,
    take: &mut impl FnMut(f64, f64),
) {
    let centre = 0.5 * (low + high);
    match judge(centre, 0.5 * (high - low)) {
        Panel::Skip => {}
        Panel::Take => take(low, high),
        Panel::Halve => {
            panels(low, centre, judge, take);
            panels(centre, high, judge, take);
        }
    }
}

/// θ in [−π/2, π/2] to [0, 1], spread out towards the ends, where Z_p of a narrow lobe falls off.
fn theta_to_x(theta: f64) -> f64 {
    let to_end = (1.0 - theta.abs() / FRAC_PI_2).max(0.0).sqrt();
    0.5 + 0.5 * (1.0 - to_end).copysign(theta)
}

/// The inverse of [`theta_to_x`].
fn x_to_theta(x: f64) -> f64 {
    let to_end = 1.0 - (2.0 * x - 1.0).abs();
    FRAC_PI_2 * (1.0 - to_end * to_end).copysign(2.0 * x - 1.0)
}

/// Linear interpolation of rows that span x in [0, 1], ends included.
fn interpolate(rows: &[[f64; 3]], x: f64) -> [f64; 3] {
    let (low, f) = place(x, rows.len());
    [0, 1, 2].map(|p| rows[low][p] + f * (rows[low + 1][p] - rows[low][p]))
}

/// Cells of a row of [`Densities`].
const CELLS: usize = 32;

/// The least value at an end of a row of [`Densities`], as a share of its neighbour's.
const END_LEAST: f64 = 0.1;

/// Functions over x in [0, 1] to draw x by, in rows over y in [0, 1]: straight between even nodes and between
/// rows, so that densities are exact and continuous.
#[derive(Clone, Debug)]
struct Densities {
    rows: Vec<[Node; CELLS + 1]>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Node {
    value: f64,
    /// The integral from x = 0, times [`CELLS`].
    sum: f64,
}

/// The row below some y, and the part of the way to the next.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    low: usize,
    f: f64,
}

impl Row {
    /// At y in [0, 1] of `rows`.
    fn at(y: f64, rows: usize) -> Self {
        let (low, f) = place(y, rows);
        Self { low, f }
    }
}

impl Densities {
    /// `of(y)` is the function of a row.
    fn new<F: Fn(f64) -> f64>(rows: usize, of: impl Fn(f64) -> F + Sync) -> Self {
        let rule = GaussLegendre::new(8);
        let row = |row| {
            let f = of(row as f64 / (rows - 1) as f64);
            let x = |k: usize| k as f64 / CELLS as f64;
            let mut nodes: [Node; CELLS + 1] =
                std::array::from_fn(|k| Node { value: f(x(k)), sum: 0.0 });
            // The ends keep their cells' integrals, since a function may fall to 0 in the last part of a cell, and
            // some of their neighbours' values: a draw of exactly 0 has a density.
            for (end, next) in [(0, 1), (CELLS, CELLS - 1)] {
                let (low, high) = (x(end.min(next)), x(end.max(next)));
                let mean = CELLS as f64 * rule.integrate(low, high, &f);
                let next = nodes[next].value;
                nodes[end].value = (2.0 * mean - next).max(END_LEAST * next);
            }
            for k in 0..CELLS {
                nodes[k + 1].sum = nodes[k].sum + 0.5 * (nodes[k].value + nodes[k + 1].value);
            }
            nodes
        };
        Self { rows: (0..rows).into_par_iter().map(row).collect() }
    }

    fn node(&self, row: Row, k: usize) -> Node {
        let [low, high] = [row.low, row.low + 1].map(|i| self.rows[i][k]);
        Node {
            value: low.value + row.f * (high.value - low.value),
            sum: low.sum + row.f * (high.sum - low.sum),
        }
    }

    /// The integral over x.
    fn integral(&self, row: Row) -> f64 {
        self.node(row, CELLS).sum / CELLS as f64
    }

    fn value(&self, row: Row, x: f64) -> f64 {
        let (k, f) = place(x, CELLS + 1);
        let [low, high] = [k, k + 1].map(|k| self.node(row, k).value);
        low + f * (high - low)
    }

    /// [`Self::value`] over the integral; 1 where that is 0.
    fn density(&self, row: Row, x: f64) -> f64 {
        let integral = self.integral(row);
        if integral > 0.0 { self.value(row, x) / integral } else { 1.0 }
    }

    /// x for a uniform `u` in [0, 1).
    fn sample(&self, row: Row, u: f64) -> f64 {
        let target = u * self.node(row, CELLS).sum;
        if target <= 0.0 {
            return u;
        }
        // The last node whose sum is not above the target.
        let (mut k, mut step) = (0, CELLS / 2);
        while step > 0 {
            k += step * usize::from(self.node(row, k + step).sum <= target);
            step /= 2;
        }
        let [low, high] = [k, k + 1].map(|k| self.node(row, k));
        // The root of low·f + (high−low)·f²/2 = rest.
        let rest = target - low.sum;
        let root = (low.value * low.value + 2.0 * (high.value - low.value) * rest).max(0.0).sqrt();
        let f = 2.0 * rest / (low.value + root).max(f64::MIN_POSITIVE);
        (k as f64 + f.min(1.0)) / CELLS as f64
    }
}

/// A Gaussian over [−π/2, π/2], which the rest of the line is cut off from.
#[derive(Clone, Copy, Debug, Default)]
struct TruncatedGaussian {
    mean: f64,
    sigma: f64,
    /// Tails of the standard normal distribution beyond the end on the mean's side and beyond the other.
    tails: [f64; 2],
    /// The share that is not cut off.
    inside: f64,
}

impl TruncatedGaussian {
    fn new(mean: f64, sigma: f64) -> Self {
        let tails = [-FRAC_PI_2, FRAC_PI_2].map(|end| upper_tail((end + mean.abs()) / sigma));
        Self { mean, sigma, tails, inside: tails[0] - tails[1] }
    }

    /// Lobe p's.
    fn of(fibre: &Fibre, p: usize, theta_o: f64) -> Self {
        Self::new(2.0 * fibre.alpha[p] - theta_o, 2.0 * fibre.beta[p])
    }

    /// θ below which lies the share `u` in [0, 1] of what is not cut off.
    fn sample(&self, u: f64) -> f64 {
        // Mirrored to a mean below 0, so that a lobe cut off near its all is an upper tail; ±π/2 is passed by
        // rounding only.
        let below = if self.mean > 0.0 { 1.0 - u } else { u };
        let t = upper_quantile(self.tails[0] - below * self.inside);
        let theta = (self.sigma * t - self.mean.abs()).clamp(-FRAC_PI_2, FRAC_PI_2);
        if self.mean > 0.0 { -theta } else { theta }
    }

    /// The density of the whole Gaussian at θ in [−π/2, π/2], and the inverse of [`Self::sample`].
    fn density_and_share(&self, theta: f64) -> (f64, f64) {
        let mirrored = if self.mean > 0.0 { -theta } else { theta };
        let t = (mirrored + self.mean.abs()) / self.sigma;
        let density = normal(t) / self.sigma;
        let below = (self.tails[0] - upper_tail(t)) / self.inside.max(f64::MIN_POSITIVE);
        (density, if self.mean > 0.0 { 1.0 - below } else { below })
    }
}

/// [`upper_tail`] at 9: less is 0.
const TAIL_MIN: f64 = 1.1e-19;

/// ∫_t^∞ of the standard normal density.
fn upper_tail(t: f64) -> f64 {
    // TAIL_MIN and 1−TAIL_MIN beyond.
    let tail = if t.abs() < 9.0 { normal(t) * mills(t.abs()) } else { 0.0 };
    if t < 0.0 { 1.0 - tail } else { tail }
}

/// The inverse of [`upper_tail`], by its Taylor series to the sixth order about Winitzki's closed form.
fn upper_quantile(tail: f64) -> f64 {
    const A: f64 = 0.147;
    let small = tail.min(1.0 - tail).max(TAIL_MIN);
    let log = (4.0 * small * (1.0 - small)).ln();
    let b = 2.0 / (PI * A) + 0.5 * log;
    let t = (2.0 * ((b * b - log / A).sqrt() - b)).max(0.0).sqrt();
    let (newton, t2) = (mills(t) - small / normal(t), t * t);
    let orders = [
        1.0,
        t / 2.0,
        (1.0 + 2.0 * t2) / 6.0,
        t * (7.0 + 6.0 * t2) / 24.0,
        (7.0 + t2 * (46.0 + 24.0 * t2)) / 120.0,
        t * (127.0 + t2 * (326.0 + 120.0 * t2)) / 720.0,
    ];
    let t = t + newton * orders.iter().rev().fold(0.0, |sum, c| sum * newton + c);
    if tail > 0.5 { -t } else { t }
}

fn normal(t: f64) -> f64 {
    (-0.5 * t * t).exp() / TAU.sqrt()
}

/// Mills' ratio, [`upper_tail`] over the density, for t ≥ 0: relative error below 1.1e-9, a Chebyshev fit of
/// ours in (t−5.5)/(t+5.5).
fn mills(t: f64) -> f64 {
    const COEFFICIENTS: [[f64; 2]; 7] = [
        [1.216_628_600_795_839_2, -0.354_416_760_874_564_2],
        [0.201_980_495_037_284_4, -0.076_723_778_649_123_92],
        [-0.000_361_837_093_861_941_2, 0.031_063_572_135_134_21],
        [-0.031_576_655_073_408_545, 0.020_246_693_815_111_188],
        [-0.009_193_593_646_842_345, 0.002_700_164_756_899_241],
        [-0.000_218_632_163_848_053_3, -0.000_189_788_127_532_382_4],
        [6.151_915_294_398_66e-5, 0.0],
    ];
    let y = (t - 5.5) / (t + 5.5);
    // Even and odd powers apart: half the latency of Horner's scheme.
    let y2 = y * y;
    let [even, odd] =
        COEFFICIENTS.iter().rev().fold([0.0; 2], |sum, c| [sum[0] * y2 + c[0], sum[1] * y2 + c[1]]);
    (even + odd * y) / (t + 1.4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scattering::gaussian::erf;

    #[test]
    fn tails_are_those_of_the_normal_distribution_and_their_quantile_inverts_them() {
        let (mut against_erf, mut back, mut control) = (0f64, 0f64, f64::MAX);
        for k in 0..800 {
            let t = -4.0 + 0.01 * f64::from(k) + 1e-3;
            let exact = 0.5 * (1.0 - erf(t / std::f64::consts::SQRT_2));
            against_erf = against_erf.max((upper_tail(t) / exact - 1.0).abs());
            control = control.min((upper_tail(t + 1e-4) / exact - 1.0).abs());
            back = back.max((upper_quantile(upper_tail(t)) - t).abs());
        }
        // Far out, where 1−erf has no digits left: the asymptotic series, off by 9!!/t^{10}.
        let t = 8.0f64;
        let (z, series) = (1.0 / (t * t), normal(t) / t);
        let series = series * (1.0 - z * (1.0 - 3.0 * z * (1.0 - 5.0 * z * (1.0 - 7.0 * z))));
        let far = (upper_tail(t) / series - 1.0).abs();
        back = back.max((upper_quantile(upper_tail(t)) - t).abs());
        println!(
            "tail {against_erf:.1e}, far {far:.1e}, quantile {back:.1e}; control {control:.1e}"
        );
        assert!(against_erf < 1e-8 && far < 2e-6 && back < 1e-8);
        assert!(control > 1e-8);
    }

    #[test]
    fn draws_follow_their_densities() {
        // Falls to 0 at an end, in a row to nothing at all.
        let densities = Densities::new(3, |y| move |x: f64| (1.0 - y) * (0.3 + x * x) * (1.0 - x));
        let rule = GaussLegendre::new(2);
        let (mut worst, mut control) = (0f64, f64::MAX);
        for y in [0.0, 0.4, 0.9] {
            let row = Row::at(y, 3);
            // The share below x, exact for what is straight between nodes.
            let below = |x: f64| -> f64 {
                let ends: Vec<f64> =
                    (0..=CELLS).map(|k| (k as f64 / CELLS as f64).min(x)).collect();
                let piece = |w: &[f64]| rule.integrate(w[0], w[1], |x| densities.density(row, x));
                ends.windows(2).map(piece).sum()
            };
            assert!((below(1.0) - 1.0).abs() < 1e-12);
            for k in 0..200 {
                let u = f64::from(k) / 200.0;
                worst = worst.max((below(densities.sample(row, u)) - u).abs());
            }
            let wrong = densities.sample(row, 0.5 * 1.01);
            control = control.min((below(wrong) - 0.5).abs());
        }
        println!("share below a draw: {worst:.1e}; 1 % off {control:.1e}");
        assert!(worst < 1e-12 && control > 1e-12);
        let nothing = Row::at(1.0, 3);
        assert_eq!([densities.density(nothing, 0.3), densities.sample(nothing, 0.3)], [1.0, 0.3]);
    }

    #[test]
    fn theta_and_x_are_inverse() {
        for k in 0..=100 {
            let x = f64::from(k) / 100.0;
            assert!((theta_to_x(x_to_theta(x)) - x).abs() < 1e-8);
        }
        assert_eq!([x_to_theta(0.0), x_to_theta(1.0)], [-FRAC_PI_2, FRAC_PI_2]);
    }
}

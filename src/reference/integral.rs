//! ∫G_j S_p cosθ_i dω of any fibre model (Xu 2011, Eq 6, before any approximation), and its albedo.
//!
//! G_j(ω) = exp(−|ω−ω_j|²/λ_j²) = exp(−4 sin²((θ_i−θ_j)/2)/λ_j²) · exp(κ(cos(φ_i−φ_j) − 1)) with
//! κ = 2 cosθ_i cosθ_j/λ_j²: both factors keep their digits for narrow lights. So
//!
//! > ∫G_j S_p cosθ_i dω = ∫ g(θ_i) M_p cosθ_i · ½∫ A_p(h) [∫g^c(φ) D_p(φ − Φ_p(h)) dφ] dh dθ_i
//!
//! whose innermost integral is [`Detector::times_light`]: no roots of Eq 8 and no caustic, N_p is never
//! formed. Both others are adaptive (`adaptive.rs`), over θ_i and over γ = asin h, and begin from breaks at
//! what the integrand does there: the peak of g·M_p and its flanks; the γ whose paths leave towards the
//! light, and those at which Φ_p turns (the caustic).
//!
//! A path that depends on φ_h (TRT of an eccentric fibre) does not let h and φ be swapped: there the
//! middle integral is over φ_i and takes N_p from the model, at fifty times the cost. Of those a bare
//! caustic (w_c = 0) is left undone: its integrand has poles at unknown φ_i, and the result is NaN.
//!
//! Where N_p is the same at every θ_i and smooth (d'Eon's with A_p at θ_o), its cosine series takes the place of both
//! inner integrals: a hundred times as fast.
//!
//! The error is 1e-8 of the value; or 1e-12 of what the lobe would give of the light at its brightest; or
//! 1e-18 of what a lobe that loses nothing would. On one core a lobe takes 5 to 30 ms, and 0.1 to 0.25 s where
//! the detector's light is itself a quadrature (d'Eon, Chiang).

use std::cell::Cell;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{
    adaptive::{Integral, Tolerance, integrate},
    model::{Detector, Direction, FibreModel, Section},
};
use crate::scattering::{
    azimuthal::wrap,
    gaussian::{bessel_steps, concentration, g_circular, i0e},
};

/// The relative error promised; [`Integral::excess`] is a multiple of it.
pub const RELATIVE: f64 = 1e-8;

/// The rule's estimates are brought this far below the promise, inner integrals further.
const OUTER: f64 = 0.1;
const INNER: f64 = 0.01;

/// Share of a lobe's brightest value that counts as nothing, and the attenuation below which it is not less:
/// at η = 1 Fresnel's reflectance is rounding.
const FLOOR: f64 = 1e-12;
const FAINT: f64 = 1e-6;

/// Share of the peak of g·M_p below which θ_i is left out.
const TAIL: f64 = 1e-17;

/// Steps of the grids on which the integrands' features are sought: θ over half a turn, which finds a
/// lobe of β ≥ 0.02° or a light of λ_j ≥ 0.0005 (they are above 0 in f64 within 27 bandwidths), and γ.
const THETA_STEPS: usize = 256;
const GAMMA_STEPS: usize = 32;

/// Up to this concentration a cosine series is summed against the light's.
const SERIES_KAPPA: f64 = 1e4;

/// G_j of peak 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    pub theta: f64,
    pub phi: f64,
    /// Bandwidth λ_j, 0.003 and more; ∞ is even light of radiance 1.
    pub lambda: f64,
}

impl Light {
    const EVEN: Self = Self { theta: 0.0, phi: 0.0, lambda: f64::INFINITY };
}

/// ∫G_j S_p cosθ_i dω, RGB.
pub fn srbf_integral(
    model: &dyn FibreModel,
    p: usize,
    o: &Direction,
    light: &Light,
) -> Integral<3> {
    let sharpness = concentration(light.lambda);
    let weight = |theta_i: f64| {
        g_circular(theta_i - light.theta, sharpness)
            * model.longitudinal(p, theta_i, o.theta())
            * theta_i.cos().max(0.0)
    };
    let breaks = inclination_breaks(weight);
    let Some(&peak) = breaks.get(PEAK) else {
        return Integral { value: [0.0; 3], error: [0.0; 3], excess: 0.0 };
    };
    let kappa = |theta_i: f64| sharpness * (theta_i.cos() * light.theta.cos()).max(0.0);
    let tolerance = |absolute| Tolerance { relative: OUTER * RELATIVE, absolute };
    let [mass] =
        integrate(&breaks, tolerance(f64::MIN_POSITIVE), |theta_i| [weight(theta_i)]).value;
    let section = Section { theta_i: peak, theta_o: o.theta(), phi_h: 0.5 * (light.phi + o.phi) };
    let tolerance = tolerance(mass * floor(model, p, &section, kappa(peak)));
    let series = model.series(p, o.theta());
    let worst = Cell::new(0.0f64);
    let mut integral = integrate(&breaks, tolerance, |theta_i| {
        let weight = weight(theta_i);
        if weight == 0.0 {
            return [0.0; 3];
        }
        let kappa = kappa(theta_i);
        let (inner, excess) = match &series {
            Some(series) if kappa <= SERIES_KAPPA => {
                (series_integral(series, light.phi - o.phi, kappa), 0.0)
            }
            _ => azimuthal_integral(model, p, theta_i, o, light.phi, kappa),
        };
        worst.set(worst.get().max(excess));
        inner.map(|x| weight * x)
    });
    for k in 0..3 {
        integral.error[k] += INNER * RELATIVE * worst.get() * integral.value[k];
    }
    integral.excess = OUTER * integral.excess + INNER * worst.get();
    integral
}

/// Share of even light that lobe p sends to ω_o, RGB.
pub fn lobe_albedo(model: &dyn FibreModel, p: usize, o: &Direction) -> Integral<3> {
    srbf_integral(model, p, o, &Light::EVEN)
}

/// The same of all lobes: 1 for a clear fibre that neither makes nor loses light.
pub fn albedo(model: &dyn FibreModel, o: &Direction) -> Integral<3> {
    let mut sum = Integral { value: [0.0; 3], error: [0.0; 3], excess: 0.0 };
    for lobe in (0..model.lobes()).map(|p| lobe_albedo(model, p, o)) {
        for k in 0..3 {
            sum.value[k] += lobe.value[k];
            sum.error[k] += lobe.error[k];
        }
        sum.excess = sum.excess.max(lobe.excess);
    }
    sum
}

/// Density of the model's sampling at ω_i for an h that is drawn too: the mean of its pdf over h, 1/sr, to 1e-8
/// or 1e-12.
pub fn far_field_pdf(model: &dyn FibreModel, o: &Direction, i: &Direction) -> Integral<1> {
    let section = Section { theta_i: i.theta(), theta_o: o.theta(), phi_h: 0.5 * (i.phi + o.phi) };
    let phi = i.phi - o.phi;
    let mut breaks: Vec<f64> = (0..model.lobes())
        .flat_map(|p| {
            let targets = targets(phi, blur(&model.detector(p)));
            offset_breaks(|gamma| model.path(p, gamma.sin(), &section).azimuth, &targets)
        })
        .collect();
    breaks.sort_by(f64::total_cmp);
    let tolerance = Tolerance { relative: RELATIVE, absolute: FLOOR };
    integrate(&breaks, tolerance, |gamma: f64| {
        [0.5 * gamma.cos() * model.evaluate(o, i, gamma.sin()).pdf]
    })
}

/// ∫g^c(φ_i−φ_j; κ) N_p(φ_i−φ_o) dφ_i at one θ_i, RGB, and its excess over the tolerance.
pub fn azimuthal_integral(
    model: &dyn FibreModel,
    p: usize,
    theta_i: f64,
    o: &Direction,
    phi_j: f64,
    kappa: f64,
) -> ([f64; 3], f64) {
    let section = |phi_h| Section { theta_i, theta_o: o.theta(), phi_h };
    if depends_on_phi_h(model, p, section) {
        if model.detector(p) == Detector::Delta {
            return ([f64::NAN; 3], f64::INFINITY);
        }
        let reach = (9.0 / kappa.sqrt()).min(PI);
        let breaks = [-1.0, -0.25, 0.0, 0.25, 1.0].map(|x| x * reach);
        let floor = floor(model, p, &section(0.0), kappa);
        let tolerance = Tolerance { relative: INNER * RELATIVE, absolute: floor };
        let integral = integrate(&breaks, tolerance, |x| {
            let phi_i = phi_j + x;
            let phi = wrap(phi_i - o.phi);
            let n = model.azimuthal(p, phi, &section(0.5 * (phi_i + o.phi)));
            n.map(|n| n * g_circular(x, kappa))
        });
        return (integral.value, integral.excess);
    }

    let (phi, section) = (phi_j - o.phi, section(0.5 * (phi_j + o.phi)));
    let detector = model.detector(p);
    let width = kappa.recip().sqrt().hypot(blur(&detector));
    let targets = targets(phi, width);
    let breaks = offset_breaks(|gamma| model.path(p, gamma.sin(), &section).azimuth, &targets);
    let tolerance =
        Tolerance { relative: INNER * RELATIVE, absolute: floor(model, p, &section, kappa) };
    let integral = integrate(&breaks, tolerance, |gamma: f64| {
        let path = model.path(p, gamma.sin(), &section);
        let light =
            if kappa > 0.0 { detector.times_light(wrap(phi - path.azimuth), kappa) } else { 1.0 };
        path.attenuation.map(|a| 0.5 * gamma.cos() * a * light)
    });
    (integral.value, integral.excess)
}

/// The same from N_p's cosine series: Σ_k a_k 2π I_k(κ) e^{−κ} cos kφ, κ ≤ [`SERIES_KAPPA`].
fn series_integral(series: &[[f64; 3]], phi: f64, kappa: f64) -> [f64; 3] {
    let begin = series.len() + 8 + (6.0 * kappa.sqrt()) as usize;
    let ratios = bessel_steps(kappa, series.len(), begin);
    let mut bessel = TAU * i0e(kappa);
    let mut sum = [0.0; 3];
    for (k, (a, ratio)) in series.iter().zip(&ratios).enumerate() {
        bessel *= ratio;
        let light = bessel * (k as f64 * phi).cos();
        sum = std::array::from_fn(|c| sum[c] + a[c] * light);
    }
    sum
}

/// Whether lobe p's path does, on a section of any φ_h: at 0 and π/2 the two axes of the ellipse lie.
pub(super) fn depends_on_phi_h(
    model: &dyn FibreModel,
    p: usize,
    section: impl Fn(f64) -> Section,
) -> bool {
    let path = |phi_h| model.path(p, 0.5, &section(phi_h));
    path(0.0) != path(FRAC_PI_2)
}

/// The Φ_p between which the integrand over γ is smooth, of a peak about φ of standard deviation `width`.
fn targets(phi: f64, width: f64) -> Vec<f64> {
    let steps: &[f64] = match width {
        w if w < 0.3 => &[-6.0, -2.0, 0.0, 2.0, 6.0],
        w if w < 1.0 => &[0.0],
        _ => &[],
    };
    steps.iter().map(|x| phi + x * width).collect()
}

/// What counts as nothing beside ½∫A_p(h) D_p × light dh: of light that falls where h = 0 leaves.
fn floor(model: &dyn FibreModel, p: usize, section: &Section, kappa: f64) -> f64 {
    let brightest = model.path(p, 0.0, section).attenuation.into_iter().fold(FAINT, f64::max);
    (FLOOR * brightest * model.detector(p).times_light(0.0, kappa)).max(f64::MIN_POSITIVE)
}

/// Standard deviation of a detector, radians.
pub(super) fn blur(detector: &Detector) -> f64 {
    match *detector {
        Detector::Delta => 0.0,
        Detector::Circular { kappa } => kappa.recip().sqrt(),
        Detector::Wrapped { sigma } => sigma,
        Detector::Logistic { scale } => scale * PI / 3f64.sqrt(),
        Detector::Uniform => f64::INFINITY,
    }
}

/// Where the peak stands among [`inclination_breaks`].
const PEAK: usize = 2;

/// Breaks over θ for an integrand that has one peak: where it is 1e-17 of that peak, or ±π/2, where it is
/// e⁻⁴ of it, and the peak. None where it is 0.
pub(super) fn inclination_breaks(weight: impl Fn(f64) -> f64) -> Vec<f64> {
    let at = |i: usize| PI * (i as f64 / THETA_STEPS as f64 - 0.5);
    let values: Vec<f64> = (0..=THETA_STEPS).map(|i| weight(at(i))).collect();
    let top = (0..=THETA_STEPS).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    if values[top] <= 0.0 {
        return Vec::new();
    }
    let peak = highest(&weight, at(top.saturating_sub(1)), at((top + 1).min(THETA_STEPS)));
    let height = weight(peak);
    // The point between the peak and ±π/2 at which the weight falls through a share of its height.
    let flank = |share: f64, end: f64| {
        let above = |theta: f64| weight(theta) > share * height;
        if above(end) { end } else { bisect(above, peak, end) }
    };
    vec![
        flank(TAIL, -FRAC_PI_2),
        flank((-4f64).exp(), -FRAC_PI_2),
        peak,
        flank((-4f64).exp(), FRAC_PI_2),
        flank(TAIL, FRAC_PI_2),
    ]
}

/// Breaks over γ in [−π/2, π/2]: its ends, where the exit azimuth Φ(γ) turns, and where it meets one of
/// `targets`, turns of the circle included.
pub(super) fn offset_breaks(azimuth: impl Fn(f64) -> f64, targets: &[f64]) -> Vec<f64> {
    let at = |i: usize| PI * (i as f64 / GAMMA_STEPS as f64 - 0.5);
    let grid: Vec<(f64, f64)> = (0..=GAMMA_STEPS).map(|i| (at(i), azimuth(at(i)))).collect();
    // Between these Φ is monotone.
    let mut knots = vec![grid[0]];
    let mut breaks = vec![-FRAC_PI_2, FRAC_PI_2];
    for three in grid.windows(3) {
        let (rise, fall) = (three[1].1 - three[0].1, three[1].1 - three[2].1);
        if rise * fall > 0.0 {
            let turn = highest(|gamma| rise.signum() * azimuth(gamma), three[0].0, three[2].0);
            breaks.push(turn);
            knots.push((turn, azimuth(turn)));
        } else {
            knots.push(three[1]);
        }
    }
    knots.push(grid[GAMMA_STEPS]);
    for pair in knots.windows(2) {
        let [(from, a), (to, b)] = [pair[0], pair[1]];
        for target in targets {
            let first = ((a.min(b) - target) / TAU).ceil() as i32;
            let last = ((a.max(b) - target) / TAU).floor() as i32;
            for turn in first..=last {
                let goal = target + TAU * f64::from(turn);
                breaks.push(bisect(|gamma| (azimuth(gamma) < goal) == (a < goal), from, to));
            }
        }
    }
    breaks.sort_by(f64::total_cmp);
    breaks
}

/// Where `inside`, true at `from` and false at `to`, turns: within 1e-6 of their distance.
fn bisect(inside: impl Fn(f64) -> bool, mut from: f64, mut to: f64) -> f64 {
    for _ in 0..20 {
        let middle = 0.5 * (from + to);
        *(if inside(middle) { &mut from } else { &mut to }) = middle;
    }
    0.5 * (from + to)
}

/// Where f, which has one peak in [low, high], is highest (golden section), within 1e-8 of high − low.
fn highest(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    for _ in 0..38 {
        if at_a > at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - golden * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + golden * (high - low);
            at_b = f(b);
        }
    }
    0.5 * (low + high)
}

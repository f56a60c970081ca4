//! Lobes as directions, and wide lobes as narrower ones.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::dense::non_negative_least_squares;
use super::{SrbfLight, lobe_integral, sharpness};

/// `count` directions that follow the lobe's own density, by its inverse distribution and a golden spiral.
pub fn sample_lobe(light: &SrbfLight, count: usize) -> Vec<DVec3> {
    if count == 1 {
        return vec![light.direction];
    }
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|k| {
            let around = golden * k as f64 / TAU;
            direction_in_lobe(light, [(k as f64 + 0.5) / count as f64, around.fract()])
        })
        .collect()
}

/// The unit direction within a lobe at which its distribution is u₀ ∈ [0, 1), at azimuth 2πu₁ about its centre.
pub fn direction_in_lobe(light: &SrbfLight, u: [f64; 2]) -> DVec3 {
    let half_lambda2 = 0.5 * light.lambda * light.lambda;
    // 1 − cos γ, without cancelling for small λ.
    let drop = (-half_lambda2 * (u[0] * (-2.0 / half_lambda2).exp_m1()).ln_1p()).clamp(0.0, 2.0);
    let (x, y) = light.direction.any_orthonormal_pair();
    let (sin, cos) = (TAU * u[1]).sin_cos();
    let across = (drop * (2.0 - drop)).sqrt();
    (light.direction * (1.0 - drop) + across * (x * cos + y * sin)).normalize()
}

/// Lights wider than this are split.
const WIDEST: f64 = 0.8;
/// Bandwidth of the parts, and their number over the whole sphere.
const PART: f64 = 0.6;
const PARTS: usize = 28;
/// Parts fainter than this share of the brightest are dropped.
const FAINT: f64 = 0.01;
/// Sweeps of coordinate descent; the weights have settled to 1e-6 long before.
const SWEEPS: usize = 200;

/// The same light with no lobe wider than λ = 0.8: all wider ones together become at most 28 lobes of
/// λ = 0.6 on a Fibonacci lattice, their weights by non-negative least squares over the sphere, their energy
/// the same. They differ by 1.3 % (relative L2) for a uniform light, 1.7 % at λ = 1 and 2.5 % at 0.9.
///
/// A method and a transport that see a lobe by its centre and one mean are wrong for lobes as wide as the
/// sky: under a uniform map, white hair sent 0.63 to the front with one light and 0.40 with 40 that fit alike;
/// split, their number makes no difference, and 40 parts of λ = 0.5 change the mean by 1 %.
pub fn split_wide(lights: &[SrbfLight]) -> Vec<SrbfLight> {
    let (wide, mut rest): (Vec<SrbfLight>, Vec<SrbfLight>) =
        lights.iter().partition(|light| light.lambda > WIDEST);
    if wide.is_empty() {
        return rest;
    }
    let golden = PI * (3.0 - 5f64.sqrt());
    let lattice: Vec<DVec3> = (0..PARTS)
        .map(|i| {
            let y = 1.0 - (2 * i + 1) as f64 / PARTS as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - y * y).sqrt();
            DVec3::new(r * cos, y, r * sin)
        })
        .collect();
    let part = |direction| SrbfLight { direction, lambda: PART, rgb: [0.0; 3] };
    let mut parts: Vec<SrbfLight> = lattice.into_iter().map(part).collect();
    let gram: Vec<f64> =
        parts.iter().flat_map(|a| parts.iter().map(|b| product_integral(a, b))).collect();
    for channel in 0..3 {
        let against = |part: &SrbfLight| -> f64 {
            wide.iter().map(|light| light.rgb[channel] * product_integral(part, light)).sum()
        };
        let target: Vec<f64> = parts.iter().map(against).collect();
        let mut weights = vec![0.0; PARTS];
        non_negative_least_squares(&gram, &target, &mut weights, SWEEPS);
        // Far from the lobes the weights are ripple: a light each for nothing.
        let most = weights.iter().copied().fold(0.0, f64::max);
        weights.iter_mut().filter(|w| **w < FAINT * most).for_each(|w| *w = 0.0);
        let wanted: f64 = wide.iter().map(|light| light.energy()[channel]).sum();
        let found = weights.iter().sum::<f64>() * lobe_integral(PART);
        let scale = if found > 0.0 { wanted / found } else { 0.0 };
        parts.iter_mut().zip(weights).for_each(|(part, w)| part.rgb[channel] = w * scale);
    }
    rest.extend(parts.into_iter().filter(|part| part.rgb != [0.0; 3]));
    rest
}

/// ∫ of the product of two lobes over the sphere, colours aside: 2π (e^(r−κ₁−κ₂) − e^(−r−κ₁−κ₂))/r with
/// r = |κ₁ω₁ + κ₂ω₂|.
fn product_integral(a: &SrbfLight, b: &SrbfLight) -> f64 {
    let (kappa_a, kappa_b) = (sharpness(a.lambda), sharpness(b.lambda));
    let r = (kappa_a * a.direction + kappa_b * b.direction).length().max(1e-9);
    2.0 * PI * (r - kappa_a - kappa_b).exp() * -(-2.0 * r).exp_m1() / r
}

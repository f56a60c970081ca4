//! A lobe seen through a blur, in closed form.
//!
//! The von Mises–Fisher density D_κ(t) = C(κ) e^(κt), C(κ) = κ/(4π sinh κ), is the SRBF of κ = 2/λ²
//! scaled to unit integral. Two of them have
//!   ∫ D_κ(ω·a) D_κ'(ω·b) dω = C(κ) C(κ')/C(r),  r² = κ² + κ'² + 2 κ κ' a·b,
//! which is at once the blur of one lobe by another and the inner product of two. It is exact,
//! unlike the sum of variances λ² + λ'², and as cheap.

use std::f64::consts::PI;

/// The unit-integral lobe of sharpness κ, blurred by that of sharpness κ_b.
pub(super) struct BlurredLobe {
    kappa: f64,
    kappa_blur: f64,
    scale: f64,
    mean_cosine: f64,
}

impl BlurredLobe {
    /// κ, κ_b > 0.
    pub(super) fn new(kappa: f64, kappa_blur: f64) -> Self {
        // C(κ) e^κ = κ / (2π (1 − e^(−2κ))).
        let normaliser = |kappa: f64| -kappa / (2.0 * PI * (-2.0 * kappa).exp_m1());
        Self {
            kappa,
            kappa_blur,
            scale: 2.0 * PI * normaliser(kappa) * normaliser(kappa_blur),
            mean_cosine: mean_cosine(kappa),
        }
    }

    /// r, and the lobe at an angle of cosine 1 − `versine`.
    fn radius_and_value(&self, versine: f64) -> (f64, f64) {
        let sum = self.kappa + self.kappa_blur;
        let twice_product = 2.0 * self.kappa * self.kappa_blur;
        let radius = (sum * sum - twice_product * versine).max(0.0).sqrt();
        // r − κ − κ_b without cancellation.
        let exponent = -twice_product * versine / (radius + sum);
        // (1 − e^(−2r))/r, whose limit at 0 is 2.
        let ratio = if radius > 18.0 {
            1.0 / radius
        } else if radius > 1e-9 {
            -(-2.0 * radius).exp_m1() / radius
        } else {
            2.0
        };
        (radius, self.scale * ratio * exponent.exp())
    }

    /// The blurred lobe at an angle of cosine 1 − `versine`.
    pub(super) fn value(&self, versine: f64) -> f64 {
        self.radius_and_value(versine).1
    }

    /// The value, its derivative by the cosine, and that by log λ (κ_b fixed).
    pub(super) fn value_and_derivatives(&self, versine: f64) -> [f64; 3] {
        let (radius, value) = self.radius_and_value(versine);
        let cosine = 1.0 - versine;
        // d ln(sinh r / r)/dr · 1/r, whose limit at 0 is 1/3.
        let slope = if radius > 1e-6 { mean_cosine(radius) / radius } else { 1.0 / 3.0 };
        let by_cosine = value * slope * self.kappa * self.kappa_blur;
        let by_kappa = value * (slope * (self.kappa + self.kappa_blur * cosine) - self.mean_cosine);
        [value, by_cosine, -2.0 * self.kappa * by_kappa]
    }
}

/// A_1(κ) = coth κ − 1/κ, the mean cosine of a von Mises–Fisher density.
fn mean_cosine(kappa: f64) -> f64 {
    if kappa < 1e-2 {
        kappa / 3.0 - kappa * kappa * kappa / 45.0
    } else if kappa > 18.0 {
        1.0 - 1.0 / kappa
    } else {
        1.0 / kappa.tanh() - 1.0 / kappa
    }
}

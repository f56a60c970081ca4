//! Reflection at the fibre's surface: exact for a dielectric, and Schlick's approximation, which
//! Xu 2011 §4.2.1 uses for the R mode (at η = 1.55 it is +5.8 % at cos 0.12 and −23 % at cos 0.55).

/// Exact unpolarised reflectance of a smooth dielectric. `cos_i` in [0, 1] is the cosine of the angle
/// of incidence from outside, `eta` ≥ 1 the relative index. From inside the value is the same.
pub fn fresnel(cos_i: f64, eta: f64) -> f64 {
    let cos_i = cos_i.clamp(0.0, 1.0);
    let cos_t = (1.0 - (1.0 - cos_i * cos_i) / (eta * eta)).max(0.0).sqrt();
    let parallel = ratio(eta * cos_i - cos_t, eta * cos_i + cos_t);
    let perpendicular = ratio(cos_i - eta * cos_t, cos_i + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// a/b, or 0 where both vanish (η = 1 at grazing, where nothing is reflected).
fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

/// F₀ = ((1−η)/(1+η))², the reflectance at normal incidence.
pub fn fresnel_normal(eta: f64) -> f64 {
    ((1.0 - eta) / (1.0 + eta)).powi(2)
}

/// Schlick's F₀ + (1−F₀)(1−cos)⁵.
pub fn schlick(cos_i: f64, eta: f64) -> f64 {
    let f0 = fresnel_normal(eta);
    f0 + (1.0 - f0) * (1.0 - cos_i).powi(5)
}

//! The scattering maths in f64 (Xu 2011), without GPU or scene. One file per idea; the WGSL twin of
//! what the renderer runs is in shaders/, name for name.
//!
//! Conventions: ω = (sin θ, cos θ cos φ, cos θ sin φ) with the strand along the first axis, root to
//! tip; θ_h = (θ_i+θ_o)/2, θ_d = (θ_o−θ_i)/2, φ = φ_o−φ_i; modes in the order R, TT, TRT; h = sin γ is
//! the offset across the fibre. β is a standard deviation of θ_h, every other width a bandwidth
//! λ = √2·(standard deviation).

pub mod azimuth_table;
pub mod azimuthal;
pub mod draw;
pub mod dual;
pub mod fast;
pub mod fibre;
pub mod fresnel;
pub mod gaussian;
pub mod global;
pub mod longitudinal;
pub mod model;
pub mod nodes;
pub mod quadrature;
pub mod tables;
pub mod xu;

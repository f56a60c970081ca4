//! What the shaders read from uniform buffers. tests/wgsl.rs holds these layouts against the WGSL.

use bytemuck::{Pod, Zeroable};

use crate::scattering::{azimuthal::FitLayers, fibre::Fibre, longitudinal::longitudinal_bandwidth};

/// `Fibre` of shaders/fibre.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FibreUniform {
    pub alpha: [f32; 3],
    pub eta: f32,
    pub lambda: [f32; 3],
    pub segments: u32,
    pub eta_star: [f32; 2],
    pub eta_low: f32,
    pub eta_per_layer: f32,
    pub eta_layers: u32,
    _pad: [u32; 3],
}

impl FibreUniform {
    /// The fibre with m = `segments` ≥ 2 of the quadrature over θ_i.
    pub fn new(fibre: &Fibre, segments: u32) -> Self {
        let layers = FitLayers::new(fibre);
        Self {
            alpha: fibre.alpha.map(|a| a as f32),
            eta: fibre.eta as f32,
            lambda: fibre.beta.map(|b| longitudinal_bandwidth(b) as f32),
            segments,
            eta_star: [layers.mean as f32, layers.half as f32],
            eta_low: layers.low as f32,
            eta_per_layer: layers.per_eta() as f32,
            eta_layers: layers.count as u32,
            _pad: [0; 3],
        }
    }
}

//! What a method binds in group 0: the fibre, and two tables.

use crate::scattering::{
    azimuthal::Energy,
    fast,
    fibre::Fibre,
    tables::{self, Tables},
    xu,
};
use crate::scene::{Energies, Method, RenderSpec};

use super::shaders;
use super::uniforms::FibreUniform;

/// Group 0 of `shaders::scattering_library`.
#[derive(Clone)]
pub struct MethodData {
    pub method: Method,
    pub fibre: FibreUniform,
    /// At bindings 1 and 2.
    pub tables: [Vec<u8>; 2],
    /// Single scattering by dense quadrature in the method's place, for judging the rest; for round fibres.
    pub exact_single: bool,
    /// Bit t: mode t is bright enough to be seen.
    pub modes: u32,
    /// Nothing that a scene lacks is left out, for judging what is.
    pub general: bool,
}

/// Every mode.
const ALL_MODES: u32 = 15;

impl MethodData {
    /// The method that a scene asks for.
    pub fn new(fibre: &Fibre, render: &RenderSpec) -> Self {
        match render.method {
            Method::Fast => Self::fast(fibre, render.nodes),
            Method::Xu => Self::xu(fibre, render.segments, render.energies),
        }
    }

    /// `nodes`: 2 to 4 over θ_i.
    pub fn fast(fibre: &Fibre, nodes: u32) -> Self {
        let tables = fast::Tables::new(fibre, nodes as usize);
        Self {
            method: Method::Fast,
            fibre: FibreUniform::new(fibre, nodes),
            modes: fast::Fast::new(fibre, &tables).visible_modes(),
            tables: [bytes(tables.azimuth.to_gpu()), bytes(&tables.nodes.to_gpu())],
            exact_single: false,
            general: false,
        }
    }

    /// `segments`: m ≥ 2 of Xu 2011 §4.2.2.
    pub fn xu(fibre: &Fibre, segments: u32, energies: Energies) -> Self {
        Self::xu_from(fibre, segments, energies, &tables::build())
    }

    /// [`Self::xu`] from tables that are there.
    pub fn xu_from(fibre: &Fibre, segments: u32, energies: Energies, tables: &Tables) -> Self {
        let energy = match energies {
            Energies::Quadrature => Energy::Quadrature,
            Energies::Taylor => Energy::Taylor(&tables.absorption),
        };
        Self {
            method: Method::Xu,
            fibre: FibreUniform::new(fibre, segments),
            tables: [
                bytes(&tables.to_gpu()),
                bytes(&xu::fibre_table(fibre, segments, energy, tables)),
            ],
            exact_single: false,
            modes: ALL_MODES,
            general: false,
        }
    }
}

impl MethodData {
    /// `shader`, put together for this method, as it is to be compiled.
    pub fn specialised(&self, shader: String) -> String {
        if self.exact_single { shaders::with_exact_single(&shader) } else { shader }
    }

    /// What the shader is specialised by: see shaders/fibre.wgsl.
    pub fn constants(&self) -> Vec<(&'static str, f64)> {
        let modes = if self.general { ALL_MODES } else { self.modes };
        vec![
            ("ECCENTRIC", f64::from(self.general || self.fibre.eta_layers > 1)),
            ("MODES", f64::from(modes)),
        ]
    }
}

fn bytes<T: bytemuck::NoUninit>(table: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(table).to_vec()
}

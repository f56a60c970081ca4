//! The methods that are measured: a row each.

use std::f64::consts::SQRT_2;

use crate::gpu::method::MethodData;
use crate::reference::DEON_LOBES;
use crate::reference::deon::Deon;
use crate::reference::marschner::Marschner;
use crate::reference::model::FibreModel;
use crate::scattering::fibre::Fibre;
use crate::scattering::model::Model;
use crate::scattering::tables::Tables;
use crate::scene::{Bcsdf, Energies};

/// A way to evaluate the scattering integrals on the GPU, at one setting.
#[derive(Clone, Copy)]
pub struct Method {
    pub name: &'static str,
    /// What distinguishes it from others of its name.
    pub setting: &'static str,
    /// Evaluations over θ_i for each mode, point and light.
    pub nodes: u32,
    /// What its shader binds for a fibre.
    pub data: fn(&Method, &Fibre, &Tables) -> MethodData,
    /// The model that it approximates.
    pub exact: Bcsdf,
    /// Whether its frames are taken apart by cause.
    pub by_cause: bool,
}

/// What others are compared with.
pub const BASELINE: usize = 1;

/// All methods, the [`BASELINE`] among them.
pub const METHODS: [Method; 9] = [
    Method { by_cause: false, ..xu("m = 2", 2) },
    xu("m = 4", 4),
    Method { by_cause: false, ..xu("m = 6", 6) },
    Method { by_cause: false, ..xu("m = 8", 8) },
    fast("2", 2),
    Method { by_cause: false, ..fast("3", 3) },
    Method { by_cause: false, ..fast("4", 4) },
    deon("2", 2),
    deon("3", 3),
];

/// The paper's method with m `segments`.
const fn xu(setting: &'static str, segments: u32) -> Method {
    Method {
        name: "xu",
        setting,
        nodes: segments - 1,
        data: |method, fibre, tables| {
            MethodData::xu_from(fibre, method.nodes + 1, Energies::Quadrature, tables)
        },
        exact: Bcsdf::Marschner,
        by_cause: true,
    }
}

/// Gauss nodes and an azimuth table.
const fn fast(setting: &'static str, nodes: u32) -> Method {
    Method {
        name: "fast",
        setting,
        nodes,
        data: |method, fibre, _| MethodData::fast(fibre, Model::Marschner, method.nodes),
        exact: Bcsdf::Marschner,
        by_cause: true,
    }
}

/// `fast` of d'Eon's fibre.
const fn deon(setting: &'static str, nodes: u32) -> Method {
    Method {
        name: "deon",
        data: |method, fibre, _| MethodData::fast(fibre, Model::Deon, method.nodes),
        exact: Bcsdf::Deon,
        by_cause: false,
        ..fast(setting, nodes)
    }
}

impl Method {
    /// Name and setting.
    pub fn label(&self) -> String {
        format!("{} {}", self.name, self.setting)
    }

    pub fn data(&self, fibre: &Fibre, tables: &Tables) -> MethodData {
        (self.data)(self, fibre, tables)
    }

    /// The model that its integrals are judged by: no lobe's energy made up for.
    pub fn model(&self, fibre: &Fibre) -> Box<dyn FibreModel> {
        match self.exact {
            Bcsdf::Deon => Box::new(Deon::conserving(fibre, fibre.w_c / SQRT_2, DEON_LOBES)),
            _ => Box::new(Marschner::new(fibre)),
        }
    }
}

/// A model's single scattering by dense quadrature, its energy made up for by four nodes; where there is a shader.
pub fn exact_single(model: Bcsdf, fibre: &Fibre) -> Option<MethodData> {
    (model == Bcsdf::Marschner)
        .then(|| MethodData { exact_single: true, ..MethodData::fast(fibre, Model::Marschner, 4) })
}

/// Bytes of the tables that the shader reads for one fibre.
pub fn table_bytes(data: &MethodData) -> usize {
    data.tables.iter().map(Vec::len).sum()
}

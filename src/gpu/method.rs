//! What a method binds in group 0: the fibre, and two tables.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use anyhow::{Result, bail, ensure};

use crate::field::Twin;
use crate::paint::Fibres;
use crate::scattering::{
    azimuth_table::Mode,
    azimuthal::{Energy, FitLayers},
    fast::{self, Fast},
    fibre::Fibre,
    model::Model,
    tables::{self, Tables},
    xu,
};
use crate::scene::{Bcsdf, Energies, Method, RenderSpec, Scattering};

use super::shaders::Shaders;
use super::uniforms::FibreUniform;

/// What a frame's scattering is evaluated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    Fast(Model),
    /// Of Marschner's fibre.
    Xu,
}

/// A mode is left out where it holds less than this share of what a fibre scatters.
const VISIBLE: f64 = 1.0 / 512.0;

/// Group 0 of `Shaders::scattering_library`.
#[derive(Clone)]
pub struct MethodData {
    pub integrator: Integrator,
    pub fibre: FibreUniform,
    /// Of the quadrature over θ_i: nodes (`fast`) or segments m ≥ 2 (`xu`).
    pub nodes: u32,
    /// At bindings 1 and 2.
    pub tables: [Vec<u8>; 2],
    /// Single scattering by dense quadrature in the method's place, for judging the rest; for round fibres.
    pub exact_single: bool,
    /// Bit t: mode t is bright enough to be seen; TRRT stands for all longer ones too.
    pub modes: u32,
    /// Nothing that a scene lacks is left out, for judging what is.
    pub general: bool,
    /// What is shaded.
    pub fibres: Arc<Fibres>,
    /// `tables` on the CPU, to find what strands make of each other's light; `xu` has its own way.
    pub twin: Option<Arc<fast::Tables>>,
}

const XU_MODES: u32 = 7;

/// See [`MethodData::modes`].
fn visible_modes(fast: &Fast) -> u32 {
    let modes = [Mode::R, Mode::Tt, Mode::Trt, Mode::Trrt];
    modes.map(|mode| u32::from(fast.share_of(mode) > VISIBLE) << mode as u32).iter().sum()
}

/// [`fast::Tables::over`], made once for all methods that are there and have the same.
pub fn tables_over(layers: &FitLayers, model: Model, nodes: usize) -> Arc<fast::Tables> {
    type Known = (FitLayers, Model, usize, Weak<fast::Tables>);
    static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());
    let same = |known: &Known| {
        let (l, m, n, _) = known;
        (l.low, l.high, l.count, *m, *n) == (layers.low, layers.high, layers.count, model, nodes)
    };
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.retain(|(.., tables)| tables.strong_count() > 0);
    if let Some(tables) = known.iter().find(|k| same(k)).and_then(|(.., tables)| tables.upgrade()) {
        return tables;
    }
    drop(known);
    let tables = Arc::new(fast::Tables::over(layers, model, nodes));
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.push((*layers, model, nodes, Arc::downgrade(&tables)));
    tables
}

impl MethodData {
    /// What a scene asks for.
    ///
    /// # Errors
    /// One line: a model that the method does not have.
    pub fn new(model: Bcsdf, fibres: Fibres, render: &RenderSpec) -> Result<Self> {
        let parts_of_xu = [Scattering::Global, Scattering::Local];
        ensure!(
            render.method == Method::Xu || !parts_of_xu.contains(&render.scattering),
            "fast does not tell global scattering from local: give --scattering multiple, or --method xu"
        );
        ensure!(
            render.method == Method::Fast || !fibres.painted(),
            "xu has no painted hair: give --method fast, or --paint none"
        );
        let fibre = *fibres.base();
        let fast = |model: Model| Self::of(fibres, model, render.nodes.unwrap_or(model.nodes()));
        Ok(match (render.method, model) {
            (Method::Fast, Bcsdf::Marschner) => fast(Model::Marschner),
            (Method::Fast, Bcsdf::Deon) => fast(Model::Deon),
            (Method::Xu, Bcsdf::Marschner) => Self::xu(&fibre, render.segments, render.energies),
            (Method::Xu, Bcsdf::Deon) => {
                bail!("the method xu has no deon: give --method fast, or --bcsdf marschner")
            }
            (_, Bcsdf::Chiang) => {
                bail!(
                    "chiang is path traced only: give --bcsdf marschner or deon, or use `hairlight reference`"
                )
            }
        })
    }

    /// `nodes`: 2 to 4 over θ_i.
    pub fn fast(fibre: &Fibre, model: Model, nodes: u32) -> Self {
        Self::of(Fibres::even(fibre), model, nodes)
    }

    /// The same of a groom whose points may have fibres of their own.
    pub fn of(fibres: Fibres, model: Model, nodes: u32) -> Self {
        /// Points that tell which modes are seen.
        const JUDGED: usize = 64;
        let base = fibres.base();
        let layers = match fibres.painted() {
            true => FitLayers::over(base, fibres.eta_range()),
            false => FitLayers::new(base),
        };
        let tables = tables_over(&layers, model, nodes as usize);
        let seen = |fibre: &Fibre| visible_modes(&Fast::new(fibre, model, &tables));
        Self {
            integrator: Integrator::Fast(model),
            fibre: FibreUniform::over(base, &layers, fibres.linked(), model),
            nodes,
            modes: fibres.sample(JUDGED).iter().fold(0, |all, fibre| all | seen(fibre)),
            tables: [bytes(tables.azimuth.to_gpu()), bytes(&tables.nodes.to_gpu())],
            exact_single: false,
            general: false,
            fibres: Arc::new(fibres),
            twin: Some(tables),
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
            integrator: Integrator::Xu,
            fibre: FibreUniform::new(fibre, Model::Marschner),
            nodes: segments,
            tables: [
                bytes(&tables.to_gpu()),
                bytes(&xu::fibre_table(fibre, segments, energy, tables)),
            ],
            exact_single: false,
            modes: XU_MODES,
            general: false,
            fibres: Arc::new(Fibres::even(fibre)),
            twin: None,
        }
    }
}

impl MethodData {
    /// `shader`, put together for this method, as it is to be compiled.
    pub fn specialised(&self, shaders: &Shaders, shader: String) -> String {
        if self.exact_single { shaders.with_exact_single(&shader) } else { shader }
    }

    /// The method on the CPU, where frames need what strands make of each other's light.
    pub fn twin(&self) -> Option<Twin<'_>> {
        let tables = self.twin.as_ref()?;
        let Integrator::Fast(model) = self.integrator else { return None };
        Some(Twin::new(&self.fibres, model, tables))
    }

    /// The same with nothing left out.
    pub fn as_general(self) -> Self {
        Self { general: true, ..self }
    }

    /// Most lights that a dispatch may sum: lavapipe ends all loops of an invocation, without a word, after 65,535
    /// rounds of them together, of which a light takes up to 200, and 3,100 where its integrals are exact.
    pub fn lights_a_pass(&self) -> usize {
        if self.exact_single { 16 } else { 256 }
    }

    /// Whether shading needs to know how many strands light crosses, and not T̃ alone.
    pub fn counts_strands(&self) -> bool {
        self.integrator == Integrator::Xu
    }

    /// What the shader is specialised by: see shaders/fibre.wgsl.
    pub fn constants(&self) -> Vec<(&'static str, f64)> {
        let modes = match self.integrator {
            _ if !self.general => self.modes,
            Integrator::Fast(model) => model.modes().iter().map(|&mode| 1 << mode as u32).sum(),
            Integrator::Xu => XU_MODES,
        };
        vec![
            ("ECCENTRIC", f64::from(self.general || self.fibre.eta_layers > 1)),
            ("PAINTED", f64::from(self.fibres.painted())),
            ("MODES", f64::from(modes)),
            ("NODES", f64::from(self.nodes)),
        ]
    }
}

fn bytes<T: bytemuck::NoUninit>(table: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(table).to_vec()
}

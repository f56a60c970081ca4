//! The shaders, put together from their files. WGSL takes declarations in any order, so a shader is the
//! plain concatenation of library files and one file with its entry points.

use std::borrow::Cow;
use std::path::Path;

use anyhow::{Context, Result, bail};
use wgpu::naga;

use super::method::Integrator;
use crate::scattering::model::Model;

macro_rules! files {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../shaders/", $name)))),*]
    };
}

/// Every file, by its path in shaders/.
const FILES: [(&str, &str); 34] = files![
    "angles.wgsl",
    "arrival.wgsl",
    "azimuth_table.wgsl",
    "azimuthal.wgsl",
    "cast.wgsl",
    "deon.wgsl",
    "draws.wgsl",
    "dual.wgsl",
    "exact.wgsl",
    "fast.wgsl",
    "fibre.wgsl",
    "fibre_draw.wgsl",
    "gather.wgsl",
    "gather_sum.wgsl",
    "gaussian.wgsl",
    "head_light.wgsl",
    "lamp.wgsl",
    "longitudinal.wgsl",
    "mark.wgsl",
    "fringe.wgsl",
    "marschner.wgsl",
    "nodes.wgsl",
    "occlusion.wgsl",
    "paths.wgsl",
    "probe/probe.wgsl",
    "raster.wgsl",
    "resolve.wgsl",
    "shade.wgsl",
    "strand_point.wgsl",
    "tables.wgsl",
    "transmittance.wgsl",
    "view.wgsl",
    "walk.wgsl",
    "xu.wgsl",
];

/// What every method stands on.
const COMMON: [&str; 6] = [
    "fibre.wgsl",
    "angles.wgsl",
    "gaussian.wgsl",
    "lamp.wgsl",
    "longitudinal.wgsl",
    "arrival.wgsl",
];

/// A method's own files, among them the seam: shaders/shade.wgsl says what it defines.
fn own(integrator: Integrator) -> &'static [&'static str] {
    match integrator {
        Integrator::Fast(Model::Marschner) => {
            &["azimuth_table.wgsl", "nodes.wgsl", "fast.wgsl", "fibre_draw.wgsl", "marschner.wgsl"]
        }
        Integrator::Fast(Model::Deon) => {
            &["azimuth_table.wgsl", "nodes.wgsl", "fast.wgsl", "fibre_draw.wgsl", "deon.wgsl"]
        }
        Integrator::Xu => &["tables.wgsl", "azimuthal.wgsl", "dual.wgsl", "walk.wgsl", "xu.wgsl"],
    }
}

fn library(integrator: Integrator) -> Vec<&'static str> {
    [&COMMON[..], own(integrator)].concat()
}

/// The text of all shaders: the built-in one, or that of a folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Shaders {
    /// As [`FILES`] is.
    texts: Vec<Cow<'static, str>>,
}

impl Default for Shaders {
    fn default() -> Self {
        Self { texts: FILES.iter().map(|&(_, text)| text.into()).collect() }
    }
}

impl Shaders {
    /// Those of a folder like shaders/, of which every file counts that is there.
    ///
    /// # Errors
    /// One line: a file that cannot be read, or with file and line what is wrong in one.
    pub fn read(folder: &Path) -> Result<Self> {
        let mut shaders = Self::default();
        let mut found = false;
        for ((name, _), text) in FILES.iter().zip(&mut shaders.texts) {
            let path = folder.join(name);
            if path.is_file() {
                let own = std::fs::read_to_string(&path);
                *text = own.with_context(|| path.display().to_string())?.into();
                found = true;
            }
        }
        if !found {
            bail!("{}: has none of the shaders (fibre.wgsl, shade.wgsl …)", folder.display());
        }
        shaders.check()?;
        Ok(shaders)
    }

    fn text(&self, name: &str) -> &str {
        FILES.iter().position(|(own, _)| *own == name).map_or("", |at| &self.texts[at])
    }

    fn join(&self, names: &[&str]) -> String {
        names.iter().map(|name| self.text(name)).collect::<Vec<_>>().join("\n")
    }

    /// Everything a pass needs to evaluate scattering; it binds group 0.
    pub fn scattering_library(&self, integrator: Integrator) -> String {
        self.join(&library(integrator))
    }

    /// The library with an entry point `probe` that calls `expression` for each item: see `probe.rs`.
    pub fn probe(&self, integrator: Integrator, expression: &str) -> String {
        let entry = self.text("probe/probe.wgsl").replace("PROBED", expression);
        self.scattering_library(integrator) + "\n" + &entry
    }

    /// Entry points `hair_vertex`, `hair_fragment`, `head_vertex`, `head_fragment`.
    pub fn raster(&self) -> String {
        self.join(&["view.wgsl", "raster.wgsl"])
    }

    /// Entry point `spread`.
    pub fn fringe(&self) -> String {
        self.text("fringe.wgsl").to_owned()
    }

    /// Entry point `mark`.
    pub fn mark(&self) -> String {
        self.join(&["view.wgsl", "mark.wgsl"])
    }

    /// Entry point `shade`.
    pub fn shade(&self, integrator: Integrator) -> String {
        self.scattering_library(integrator)
            + "\n"
            + &self.join(&["strand_point.wgsl", "shade.wgsl"])
    }

    /// Entry points `aim`, `meet`; for [`Integrator::Fast`].
    pub fn gather(&self, integrator: Integrator) -> String {
        let own = ["strand_point.wgsl", "draws.wgsl", "paths.wgsl", "gather.wgsl"];
        self.scattering_library(integrator) + "\n" + &self.join(&own)
    }

    /// Entry points `cast_nearest`, `cast_any`.
    pub fn cast(&self) -> String {
        self.join(&["angles.wgsl", "occlusion.wgsl", "draws.wgsl", "paths.wgsl", "cast.wgsl"])
    }

    /// Entry points `sum`, `even_out`.
    pub fn gather_sum(&self) -> String {
        self.join(&["paths.wgsl", "gather_sum.wgsl"])
    }

    /// Entry point `transmittance`.
    pub fn transmittance(&self) -> String {
        self.join(&["angles.wgsl", "occlusion.wgsl", "draws.wgsl", "transmittance.wgsl"])
    }

    /// Entry point `light_head`.
    pub fn head_light(&self) -> String {
        self.join(&["angles.wgsl", "lamp.wgsl", "occlusion.wgsl", "draws.wgsl", "head_light.wgsl"])
    }

    /// A shader with `single_scattering` by dense quadrature (shaders/exact.wgsl), for judging the rest of a method.
    pub fn with_exact_single(&self, shader: &str) -> String {
        // The method's own stays under another name.
        let own = shader.replace("fn single_scattering(", "fn method_single_scattering(");
        own + "\n" + self.text("exact.wgsl")
    }

    /// Entry points `resolve`, `backdrop`.
    pub fn resolve(&self) -> String {
        self.join(&["view.wgsl", "resolve.wgsl"])
    }

    /// Every pass's shader with its name.
    pub fn passes(&self) -> [(&'static str, String); 13] {
        [
            ("raster", self.raster()),
            ("mark", self.mark()),
            ("fringe", self.fringe()),
            ("transmittance", self.transmittance()),
            ("head light", self.head_light()),
            ("shade, fast", self.shade(Integrator::Fast(Model::Marschner))),
            ("shade, fast, deon", self.shade(Integrator::Fast(Model::Deon))),
            ("shade, xu", self.shade(Integrator::Xu)),
            ("gather, fast", self.gather(Integrator::Fast(Model::Marschner))),
            ("gather, fast, deon", self.gather(Integrator::Fast(Model::Deon))),
            ("cast", self.cast()),
            ("gather sum", self.gather_sum()),
            ("resolve", self.resolve()),
        ]
    }

    /// # Errors
    /// With file and line, what naga finds wrong.
    fn check(&self) -> Result<()> {
        let flags = naga::valid::ValidationFlags::all();
        // unpack2x16float, which is in every WebGPU device.
        let capabilities = naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32;
        for (_, source) in self.passes() {
            let (at, what) = match naga::front::wgsl::parse_str(&source) {
                Err(error) => (error.location(&source), error.message().to_owned()),
                Ok(module) => {
                    let valid = naga::valid::Validator::new(flags, capabilities).validate(&module);
                    let Err(error) = valid else { continue };
                    let causes = std::iter::successors(
                        Some(error.as_inner() as &dyn std::error::Error),
                        |error| error.source(),
                    );
                    let causes: Vec<String> = causes.map(ToString::to_string).collect();
                    (error.location(&source), causes.join(": "))
                }
            };
            match at.and_then(|at| self.place(&source, at.offset as usize)) {
                Some((name, line)) => bail!("{name}, line {line}: {what}"),
                None => bail!("{what}"),
            }
        }
        Ok(())
    }

    /// The file, and the line in it, of a place in a shader.
    fn place(&self, source: &str, offset: usize) -> Option<(&'static str, usize)> {
        FILES.iter().zip(&self.texts).find_map(|((name, _), text)| {
            let begin = source.find(&**text)?;
            let within = offset.checked_sub(begin).filter(|&at| at <= text.len())?;
            Some((*name, text.get(..within)?.matches('\n').count() + 1))
        })
    }
}

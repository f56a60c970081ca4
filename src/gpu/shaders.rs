//! The shaders, put together from their files. WGSL takes declarations in any order, so a shader is the
//! plain concatenation of library files and one file with its entry points.

use super::method::Integrator;
use crate::scattering::model::Model;

/// What every method stands on.
const COMMON: [&str; 5] = [
    include_str!("../../shaders/fibre.wgsl"),
    include_str!("../../shaders/angles.wgsl"),
    include_str!("../../shaders/gaussian.wgsl"),
    include_str!("../../shaders/longitudinal.wgsl"),
    include_str!("../../shaders/arrival.wgsl"),
];

const FAST: [&str; 3] = [
    include_str!("../../shaders/azimuth_table.wgsl"),
    include_str!("../../shaders/nodes.wgsl"),
    include_str!("../../shaders/fast.wgsl"),
];

/// A method's own files, among them the seam: shaders/shade.wgsl says what it defines.
fn own(integrator: Integrator) -> Vec<&'static str> {
    match integrator {
        Integrator::Fast(model) => {
            let fibre = match model {
                Model::Marschner => include_str!("../../shaders/marschner.wgsl"),
                Model::Deon => include_str!("../../shaders/deon.wgsl"),
            };
            [&FAST[..], &[fibre]].concat()
        }
        Integrator::Xu => vec![
            include_str!("../../shaders/tables.wgsl"),
            include_str!("../../shaders/azimuthal.wgsl"),
            include_str!("../../shaders/dual.wgsl"),
            include_str!("../../shaders/walk.wgsl"),
            include_str!("../../shaders/xu.wgsl"),
        ],
    }
}

/// Everything a pass needs to evaluate scattering; it binds group 0.
pub fn scattering_library(integrator: Integrator) -> String {
    [&COMMON[..], &own(integrator)].concat().join("\n")
}

/// The library with an entry point `probe` that calls `expression` for each item: see `probe.rs`.
pub fn probe(integrator: Integrator, expression: &str) -> String {
    let entry = include_str!("../../shaders/probe/probe.wgsl").replace("PROBED", expression);
    scattering_library(integrator) + "\n" + &entry
}

const VIEW: &str = include_str!("../../shaders/view.wgsl");

/// Entry points `hair_vertex`, `hair_fragment`, `head_vertex`, `head_fragment`.
pub fn raster() -> String {
    [VIEW, include_str!("../../shaders/raster.wgsl")].join("\n")
}

/// Entry points `mark`, `plan_shading`, `end_shading`.
pub fn mark() -> String {
    [VIEW, include_str!("../../shaders/mark.wgsl")].join("\n")
}

/// Entry point `shade`.
pub fn shade(integrator: Integrator) -> String {
    [&scattering_library(integrator), include_str!("../../shaders/shade.wgsl")].join("\n")
}

/// The shader with `single_scattering` by dense quadrature (shaders/exact.wgsl), for judging the rest of a method.
pub fn with_exact_single(shader: &str) -> String {
    // The method's own stays under another name.
    let own = shader.replace("fn single_scattering(", "fn method_single_scattering(");
    [&own, include_str!("../../shaders/exact.wgsl")].join("\n")
}

/// Entry points `resolve`, `backdrop`.
pub fn resolve() -> String {
    [VIEW, include_str!("../../shaders/resolve.wgsl")].join("\n")
}

/// Every pass's shader with its name.
pub fn passes() -> [(&'static str, String); 6] {
    [
        ("raster", raster()),
        ("mark", mark()),
        ("shade, fast", shade(Integrator::Fast(Model::Marschner))),
        ("shade, fast, deon", shade(Integrator::Fast(Model::Deon))),
        ("shade, xu", shade(Integrator::Xu)),
        ("resolve", resolve()),
    ]
}

//! The shaders, put together from their files. WGSL takes declarations in any order, so a shader is the
//! plain concatenation of library files and one file with its entry points.

/// The files of the method, but for its entry points: group 0 of shaders/fibre.wgsl and all that is
/// evaluated at a point. xu.wgsl is the seam: another method's file would take its place.
const SCATTERING: [&str; 8] = [
    include_str!("../../shaders/fibre.wgsl"),
    include_str!("../../shaders/angles.wgsl"),
    include_str!("../../shaders/gaussian.wgsl"),
    include_str!("../../shaders/longitudinal.wgsl"),
    include_str!("../../shaders/tables.wgsl"),
    include_str!("../../shaders/azimuthal.wgsl"),
    include_str!("../../shaders/dual.wgsl"),
    include_str!("../../shaders/xu.wgsl"),
];

/// Everything a pass needs to evaluate scattering; it binds group 0.
pub fn scattering_library() -> String {
    SCATTERING.join("\n")
}

/// The library with an entry point `probe` that calls `expression` for each item: see `probe.rs`.
pub fn probe(expression: &str) -> String {
    let entry = include_str!("../../shaders/probe/probe.wgsl").replace("PROBED", expression);
    scattering_library() + "\n" + &entry
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
pub fn shade() -> String {
    [&scattering_library(), include_str!("../../shaders/shade.wgsl")].join("\n")
}

/// Entry points `resolve`, `backdrop`.
pub fn resolve() -> String {
    [VIEW, include_str!("../../shaders/resolve.wgsl")].join("\n")
}

/// Every pass's shader with its name.
pub fn passes() -> [(&'static str, String); 4] {
    [("raster", raster()), ("mark", mark()), ("shade", shade()), ("resolve", resolve())]
}

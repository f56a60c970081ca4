//! `hairlight probe`: our scattering functions over rows of numbers, CSV in and CSV out.
//!
//! The header names the columns in any order. A result row is its input row as it was, then the results with
//! nine significant digits. A row or column that is wrong is an error that names it, and nothing is written.
//!
//! Angles are radians, but for columns that end in `_deg`. Inputs that a function and a model need and take:
//!
//! - the fibre: `eta`; absorption per radius as `sigma_a` or `sigma_a_r`, `_g`, `_b` (`srbf` and `dual` are
//!   grey and take equal ones only). marschner, deon: `beta_r_deg`, `beta_tt_deg` (default: half of it),
//!   `beta_trt_deg` (default: twice), standard deviations of θ_h; the azimuthal width as `w_c`, a bandwidth
//!   in radians, or `beta_n_deg`, the standard deviation w_c/√2 in degrees (of both marschner reads `w_c`
//!   and deon `beta_n_deg`); `alpha_r_deg` (default: `alpha_deg`, or 0), `alpha_tt_deg` (−α_R/2),
//!   `alpha_trt_deg` (−3α_R/2); marschner: `eccentricity` (1). chiang: `beta_m`, `beta_n` in [0, 1] and
//!   `alpha_deg` (0), after pbrt. What a model does not take may stand there unread. marschner and deon are
//!   as published, no lobe's energy made up for.
//! - `bcsdf`: `theta_i`, `phi_i`, `theta_o`, `phi_o`, chiang's `h` → `f_cos_r`, `f_cos_g`, `f_cos_b`, `pdf`.
//!   S·cosθ_i, 1/sr, of chiang at h, else the far field; the density of the model's sampling likewise at h or
//!   its mean over h.
//! - `srbf`: `theta_o`, `phi_o`, `theta_j`, `phi_j`, `lambda_j` → `m_r`, `m_tt`, `m_trt`, ∫G_j S_t cosθ_i dω
//!   in the far field: lobes of higher order, which deon and chiang have, are not among them.
//! - `dual`: `theta` → `a_f`, `a_b`, `alpha_f`, `alpha_b`, `beta_f`, `beta_b`, `A_b`, `delta_b`, `sigma_b`,
//!   angles of θ_h; `A_b` is the whole series (`reference/averages.rs`).
//!
//! [`Method::Exact`] is `reference`. The others are what the renderer computes, `fast` for marschner and for deon, whose
//! A_p it takes at θ_o, `xu` for marschner alone: its f64 twin on the CPU or its own WGSL on the GPU, without energy
//! compensation. They have no value per direction, so
//! `bcsdf` is their answer to a light of λ_j = 0.01 and unit energy, and has no pdf; `xu` alone knows `dual`, of which
//! it has `a_f`, `a_b`, `beta_f`, `A_b`, `delta_b`, `sigma_b`.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, SQRT_2};
use std::io::{Read, Write};
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use rayon::prelude::*;

use crate::gpu::method::{Integrator, MethodData};
use crate::reference::{
    DEON_LOBES,
    averages::averages,
    chiang::Chiang,
    deon::Deon,
    integral::{Light, far_field_pdf, srbf_integral},
    marschner::Marschner,
    model::{Direction, FibreModel},
};
use crate::scattering::{
    azimuthal::{Energy, wrap},
    fast::{self, Fast},
    fibre::Fibre,
    gaussian,
    model::Model,
    xu::{Modes, Xu},
};
use crate::scene::{Bcsdf, Energies};

/// What is computed for each row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Function {
    Bcsdf,
    Srbf,
    Dual,
}

impl Function {
    pub const NAMES: [&str; 3] = ["bcsdf", "srbf", "dual"];

    fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

impl FromStr for Function {
    type Err = anyhow::Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "bcsdf" => Ok(Self::Bcsdf),
            "srbf" => Ok(Self::Srbf),
            "dual" => Ok(Self::Dual),
            _ => bail!("'{name}' is no function of probe: there are {}", Self::NAMES.join(", ")),
        }
    }
}

/// The exact quantity, or what the renderer takes for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    Exact,
    Fast,
    Xu,
}

/// How [`run`] computes.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    pub model: Bcsdf,
    /// `None`: exact on the CPU, `fast` on the GPU.
    pub method: Option<Method>,
    /// Runs the renderer's WGSL; `None` is the CPU.
    pub gpu: Option<&'a Gpu<'a>>,
}

/// The outputs of a [`Request`] for each of the inputs, computed by the renderer for one fibre, with
/// [`SEGMENTS`] or [`Model::nodes`] and without energy compensation.
pub type Gpu<'a> = dyn Fn(&Fibre, Request, &[[f32; 8]]) -> Result<Vec<[f32; 12]>> + 'a;

/// Segments m of the quadrature of `xu`.
pub const SEGMENTS: u32 = 4;

/// A function of the renderer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    pub quantity: Quantity,
    pub integrator: Integrator,
}

/// What a [`Request`] asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity {
    /// (θ_o, θ_j, φ_o−φ_j, cos(φ_o+φ_j), λ_j) → R, TT, TRT and longer paths, RGB each.
    SingleScattering,
    /// (θ) → ā_f, ā_b, β̄_f², Ā_b, Δ̄_b, σ̄_b of the first channel, in the renderer's units; of `xu` alone.
    Averages,
}

impl Request {
    /// WGSL that reads `x: array<vec4f, 2>` and sets `y: array<vec4f, 3>`.
    pub fn statement(self) -> &'static str {
        match (self.quantity, self.integrator) {
            (Quantity::SingleScattering, _) => {
                "let m = single_scattering(fibre, x[0].x, x[0].y, x[0].z, x[0].w, x[1].x);
                y[0] = vec4f(m.r, m.tt.x); y[1] = vec4f(m.tt.yz, m.trt.xy); y[2] = vec4f(m.trt.z, m.longer);"
            }
            (Quantity::Averages, _) => {
                "let a = averages(x[0].x);
                y[0] = vec4f(a.a_f.x, a.a_b.x, a.beta_f2.x, a.A_b.x);
                y[1] = vec4f(a.delta_b, a.sigma_b, 0.0, 0.0);"
            }
        }
    }

    /// What the statement runs with, for one fibre.
    pub fn data(self, fibre: &Fibre) -> MethodData {
        match self.integrator {
            Integrator::Fast(model) => MethodData::fast(fibre, model, model.nodes()).as_general(),
            Integrator::Xu => MethodData::xu(fibre, SEGMENTS, Energies::Quadrature),
        }
    }

    /// The same by the f64 twin.
    fn twins(self, fibre: &Fibre, inputs: &[[f64; 8]]) -> Vec<[f64; 12]> {
        let modes = |m: Modes| [m.r, m.tt, m.trt, m.longer].as_flattened().to_vec();
        let single = self.quantity == Quantity::SingleScattering;
        let padded = |y: Vec<f64>| std::array::from_fn(|k| y.get(k).copied().unwrap_or(0.0));
        match self.integrator {
            Integrator::Fast(model) => {
                let tables = fast::Tables::new(fibre, model, model.nodes() as usize);
                let fast = Fast::new(fibre, model, &tables);
                let of = |x: &[f64; 8]| modes(fast.single_scattering(x[0], x[1], x[2], x[3], x[4]));
                inputs.par_iter().map(|x| padded(of(x))).collect()
            }
            Integrator::Xu => {
                let xu = Xu::new(fibre, SEGMENTS, Energy::Quadrature);
                let of = |x: &[f64; 8]| {
                    if single {
                        return modes(xu.single_scattering(x[0], x[1], x[2], x[3], x[4]));
                    }
                    let a = xu.averages(x[0]);
                    vec![a.a_f[0], a.a_b[0], a.beta_f2[0], a.big_a_b[0], a.delta_b, a.sigma_b]
                };
                inputs.par_iter().map(|x| padded(of(x))).collect()
            }
        }
    }
}

/// The light that stands for one direction of `bcsdf` by the renderer's methods: it widens a lobe of β = 5° by
/// 0.08 %.
const NARROW: f64 = 0.01;

/// A name that a header may have, and the values beneath.
struct Column {
    name: &'static str,
    low: f64,
    high: f64,
    unit: &'static str,
}

const fn column(name: &'static str, low: f64, high: f64, unit: &'static str) -> Column {
    Column { name, low, high, unit }
}

/// π/2, rounded up.
const QUARTER: f64 = 1.570797;

/// Directions and lights. The rest describes the fibre.
const PLACES: [Column; 9] = [
    column("theta", -QUARTER, QUARTER, "radians"),
    column("theta_i", -QUARTER, QUARTER, "radians"),
    column("phi_i", -1e3, 1e3, "radians"),
    column("theta_o", -QUARTER, QUARTER, "radians"),
    column("phi_o", -1e3, 1e3, "radians"),
    column("theta_j", -QUARTER, QUARTER, "radians"),
    column("phi_j", -1e3, 1e3, "radians"),
    column("lambda_j", 0.003, 1e6, "a bandwidth in radians"),
    column("h", -1.0, 1.0, "radii"),
];

const FIBRE: [Column; 17] = [
    column("eta", 1.0, 3.0, "relative to air"),
    column("sigma_a", 0.0, 1e3, "per radius"),
    column("sigma_a_r", 0.0, 1e3, "per radius"),
    column("sigma_a_g", 0.0, 1e3, "per radius"),
    column("sigma_a_b", 0.0, 1e3, "per radius"),
    column("beta_m", 0.0, 1.0, "pbrt's roughness"),
    column("beta_n", 0.0, 1.0, "pbrt's roughness"),
    column("beta_r_deg", 0.05, 360.0, "degrees"),
    column("beta_tt_deg", 0.05, 360.0, "degrees"),
    column("beta_trt_deg", 0.05, 360.0, "degrees"),
    column("beta_n_deg", 0.0, 360.0, "degrees"),
    column("w_c", 0.0, 10.0, "a bandwidth in radians"),
    column("alpha_deg", -90.0, 90.0, "degrees"),
    column("alpha_r_deg", -90.0, 90.0, "degrees"),
    column("alpha_tt_deg", -90.0, 90.0, "degrees"),
    column("alpha_trt_deg", -90.0, 90.0, "degrees"),
    column("eccentricity", 0.5, 2.0, "a ratio of axes"),
];

/// The names of [`PLACES`] that a function takes.
fn places(function: Function) -> &'static [&'static str] {
    match function {
        Function::Bcsdf => &["theta_i", "phi_i", "theta_o", "phi_o", "h"],
        Function::Srbf => &["theta_o", "phi_o", "theta_j", "phi_j", "lambda_j"],
        Function::Dual => &["theta"],
    }
}

/// What there must be: of each entry one of the alternatives that `|` parts, all of its columns.
fn needs(function: Function, model: Bcsdf) -> Vec<&'static str> {
    let of_fibre: &[&str] = match model {
        Bcsdf::Chiang => &["beta_m", "beta_n"],
        Bcsdf::Marschner | Bcsdf::Deon => &["beta_r_deg", "w_c|beta_n_deg"],
    };
    let h_is_needed = model == Bcsdf::Chiang;
    let places = places(function).iter().filter(|&&name| name != "h" || h_is_needed);
    let shared = ["eta", "sigma_a|sigma_a_r sigma_a_g sigma_a_b"];
    places.chain(&shared).chain(of_fibre).copied().collect()
}

/// The names of the results.
fn results(function: Function, method: Method) -> &'static [&'static str] {
    match (function, method) {
        (Function::Bcsdf, Method::Exact) => &["f_cos_r", "f_cos_g", "f_cos_b", "pdf"],
        (Function::Bcsdf, Method::Fast | Method::Xu) => &["f_cos_r", "f_cos_g", "f_cos_b"],
        (Function::Srbf, _) => &["m_r", "m_tt", "m_trt"],
        (Function::Dual, Method::Exact) => {
            &["a_f", "a_b", "alpha_f", "alpha_b", "beta_f", "beta_b", "A_b", "delta_b", "sigma_b"]
        }
        (Function::Dual, _) => &["a_f", "a_b", "beta_f", "A_b", "delta_b", "sigma_b"],
    }
}

/// One line of the input.
struct Row<'a> {
    columns: &'a [&'static Column],
    line: u64,
    fields: csv::StringRecord,
    values: Vec<f64>,
}

impl Row<'_> {
    fn get(&self, name: &str) -> Option<f64> {
        self.columns.iter().position(|column| column.name == name).map(|k| self.values[k])
    }

    /// A column that [`needs`] has made sure of.
    fn at(&self, name: &str) -> f64 {
        self.get(name).unwrap_or(f64::NAN)
    }

    /// The direction that `theta_…` and `phi_…` name.
    fn direction(&self, theta: &str, phi: &str) -> Direction {
        Direction::new(self.at(theta).clamp(-FRAC_PI_2, FRAC_PI_2), wrap(self.at(phi)))
    }

    fn sigma_a(&self) -> [f64; 3] {
        match self.get("sigma_a") {
            Some(grey) => [grey; 3],
            None => ["sigma_a_r", "sigma_a_g", "sigma_a_b"].map(|name| self.at(name)),
        }
    }

    /// The fibre as marschner and deon take it.
    fn fibre(&self) -> Fibre {
        let or = |name: &str, default: f64| self.get(name).unwrap_or(default);
        let beta_r = self.at("beta_r_deg");
        let alpha_r = or("alpha_r_deg", or("alpha_deg", 0.0));
        let beta = [beta_r, or("beta_tt_deg", 0.5 * beta_r), or("beta_trt_deg", 2.0 * beta_r)];
        let alpha =
            [alpha_r, or("alpha_tt_deg", -0.5 * alpha_r), or("alpha_trt_deg", -1.5 * alpha_r)];
        Fibre {
            eta: self.at("eta"),
            sigma_a: self.sigma_a(),
            alpha: alpha.map(f64::to_radians),
            beta: beta.map(f64::to_radians),
            w_c: or("w_c", SQRT_2 * self.at("beta_n_deg").to_radians()),
            eccentricity: or("eccentricity", 1.0),
            tint: Fibre::UNTINTED,
        }
    }

    /// The azimuthal standard deviation of deon.
    fn beta_n(&self) -> f64 {
        self.get("beta_n_deg").map_or_else(|| self.at("w_c") / SQRT_2, f64::to_radians)
    }

    fn model(&self, model: Bcsdf) -> Box<dyn FibreModel> {
        match model {
            Bcsdf::Marschner => Box::new(Marschner::new(&self.fibre())),
            Bcsdf::Deon => Box::new(Deon::new(&self.fibre(), self.beta_n(), DEON_LOBES)),
            Bcsdf::Chiang => {
                let alpha = self.get("alpha_deg").unwrap_or(0.0).to_radians();
                let (beta_m, beta_n) = (self.at("beta_m"), self.at("beta_n"));
                Box::new(Chiang::new(beta_m, beta_n, alpha, self.at("eta"), self.sigma_a()))
            }
        }
    }

    /// What rows of the same fibre have alike.
    fn fibre_key(&self) -> Vec<u64> {
        let of_fibre = |column: &Column| FIBRE.iter().any(|f| f.name == column.name);
        let pairs = self.columns.iter().zip(&self.values);
        pairs.filter(|(column, _)| of_fibre(column)).map(|(_, value)| value.to_bits()).collect()
    }
}

/// Reads rows from `input`, computes `function` of each and writes them to `output`.
pub fn run(
    function: Function,
    options: &Options,
    input: impl Read,
    output: impl Write,
) -> Result<()> {
    let default = if options.gpu.is_some() { Method::Fast } else { Method::Exact };
    let method = options.method.unwrap_or(default);
    ensure!(
        method != Method::Exact || options.gpu.is_none(),
        "the GPU has the renderer's methods only: give --on cpu for the exact one"
    );
    ensure!(
        match method {
            Method::Exact => true,
            Method::Fast => options.model != Bcsdf::Chiang,
            Method::Xu => options.model == Bcsdf::Marschner,
        },
        "fast is made for marschner and deon, xu for marschner alone: give another --model, or the exact method"
    );
    ensure!(
        function != Function::Dual || method != Method::Fast,
        "fast solves for multiple scattering, and has no dual averages: give --method xu"
    );
    ensure!(
        function != Function::Dual || options.model != Bcsdf::Chiang,
        "dual takes lobes of one α and β each: give --model marschner or deon"
    );

    let mut reader =
        csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(input);
    let header = reader.headers().context("the header cannot be read")?.clone();
    let columns = columns(function, options.model, &header)?;
    let mut rows = Vec::new();
    for record in reader.records() {
        rows.push(row(function, &columns, record?)?);
    }
    let mut fibres = BTreeMap::<Vec<u64>, Vec<usize>>::new();
    for (k, row) in rows.iter().enumerate() {
        fibres.entry(row.fibre_key()).or_default().push(k);
    }
    let fibres: Vec<Vec<usize>> = fibres.into_values().collect();
    let of = |group: &[usize]| group.iter().map(|&k| &rows[k]).collect::<Vec<_>>();
    let model = options.model;
    let values: Vec<Vec<Vec<f64>>> = match method {
        Method::Exact => fibres
            .par_iter()
            .map(|group| exact(function, model, &of(group)))
            .collect::<Result<_>>()?,
        Method::Fast | Method::Xu => fibres
            .iter()
            .map(|group| renderers(function, method, options, &of(group)))
            .collect::<Result<_>>()?,
    };
    let mut ordered: Vec<(usize, Vec<f64>)> =
        fibres.into_iter().flatten().zip(values.into_iter().flatten()).collect();
    ordered.sort_by_key(|(k, _)| *k);
    for (k, values) in &ordered {
        if let Some(bad) = values.iter().position(|value| !value.is_finite()) {
            let name = results(function, method)[bad];
            bail!("line {}: {name} came out as {}", rows[*k].line, values[bad]);
        }
    }

    let mut writer = csv::Writer::from_writer(output);
    writer.write_record(header.iter().chain(results(function, method).iter().copied()))?;
    for (k, values) in ordered {
        let values: Vec<String> = values.iter().map(|value| format!("{value:.8e}")).collect();
        writer.write_record(rows[k].fields.iter().chain(values.iter().map(String::as_str)))?;
    }
    writer.flush().context("the results cannot be written")
}

/// The columns that a header names, all known and all there.
fn columns(
    function: Function,
    model: Bcsdf,
    header: &csv::StringRecord,
) -> Result<Vec<&'static Column>> {
    ensure!(
        header.iter().any(|name| !name.is_empty()),
        "the input is empty: its first line must name the columns"
    );
    let known: Vec<&Column> = PLACES
        .iter()
        .filter(|column| places(function).contains(&column.name))
        .chain(&FIBRE)
        .collect();
    let mut columns: Vec<&Column> = Vec::new();
    for name in header {
        let Some(&column) = known.iter().find(|column| column.name == name) else {
            let likeness = |column: &&&Column| {
                strsim::normalized_damerau_levenshtein(name, column.name).to_bits()
            };
            let nearest = known.iter().max_by_key(likeness).map_or("", |column| column.name);
            bail!("line 1: {} has no column '{name}'; the nearest is '{nearest}'", function.name());
        };
        ensure!(
            columns.iter().all(|other| other.name != name),
            "line 1: the column '{name}' is there twice"
        );
        columns.push(column);
    }
    let has = |name: &&str| columns.iter().any(|column| column.name == *name);
    for need in needs(function, model) {
        let there = need.split('|').any(|all| all.split(' ').all(|name| has(&name)));
        let alternatives = need.replace(' ', ", ").replace('|', " or else ");
        ensure!(there, "line 1: {} needs the column {alternatives}", function.name());
    }
    let rgb = ["sigma_a_r", "sigma_a_g", "sigma_a_b"];
    ensure!(
        !(has(&"sigma_a") && rgb.iter().any(has)),
        "line 1: the column sigma_a is grey absorption: leave it out, or sigma_a_r, _g and _b"
    );
    Ok(columns)
}

/// A line's values, all within their columns' ranges.
fn row<'a>(
    function: Function,
    columns: &'a [&'static Column],
    fields: csv::StringRecord,
) -> Result<Row<'a>> {
    let line = fields.position().map_or(0, csv::Position::line);
    ensure!(
        fields.len() == columns.len(),
        "line {line}: there are {} values under {} columns",
        fields.len(),
        columns.len()
    );
    let mut values = Vec::with_capacity(columns.len());
    for (Column { name, low, high, unit }, field) in columns.iter().zip(&fields) {
        let value: f64 = field.parse().ok().with_context(|| {
            format!("line {line}, column {name}: '{}' is no number", field.escape_debug())
        })?;
        ensure!(
            (*low..=*high).contains(&value),
            "line {line}, column {name}: {field} is not within {low} to {high} ({unit})"
        );
        values.push(value);
    }
    let row = Row { columns, line, fields, values };
    let [r, g, b] = row.sigma_a();
    ensure!(
        function == Function::Bcsdf || (r == g && r == b),
        "line {line}, column {}: {} is grey: make it equal to sigma_a_r, or give sigma_a",
        if r == g { "sigma_a_b" } else { "sigma_a_g" },
        function.name()
    );
    Ok(row)
}

/// The reference's results for rows of one fibre.
fn exact(function: Function, model: Bcsdf, rows: &[&Row]) -> Result<Vec<Vec<f64>>> {
    let Some(first) = rows.first() else { return Ok(Vec::new()) };
    let fibre = first.model(model);
    rows.par_iter()
        .map(|row| match function {
            Function::Bcsdf => exact_bcsdf(&*fibre, row),
            Function::Srbf => exact_srbf(&*fibre, row),
            Function::Dual => Ok(exact_dual(&*fibre, row)),
        })
        .collect()
}

fn exact_bcsdf(fibre: &dyn FibreModel, row: &Row) -> Result<Vec<f64>> {
    let (o, i) = (row.direction("theta_o", "phi_o"), row.direction("theta_i", "phi_i"));
    if fibre.near_field() {
        let value = fibre.evaluate(&o, &i, row.at("h"));
        return Ok([value.f_cos.as_slice(), &[value.pdf]].concat());
    }
    let pdf = far_field_pdf(fibre, &o, &i);
    ensure!(pdf.excess <= 1.0, "line {}: the mean of pdf over h does not converge", row.line);
    Ok([fibre.f_cos(&o, &i).as_slice(), &pdf.value].concat())
}

fn exact_srbf(fibre: &dyn FibreModel, row: &Row) -> Result<Vec<f64>> {
    let o = row.direction("theta_o", "phi_o");
    let j = row.direction("theta_j", "phi_j");
    let light = Light { theta: j.theta(), phi: j.phi, lambda: row.at("lambda_j") };
    (0..3)
        .map(|p| {
            let integral = srbf_integral(fibre, p, &o, &light);
            ensure!(
                integral.excess <= 1.0,
                "line {}: the integral of lobe {p} ends {:.0e} times off its promised error",
                row.line,
                integral.excess
            );
            Ok(integral.value[0])
        })
        .collect()
}

fn exact_dual(fibre: &dyn FibreModel, row: &Row) -> Vec<f64> {
    let Fibre { alpha, beta, .. } = row.fibre();
    let mut shape: Vec<(f64, f64)> = alpha.into_iter().zip(beta).collect();
    // Lobes past TRT have its width and no shift.
    shape.resize(fibre.lobes(), (0.0, beta[2]));
    let a = averages(fibre, &shape, row.at("theta").clamp(-FRAC_PI_2, FRAC_PI_2));
    let all =
        [a.a_f, a.a_b, a.alpha_f, a.alpha_b, a.beta_f, a.beta_b, a.big_a_b, a.delta_b, a.sigma_b];
    all.map(|rgb| rgb[0]).to_vec()
}

/// The renderer's results for rows of one fibre.
fn renderers(
    function: Function,
    method: Method,
    options: &Options,
    rows: &[&Row],
) -> Result<Vec<Vec<f64>>> {
    let Some(first) = rows.first() else { return Ok(Vec::new()) };
    let quantity = match function {
        Function::Bcsdf | Function::Srbf => Quantity::SingleScattering,
        Function::Dual => Quantity::Averages,
    };
    let mut fibre = first.fibre();
    let integrator = match (method, options.model) {
        (Method::Xu, _) => Integrator::Xu,
        (_, Bcsdf::Deon) => {
            fibre.w_c = SQRT_2 * first.beta_n();
            Integrator::Fast(Model::Deon)
        }
        _ => Integrator::Fast(Model::Marschner),
    };
    let request = Request { quantity, integrator };
    let inputs: Vec<[f64; 8]> = rows.iter().map(|row| input_of(function, row)).collect();
    let outputs: Vec<[f64; 12]> = match options.gpu {
        Some(gpu) => {
            let inputs: Vec<_> = inputs.iter().map(|x| x.map(|x| x as f32)).collect();
            let outputs = gpu(&fibre, request, &inputs)?;
            outputs.into_iter().map(|y| y.map(f64::from)).collect()
        }
        None => request.twins(&fibre, &inputs),
    };
    let count = results(function, method).len();
    Ok(outputs.iter().map(|y| output_of(function, y)[..count].to_vec()).collect())
}

fn input_of(function: Function, row: &Row) -> [f64; 8] {
    let single = |j: Direction, lambda_j| {
        let o = row.direction("theta_o", "phi_o");
        let (apart, sum) = (wrap(o.phi - j.phi), (o.phi + j.phi).cos());
        [o.theta(), j.theta(), apart, sum, lambda_j, 0.0, 0.0, 0.0]
    };
    match function {
        Function::Bcsdf => single(row.direction("theta_i", "phi_i"), NARROW),
        Function::Srbf => single(row.direction("theta_j", "phi_j"), row.at("lambda_j")),
        Function::Dual => [row.at("theta"), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    }
}

fn output_of(function: Function, y: &[f64; 12]) -> Vec<f64> {
    match function {
        Function::Bcsdf => {
            let energy = gaussian::srbf_integral(NARROW);
            (0..3).map(|c| (0..4).map(|p| y[3 * p + c]).sum::<f64>() / energy).collect()
        }
        Function::Srbf => vec![y[0], y[3], y[6]],
        // From bandwidths and shifts of θ_i+θ_o to standard deviations and shifts of θ_h.
        Function::Dual => {
            vec![y[0], y[1], (0.125 * y[2]).sqrt(), y[3], 0.5 * y[4], y[5] / (2.0 * SQRT_2)]
        }
    }
}

//! Error and time of one evaluation of ∫G_j S_t cosθ_i dω: the renderer's WGSL in f32 against adaptive quadrature
//! in f64 (reference/integral.rs).
//!
//! Over every combination of η, β_R, λ_j and σ_a the relative L2 error √(Σw(x−x̂)²/Σwx̂²) is that of θ_o and θ_j in
//! ±75° and all φ, by points of low discrepancy, most of them where the lobe meets the light, which the weights w
//! undo. One set for all methods of a model.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::f64::consts::{PI, TAU};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::Serialize;

use super::Effort;
use super::method::{BASELINE, Method, table_bytes};
use super::statistics::{Spread, rms};
use crate::gpu::Gpu;
use crate::gpu::method::MethodData;
use crate::gpu::probe::{INPUTS, OUTPUTS, Probe, run};
use crate::probe::{Quantity, Request};
use crate::reference::integral::{Light, srbf_integral};
use crate::reference::model::{Direction, FibreModel, Section};
use crate::scattering::azimuthal::wrap;
use crate::scattering::fibre::Fibre;
use crate::scattering::gaussian::concentration;
use crate::scattering::longitudinal::longitudinal_bandwidth;
use crate::scattering::tables::Tables;

const ETAS: [f64; 3] = [1.45, 1.55, 1.65];
const BETAS_DEG: [f64; 3] = [5.0, 7.5, 10.0];
pub const LAMBDAS: [f64; 4] = [0.1, 0.3, 0.6, 1.0];
/// σ_a, three to a fibre, as its colours.
pub const ABSORPTIONS: [[f64; 3]; 2] = [[0.0, 0.2, 0.6], [1.0, 3.0, 8.0]];
/// θ_o and θ_j.
const STEEPEST: f64 = 75.0 * PI / 180.0;
/// A lobe meets a light within so many of their common bandwidth.
const MEETING: f64 = 2.0;
/// Share of points that are spread evenly, wherever the light is.
const EVEN_SHARE: f64 = 0.25;
/// A colour's lobe counts where its norm is above this share of what a clear fibre's is.
const FAINT: f64 = 1e-6;
/// Directions of the brute-force sums.
const DIRECTIONS: [usize; 4] = [64, 256, 1024, 4096];
/// SRBF values that a sum leaves out.
const DARK: f64 = 1e-9;

const MODES: usize = 3;

/// Lights that [`WHOLE`] sums.
const WHOLE_LIGHTS: usize = 16;

/// What a frame does at a point: all scattering of [`WHOLE_LIGHTS`] lights around the fibre, of each of which T̃ =
/// e^−1 arrives, what lights share once, and where the method takes it from there the light along 48 ordinates.
const WHOLE: &str = "let known = TransmittanceMoments(exp(-1.0), exp(-0.25), 1.0, 0.6);
    let strand = strand_at(fibre, x[0].x);
    var total = vec3f();
    for (var j = 0u; j < select(16u + 48u, 16u, FORWARD); j++) {
        let lambda = select(0.36, x[1].x, j < 16u);
        let arrival = Arrival(x[0].y, wrap(x[0].z + 0.3 * f32(j)), x[0].w, lambda, srbf_integral(lambda), vec3f(1.0),
            0.001, known, vec3f());
        total += light_scattering(fibre, strand, arrival, SINGLE | GLOBAL | LOCAL);
    }
    y[0] = vec4f(total, 0.0);
    y[1] = vec4f();
    y[2] = vec4f();";

/// How far a mode's integrals are from the exact ones: rms and worst of the relative L2 errors of combinations.
#[derive(Clone, Debug, Serialize)]
pub struct ModeError {
    pub rms: f64,
    pub worst: f64,
    /// The combination of the worst.
    pub worst_at: String,
    /// rms for each σ_a; null where the lobe is too faint to be judged.
    pub by_absorption: Vec<Option<f64>>,
    /// rms for each λ_j.
    pub by_bandwidth: Vec<f64>,
}

/// One method.
#[derive(Clone, Debug, Serialize)]
pub struct IntegralRow {
    pub method: String,
    pub nodes: u32,
    pub table_bytes: usize,
    /// R, TT, TRT.
    pub modes: [ModeError; MODES],
    /// Nanoseconds of one single-scattering evaluation, all modes, on the whole adapter.
    pub single_ns: Spread,
    /// All that a light costs a point of a frame: single and multiple scattering.
    pub whole_ns: Spread,
    /// Of the baseline's in the same round.
    pub single_ratio: Spread,
    pub whole_ratio: Spread,
}

/// Sums over N directions.
#[derive(Clone, Debug, Serialize)]
pub struct BruteRow {
    pub directions: usize,
    /// rms for R, TT, TRT, for the fibres in the middle of the grid.
    pub modes: [f64; MODES],
    /// N times one evaluation of the far-field model by one thread of the CPU.
    pub cpu_ns: f64,
}

/// What the integrals' part found.
#[derive(Clone, Debug, Serialize)]
pub struct Integrals {
    /// Integrals of each mode.
    pub evaluations: usize,
    /// Tuples of each timed run.
    pub timed: usize,
    pub rows: Vec<IntegralRow>,
    pub brute_force: Vec<BruteRow>,
}

/// A fibre and light of the grid.
#[derive(Clone, Copy)]
struct Combination {
    fibre: usize,
    lambda: usize,
    mode: usize,
}

#[derive(Clone, Copy)]
struct Point {
    theta_o: f64,
    theta_j: f64,
    /// φ_o − φ_j.
    phi: f64,
    weight: f64,
}

impl Point {
    fn input(&self, lambda: f64) -> [f32; INPUTS] {
        [self.theta_o, self.theta_j, self.phi, 1.0, lambda, 0.0, 0.0, 0.0].map(|x| x as f32)
    }

    fn viewer(&self) -> Direction {
        Direction::new(self.theta_o, 0.0)
    }

    fn light(&self, lambda: f64) -> Light {
        Light { theta: self.theta_j, phi: -self.phi, lambda }
    }
}

/// The fibres of the grid, each with three absorptions.
fn fibres() -> Vec<Fibre> {
    let mut fibres = Vec::new();
    for sigma_a in ABSORPTIONS {
        for eta in ETAS {
            for beta in BETAS_DEG {
                fibres.push(Fibre {
                    eta,
                    sigma_a,
                    alpha: [-7.5, 3.75, 11.25].map(f64::to_radians),
                    beta: [beta, 0.5 * beta, 2.0 * beta].map(f64::to_radians),
                    w_c: 0.2,
                    eccentricity: 1.0,
                    tint: Fibre::UNTINTED,
                });
            }
        }
    }
    fibres
}

/// The set of points with its exact values.
pub struct Set {
    fibres: Vec<Fibre>,
    combinations: Vec<Combination>,
    /// By combination.
    points: Vec<Vec<Point>>,
    exact: Vec<Vec<[f64; 3]>>,
}

impl Set {
    /// `count` points a combination, the exact values by `method`'s model. None when cancelled.
    pub fn new(
        method: &Method,
        count: usize,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Option<Set> {
        let fibres = fibres();
        let mut combinations = Vec::new();
        for fibre in 0..fibres.len() {
            for lambda in 0..LAMBDAS.len() {
                combinations.extend((0..MODES).map(|mode| Combination { fibre, lambda, mode }));
            }
        }
        let points: Vec<Vec<Point>> = combinations
            .iter()
            .map(|c| {
                // Absorptions of one fibre share points, so that their norms can be compared.
                let place = c.fibre % (ETAS.len() * BETAS_DEG.len());
                let first = ((place * LAMBDAS.len() + c.lambda) * MODES + c.mode) * count;
                (first..first + count)
                    .map(|i| point(i as u32, &fibres[c.fibre], LAMBDAS[c.lambda], c.mode))
                    .collect()
            })
            .collect();
        let models: Vec<_> = fibres.iter().map(|fibre| method.model(fibre)).collect();
        let done = AtomicUsize::new(0);
        let exact: Option<Vec<Vec<[f64; 3]>>> = combinations
            .par_iter()
            .zip(&points)
            .map(|(c, points)| {
                let values = points
                    .iter()
                    .map(|point| {
                        let light = point.light(LAMBDAS[c.lambda]);
                        srbf_integral(&*models[c.fibre], c.mode, &point.viewer(), &light).value
                    })
                    .collect();
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(done as f32 / combinations.len() as f32).then_some(values)
            })
            .collect();
        exact.map(|exact| Set { fibres, combinations, points, exact })
    }

    fn evaluations(&self) -> usize {
        self.points.iter().map(Vec::len).sum::<usize>() / MODES
    }

    /// Errors of values for R, TT, TRT, `values[combination][point]`.
    fn errors(&self, values: &[Vec<[f64; 3]>]) -> [ModeError; MODES] {
        let norm = |i: usize, c: usize| {
            let squares = self.points[i].iter().zip(&self.exact[i]);
            squares.map(|(point, e)| point.weight * e[c] * e[c]).sum::<f64>()
        };
        let clear = self.combinations.len() / ABSORPTIONS.len();
        struct One {
            combination: Combination,
            absorption: usize,
            error: f64,
        }
        let mut errors = Vec::new();
        for (i, &combination) in self.combinations.iter().enumerate() {
            let set = i / clear;
            for c in 0..3 {
                let whole = norm(i, c);
                if whole <= FAINT * FAINT * norm(i % clear, 0) {
                    continue;
                }
                let apart: f64 = self.points[i]
                    .iter()
                    .zip(&self.exact[i])
                    .zip(&values[i])
                    .map(|((point, exact), value)| point.weight * (value[c] - exact[c]).powi(2))
                    .sum();
                let error = (apart / whole).sqrt();
                errors.push(One { combination, absorption: 3 * set + c, error });
            }
        }
        [0, 1, 2].map(|mode| {
            let of = |keep: &dyn Fn(&One) -> bool| {
                let kept = errors.iter().filter(|e| e.combination.mode == mode && keep(e));
                kept.map(|e| e.error).collect::<Vec<f64>>()
            };
            let mean = |errors: Vec<f64>| rms(errors.into_iter());
            let worst = errors
                .iter()
                .filter(|e| e.combination.mode == mode)
                .max_by(|a, b| a.error.total_cmp(&b.error));
            ModeError {
                rms: mean(of(&|_| true)),
                worst: worst.map_or(0.0, |w| w.error),
                worst_at: worst.map_or(String::new(), |w| {
                    let fibre = &self.fibres[w.combination.fibre];
                    format!(
                        "η {}, σ_a {}, β_R {}°, λ_j {}",
                        fibre.eta,
                        ABSORPTIONS.as_flattened()[w.absorption],
                        (fibre.beta[0].to_degrees() * 10.0).round() / 10.0,
                        LAMBDAS[w.combination.lambda]
                    )
                }),
                by_absorption: (0..ABSORPTIONS.as_flattened().len())
                    .map(|a| of(&|e| e.absorption == a))
                    .map(|errors| (!errors.is_empty()).then(|| mean(errors)))
                    .collect(),
                by_bandwidth: (0..LAMBDAS.len())
                    .map(|l| mean(of(&|e| e.combination.lambda == l)))
                    .collect(),
            }
        })
    }

    /// Errors of a method's WGSL.
    pub fn judge(&self, gpu: &Gpu, method: &Method, tables: &Tables) -> Result<[ModeError; MODES]> {
        let mut values: Vec<Vec<[f64; 3]>> = Vec::new();
        for (k, fibre) in self.fibres.iter().enumerate() {
            let of_fibre = || self.combinations.iter().zip(&self.points).filter(|c| c.0.fibre == k);
            let inputs: Vec<_> = of_fibre()
                .flat_map(|(c, points)| points.iter().map(|p| p.input(LAMBDAS[c.lambda])))
                .collect();
            let data = method.data(fibre, tables);
            let outputs = run(gpu, single_statement(&data), &data, &inputs)?;
            let mut outputs = outputs.into_iter();
            for (c, points) in of_fibre() {
                let mode = |y: [f32; OUTPUTS]| [0, 1, 2].map(|k| f64::from(y[3 * c.mode + k]));
                values.push(outputs.by_ref().take(points.len()).map(mode).collect());
            }
        }
        Ok(self.errors(&values))
    }
}

/// Point `i` of the set for one fibre, light and mode.
fn point(i: u32, fibre: &Fibre, lambda: f64, mode: usize) -> Point {
    let u = sobol_burley::sample_4d(i, 0, 0).map(f64::from);
    let theta_o = STEEPEST * (2.0 * u[0] - 1.0);
    let centre = 2.0 * fibre.alpha[mode] - theta_o;
    let width = MEETING * lambda.hypot(longitudinal_bandwidth(fibre.beta[mode]));
    let meeting = [(centre - width).max(-STEEPEST), (centre + width).min(STEEPEST)];
    let (theta_j, weight_j) = mixed([u[1], u[3]], [-STEEPEST, STEEPEST], meeting);
    // TT leaves most of the circle dark.
    let bright = if mode == 1 { [0.5 * PI, 1.5 * PI] } else { [0.0, TAU] };
    let even = (2.0 * u[2]).fract();
    let (phi, weight_phi) = mixed([u[2], even], [0.0, TAU], bright);
    Point { theta_o, theta_j, phi: wrap(phi), weight: weight_j * weight_phi }
}

/// A value that is even over `all` by [`EVEN_SHARE`] of the time and else over `part` of it, and the inverse of its
/// density.
fn mixed(u: [f64; 2], all: [f64; 2], part: [f64; 2]) -> (f64, f64) {
    let length = |[low, high]: [f64; 2]| high - low;
    if length(part) <= 0.0 {
        return (all[0] + u[1] * length(all), length(all));
    }
    let range = if u[0] < EVEN_SHARE { all } else { part };
    let x = range[0] + u[1] * length(range);
    let inside = (part[0]..=part[1]).contains(&x);
    let among = if inside { (1.0 - EVEN_SHARE) / length(part) } else { 0.0 };
    (x, (EVEN_SHARE / length(all) + among).recip())
}

/// Measures all methods.
pub fn measure(
    gpu: &Gpu,
    methods: &[Method],
    effort: &Effort,
    tables: &Tables,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<Integrals> {
    let part = |from: f32, to: f32| move |done: f32| progress(from + done * (to - from));
    let mut sets = BTreeMap::new();
    for method in methods {
        if let Entry::Vacant(place) = sets.entry(method.exact) {
            let Some(set) = Set::new(method, effort.points, &part(0.0, 0.6)) else {
                bail!("cancelled")
            };
            place.insert(set);
        }
    }
    let set_of = |method: &Method| &sets[&method.exact];
    let timed = |what, progress: &dyn Fn(f32) -> bool| {
        time(gpu, methods, tables, what, set_of(&methods[0]), effort, progress)
    };
    let single = timed((single_statement, 1), &part(0.6, 0.7))?;
    let whole = timed((|_| WHOLE, WHOLE_LIGHTS), &part(0.7, 0.8))?;
    let mut rows = Vec::new();
    for (k, method) in methods.iter().enumerate() {
        let set = set_of(method);
        let ratio = |times: &[Vec<f64>]| {
            let base = &times[BASELINE.min(methods.len() - 1)];
            Spread::of(&times[k].iter().zip(base).map(|(a, b)| a / b).collect::<Vec<_>>())
        };
        rows.push(IntegralRow {
            method: method.label(),
            nodes: method.nodes,
            table_bytes: table_bytes(&method.data(&set.fibres[0], tables)),
            modes: set.judge(gpu, method, tables)?,
            single_ns: Spread::of(&single[k]),
            whole_ns: Spread::of(&whole[k]),
            single_ratio: ratio(&single),
            whole_ratio: ratio(&whole),
        });
        if !progress(0.8 + 0.1 * k as f32 / methods.len() as f32) {
            bail!("cancelled");
        }
    }
    let set = set_of(&methods[0]);
    let Some(brute_force) = brute_force(&methods[0], set, &part(0.9, 1.0)) else {
        bail!("cancelled")
    };
    Ok(Integrals { evaluations: set.evaluations(), timed: effort.timed, rows, brute_force })
}

fn single_statement(data: &MethodData) -> &'static str {
    Request { quantity: Quantity::SingleScattering, integrator: data.integrator }.statement()
}

/// Nanoseconds of `statement` for each of the `lights` that an item sums, method by method and round by round, all
/// methods in each round.
fn time(
    gpu: &Gpu,
    methods: &[Method],
    tables: &Tables,
    (statement, lights): (fn(&MethodData) -> &'static str, usize),
    set: &Set,
    effort: &Effort,
    progress: &dyn Fn(f32) -> bool,
) -> Result<Vec<Vec<f64>>> {
    // A fibre in the middle of the grid; neighbours on the GPU are neighbours in the set.
    let fibre = &set.fibres[ETAS.len() * BETAS_DEG.len() / 2];
    let inputs: Vec<[f32; INPUTS]> = set
        .combinations
        .iter()
        .zip(&set.points)
        .flat_map(|(c, points)| points.iter().map(|p| p.input(LAMBDAS[c.lambda])))
        .cycle()
        .take((effort.timed / lights).max(1))
        .collect();
    let data: Vec<_> = methods.iter().map(|method| method.data(fibre, tables)).collect();
    let probes: Vec<Probe> = data
        .iter()
        .map(|data| Probe::new(gpu, statement(data), data, &inputs))
        .collect::<Result<_>>()?;
    let mut times = vec![Vec::new(); methods.len()];
    for round in 0..=effort.rounds {
        for (probe, times) in probes.iter().zip(&mut times) {
            let begun = Instant::now();
            probe.dispatch();
            gpu.wait()?;
            // The first round warms up.
            if round > 0 {
                let evaluations = (lights * inputs.len()) as f64;
                times.push(1e9 * begun.elapsed().as_secs_f64() / evaluations);
            }
        }
        if !progress(round as f32 / effort.rounds as f32) {
            bail!("cancelled");
        }
    }
    Ok(times)
}

/// Sums of G_j S_t cosθ_i over Fibonacci directions, for the fibres in the middle of the grid.
fn brute_force(
    method: &Method,
    set: &Set,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<Vec<BruteRow>> {
    let models: Vec<_> = set.fibres.iter().map(|fibre| method.model(fibre)).collect();
    let grid = ETAS.len() * BETAS_DEG.len();
    let middle = |i: &usize| set.combinations[*i].fibre % grid == grid / 2;
    let kept: Vec<usize> = (0..set.combinations.len()).filter(middle).collect();
    let part = Set {
        fibres: set.fibres.clone(),
        combinations: kept.iter().map(|&i| set.combinations[i]).collect(),
        points: kept.iter().map(|&i| set.points[i].clone()).collect(),
        exact: kept.iter().map(|&i| set.exact[i].clone()).collect(),
    };
    let evaluation_ns = evaluation_ns(&*models[0], &part);
    DIRECTIONS
        .iter()
        .enumerate()
        .map(|(k, &directions)| {
            let lattice = fibonacci(directions);
            let values: Vec<Vec<[f64; 3]>> = part
                .combinations
                .par_iter()
                .zip(&part.points)
                .map(|(c, points)| {
                    let lambda = LAMBDAS[c.lambda];
                    points
                        .iter()
                        .map(|p| sum(&*models[c.fibre], c.mode, p, lambda, &lattice))
                        .collect()
                })
                .collect();
            let row = BruteRow {
                directions,
                modes: part.errors(&values).map(|mode| mode.rms),
                cpu_ns: directions as f64 * evaluation_ns,
            };
            progress((k + 1) as f32 / DIRECTIONS.len() as f32).then_some(row)
        })
        .collect()
}

/// Directions of equal solid angle on a golden spiral about the fibre.
fn fibonacci(count: usize) -> Vec<Direction> {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|k| {
            let sin_theta = 1.0 - (2 * k + 1) as f64 / count as f64;
            Direction::new(sin_theta.asin(), wrap(golden * k as f64))
        })
        .collect()
}

fn sum(
    model: &dyn FibreModel,
    p: usize,
    point: &Point,
    lambda: f64,
    lattice: &[Direction],
) -> [f64; 3] {
    let o = point.viewer();
    let light = point.light(lambda);
    let towards = Direction::new(light.theta, light.phi).vector();
    let share = 2.0 * TAU / lattice.len() as f64;
    let mut total = [0.0; 3];
    for i in lattice {
        let g = (-0.5 * concentration(lambda) * (i.vector() - towards).length_squared()).exp();
        if g > DARK {
            let section = Section { theta_i: i.theta(), theta_o: o.theta(), phi_h: 0.0 };
            let m = g * share * model.longitudinal(p, i.theta(), o.theta());
            let n = model.azimuthal(p, wrap(i.phi - o.phi), &section);
            total = [0, 1, 2].map(|c| total[c] + m * n[c]);
        }
    }
    total
}

/// Time of one far-field evaluation, the median over the part's points.
fn evaluation_ns(model: &dyn FibreModel, part: &Set) -> f64 {
    let lattice = fibonacci(16);
    let times: Vec<f64> = part
        .points
        .iter()
        .flatten()
        .take(64)
        .map(|point| {
            let begun = Instant::now();
            let total: f64 = lattice.iter().map(|i| model.f_cos(&point.viewer(), i)[0]).sum();
            std::hint::black_box(total);
            1e9 * begun.elapsed().as_secs_f64() / lattice.len() as f64
        })
        .collect();
    Spread::of(&times).median
}

//! P_t, the azimuthal part of a mode seen by an SRBF light, as a table that knows η alone.
//!
//! The inner integral of Xu 2011, Eq 11, over a light of concentration κ = 2 cosθ_i cosθ_j/λ_j² is
//!
//! > ∫g^c(φ_i−φ_j; κ) N_t dφ_i = 2π I₀e(κ) · P_t,  P_t(φ; θ_d, κ) = ½∫_{−1}^{1} A_t(h) D(φ − Φ_t(h); κ) dh
//!
//! with D the circular Gaussian of unit integral: N_t with its caustic blurred by the light (d'Eon 2011, Eq 10,
//! with the light as detector). So one table serves R, TT, TRT and TRRT of Marschner's and of d'Eon's model:
//! - **A blur of the model's own** joins the light's: mean cosines multiply under convolution, so 1 − ⟨cos⟩ is
//!   the width here ([`deficit`], [`joined`]), exact in the first harmonic.
//! - **Absorption is no axis.** T^p = e^{−xc}, with x = 2pσ_a/cosθ_t and c = cosγ_t in [c_0, 1], c_0 = √(1−1/η′²),
//!   is e^{−xc} ≈ Σ ℓ_i(u) e^{−x c_i}, u = (c−c_0)/(1−c_0), for four fixed c_i: an entry holds the integrals of
//!   A_t without T against ℓ_i, and [`transmitted`] sums them with two exponentials a channel. ℓ_i are fitted by
//!   least squares over x(1−c_0) ≤ 9, which σ_a = 3 reaches in TRT.
//!
//! Axes: cosθ_d, in which Fresnel and 1/η′ are smooth down to grazing; φ, finer where a mode varies most;
//! (1−⟨cos⟩)^¼. Tetrahedra interpolate, four loads instead of eight, their long edge along the way of the caustic.
//! The entries are made from cosine series, in which a light is a factor I_k/I₀(κ), and are the least-squares
//! values of that interpolant instead of samples, which halves the error.
//!
//! Relative L2 error over φ and θ_d ≤ 80° against exact quadrature, in per cent, rms / worst over η 1.45, 1.55,
//! 1.65, cosθ_i cosθ_j 1 and ¼, own blur w_c 0 and 0.1 (R, TT) or 0.1 and 0.2 (TRT, TRRT):
//!
//! | | λ_j 0.1–1, σ_a ≤ 3 | λ_j 0.003, σ_a ≤ 3 | λ_j 0.1–1, σ_a 8 |
//! | --- | --- | --- | --- |
//! | R | 0.15 / 0.20 | 0.45 / 0.67 | |
//! | TT | 0.20 / 0.47 | 0.19 / 0.35 | 0.37 / 0.64 |
//! | TRT | 0.39 / 0.83 | 1.1 / 1.8 | 0.43 / 0.74 |
//! | TRRT | 1.4 / 5.2 | 2.5 / 4.5 | 2.0 / 5.7 |
//!
//! At σ_a = 20 TT is 2.9 / 7.9 off and TRT 10 / 23, of values below 1e-13. 397 KB and 30 ms of one core's time an
//! η. On lavapipe a look-up with absorption and 2π I₀e takes 22 ns (R) or 43 ns (TT, TRT) of a core, where xu's
//! inner integrals take 41, 33 and 67.
//!
//! E_t = ∫N_t dφ and the energy of all longer paths have the same form: within 0.2 and 0.4 % of what a clear fibre
//! gives.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

use half::f16;
use rayon::prelude::*;

use super::{
    azimuthal::exit_azimuth, fresnel::fresnel, gaussian::bessel_steps, quadrature::GaussLegendre,
    tables::place,
};

/// Numbers of an entry.
const WEIGHTS: usize = 4;

/// u of the four c_i: 0.04 + 0.22·{0, 1, 3, 4}.
const FIRST_NODE: f64 = 0.04;
const NODE_STEP: f64 = 0.22;
const POWERS: [i32; WEIGHTS] = [0, 1, 3, 4];

/// p of the lobe that stands for all longer paths.
const REST: u32 = 4;

/// σ of the narrowest layer, radians: less counts as this much.
const WIDTH_MIN: f64 = 0.03;

/// Cosines of a series: the next has a factor of 1e-5 in the narrowest layer.
const ORDERS: usize = 160;

/// The rule over γ = asin h in [0, π/2]: panels of 16 nodes, which resolve the highest cosine.
const PANELS: usize = 9;
const NODES: usize = 16;

/// A lobe of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    R,
    Tt,
    Trt,
    Trrt,
}

impl Mode {
    pub const ALL: [Self; 4] = [Self::R, Self::Tt, Self::Trt, Self::Trrt];

    /// Crossings of the fibre, p.
    pub fn crossings(self) -> u32 {
        self as u32
    }

    /// `AZIMUTH_R` … `AZIMUTH_TRRT` of the shader, but that an R there holds two columns at two layers.
    const fn grid(self) -> Grid {
        match self {
            Self::R => Grid { rows: 20, columns: 24, layers: 10, fine: 0.3, from_pi: true },
            Self::Tt => Grid { rows: 20, columns: 32, layers: 14, fine: 1.0, from_pi: true },
            Self::Trt => Grid { rows: 32, columns: 40, layers: 16, fine: 0.3, from_pi: false },
            Self::Trrt => Grid { rows: 28, columns: 40, layers: 12, fine: 1.0, from_pi: true },
        }
    }

    /// Index of the mode's first entry within one η.
    const fn first(self) -> usize {
        let mut sum = 0;
        let mut mode = 0;
        while mode < self as usize {
            sum += Self::ALL[mode].entries();
            mode += 1;
        }
        sum
    }

    const fn entries(self) -> usize {
        let grid = self.grid();
        match self {
            Self::R => grid.rows * (grid.columns - 1) * (grid.layers - 1),
            _ => grid.rows * grid.columns * grid.layers,
        }
    }
}

/// A mode's samples: `[layer][row][column]` over (width, cosθ_d, |φ|).
#[derive(Clone, Copy, Debug)]
struct Grid {
    rows: usize,
    columns: usize,
    layers: usize,
    /// dφ/du at the fine end of the columns, as a share of their mean.
    fine: f64,
    /// The fine end is φ = π.
    from_pi: bool,
}

impl Grid {
    /// φ of u in [0, 1].
    fn phi_of(&self, u: f64) -> f64 {
        let x = u * (self.fine + (1.0 - self.fine) * u);
        PI * if self.from_pi { 1.0 - x } else { x }
    }

    /// The inverse of [`Self::phi_of`].
    fn u_of(&self, phi: f64) -> f64 {
        let x = (phi.abs() / PI).min(1.0);
        let x = if self.from_pi { 1.0 - x } else { x };
        2.0 * x / (self.fine + (self.fine * self.fine + 4.0 * (1.0 - self.fine) * x).sqrt())
    }
}

/// The energies' part: `[row][entry]` over cosθ_d: E_t for each mode, then the rest's E.
const ENERGY_ROWS: usize = 64;
const ENERGY_SIZE: usize = Mode::ALL.len() + 1;
const ENERGY_FIRST: usize = Mode::Trrt.first() + Mode::Trrt.entries();

/// D̃(κ) ≈ 1 − I₁(κ)/I₀(κ) = 1 − ⟨cos⟩ of a circular Gaussian, relative error below 0.6 %: the width by which
/// the table is read. σ²/2 where that is small, in (0, 1].
pub fn deficit(kappa: f64) -> f64 {
    let k2 = kappa * kappa;
    let q = (2.25 + 0.15 * k2) / (1.0 + 0.2 * k2);
    let root = (k2 + q).sqrt();
    (0.5 + q / (root + kappa)) / (0.5 + root)
}

/// 1 − ⟨cos⟩ of a wrapped Gaussian of standard deviation σ.
pub fn wrapped_deficit(sigma: f64) -> f64 {
    -(-0.5 * sigma * sigma).exp_m1()
}

/// The deficit of one blur after another.
pub fn joined(a: f64, b: f64) -> f64 {
    a + b - a * b
}

/// κ of a [`deficit`] in (0, 1]: 0 at 1.
fn concentration_of_deficit(d: f64) -> f64 {
    if d >= deficit(0.0) {
        return 0.0;
    }
    let (mut low, mut high) = (-40f64, 40f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if deficit(middle.exp()) > d { &mut low } else { &mut high }) = middle;
    }
    (0.5 * (low + high)).exp()
}

/// `AZIMUTH_LAYER_FIRST` of the shader: D̃^¼ of the narrowest layer.
fn layer_first() -> f64 {
    (0.5 * WIDTH_MIN * WIDTH_MIN).sqrt().sqrt()
}

/// The deficit at u in [0, 1] of the layers.
fn layer_to_deficit(u: f64) -> f64 {
    (layer_first() + u * (1.0 - layer_first())).powi(4)
}

/// The inverse of [`layer_to_deficit`].
fn deficit_to_layer(d: f64) -> f64 {
    (d.sqrt().sqrt() - layer_first()) / (1.0 - layer_first())
}

/// I_k/I₀(κ), k = 0 … until they are below 1e-6, by the continued fraction of I_k/I_{k−1} from its far end.
fn bessel_ratios(kappa: f64) -> Vec<f64> {
    let steps = bessel_steps(kappa, ORDERS, 2 * ORDERS - 1);
    let products = steps.iter().scan(1.0, |product, step| {
        *product *= step;
        Some(*product)
    });
    products.take_while(|&ratio| ratio > 1e-6).collect()
}

/// x of a·x = b, a symmetric and positive definite.
fn solve(mut a: [[f64; WEIGHTS]; WEIGHTS], mut b: [f64; WEIGHTS]) -> [f64; WEIGHTS] {
    for k in 0..WEIGHTS {
        let (pivot, right) = (a[k], b[k]);
        for row in k + 1..WEIGHTS {
            let f = a[row][k] / pivot[k];
            a[row] = std::array::from_fn(|column| a[row][column] - f * pivot[column]);
            b[row] -= f * right;
        }
    }
    for k in (0..WEIGHTS).rev() {
        let known: f64 = (k + 1..WEIGHTS).map(|column| a[k][column] * b[column]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    b
}

/// Least squares: the four factors of `functions` that come nearest to `goal` over weighted samples
/// (functions, goal, weight).
fn least_squares(samples: impl Iterator<Item = ([f64; WEIGHTS], f64, f64)>) -> [f64; WEIGHTS] {
    let (mut gram, mut right) = ([[0.0; WEIGHTS]; WEIGHTS], [0.0; WEIGHTS]);
    for (functions, goal, weight) in samples {
        for i in 0..WEIGHTS {
            for j in 0..WEIGHTS {
                gram[i][j] += weight * functions[i] * functions[j];
            }
            right[i] += weight * functions[i] * goal;
        }
    }
    solve(gram, right)
}

/// ℓ_i(u) over u in [0, 1].
static BASIS: LazyLock<Vec<[f64; WEIGHTS]>> = LazyLock::new(|| {
    const ROWS: usize = 257;
    // y = x(1−c_0): clear fibres exactly, then to 9, where what is left of a lobe grows as y^{−3/2}.
    let step = (9f64 / 0.05).ln() / 39.0;
    let samples: Vec<(f64, f64)> = (0..40)
        .map(|k| 0.05 * (step * f64::from(k)).exp())
        .map(|y| (y, (1.0 + y).powf(1.5)))
        .chain([(0.0, 4e4)])
        .collect();
    (0..ROWS)
        .map(|row| {
            let u = row as f64 / (ROWS - 1) as f64;
            least_squares(samples.iter().map(|&(y, weight)| {
                let nodes = POWERS.map(|k| (-y * (FIRST_NODE + NODE_STEP * f64::from(k))).exp());
                (nodes, (-y * u).exp(), weight)
            }))
        })
        .collect()
});

/// Linear between neighbours of a row of entries.
fn mix(a: [f64; WEIGHTS], b: [f64; WEIGHTS], f: f64) -> [f64; WEIGHTS] {
    std::array::from_fn(|i| a[i] + f * (b[i] - a[i]))
}

/// A cross section at one θ_d.
#[derive(Clone, Copy)]
struct Slice {
    eta: f64,
    cos: f64,
    /// 1/η′.
    q: f64,
    c_0: f64,
    /// 2/cosθ_t.
    chord: f64,
}

impl Slice {
    fn new(eta: f64, cos: f64) -> Self {
        let edge = (eta * eta - 1.0).max(1e-6);
        let g = (edge + cos * cos).sqrt().recip();
        Self { eta, cos, q: (cos * g).min(1.0), c_0: edge.sqrt() * g, chord: 2.0 * eta * g }
    }

    /// x c_i of one crossing per unit of σ_a: (that of i = 0, the step).
    fn absorption(&self) -> (f64, f64) {
        let span = 1.0 - self.c_0;
        (self.chord * (self.c_0 + FIRST_NODE * span), self.chord * NODE_STEP * span)
    }

    /// The same for the rest of the series: about T⁴, a crossing more a step.
    fn rest_absorption(&self) -> (f64, f64) {
        let crossing = 0.5 * self.chord * (1.0 + self.c_0);
        (f64::from(REST) * crossing, crossing)
    }
}

/// γ, what A_t shares between modes there, and a weight that includes cosγ.
struct Offset {
    gamma: f64,
    weight: f64,
    fresnel: f64,
    /// cosγ_t.
    c: f64,
    basis: [f64; WEIGHTS],
}

fn offsets(rule: &GaussLegendre, slice: &Slice) -> Vec<Offset> {
    let step = FRAC_PI_2 / PANELS as f64;
    let panels = (0..PANELS).map(|panel| step * panel as f64);
    panels
        .flat_map(|a| rule.on(a, a + step))
        .map(|(gamma, weight)| {
            let (sin, cos) = gamma.sin_cos();
            let c = (1.0 - (sin * slice.q).powi(2)).max(0.0).sqrt();
            let u = (c - slice.c_0) / (1.0 - slice.c_0).max(1e-9);
            let (low, f) = place(u, BASIS.len());
            Offset {
                gamma,
                weight: weight * cos,
                fresnel: fresnel(slice.cos * cos, slice.eta),
                c,
                basis: mix(BASIS[low], BASIS[low + 1], f),
            }
        })
        .collect()
}

/// A_t(h) dh without T against each ℓ_i.
fn attenuation(offset: &Offset, mode: Mode) -> [f64; WEIGHTS] {
    let f = offset.fresnel;
    match mode {
        Mode::R => [f * offset.weight, 0.0, 0.0, 0.0],
        _ => {
            let inside = (1.0 - f).powi(2) * f.powi(mode.crossings() as i32 - 1);
            offset.basis.map(|l| l * inside * offset.weight)
        }
    }
}

/// The first `orders` a_k of N_t = Σ_k a_k cos kφ, for each weight.
fn series(offsets: &[Offset], slice: &Slice, mode: Mode, orders: usize) -> Vec<[f64; WEIGHTS]> {
    // (a_k's integrand without its cosine, 2cosΦ, cos kΦ, cos (k−1)Φ).
    let mut nodes: Vec<_> = offsets
        .iter()
        .map(|o| {
            let cos = exit_azimuth(mode.crossings(), o.gamma, slice.q).cos();
            (attenuation(o, mode).map(|a| a / PI), 2.0 * cos, 1.0, cos)
        })
        .collect();
    (0..orders)
        .map(|k| {
            let mut sum = [0.0; WEIGHTS];
            for (weights, twice, at, before) in &mut nodes {
                for i in 0..WEIGHTS {
                    sum[i] += weights[i] * *at;
                }
                (*at, *before) = (*twice * *at - *before, *at);
            }
            if k == 0 { sum.map(|s| 0.5 * s) } else { sum }
        })
        .collect()
}

/// Σ_k factor_k a_k cos kφ at the columns; `cosines[k]` holds those of one k.
fn sum_series(
    series: &[[f64; WEIGHTS]],
    factors: &[f64],
    cosines: &[Vec<f64>],
) -> Vec<[f64; WEIGHTS]> {
    let mut sums = vec![[0.0; WEIGHTS]; cosines[0].len()];
    for ((a, factor), cosines) in series.iter().zip(factors).zip(cosines) {
        let a = a.map(|a| a * factor);
        for (sum, cos) in sums.iter_mut().zip(cosines) {
            for i in 0..WEIGHTS {
                sum[i] += a[i] * cos;
            }
        }
    }
    sums
}

/// cos kφ at the columns, `[k][column]`.
fn cosines(grid: &Grid) -> Vec<Vec<f64>> {
    let last = (grid.columns - 1) as f64;
    let phi: Vec<f64> = (0..grid.columns).map(|c| grid.phi_of(c as f64 / last)).collect();
    (0..ORDERS).map(|k| phi.iter().map(|phi| (k as f64 * phi).cos()).collect()).collect()
}

/// Turns samples along one axis into the least-squares values of their linear interpolant; an axis that is even
/// about its ends has them as well.
fn fit_linear(values: &mut [[f64; WEIGHTS]], stride: usize, count: usize, even: bool) {
    let mut line = vec![[0.0; WEIGHTS]; count];
    for start in (0..values.len()).filter(|i| i % (stride * count) < stride) {
        for (k, value) in line.iter_mut().enumerate() {
            *value = values[start + k * stride];
        }
        let ends = if even { 0..count } else { 1..count - 1 };
        for k in ends {
            let before = line[if k == 0 { 1 } else { k - 1 }];
            let after = line[if k == count - 1 { k - 1 } else { k + 1 }];
            for i in 0..WEIGHTS {
                values[start + k * stride][i] -= (before[i] - 2.0 * line[k][i] + after[i]) / 12.0;
            }
        }
    }
}

/// What [`fit_linear`] leaves out where tetrahedra interpolate: they take xy as min(x, y), 1/12 too much on
/// average.
fn fit_tetrahedra(values: &mut [[f64; WEIGHTS]], strides: [usize; 3], counts: [usize; 3]) {
    let samples = values.to_vec();
    for (i, value) in values.iter_mut().enumerate() {
        let inner = |axis: usize| {
            let k = i / strides[axis] % counts[axis];
            k > 0 && k < counts[axis] - 1
        };
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            if inner(a) && inner(b) {
                let (a, b) = (strides[a], strides[b]);
                let corners = [i + a + b, i + a - b, i + b - a, i - a - b].map(|i| samples[i]);
                for k in 0..WEIGHTS {
                    let mixed = corners[0][k] - corners[1][k] - corners[2][k] + corners[3][k];
                    value[k] -= mixed / 48.0;
                }
            }
        }
    }
}

fn pack(values: [f64; WEIGHTS]) -> [u32; 2] {
    let half = |x: f64| u32::from(f16::from_f64(x).to_bits());
    [half(values[0]) | half(values[1]) << 16, half(values[2]) | half(values[3]) << 16]
}

fn unpack(entry: [u32; 2]) -> [f64; WEIGHTS] {
    let half = |bits: u32| f16::from_bits(bits as u16).to_f64();
    [half(entry[0]), half(entry[0] >> 16), half(entry[1]), half(entry[1] >> 16)]
}

/// What a mode's builder shares between rows and η.
struct Plan {
    rule: GaussLegendre,
    /// I_k/I₀ of each layer, for each mode.
    ratios: [Vec<Vec<f64>>; 4],
    cosines: [Vec<Vec<f64>>; 4],
}

impl Plan {
    fn new() -> Self {
        let ratios = |mode: Mode| {
            let layers = mode.grid().layers;
            let of = |l| layer_to_deficit(l as f64 / (layers - 1) as f64);
            (0..layers).map(|l| bessel_ratios(concentration_of_deficit(of(l)))).collect()
        };
        Self {
            rule: GaussLegendre::new(NODES),
            ratios: Mode::ALL.map(ratios),
            cosines: Mode::ALL.map(|mode| cosines(&mode.grid())),
        }
    }

    /// `[layer][column]` of a mode, at row `row`.
    fn row(&self, eta: f64, mode: Mode, row: usize) -> Vec<Vec<[f64; WEIGHTS]>> {
        let slice = Slice::new(eta, row as f64 / (mode.grid().rows - 1) as f64);
        let series = series(&offsets(&self.rule, &slice), &slice, mode, ORDERS);
        let (ratios, cosines) = (&self.ratios[mode as usize], &self.cosines[mode as usize]);
        ratios.iter().map(|ratios| sum_series(&series, ratios, cosines)).collect()
    }

    fn mode(&self, eta: f64, mode: Mode) -> Vec<[u32; 2]> {
        let grid = mode.grid();
        let rows: Vec<_> =
            (0..grid.rows).into_par_iter().map(|row| self.row(eta, mode, row)).collect();
        let mut values: Vec<[f64; WEIGHTS]> = (0..grid.layers)
            .flat_map(|l| rows.iter().flat_map(move |row| row[l].iter().copied()))
            .collect();
        fit_linear(&mut values, 1, grid.columns, true);
        fit_linear(&mut values, grid.columns, grid.rows, false);
        fit_linear(&mut values, grid.columns * grid.rows, grid.layers, false);
        if mode != Mode::R {
            let strides = [1, grid.columns, grid.columns * grid.rows];
            let counts = [grid.columns, grid.rows, grid.layers];
            fit_tetrahedra(&mut values, strides, counts);
            return values.into_iter().map(pack).collect();
        }
        let mut packed = Vec::with_capacity(mode.entries());
        for l in 0..grid.layers - 1 {
            for row in 0..grid.rows {
                for column in 0..grid.columns - 1 {
                    let here = (l * grid.rows + row) * grid.columns + column;
                    let above = here + grid.rows * grid.columns;
                    packed.push(pack([here, here + 1, above, above + 1].map(|i| values[i][0])));
                }
            }
        }
        packed
    }

    fn energies(&self, eta: f64) -> Vec<[u32; 2]> {
        let mut rows: Vec<_> = (0..ENERGY_ROWS)
            .into_par_iter()
            .flat_map_iter(|row| {
                let slice = Slice::new(eta, row as f64 / (ENERGY_ROWS - 1) as f64);
                let offsets = offsets(&self.rule, &slice);
                let modes = Mode::ALL.map(|mode| {
                    offsets.iter().fold([0.0; WEIGHTS], |sum, o| {
                        let a = attenuation(o, mode);
                        std::array::from_fn(|i| sum[i] + a[i])
                    })
                });
                modes.into_iter().chain([rest(&offsets, &slice)]).collect::<Vec<_>>()
            })
            .collect();
        fit_linear(&mut rows, ENERGY_SIZE, ENERGY_ROWS, false);
        rows.into_iter().map(pack).collect()
    }
}

/// E of all paths p ≥ 4, Σ A_p = (1−f)² f³ T⁴/(1−fT), in the weights of [`Slice::rest_absorption`].
fn rest(offsets: &[Offset], slice: &Slice) -> [f64; WEIGHTS] {
    let (first, step) = slice.rest_absorption();
    let energy = |sigma_a: f64| -> f64 {
        offsets
            .iter()
            .map(|o| {
                let (f, t) = (o.fresnel, (-sigma_a * slice.chord * o.c).exp());
                let lost = (1.0 - f * t).max(f64::MIN_POSITIVE);
                o.weight * (1.0 - f).powi(2) * f.powi(3) * t.powi(4) / lost
            })
            .sum()
    };
    // Absorptions of up to e^{−12} in all.
    least_squares((0..25).map(|k| {
        let sigma_a = 12.0 / first * (f64::from(k) / 24.0).powi(2);
        let nodes = POWERS.map(|power| (-sigma_a * (first + step * f64::from(power))).exp());
        let scale = (sigma_a * first).exp();
        // Nothing leaves at η = 1.
        (nodes, energy(sigma_a), scale)
    }))
}

/// What four weights give for an absorption.
fn absorbed(weights: [f64; WEIGHTS], (first, step): (f64, f64), sigma_a: f64) -> f64 {
    let r = (-sigma_a * step).exp();
    let sum = weights[0] + r * weights[1] + r * r * r * (weights[2] + r * weights[3]);
    ((-sigma_a * first).exp() * sum).max(0.0)
}

/// A mode's value from its weights. `cos_theta_d` in [0, 1], σ_a per radius.
pub fn transmitted(
    weights: [f64; WEIGHTS],
    mode: Mode,
    eta: f64,
    cos_theta_d: f64,
    sigma_a: f64,
) -> f64 {
    let scale = Slice::new(eta, cos_theta_d).absorption();
    absorbed(weights, scale, sigma_a * f64::from(mode.crossings()))
}

/// The energy of the rest of the series from its weights.
pub fn transmitted_rest(weights: [f64; WEIGHTS], eta: f64, cos_theta_d: f64, sigma_a: f64) -> f64 {
    absorbed(weights, Slice::new(eta, cos_theta_d).rest_absorption(), sigma_a)
}

/// The table over one η or several.
#[derive(Clone, Debug)]
pub struct AzimuthTable {
    low: f64,
    high: f64,
    layers: usize,
    entries: Vec<[u32; 2]>,
}

impl AzimuthTable {
    /// Entries of one η.
    pub const SIZE: usize = ENERGY_FIRST + ENERGY_ROWS * ENERGY_SIZE;

    /// The table of one η ≥ 1.
    pub fn new(eta: f64) -> Self {
        Self::over(eta, eta, 1)
    }

    /// Tables at `layers` ≥ 1 indices evenly spaced from `low` ≥ 1 to `high`, for η that varies.
    pub fn over(low: f64, high: f64, layers: usize) -> Self {
        let plan = Plan::new();
        let step = (high - low) / layers.saturating_sub(1).max(1) as f64;
        let entries = (0..layers)
            .into_par_iter()
            .flat_map_iter(|layer| {
                let eta = low + step * layer as f64;
                let modes = Mode::ALL.map(|mode| plan.mode(eta, mode));
                modes.into_iter().chain([plan.energies(eta)]).flatten()
            })
            .collect();
        Self { low, high, layers, entries }
    }

    /// Four weights of P_t(φ; θ_d), 1/rad; `width` is a [`deficit`]. Interpolated as the shader does.
    pub fn azimuth(
        &self,
        mode: Mode,
        eta: f64,
        cos_theta_d: f64,
        phi: f64,
        width: f64,
    ) -> [f64; 4] {
        let grid = mode.grid();
        let (row, f_row) = place(cos_theta_d, grid.rows);
        let (column, f_column) = place(grid.u_of(phi), grid.columns);
        let (layer, f_layer) = place(deficit_to_layer(width), grid.layers);
        if mode == Mode::R {
            let columns = grid.columns - 1;
            let i = Mode::R.first() + (layer * grid.rows + row) * columns + column;
            let patch = self.at(eta, |first| {
                let entry = |i: usize| unpack(self.entries[first + i]);
                mix(entry(i), entry(i + columns), f_row)
            });
            let pair = [0, 1].map(|k| patch[k] + f_layer * (patch[k + 2] - patch[k]));
            return [pair[0] + f_column * (pair[1] - pair[0]), 0.0, 0.0, 0.0];
        }
        let first = mode.first() + (layer * grid.rows + row) * grid.columns + column;
        // The tetrahedron around the place: from the least corner to the greatest, by the axes in the order of
        // their parts of the way.
        let mut axes = [(f_column, 1), (f_row, grid.columns), (f_layer, grid.rows * grid.columns)];
        axes.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.at(eta, |eta_first| {
            let mut i = eta_first + first;
            let mut sum = unpack(self.entries[i]).map(|w| w * (1.0 - axes[0].0));
            for (k, (f, stride)) in axes.into_iter().enumerate() {
                i += stride;
                let weight = f - axes.get(k + 1).map_or(0.0, |next| next.0);
                let entry = unpack(self.entries[i]);
                sum = std::array::from_fn(|k| sum[k] + weight * entry[k]);
            }
            sum
        })
    }

    /// Four weights of E_t = ∫N_t dφ.
    pub fn energy(&self, mode: Mode, eta: f64, cos_theta_d: f64) -> [f64; 4] {
        self.energy_entry(mode as usize, eta, cos_theta_d)
    }

    /// Four weights, for [`transmitted_rest`], of the energy of all paths p ≥ 4.
    pub fn rest_energy(&self, eta: f64, cos_theta_d: f64) -> [f64; 4] {
        self.energy_entry(ENERGY_SIZE - 1, eta, cos_theta_d)
    }

    /// What the shader binds as `azimuth_table`: [`Self::SIZE`] entries an η.
    pub fn to_gpu(&self) -> &[[u32; 2]] {
        &self.entries
    }

    fn energy_entry(&self, entry: usize, eta: f64, cos_theta_d: f64) -> [f64; WEIGHTS] {
        let (row, f) = place(cos_theta_d, ENERGY_ROWS);
        let i = ENERGY_FIRST + row * ENERGY_SIZE + entry;
        self.at(eta, |first| {
            let entry = |i: usize| unpack(self.entries[first + i]);
            mix(entry(i), entry(i + ENERGY_SIZE), f)
        })
    }

    /// `of` an η's first entry, between the two nearest η.
    fn at(&self, eta: f64, of: impl Fn(usize) -> [f64; WEIGHTS]) -> [f64; WEIGHTS] {
        if self.layers == 1 {
            return of(0);
        }
        let (low, f) = place((eta - self.low) / (self.high - self.low), self.layers);
        mix(of(low * Self::SIZE), of((low + 1) * Self::SIZE), f)
    }
}

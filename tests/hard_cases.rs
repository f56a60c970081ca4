//! Hard cases of the `fast` method: f32 WGSL against its f64 twin, far beyond what a scene would ask for, and
//! fine sweeps that show no step.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

use hairlight::gpu::{Gpu, method::MethodData, probe};
use hairlight::scattering::{
    azimuth_table::AzimuthTable,
    fast::{Fast, Tables},
    fibre::Fibre,
    model::Model,
};
use rayon::prelude::*;

use super::wgsl::cpu;

/// What varies from tuple to tuple; η, w_c and the cross section belong to a batch.
#[derive(Clone, Copy, Debug)]
struct Tuple {
    theta_o: f64,
    theta_j: f64,
    phi: f64,
    cos_sum: f64,
    lambda_j: f64,
    sigma_a: f64,
    beta_r_deg: f64,
    alpha_r_deg: f64,
}

impl Tuple {
    /// What the shader is given, and the same as the twin sees it.
    fn input(&self) -> [f32; 8] {
        [
            self.theta_o,
            self.theta_j,
            self.phi,
            self.cos_sum,
            self.lambda_j,
            self.sigma_a,
            2.0 * SQRT_2 * self.beta_r_deg.to_radians(),
            self.alpha_r_deg.to_radians(),
        ]
        .map(|x| x as f32)
    }
}

/// A fibre whose modes are linked by Marschner's ratios, as the shader's statement has them.
fn fibre_of(batch: &Fibre, x: &[f32; 8]) -> Fibre {
    let (lambda, alpha) = (f64::from(x[6]), f64::from(x[7]));
    Fibre {
        sigma_a: [f64::from(x[5]); 3],
        beta: [1.0, 0.5, 2.0].map(|k| k * lambda / (2.0 * SQRT_2)),
        alpha: [1.0, -0.5, -1.5].map(|k| k * alpha),
        ..*batch
    }
}

const MODELS: [Model; 2] = [Model::Marschner, Model::Deon];

const STATEMENT: &str = "var f = fibre; f.sigma_a = vec3f(x[1].y);
    f.lambda = vec3f(1.0, 0.5, 2.0) * x[1].z; f.alpha = vec3f(1.0, -0.5, -1.5) * x[1].w;
    let m = single_scattering(f, x[0].x, x[0].y, x[0].z, x[0].w, x[1].x);
    y[0] = vec4f(m.r.x, m.tt.x, m.trt.x, m.longer.x); y[1] = vec4f(energy_compensation(f, x[0].x), 0.0);";
const NAMES: [&str; 7] = ["R", "TT", "TRT", "longer", "C_R", "C_TT", "C_TRT"];

fn twin(batch: &Fibre, model: Model, tables: &Tables, x: &[f32; 8]) -> [f64; 7] {
    let fibre = fibre_of(batch, x);
    let fast = Fast::new(&fibre, model, tables);
    let [o, j, phi, sum, lambda, ..] = x.map(f64::from);
    let m = fast.single_scattering(o, j, phi, sum, lambda);
    let c = fast.energy_compensation(o);
    [m.r[0], m.tt[0], m.trt[0], m.longer[0], c[0], c[1], c[2]]
}

/// The worst of a run: |f32 − f64| over |f64| + [`FLOOR`].
#[derive(Clone, Debug, Default)]
struct Worst {
    bad: usize,
    error: f64,
    line: String,
}

/// Values far below this, a share of a light that fills the sphere, are held in absolute terms alone.
const FLOOR: f64 = 1e-3;

fn compare(gpu: &Gpu, batch: &Fibre, model: Model, tuples: &[Tuple], worst: &mut Worst) {
    let inputs: Vec<[f32; 8]> = tuples.iter().map(Tuple::input).collect();
    let outputs =
        probe::run(gpu, STATEMENT, &MethodData::fast(batch, model, 2).as_general(), &inputs)
            .expect("runs");
    let tables = Tables::new(batch, model, 2);
    let errors: Vec<(bool, f64, usize)> = inputs
        .par_iter()
        .zip(&outputs)
        .map(|(x, got)| {
            let want = twin(batch, model, &tables, x);
            let mut most = (true, 0.0, 0);
            for (k, want) in want.into_iter().enumerate() {
                let got = f64::from(got[k]);
                let error = (got - want).abs() / (want.abs() + FLOOR);
                if !got.is_finite() || got < 0.0 || !want.is_finite() {
                    return (false, f64::INFINITY, k);
                }
                if error > most.1 {
                    most = (true, error, k);
                }
            }
            most
        })
        .collect();
    for (i, &(fine, error, k)) in errors.iter().enumerate() {
        worst.bad += usize::from(!fine);
        if error > worst.error {
            worst.error = error;
            worst.line = format!("{model:?} {} at {:?}, {batch:?}", NAMES[k], tuples[i]);
        }
    }
}

/// SplitMix64, in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) as f64 / 2f64.powi(64)
    }

    /// Log-uniform.
    fn log(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.next())
    }

    fn even(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// An inclination; one in eight within 1e-6 of a pole.
    fn theta(&mut self) -> f64 {
        let theta = self.even(-FRAC_PI_2, FRAC_PI_2);
        if self.next() < 0.125 { (FRAC_PI_2 - 1e-6 * self.next()).copysign(theta) } else { theta }
    }

    fn tuple(&mut self) -> Tuple {
        let theta_o = self.theta();
        let alpha_r_deg = self.even(-20.0, 20.0);
        let (beta_r_deg, lambda_j) = (self.log(0.05, 45.0), self.log(0.003, 3.0));
        // Half of the lights where R's lobe can see them.
        let near = 2.0 * alpha_r_deg.to_radians() - theta_o
            + 3.0 * (lambda_j + 3.0 * beta_r_deg.to_radians()) * self.even(-1.0, 1.0);
        let theta_j =
            if self.next() < 0.5 { near.clamp(-FRAC_PI_2, FRAC_PI_2) } else { self.theta() };
        Tuple {
            theta_o,
            theta_j,
            phi: self.even(-PI, PI),
            cos_sum: self.even(-1.0, 1.0),
            lambda_j,
            sigma_a: if self.next() < 0.1 { 0.0 } else { self.log(1e-3, 1e3) },
            beta_r_deg,
            alpha_r_deg,
        }
    }

    fn batch(&mut self) -> Fibre {
        let eta = match (4.0 * self.next()) as u32 {
            0 => 2.0 + 1e-7 * self.even(-1.0, 1.0),
            _ => self.even(1.0, 3.0),
        };
        let eccentricity = if self.next() < 0.5 { 1.0 } else { self.log(0.5, 2.0) };
        fibre(eta, self.log(0.01, 1.0), eccentricity)
    }
}

fn fibre(eta: f64, w_c: f64, eccentricity: f64) -> Fibre {
    let (sigma_a, tint) = ([0.0; 3], Fibre::UNTINTED);
    Fibre { eta, sigma_a, alpha: [0.0; 3], beta: [0.1; 3], w_c, eccentricity, tint }
}

/// f32 against f64 over everything at once. `HAIRLIGHT_SWEEP` is the number of tuples, ten million by hand.
#[test]
fn random_tuples_are_near_their_twin() {
    let number = |name: &str, default: u64| {
        std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
    };
    let (count, seed) = (number("HAIRLIGHT_SWEEP", 200_000), number("HAIRLIGHT_SEED", 1));
    let gpu = cpu();
    let mut random = Random(seed);
    let mut worst = Worst::default();
    let batch_size = (count / 8).clamp(1000, 500_000);
    for k in 0..count.div_ceil(batch_size) {
        let model = MODELS[k as usize % 2];
        let batch = random.batch();
        let tuples: Vec<Tuple> = (0..batch_size).map(|_| random.tuple()).collect();
        compare(&gpu, &batch, model, &tuples, &mut worst);
    }
    println!(
        "{count} tuples, seed {seed}: {} bad, worst {:.2e}, {}",
        worst.bad, worst.error, worst.line
    );
    assert_eq!(worst.bad, 0, "{}", worst.line);
    assert!(worst.error < RANDOM_BOUND, "{:.2e}, {}", worst.error, worst.line);
}

/// A light of λ_j = 0.003 and a lobe of β = 0.05° leave 2e-4 of θ's own rounding in an exponent.
const RANDOM_BOUND: f64 = 0.02;

/// Measured: 8e-4.
const NAMED_BOUND: f64 = 2e-3;

#[test]
fn named_cases_are_near_their_twin() {
    let gpu = cpu();
    let common = fibre(1.55, 0.2, 1.0);
    type Change = fn(&mut Tuple);
    let rows: [(&str, Fibre, Change); 17] = [
        ("β 0.05°", common, |t| t.beta_r_deg = 0.05),
        ("β 45°", common, |t| t.beta_r_deg = 45.0),
        ("λ_j 0.003", common, |t| t.lambda_j = 0.003),
        ("λ_j 3", common, |t| t.lambda_j = 3.0),
        ("θ_o at the pole", common, |t| t.theta_o = FRAC_PI_2.copysign(t.theta_o)),
        ("θ_o 1e-6 off it", common, |t| t.theta_o = FRAC_PI_2 - 1e-6),
        ("light at a pole", common, |t| t.theta_j = -FRAC_PI_2),
        ("parallel", common, |t| (t.theta_j, t.phi) = (t.theta_o, 0.0)),
        ("opposite", common, |t| (t.theta_j, t.phi) = (-t.theta_o, PI)),
        ("η 1", fibre(1.0, 0.2, 1.0), |_| ()),
        ("η 3", fibre(3.0, 0.2, 1.0), |_| ()),
        ("η′ at 2", fibre(2.0 - 1e-7, 0.01, 1.0), |t| t.theta_o = 0.0),
        ("σ_a 1e3", common, |t| t.sigma_a = 1e3),
        ("clear: ā_f+ā_b → 1", common, |t| t.sigma_a = 0.0),
        ("eccentricity 0.5", fibre(1.55, 0.2, 0.5), |_| ()),
        ("eccentricity 2", fibre(1.55, 0.2, 2.0), |_| ()),
        ("tilt 20°", common, |t| t.alpha_r_deg = 20.0),
    ];
    let mut failed = Vec::new();
    for (model, (name, batch, change)) in
        MODELS.into_iter().flat_map(|model| rows.map(|row| (model, row)))
    {
        let mut random = Random(7);
        let tuples: Vec<Tuple> = (0..4000)
            .map(|_| {
                let mut tuple = random.tuple();
                change(&mut tuple);
                tuple
            })
            .collect();
        let mut worst = Worst::default();
        compare(&gpu, &batch, model, &tuples, &mut worst);
        println!("{model:?}, {name}: {} bad, worst {:.1e}", worst.bad, worst.error);
        if worst.bad > 0 || worst.error > NAMED_BOUND {
            failed.push(format!("{model:?}, {name}: {worst:?}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
    // The control: a twin of another η.
    let mut random = Random(7);
    let tuples: Vec<Tuple> = (0..500).map(|_| random.tuple()).collect();
    let inputs: Vec<[f32; 8]> = tuples.iter().map(Tuple::input).collect();
    let outputs = probe::run(
        &gpu,
        STATEMENT,
        &MethodData::fast(&common, Model::Marschner, 2).as_general(),
        &inputs,
    )
    .expect("the probe runs");
    let other = fibre(1.57, 0.2, 1.0);
    let tables = Tables::new(&other, Model::Marschner, 2);
    let most = inputs
        .iter()
        .zip(&outputs)
        .map(|(x, got)| {
            let want = twin(&other, Model::Marschner, &tables, x);
            (0..NAMES.len())
                .map(|k| (f64::from(got[k]) - want[k]).abs() / (want[k] + FLOOR))
                .fold(0.0, f64::max)
        })
        .fold(0.0, f64::max);
    assert!(most > 0.02, "another η passes: {most}");
}

/// The greatest change from step to step of a fine sweep, over the greatest value of the sweep.
fn step(values: &[f64]) -> f64 {
    let most = values.iter().copied().fold(1e-12, f64::max);
    values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max) / most
}

#[test]
fn sweeps_have_no_step() {
    let base = Tuple {
        theta_o: 0.35,
        theta_j: -0.3,
        phi: 0.7,
        cos_sum: 0.3,
        lambda_j: 0.3,
        sigma_a: 0.3,
        beta_r_deg: 7.5,
        alpha_r_deg: -5.0,
    };
    const STEPS: usize = 8192;
    // A table over η, as for fibres whose η is painted.
    let layers = fibre(1.55, 0.2, 0.9);
    let azimuth = AzimuthTable::over(1.3, 2.3, 51);
    let tables = MODELS.map(|model| Tables {
        azimuth: azimuth.clone(),
        ..Tables::new(&layers, model, model.nodes() as usize)
    });
    type Set = fn(&mut Tuple, &mut Fibre, f64);
    let sweeps: [(&str, Set); 9] = [
        ("θ_o", |t, _, u| t.theta_o = 3.0 * (u - 0.5)),
        ("θ_j", |t, _, u| t.theta_j = PI * (u - 0.5)),
        ("φ", |t, _, u| t.phi = 2.0 * PI * (u - 0.5)),
        ("λ_j", |t, _, u| t.lambda_j = 0.003 * 1e3f64.powf(u)),
        ("σ_a", |t, _, u| t.sigma_a = 1e-3 * 1e6f64.powf(u)),
        ("β", |t, _, u| t.beta_r_deg = 0.05 * 900f64.powf(u)),
        ("α", |t, _, u| t.alpha_r_deg = 40.0 * (u - 0.5)),
        ("η, across η′ = 2", |_, f, u| f.eta = 1.3 + u),
        ("w_c", |_, f, u| f.w_c = 0.01 * 100f64.powf(u)),
    ];
    for (model, (name, set)) in
        MODELS.into_iter().flat_map(|model| sweeps.map(|sweep| (model, sweep)))
    {
        let tables = &tables[model as usize];
        let values: Vec<[f64; 7]> = (0..=STEPS)
            .into_par_iter()
            .map(|i| {
                let (mut tuple, mut batch) = (base, fibre(1.55, 0.2, 1.0));
                set(&mut tuple, &mut batch, i as f64 / STEPS as f64);
                twin(&batch, model, tables, &tuple.input())
            })
            .collect();
        let steps: Vec<f64> = (0..NAMES.len())
            .map(|k| step(&values.iter().map(|v| v[k]).collect::<Vec<_>>()))
            .collect();
        let most = steps.iter().copied().fold(0.0, f64::max);
        println!("{model:?}, {name}: greatest step {most:.1e} of the peak");
        assert!(most < 0.01, "{model:?}, {name}: {steps:?}");
        // The control: every eighth of the sweep is a step away from the next.
        let coarse: Vec<f64> = values.iter().step_by(STEPS / 8).map(|v| v[2].max(v[1])).collect();
        assert!(step(&coarse) > 0.01, "{name} does nothing");
    }
}

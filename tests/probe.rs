//! The probe from CSV to CSV.

use std::cell::RefCell;
use std::f64::consts::{FRAC_PI_2, TAU};

use anyhow::Result;
use hairlight::probe::{self, Function, Gpu, Method, Options, Quantity, SEGMENTS};
use hairlight::reference::{
    averages::averages,
    chiang::Chiang,
    integral::{Light, srbf_integral},
    marschner::Marschner,
    model::{Direction, FibreModel},
};
use hairlight::scattering::{
    azimuthal::Energy,
    fast::{self, Fast},
    fibre::Fibre,
    model::Model,
    quadrature::GaussLegendre,
    xu::Xu,
};
use hairlight::scene::Bcsdf;

const EXACT: Options = Options { model: Bcsdf::Marschner, method: None, gpu: None };
const FAST: Options = Options { method: Some(Method::Fast), ..EXACT };
const XU: Options = Options { method: Some(Method::Xu), ..EXACT };

/// What a run writes, and nothing beside an error.
fn run(function: Function, options: &Options, input: &str) -> Result<String> {
    let mut output = Vec::new();
    let result = probe::run(function, options, input.as_bytes(), &mut output);
    let text = String::from_utf8(output).expect("CSV is text");
    assert!(result.is_ok() || text.is_empty(), "an error after {text:?}");
    result.map(|()| text)
}

/// The header and the fields of each row.
fn parse(text: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let fields = |line: &str| line.split(',').map(str::to_owned).collect();
    let mut lines = text.lines();
    (fields(lines.next().expect("a header")), lines.map(fields).collect())
}

/// One column of the output as numbers.
fn numbers(text: &str, name: &str) -> Vec<f64> {
    let (header, rows) = parse(text);
    let k = header.iter().position(|column| column == name);
    let k = k.unwrap_or_else(|| panic!("no {name} in {header:?}"));
    rows.iter().map(|row| row[k].parse().expect("a number")).collect()
}

fn close(got: f64, want: f64) -> bool {
    (got - want).abs() <= 1e-8 * want.abs()
}

/// The fibre of [`SRBF`]'s first row.
fn fibre() -> Fibre {
    let (alpha, beta) = ((-7.5f64).to_radians(), 7.5f64.to_radians());
    Fibre {
        eta: 1.55,
        sigma_a: [0.2; 3],
        alpha: [alpha, -0.5 * alpha, -1.5 * alpha],
        beta: [beta, 0.5 * beta, 2.0 * beta],
        w_c: 0.2,
        eccentricity: 1.0,
        tint: Fibre::UNTINTED,
    }
}

const SRBF: &str = "\
theta_o,phi_o,theta_j,phi_j,lambda_j,eta,sigma_a,beta_r_deg,alpha_deg,w_c
0.3,0.1,-0.2,3.0,0.3,1.55,0.2,7.5,-7.5,0.2
0.3,0.1,-0.2,0.5,0.3,1.45,0.2,7.5,-7.5,0.2
-0.4,2.0,0.3,-1.5,1.5,1.55,0.2,7.5,-7.5,0.2
";

#[test]
fn srbf_rows_are_the_exact_integrals() {
    let text = run(Function::Srbf, &EXACT, SRBF).unwrap();
    let (header, rows) = parse(&text);
    assert_eq!(header[10..], ["m_r", "m_tt", "m_trt"]);
    // The input comes back as it was; results have nine digits.
    for (row, line) in rows.iter().zip(SRBF.lines().skip(1)) {
        assert_eq!(row[..10].join(","), line);
        for result in &row[10..] {
            let (digits, exponent) = result.split_once('e').expect("an exponent");
            assert!(digits.len() == 10 && exponent.parse::<i32>().is_ok(), "{result}");
        }
    }
    // Rows of two fibres come back in order.
    for (k, eta, o, j) in [
        (0, 1.55, (0.3, 0.1), (-0.2, 3.0, 0.3)),
        (1, 1.45, (0.3, 0.1), (-0.2, 0.5, 0.3)),
        (2, 1.55, (-0.4, 2.0), (0.3, -1.5, 1.5)),
    ] {
        let model = Marschner::new(&Fibre { eta, ..fibre() });
        let light = Light { theta: j.0, phi: j.1, lambda: j.2 };
        for (p, name) in ["m_r", "m_tt", "m_trt"].into_iter().enumerate() {
            let want = srbf_integral(&model, p, &Direction::new(o.0, o.1), &light).value[0];
            let got = numbers(&text, name)[k];
            assert!(close(got, want) && !close(got, 1.000_000_1 * want), "row {k}, {name}: {got}");
        }
    }
}

#[test]
fn columns_may_stand_in_any_order_and_take_defaults() {
    let want = run(Function::Srbf, &EXACT, SRBF).unwrap();
    // Backwards, with spaces, a BOM and what is linked or defaulted written out.
    let turned = "\u{feff}\
alpha_trt_deg, alpha_tt_deg,alpha_r_deg,beta_trt_deg,beta_tt_deg,beta_r_deg,eccentricity,beta_n_deg,\
sigma_a_b,sigma_a_g,sigma_a_r,eta,lambda_j,phi_j,theta_j,phi_o,theta_o
11.25,3.75,-7.5, 15,3.75,7.5,1,8.102846845, 0.2,.2,2e-1,1.55,0.3,3.0,-0.2,0.1,0.3
";
    let got = run(Function::Srbf, &EXACT, turned).unwrap();
    for name in ["m_r", "m_tt", "m_trt"] {
        assert!((numbers(&got, name)[0] / numbers(&want, name)[0] - 1.0).abs() < 2e-8, "{name}");
    }
    // Only a header: only a header.
    let header = SRBF.lines().next().unwrap();
    let got = run(Function::Srbf, &EXACT, header).unwrap();
    assert_eq!(got.trim_end(), format!("{header},m_r,m_tt,m_trt"));
}

#[test]
fn bcsdf_integrates_to_the_albedo() {
    // A clear chiang fibre keeps all light at every h. Gauss in θ_i, even steps in φ_i.
    let mut input =
        String::from("theta_i,phi_i,theta_o,phi_o,eta,sigma_a,beta_m,beta_n,alpha_deg,h\n");
    let (count, mut weights) = (64, Vec::new());
    for (theta, weight) in GaussLegendre::new(40).on(-FRAC_PI_2, FRAC_PI_2) {
        for k in 0..count {
            let step = TAU / f64::from(count);
            input += &format!("{theta},{},0.3,0.7,1.55,0,0.6,0.6,2,0.4\n", step * f64::from(k));
            weights.push(weight * step * theta.cos());
        }
    }
    let chiang = Options { model: Bcsdf::Chiang, ..EXACT };
    let text = run(Function::Bcsdf, &chiang, &input).unwrap();
    for (name, tolerance) in [("f_cos_r", 1e-5), ("pdf", 1e-5)] {
        let total: f64 = numbers(&text, name).iter().zip(&weights).map(|(f, w)| f * w).sum();
        println!("chiang: ∫{name} dω = 1 − {:.1e}", 1.0 - total);
        assert!((total - 1.0).abs() < tolerance, "{name}: {total}");
        let without_cosine: f64 = numbers(&text, name).iter().sum::<f64>() * weights[0];
        assert!((without_cosine - 1.0).abs() > 0.1);
    }
    // At one direction, by the model itself; colours apart.
    let input = "h,beta_n,beta_m,sigma_a_r,sigma_a_g,sigma_a_b,eta,theta_i,phi_i,theta_o,phi_o
-0.3,0.4,0.2,0.1,0.4,1.2,1.55,-0.25,2.9,0.3,0.1\n";
    let text = run(Function::Bcsdf, &chiang, input).unwrap();
    let model = Chiang::new(0.2, 0.4, 0.0, 1.55, [0.1, 0.4, 1.2]);
    let (o, i) = (Direction::new(0.3, 0.1), Direction::new(-0.25, 2.9));
    let want = model.evaluate(&o, &i, -0.3);
    for (c, name) in ["f_cos_r", "f_cos_g", "f_cos_b"].into_iter().enumerate() {
        assert!(close(numbers(&text, name)[0], want.f_cos[c]), "{name}");
    }
    assert!(close(numbers(&text, "pdf")[0], want.pdf));
    assert!(!close(want.f_cos[0], model.evaluate(&o, &i, 0.3).f_cos[0]), "h is not felt");

    // Far-field models, whose columns may stand beside those that they do not take.
    let input = "theta_i,phi_i,theta_o,phi_o,eta,sigma_a,beta_r_deg,w_c,beta_m,h
-0.25,2.9,0.3,0.1,1.55,0.3,8,0.2,0.5,0.9\n";
    for model in [Bcsdf::Marschner, Bcsdf::Deon] {
        let text = run(Function::Bcsdf, &Options { model, ..EXACT }, input).unwrap();
        let (f, pdf) = (numbers(&text, "f_cos_g")[0], numbers(&text, "pdf")[0]);
        assert!(f > 0.05 && f < 5.0 && pdf > 0.05 && pdf < 5.0, "{f} {pdf}");
    }
}

const DUAL: &str = "theta,eta,sigma_a,beta_r_deg,alpha_deg,w_c\n0.4,1.55,0.2,7.5,-7.5,0.2\n";

#[test]
fn dual_rows_are_the_exact_averages() {
    let text = run(Function::Dual, &EXACT, DUAL).unwrap();
    let (header, _) = parse(&text);
    let names =
        ["a_f", "a_b", "alpha_f", "alpha_b", "beta_f", "beta_b", "A_b", "delta_b", "sigma_b"];
    assert_eq!(header[6..], names);
    let fibre = fibre();
    let shape: Vec<_> = fibre.alpha.into_iter().zip(fibre.beta).collect();
    let a = averages(&Marschner::new(&fibre), &shape, 0.4);
    let want =
        [a.a_f, a.a_b, a.alpha_f, a.alpha_b, a.beta_f, a.beta_b, a.big_a_b, a.delta_b, a.sigma_b];
    for (name, want) in names.into_iter().zip(want) {
        assert!(close(numbers(&text, name)[0], want[0]), "{name}");
    }
    // d'Eon's lobes past TRT are among the averages.
    let deon = run(Function::Dual, &Options { model: Bcsdf::Deon, ..EXACT }, DUAL).unwrap();
    let (f, b) = (numbers(&deon, "a_f")[0], numbers(&deon, "a_b")[0]);
    assert!(f > 0.3 && b > 0.05 && f + b < 1.0, "{f} {b}");
}

#[test]
fn other_methods_are_the_renderers() {
    let xu = Xu::new(&fibre(), SEGMENTS, Energy::Quadrature);
    let tables = fast::Tables::new(&fibre(), Model::Marschner, 2);
    let fast = Fast::new(&fibre(), Model::Marschner, &tables);
    let place = (0.3, -0.2, 0.1 - 3.0, 3.1f64.cos(), 0.3);
    let (a, b, c, d, e) = place;
    let exact = numbers(&run(Function::Srbf, &EXACT, SRBF).unwrap(), "m_tt")[0];
    for (options, want, bound) in [
        (&XU, xu.single_scattering(a, b, c, d, e), 0.1),
        (&FAST, fast.single_scattering(a, b, c, d, e), 0.01),
    ] {
        let text = run(Function::Srbf, options, SRBF).unwrap();
        for (name, want) in [("m_r", want.r), ("m_tt", want.tt), ("m_trt", want.trt)] {
            assert!(close(numbers(&text, name)[0], want[0]), "{name}");
        }
        // It is an approximation, and not a bad one.
        let off = numbers(&text, "m_tt")[0] / exact - 1.0;
        println!("m_tt off by {:.3} %", 100.0 * off);
        assert!(off.abs() > 1e-6 && off.abs() < bound, "{off}");
    }

    // Angles of θ_h on both sides.
    let exact = run(Function::Dual, &EXACT, DUAL).unwrap();
    let text = run(Function::Dual, &XU, DUAL).unwrap();
    for name in ["a_f", "a_b", "beta_f", "A_b", "delta_b", "sigma_b"] {
        let (value, exact) = (numbers(&text, name)[0], numbers(&exact, name)[0]);
        println!("dual {name}: {value:.4}, exact {exact:.4}");
        assert!((value / exact - 1.0).abs() < 0.1, "{name}: {value} {exact}");
    }
    let error = run(Function::Dual, &FAST, DUAL).unwrap_err().to_string();
    assert!(error.contains("--method xu"), "{error}");
    // A narrow light stands for a direction.
    let input = "theta_i,phi_i,theta_o,phi_o,eta,sigma_a,beta_r_deg,alpha_deg,w_c
-0.3,2.9,0.3,0.1,1.55,0.2,7.5,-7.5,0.2\n";
    let of = |options| numbers(&run(Function::Bcsdf, options, input).unwrap(), "f_cos_r")[0];
    let (fast, exact) = (of(&FAST), of(&EXACT));
    println!("bcsdf: fast {fast:.4}, exact {exact:.4}");
    assert!((fast / exact - 1.0).abs() < 0.1, "{fast} {exact}");
}

#[test]
fn the_gpu_gets_one_batch_a_fibre_and_gives_its_columns() {
    let batches = RefCell::new(Vec::new());
    let gpu: &Gpu = &|fibre, request, inputs| {
        batches.borrow_mut().push((fibre.eta, request, inputs.to_vec()));
        let outputs = inputs.iter().map(|x| std::array::from_fn(|k| x[4] + k as f32));
        Ok(outputs.collect())
    };
    let options = Options { gpu: Some(gpu), ..EXACT };
    let text = run(Function::Srbf, &options, SRBF).unwrap();
    let mut batches = batches.take();
    batches.sort_by_key(|(_, _, inputs)| inputs.len());
    let shape: Vec<_> = batches
        .iter()
        .map(|(eta, request, inputs)| (*eta, request.quantity, inputs.len()))
        .collect();
    let single = Quantity::SingleScattering;
    assert_eq!(shape, [(1.45, single, 1), (1.55, single, 2)]);
    // λ_j + k, first channel of each mode, rows in order.
    assert!((numbers(&text, "m_tt")[2] - 4.5).abs() < 1e-6, "{text}");
    assert!((numbers(&text, "m_trt")[1] - 6.3).abs() < 1e-6, "{text}");

    let options = Options { method: Some(Method::Xu), ..options };
    let text = run(Function::Dual, &options, DUAL).unwrap();
    assert_eq!(parse(&text).0[6..], ["a_f", "a_b", "beta_f", "A_b", "delta_b", "sigma_b"]);
    assert!((numbers(&text, "A_b")[0] - 3.0).abs() < 1e-6, "{text}");
    let nan: &Gpu = &|_, _, inputs| Ok(vec![[f32::NAN; 12]; inputs.len()]);
    let error = run(Function::Srbf, &Options { gpu: Some(nan), ..EXACT }, SRBF).unwrap_err();
    assert_eq!(error.to_string(), "line 2: m_r came out as NaN");
}

#[test]
fn what_is_wrong_is_named_in_one_line() {
    let header = SRBF.lines().next().unwrap();
    let good = "0.3,0.1,-0.2,3.0,0.3,1.55,0.2,7.5,-7.5,0.2";
    let rows = |bad: &str| format!("{header}\n{good}\n{bad}\n");
    let cases = [
        (String::new(), "the input is empty: its first line must name the columns"),
        (
            rows("0.3,0.1,-0.2,3.0,x,1.55,0.2,7.5,-7.5,0.2"),
            "line 3, column lambda_j: 'x' is no number",
        ),
        (
            rows("1.6,0.1,-0.2,3.0,0.3,1.55,0.2,7.5,-7.5,0.2"),
            "line 3, column theta_o: 1.6 is not within",
        ),
        (rows("nan,0.1,-0.2,3.0,0.3,1.55,0.2,7.5,-7.5,0.2"), "line 3, column theta_o: nan is not"),
        (rows("0.3,0.1,-0.2,inf,0.3,1.55,0.2,7.5,-7.5,0.2"), "line 3, column phi_j: inf is not"),
        (rows("0.3,0.1,-0.2,3.0,0.3,1.55,0.2"), "line 3: there are 7 values under 10 columns"),
        (
            rows("0.3,0.1,-0.2,3.0,,1.55,0.2,7.5,-7.5,0.2"),
            "line 3, column lambda_j: '' is no number",
        ),
        (SRBF.replace("phi_j", "phi_k"), "has no column 'phi_k'; the nearest is 'phi_j'"),
        (SRBF.replace("w_c", "eta"), "the column 'eta' is there twice"),
        (SRBF.replace("w_c", "eccentricity"), "srbf needs the column w_c or else beta_n_deg"),
        (
            SRBF.replace("sigma_a", "sigma_a_g"),
            "srbf needs the column sigma_a or else sigma_a_r, sigma_a_g, sigma_a_b",
        ),
        (SRBF.replace("alpha_deg", "sigma_a_r"), "line 1: the column sigma_a is grey absorption"),
        (
            "theta_o,phi_o,theta_j,phi_j,lambda_j,eta,beta_r_deg,w_c,sigma_a_r,sigma_a_g,sigma_a_b
0.3,0.1,-0.2,3.0,0.3,1.55,7.5,0.2,0.1,0.1,0.3\n"
                .to_owned(),
            "line 2, column sigma_a_b: srbf is grey",
        ),
        (
            "theta_o,phi_o,theta_j,phi_j,lambda_j,eta,beta_r_deg,w_c,sigma_a,eccentricity
0.3,0.1,-0.2,3.0,0.3,1.55,7.5,0,0.1,0.9\n"
                .to_owned(),
            "line 2: the integral of lobe 2",
        ),
    ];
    for (input, want) in cases {
        let error = run(Function::Srbf, &EXACT, &input).expect_err(want);
        let line = format!("{error:#}");
        println!("{line}");
        assert!(line.contains(want) && !line.contains('\n'), "{line:?} against {want:?}");
    }
    assert!("srbf".parse::<Function>().is_ok_and(|f| f == Function::Srbf));
    let error = "brdf".parse::<Function>().unwrap_err().to_string();
    assert!(error.contains("'brdf'") && error.contains("bcsdf, srbf, dual"), "{error}");

    let gpu: &Gpu = &|_, _, _| Ok(Vec::new());
    for (function, options, want) in [
        (
            Function::Srbf,
            Options { gpu: Some(gpu), method: Some(Method::Exact), ..EXACT },
            "--on cpu",
        ),
        (Function::Srbf, Options { model: Bcsdf::Chiang, ..FAST }, "another --model"),
        (Function::Srbf, Options { model: Bcsdf::Deon, ..XU }, "xu for marschner alone"),
        (Function::Dual, Options { model: Bcsdf::Chiang, ..EXACT }, "marschner or deon"),
    ] {
        let line = format!("{:#}", run(function, &options, SRBF).expect_err(want));
        assert!(line.contains(want) && !line.contains('\n'), "{line}");
    }
    // The rows alone are fine.
    assert!(run(Function::Srbf, &FAST, &rows(good)).is_ok());
}

//! The shaders against their f64 twins, on the CPU adapter.

use std::f64::consts::{FRAC_PI_2, PI};

use hairlight::gpu::{
    Gpu,
    method::{Integrator, MethodData},
    probe::{self, INPUTS, OUTPUTS},
    shaders::Shaders,
};
use hairlight::scattering::{
    azimuth_table::AzimuthTable,
    azimuthal::{Energy, FitTable},
    dual::AverageTable,
    fibre::Fibre,
    gaussian,
    global::GlobalTable,
    longitudinal,
    model::Model,
    nodes::{self, NodeTable},
    tables::CircleTable,
    xu::{self, Modes, Xu},
};
use hairlight::scene::Energies;

/// Point `i` of the R_d sequence: evenly spread in `INPUTS` dimensions.
pub(super) fn low_discrepancy(i: usize) -> [f64; INPUTS] {
    // The positive root of x^9 = x + 1.
    const ROOT: f64 = 1.085_070_245_491_450_8;
    std::array::from_fn(|d| (0.5 + (i as f64 + 1.0) * ROOT.powi(-(d as i32) - 1)).fract())
}

pub(super) fn fibre(sigma_a: [f64; 3], beta_deg: f64, eccentricity: f64) -> Fibre {
    let radians = |x: [f64; 3]| x.map(f64::to_radians);
    Fibre {
        eta: 1.55,
        sigma_a,
        alpha: radians([-7.5, 3.75, 11.25]),
        beta: radians([beta_deg, 0.5 * beta_deg, 2.0 * beta_deg]),
        w_c: 0.2,
        eccentricity,
        tint: Fibre::UNTINTED,
    }
}

/// Runs `statement` of a method.
pub(super) fn run(
    gpu: &Gpu,
    statement: &str,
    method: &MethodData,
    inputs: &[[f64; INPUTS]],
) -> Vec<[f32; OUTPUTS]> {
    let inputs: Vec<_> = inputs.iter().map(|x| x.map(|x| x as f32)).collect();
    probe::run(gpu, statement, method, &inputs).expect("the probe runs")
}

fn xu_data(fibre: &Fibre) -> MethodData {
    MethodData::xu(fibre, 4, Energies::Quadrature)
}

/// One function to compare: a WGSL statement, its twin, its inputs, and the tolerance
/// |difference| ≤ relative·|twin| + floor.
pub(super) struct Case<'a> {
    pub(super) name: &'a str,
    pub(super) statement: &'a str,
    pub(super) relative: f64,
    pub(super) floor: f64,
    pub(super) input: fn([f64; INPUTS]) -> [f64; INPUTS],
    pub(super) twin: &'a dyn Fn([f64; INPUTS]) -> Vec<f64>,
}

/// The worst of a case's outputs as a multiple of its tolerance, with a line that describes it.
pub(super) fn worst(gpu: &Gpu, method: &MethodData, case: &Case, count: usize) -> (f64, String) {
    // The shader sees f32: so does the twin.
    let inputs: Vec<[f64; INPUTS]> =
        (0..count).map(|i| (case.input)(low_discrepancy(i)).map(|x| f64::from(x as f32))).collect();
    let outputs = run(gpu, case.statement, method, &inputs);
    let mut worst = (0.0, format!("{}: exact", case.name));
    for (input, output) in inputs.iter().zip(&outputs) {
        for (k, want) in (case.twin)(*input).into_iter().enumerate() {
            let got = f64::from(output[k]);
            let excess = (got - want).abs() / (case.relative * want.abs() + case.floor);
            if !excess.is_finite() || excess > worst.0 {
                let excess = if excess.is_finite() { excess } else { f64::INFINITY };
                let line = format!("{}[{k}] at {input:.6?}: {got:e}, twin {want:e}", case.name);
                worst = (excess, line);
            }
        }
    }
    worst
}

/// Runs every case before it fails.
pub(super) fn check(gpu: &Gpu, method: &MethodData, cases: &[Case], count: usize) {
    let results: Vec<_> = cases.iter().map(|case| worst(gpu, method, case, count)).collect();
    let failed: Vec<_> = results.iter().filter(|(excess, _)| *excess > 1.0).collect();
    for (excess, line) in &results {
        println!("{excess:8.3} of the tolerance, {line}");
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

pub(super) fn cpu() -> Gpu {
    Gpu::new("cpu").expect("a CPU adapter (lavapipe)")
}

/// (θ_o, θ_j near the mirror direction and beyond, φ, cos(φ_o+φ_j), width log-uniform in 0.02…3).
pub(super) fn scattering_input(u: [f64; INPUTS]) -> [f64; INPUTS] {
    let theta_o = 1.5 * (2.0 * u[0] - 1.0);
    let theta_j = (-theta_o + 1.2 * (2.0 * u[1] - 1.0)).clamp(-1.5, 1.5);
    let width = 0.02 * 150f64.powf(u[3]);
    [theta_o, theta_j, PI * (2.0 * u[2] - 1.0), 2.0 * u[4] - 1.0, width, 0.0, 0.0, 0.0]
}

pub(super) fn flat(modes: Modes) -> Vec<f64> {
    [modes.r, modes.tt, modes.trt].concat()
}

pub(super) const SINGLE: &str =
    "let m = single_scattering(fibre, x[0].x, x[0].y, x[0].z, x[0].w, x[1].x);
    y[0] = vec4f(m.r, m.tt.x); y[1] = vec4f(m.tt.yz, m.trt.xy); y[2] = vec4f(m.trt.z, m.longer);";
const GLOBAL: &str = "let m = global_scattering(fibre, x[0].x, x[0].y, x[0].z, x[1].x);
    y[0] = vec4f(m.r, m.tt.x); y[1] = vec4f(m.tt.yz, m.trt.xy); y[2] = vec4f(m.trt.z, m.longer);";
const LOCAL_DIRECT: &str =
    "y[0] = vec4f(local_scattering_direct(fibre, x[0].x, x[0].y, x[0].z, x[1].x), 0.0);";
const LOCAL_FORWARD: &str =
    "y[0] = vec4f(local_scattering_forward(fibre, x[0].x, x[0].y, x[0].z, x[1].x), 0.0);";

/// Tolerances of whole integrals: 0.2 % and a floor of 2e-4 where values reach 1, which is what linear
/// interpolation of the fits (256 rows) and of 𝒞_k (64 × 96) leaves.
fn scattering_cases<'a>(xu: &'a Twins) -> Vec<Case<'a>> {
    let case = |name, statement, twin| Case {
        name,
        statement,
        relative: 2e-3,
        floor: 2e-4,
        input: scattering_input,
        twin,
    };
    vec![
        case("single_scattering", SINGLE, &*xu.single),
        case("global_scattering", GLOBAL, &*xu.global),
        case("local_scattering_direct", LOCAL_DIRECT, &*xu.local_direct),
        case("local_scattering_forward", LOCAL_FORWARD, &*xu.local_forward),
    ]
}

type Twin = Box<dyn Fn([f64; INPUTS]) -> Vec<f64>>;

/// The four integrals of a fibre, in f64 and without tables.
struct Twins {
    single: Twin,
    global: Twin,
    local_direct: Twin,
    local_forward: Twin,
}

impl Twins {
    fn new(fibre: &Fibre) -> Self {
        let xu = || Xu::new(fibre, 4, Energy::Quadrature);
        let (a, b, c, d) = (xu(), xu(), xu(), xu());
        Self {
            single: Box::new(move |x| flat(a.single_scattering(x[0], x[1], x[2], x[3], x[4]))),
            global: Box::new(move |x| flat(b.global_scattering(x[0], x[1], x[2], x[4]))),
            local_direct: Box::new(move |x| {
                c.local_scattering_direct(x[0], x[1], x[2], x[4]).to_vec()
            }),
            local_forward: Box::new(move |x| {
                d.local_scattering_forward(x[0], x[1], x[2], x[4]).to_vec()
            }),
        }
    }
}

#[test]
fn small_functions_equal_their_twins() {
    let gpu = cpu();
    let fibre = fibre([0.2, 0.6, 1.2], 7.5, 1.0);
    let averages = AverageTable::new(&fibre, 4);
    let cases = [
        Case {
            name: "asin_accurate, atan2_accurate",
            statement: "y[0] = vec4f(asin_accurate(x[0].x), atan2_accurate(x[0].y, x[0].z), wrap(x[0].w), 0.0);",
            relative: 0.0,
            floor: 6e-7,
            input: |u| {
                let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
                [2.0 * u[0] - 1.0, u[2] * sin, u[2] * cos, 6.0 * u[3] - 3.0, 0.0, 0.0, 0.0, 0.0]
            },
            twin: &|x| vec![x[0].asin(), x[1].atan2(x[2]), x[3]],
        },
        Case {
            name: "erf_and_gauss",
            statement: "y[0] = vec4f(erf_and_gauss(x[0].x), 0.0, 0.0);",
            relative: 0.0,
            floor: 5e-7,
            input: |u| [12.0 * u[0] - 6.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            twin: &|x| vec![gaussian::erf(x[0]), (-x[0] * x[0]).exp()],
        },
        Case {
            name: "i0e, srbf_integral",
            statement: "y[0] = vec4f(i0e(vec3f(x[0].x)).x, srbf_integral(x[0].y), 0.0, 0.0);",
            relative: 2e-6,
            floor: 0.0,
            input: |u| {
                [1e-3 * 1e9f64.powf(u[0]), 3e-3 * 3e5f64.powf(u[1]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
            },
            twin: &|x| vec![gaussian::i0e(x[0]), gaussian::srbf_integral(x[1])],
        },
        Case {
            name: "g_circular_product",
            statement: "let s = sin(0.5 * x[0].x); y[0].x = g_circular_product(vec3f(s * s), x[0].y, vec3f(x[0].z)).x;",
            relative: 3e-4,
            floor: 1e-6,
            input: |u| {
                [PI * u[0], 1e-3 * 1e8f64.powf(u[1]), 1e-2 * 2e6f64.powf(u[2]), 0.0, 0.0, 0.0, 0.0, 0.0]
            },
            twin: &|x| vec![gaussian::g_circular_product(x[0], x[1], x[2])],
        },
        Case {
            name: "projection, spread_normaliser",
            statement: "y[0] = vec4f(projection(x[0].x, x[0].y), spread_normaliser(x[0].x, x[0].z), 0.0, 0.0);",
            relative: 1e-4,
            floor: 2e-6,
            input: |u| {
                [3.1 * (u[0] - 0.5), 3.1 * (u[1] - 0.5), 0.01 + 1.2 * u[2], 0.0, 0.0, 0.0, 0.0, 0.0]
            },
            twin: &|x| {
                vec![
                    longitudinal::projection(x[0], x[1]),
                    longitudinal::spread_normaliser(x[0], x[2]),
                ]
            },
        },
        Case {
            name: "walk",
            statement: "var w = walk_begin(x[0].x, x[0].y, 4u);
                for (var k = 0; k < 3; k++) { let n = walk_next(&w, u32(k)); y[0][k] = n.theta; y[1][k] = n.weight; }",
            relative: 2e-5,
            // A clamped node's weight is the difference of nearly equal numbers.
            floor: 2e-5,
            input: |u| {
                [6.0 * (u[0] - 0.5), 3e-3 * 1e3f64.powf(u[1]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
            },
            twin: &|x| {
                let nodes: Vec<_> = longitudinal::linear_quadrature(x[0], x[1], 4).collect();
                let theta = nodes.iter().map(|n| n.theta);
                theta.chain([0.0]).chain(nodes.iter().map(|n| n.weight)).collect()
            },
        },
        Case {
            name: "averages",
            statement: "let a = averages(x[0].x);
                y[0] = vec4f(a.a_f, a.delta_b); y[1] = vec4f(a.a_b, a.sigma_b); y[2] = vec4f(a.A_b, a.energy.x);",
            // 16-bit floats, of which two of either sign may make a small one (Δ̄_b, whose rows reach 0.01).
            relative: 6e-4,
            floor: 5e-6,
            input: |u| [3.15 * (u[0] - 0.5), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            twin: &|x| {
                let a = averages.sample(x[0].clamp(-FRAC_PI_2, FRAC_PI_2));
                [&a.a_f[..], &[a.delta_b], &a.a_b, &[a.sigma_b], &a.big_a_b, &[a.energy[0]]].concat()
            },
        },
    ];
    check(&gpu, &xu_data(&fibre), &cases, 4096);
}

#[test]
fn integrals_equal_their_twins() {
    let gpu = cpu();
    for fibre in [
        fibre([0.0, 0.3, 1.5], 7.5, 1.0),
        fibre([2.0, 4.0, 11.0], 3.0, 1.0),
        fibre([0.1, 0.2, 0.4], 12.0, 0.9),
    ] {
        check(&gpu, &xu_data(&fibre), &scattering_cases(&Twins::new(&fibre)), 2048);
    }
}

#[test]
fn a_fibre_one_percent_off_is_told() {
    let gpu = cpu();
    let fibre = fibre([0.0, 0.3, 1.5], 7.5, 1.0);
    let other = Fibre { eta: 1.01 * fibre.eta, ..fibre };
    let twins = Twins::new(&fibre);
    for case in &scattering_cases(&twins)[..2] {
        let (excess, _) = worst(&gpu, &xu_data(&other), case, 512);
        assert!(excess > 1.0, "{} does not feel η: {excess} of its tolerance", case.name);
    }
}

#[test]
fn hard_inputs_stay_finite() {
    let gpu = cpu();
    let of_xu: &[&str] = &[SINGLE, GLOBAL, LOCAL_DIRECT, LOCAL_FORWARD];
    let of_fast: &[&str] = &[SINGLE, "y[0] = vec4f(energy_compensation(fibre, x[0].x), 0.0);"];
    let edges = [-FRAC_PI_2, -FRAC_PI_2 + 1e-6, -0.3, 0.0, 0.8, FRAC_PI_2 - 1e-6, FRAC_PI_2];
    let mut inputs = Vec::new();
    for theta_o in edges {
        for theta_j in edges.into_iter().chain([-theta_o]) {
            for phi in [-PI, -FRAC_PI_2, -1e-6, 0.0, 1.0, FRAC_PI_2, PI] {
                for width in [0.003, 0.05, 0.7, 3.0, 1e3] {
                    inputs.push([theta_o, theta_j, phi, -1.0, width, 0.0, 0.0, 0.0]);
                    inputs.push([theta_o, theta_j, phi, 1.0, width, 0.0, 0.0, 0.0]);
                }
            }
        }
    }
    let common = fibre([0.0, 1.0, 1e3], 7.5, 1.0);
    let fibres = [
        common,
        fibre([0.0; 3], 0.05, 1.0),
        fibre([1e3; 3], 45.0, 1.0),
        fibre([0.1; 3], 7.5, 0.5),
        fibre([0.1; 3], 7.5, 2.0),
        Fibre { eta: 1.0, ..common },
        Fibre { eta: 3.0, ..common },
        Fibre { eta: 2.0 + 1e-7, w_c: 0.01, ..common },
        Fibre { alpha: [-20f64.to_radians(), 20f64.to_radians(), 60f64.to_radians()], ..common },
    ];
    let mut bad = Vec::new();
    for fibre in &fibres {
        for (method, statements) in [
            (xu_data(fibre), of_xu),
            (MethodData::fast(fibre, Model::Marschner, 2).as_general(), of_fast),
        ] {
            for statement in statements {
                for (input, output) in inputs.iter().zip(run(&gpu, statement, &method, &inputs)) {
                    if output.iter().any(|y| !y.is_finite() || *y < 0.0) {
                        bad.push(format!("{statement:.30} {fibre:?} {input:?}: {output:?}"));
                    }
                }
            }
        }
    }
    assert!(bad.is_empty(), "{} of them, first: {:#?}", bad.len(), &bad[..3.min(bad.len())]);
}

/// Parses and validates a shader, as the device would.
fn validated(source: &str) -> naga::Module {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    let flags = naga::valid::ValidationFlags::all();
    // unpack2x16float, which is in every WebGPU device.
    naga::valid::Validator::new(flags, naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32)
        .validate(&module)
        .unwrap_or_else(|e| panic!("{}", e.emit_to_string(source)));
    module
}

/// Names, offsets and span of a struct, as naga lays it out.
fn layout(module: &naga::Module, name: &str) -> (Vec<(String, usize)>, usize) {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
    let Some((_, naga::Type { inner: naga::TypeInner::Struct { members, span }, .. })) = found
    else {
        panic!("struct {name} is not in the shader")
    };
    let name = |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
    (members.iter().map(name).collect(), *span as usize)
}

#[test]
fn passes_are_valid_and_laid_out_as_in_rust() {
    use hairlight::gpu::uniforms::{
        CastUniform, FieldGrid, GatherSumUniform, GatherUniform, HeadPlace, LightEntry,
        NEEDED_LIST, Path, Queue, ShadingUniform, ViewUniform,
    };
    use std::mem::{offset_of, size_of};
    for (name, source) in Shaders::default().passes() {
        println!("{name}");
        validated(&source);
    }
    macro_rules! same {
        ($shader:expr, $wgsl:literal, $rust:ty, [$($field:ident),*]) => {
            let expected: Vec<(String, usize)> =
                vec![$((stringify!($field).to_owned(), offset_of!($rust, $field))),*];
            assert_eq!(layout(&validated(&$shader), $wgsl), (expected, size_of::<$rust>()), $wgsl);
        };
    }
    same!(
        Shaders::default().resolve(),
        "View",
        ViewUniform,
        [
            clip_from_pos,
            eye,
            pieces,
            right,
            background,
            up,
            environment_rotation_rad,
            forward,
            environment_scale,
            background_rgb,
            share,
            size,
            grid,
            widened
        ]
    );
    let shade = || Shaders::default().shade(Integrator::Fast(Model::Marschner));
    for method in [Integrator::Fast(Model::Marschner), Integrator::Xu] {
        validated(&Shaders::default().with_exact_single(&Shaders::default().shade(method)));
    }
    same!(
        shade(),
        "Light",
        LightEntry,
        [direction, lambda, rgb, energy, least, side, chance, end, pad]
    );
    same!(
        shade(),
        "Shading",
        ShadingUniform,
        [
            eye,
            parts,
            first_light,
            lights,
            slots,
            first_ordinate,
            grid,
            lamps,
            stride,
            last_column,
            gathered
        ]
    );
    same!(shade(), "FieldGrid", FieldGrid, [origin, cell, dims, scale]);
    let gather = || Shaders::default().gather(Integrator::Fast(Model::Marschner));
    same!(gather(), "Path", Path, [origin, most, direction, clear, weight, id, own, draw]);
    same!(gather(), "HeadPlace", HeadPlace, [position, seed, normal, pad]);
    same!(
        gather(),
        "Gather",
        GatherUniform,
        [
            eye,
            paths,
            grid,
            first,
            count,
            lights,
            lamps,
            first_ordinate,
            ordinate_share,
            parts,
            event,
            strands,
            judged
        ]
    );
    same!(Shaders::default().cast(), "Cast", CastUniform, [first, all, head]);
    same!(Shaders::default().cast(), "Queue", Queue, [workgroups, count]);
    let sums = Shaders::default().gather_sum();
    same!(sums, "GatherSum", GatherSumUniform, [first, count, paths, pad]);
    let trace = || Shaders::default().transmittance();
    use hairlight::transport::draws::{Block, HeadLight, HeadVertex, TracedLight};
    let of_head = || Shaders::default().head_light();
    same!(of_head(), "HeadVertex", HeadVertex, [position, seed, normal, pad_2, lights, pad_3]);
    same!(of_head(), "HeadLight", HeadLight, [light, rgb, energy, wide, pad]);
    same!(trace(), "Block", Block, [point, members, own]);
    same!(
        trace(),
        "TracedLight",
        TracedLight,
        [direction, lambda, side, lamp, column, rays, fresh, pad]
    );
    for (shader, name) in [(Shaders::default().mark(), "Needed"), (shade(), "NeededPoints")] {
        let (members, _) = layout(&validated(&shader), name);
        let offset = |field: &str| members.iter().find(|m| m.0 == field).map(|m| m.1 as u64);
        assert_eq!(offset("points"), Some(NEEDED_LIST), "{name}");
    }
}

#[test]
fn layouts_and_constants_are_those_of_rust() {
    let module = validated(&Shaders::default().probe(Integrator::Xu, SINGLE));
    let (_, fibre) = module
        .types
        .iter()
        .find(|(_, ty)| ty.name.as_deref() == Some("Fibre"))
        .expect("struct Fibre");
    let naga::TypeInner::Struct { members, span } = &fibre.inner else { panic!("{fibre:?}") };
    let offsets: Vec<_> =
        members.iter().map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize)).collect();
    use hairlight::gpu::uniforms::FibreUniform;
    use std::mem::{offset_of, size_of};
    let expected = [
        ("alpha", offset_of!(FibreUniform, alpha)),
        ("eta", offset_of!(FibreUniform, eta)),
        ("lambda", offset_of!(FibreUniform, lambda)),
        ("linked", offset_of!(FibreUniform, linked)),
        ("sigma_a", offset_of!(FibreUniform, sigma_a)),
        ("blur", offset_of!(FibreUniform, blur)),
        ("eta_star", offset_of!(FibreUniform, eta_star)),
        ("eta_low", offset_of!(FibreUniform, eta_low)),
        ("eta_per_layer", offset_of!(FibreUniform, eta_per_layer)),
        ("eta_layers", offset_of!(FibreUniform, eta_layers)),
        ("w_c", offset_of!(FibreUniform, w_c)),
        ("tint", offset_of!(FibreUniform, tint)),
    ];
    assert_eq!(offsets, expected);
    assert_eq!(*span as usize, size_of::<FibreUniform>());

    let constant = |module: &naga::Module, name: &str| {
        let (_, constant) = module
            .constants
            .iter()
            .find(|(_, c)| c.name.as_deref() == Some(name))
            .unwrap_or_else(|| panic!("const {name}"));
        match module.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::U32(n)) => n as f64,
            naga::Expression::Literal(naga::Literal::F32(x)) => f64::from(x),
            naga::Expression::Literal(naga::Literal::AbstractFloat(x)) => x,
            ref other => panic!("{name} is {other:?}"),
        }
    };
    for (name, value) in [
        ("CIRCLE_ROWS", CircleTable::ROWS as f64),
        ("CIRCLE_COLUMNS", CircleTable::COLUMNS as f64),
        ("FIT_ROWS", FitTable::ROWS as f64),
        ("FIT_SIZE", FitTable::SIZE as f64),
        ("AVERAGE_ROWS", AverageTable::ROWS as f64),
        ("AVERAGE_SIZE", AverageTable::SIZE as f64),
        ("GLOBAL_ROWS", GlobalTable::ROWS as f64),
        ("GLOBAL_COLUMNS", GlobalTable::COLUMNS as f64),
        ("PROBE_IN", (INPUTS / 4) as f64),
        ("PROBE_OUT", (OUTPUTS / 4) as f64),
        ("KAPPA_MAX", gaussian::KAPPA_MAX),
        ("SPREAD_MAX", longitudinal::SPREAD_MAX),
        ("AMPLITUDE_MIN", xu::AMPLITUDE_MIN),
    ] {
        let found = constant(&module, name);
        assert!((found - value).abs() <= 1e-7 * value, "{name}: {found} in WGSL, {value} in Rust");
    }
    let module = validated(&Shaders::default().probe(Integrator::Fast(Model::Marschner), SINGLE));
    for (name, value) in [
        ("COMPENSATION_MAX", longitudinal::COMPENSATION_MAX),
        ("EXPONENT_MAX", nodes::EXPONENT_MAX),
        ("NODE_ROWS", NodeTable::ROWS as f64),
        ("NODE_COLUMNS", NodeTable::COLUMNS as f64),
        ("AZIMUTH_SIZE", AzimuthTable::SIZE as f64),
    ] {
        let found = constant(&module, name);
        assert!((found - value).abs() <= 1e-7 * value, "{name}: {found} in WGSL, {value} in Rust");
    }
}

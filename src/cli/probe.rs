//! `hairlight probe`.

use anyhow::Result;
use clap::builder::PossibleValuesParser;
use clap::{Arg, ArgMatches, Command};

use super::{adapter, choice, word};
use crate::gpu::Gpu;
use crate::gpu::probe::run as run_on_gpu;
use crate::probe::{self, Function, Method, Options, Request};
use crate::scattering::fibre::Fibre;
use crate::scene::Bcsdf;

pub fn command() -> Command {
    Command::new("probe")
        .about("Evaluates scattering functions over rows of numbers, CSV in and CSV out")
        .long_about(
            "Evaluates scattering functions over rows of numbers: CSV from stdin, with a header that names the \
             columns in any order, to stdout, with the results as further columns.\n\n\
             bcsdf  theta_i phi_i theta_o phi_o [h], fibre → f_cos_r f_cos_g f_cos_b [pdf], S·cosθ_i in 1/sr\n\
             srbf   theta_o phi_o theta_j phi_j lambda_j, fibre → m_r m_tt m_trt, ∫G_j S_t cosθ_i dω\n\
             dual   theta, fibre → a_f a_b alpha_f alpha_b beta_f beta_b A_b delta_b sigma_b\n\n\
             A fibre is eta, sigma_a (or sigma_a_r _g _b, per radius), beta_r_deg [beta_tt_deg beta_trt_deg], \
             w_c or beta_n_deg, [alpha_deg or alpha_r_deg alpha_tt_deg alpha_trt_deg] [eccentricity]; for chiang \
             eta, sigma_a, beta_m, beta_n, [alpha_deg], after pbrt. Angles are radians, but for columns in _deg; \
             betas are standard deviations of θ_h, w_c is a bandwidth.",
        )
        .arg(
            Arg::new("function")
                .required(true)
                .value_name(Function::NAMES.join("|"))
                .hide_possible_values(true)
                .value_parser(PossibleValuesParser::new(Function::NAMES))
                .help("What to evaluate"),
        )
        .arg(choice("model", Bcsdf::WORDS).help("How a fibre scatters"))
        .arg(
            choice("method", &["auto", "exact", "fast", "xu"]).help(
                "By quadrature, or by a method of the renderer; auto is exact on the CPU, fast on the GPU",
            ),
        )
        .arg(choice("on", &["cpu", "gpu"]).help("In f64, or by the renderer's own WGSL"))
        .arg(adapter())
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    let function: Function = word(matches, "function").parse()?;
    let method = match word(matches, "method") {
        "exact" => Some(Method::Exact),
        "fast" => Some(Method::Fast),
        "xu" => Some(Method::Xu),
        _ => None,
    };
    let model = Bcsdf::named(word(matches, "model"));
    let (input, output) = (std::io::stdin().lock(), std::io::stdout().lock());
    if word(matches, "on") == "cpu" {
        return probe::run(function, &Options { model, method, gpu: None }, input, output);
    }
    let gpu = Gpu::new(word(matches, "adapter"))?;
    let on_gpu = |fibre: &Fibre, request: Request, inputs: &[[f32; 8]]| {
        run_on_gpu(&gpu, request.statement(), &request.data(fibre), inputs)
    };
    probe::run(function, &Options { model, method, gpu: Some(&on_gpu) }, input, output)
}

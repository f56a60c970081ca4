//! The report: Markdown for people, JSON for programs, plots for both.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result};

use super::Bench;
use super::causes::CAUSES;
use super::images::Image;
use super::integrals::{ABSORPTIONS, IntegralRow, LAMBDAS};
use super::statistics::{Spread, pareto, rms};
use crate::file::write_whole;
use crate::measure::plot::{Axis, Bars, COLOURS, Curves, Part, Plot, Series, Stroke};

const ERROR: &str = "relative L2, %";

/// Writes the report's files into `folder`.
pub(super) fn write(bench: &Bench, folder: &Path) -> Result<()> {
    let file = |name: &str, bytes: &[u8]| {
        write_whole(&folder.join(name), |file| Ok(file.write_all(bytes)?))
    };
    for (name, plot) in
        [("bench_time", error_against_time(bench)), ("bench_causes", by_cause(bench))]
    {
        let svg = plot.svg();
        file(&format!("{name}.png"), &plot.png(&svg).context(name)?)?;
        file(&format!("{name}.svg"), svg.as_bytes())?;
        file(&format!("{name}.csv"), &plot.csv()?)?;
    }
    file("bench.json", &serde_json::to_vec_pretty(bench)?)?;
    file("bench.md", markdown(bench).as_bytes())
}

fn percent(error: f64) -> String {
    match 100.0 * error {
        // Noise of traced pictures explains it all.
        0.0 => "in the noise".to_owned(),
        p if p >= 10.0 => format!("{p:.0} %"),
        p if p >= 1.0 => format!("{p:.1} %"),
        p => format!("{p:.2} %"),
    }
}

/// Median and quartiles.
fn spread(s: Spread, digits: usize) -> String {
    format!("{:.digits$} ({:.digits$}–{:.digits$})", s.median, s.lower, s.upper)
}

/// A table of rows under a head.
fn table(out: &mut String, head: &[&str], rows: impl Iterator<Item = Vec<String>>) {
    _ = writeln!(out, "| {} |", head.join(" | "));
    _ = writeln!(out, "|{}", " --- |".repeat(head.len()));
    for row in rows {
        _ = writeln!(out, "| {} |", row.join(" | "));
    }
    out.push('\n');
}

fn markdown(bench: &Bench) -> String {
    let mut out = String::from("# Speed against error\n\n");
    let machine = &bench.machine;
    _ = writeln!(
        out,
        "hairlight {}{} on {} ({}), {} CPU threads. Times are medians (quartiles); errors are relative L2.\n",
        machine.version,
        if bench.quick { ", --quick," } else { "" },
        machine.adapter,
        machine.backend,
        machine.threads
    );
    out += "![Error against time](bench_time.png)\n\n![Error by cause](bench_causes.png)\n\n";
    integrals(&mut out, bench);
    for image in &bench.images {
        picture(&mut out, image);
    }
    out
}

fn integrals(out: &mut String, bench: &Bench) {
    let found = &bench.integrals;
    let front = integral_front(&found.rows);
    _ = writeln!(
        out,
        "## Integrals\n\n∫G_j S_t cosθ_i dω in WGSL against adaptive quadrature: {} values a mode and colour over η, \
         β_R, λ_j, σ_a, θ_o, θ_j, φ. Errors: rms / worst over combinations of η, β_R, λ_j, σ_a. Times: {} tuples a \
         run, on the whole adapter; a light of a point is single and multiple scattering, as in a frame.\n",
        found.evaluations, found.timed
    );
    let error =
        |m: &super::integrals::ModeError| format!("{} / {}", percent(m.rms), percent(m.worst));
    table(
        out,
        &[
            "method",
            "nodes a mode",
            "table bytes",
            "R",
            "TT",
            "TRT",
            "single, ns",
            "ratio",
            "a light of a point, ns",
            "ratio",
            "Pareto",
        ],
        found.rows.iter().zip(&front).map(|(row, front)| {
            let mut cells =
                vec![row.method.clone(), row.nodes.to_string(), row.table_bytes.to_string()];
            cells.extend(row.modes.iter().map(error));
            cells.extend([
                spread(row.single_ns, 0),
                spread(row.single_ratio, 2),
                spread(row.whole_ns, 0),
                spread(row.whole_ratio, 2),
                if *front { "yes" } else { "" }.to_owned(),
            ]);
            cells
        }),
    );
    out.push_str("By σ_a and by λ_j, rms:\n\n");
    let labels: Vec<String> = ABSORPTIONS
        .as_flattened()
        .iter()
        .map(|s| format!("σ_a {s}"))
        .chain(LAMBDAS.iter().map(|l| format!("λ_j {l}")))
        .collect();
    let mut head = vec!["method", "mode"];
    head.extend(labels.iter().map(String::as_str));
    table(
        out,
        &head,
        found.rows.iter().flat_map(|row| {
            row.modes.iter().zip(["R", "TT", "TRT"]).map(|(mode, name)| {
                let mut cells = vec![row.method.clone(), name.to_owned()];
                let judged = mode.by_absorption.iter();
                cells.extend(judged.map(|e| e.map_or("too faint".to_owned(), percent)));
                cells.extend(mode.by_bandwidth.iter().map(|&e| percent(e)));
                cells
            })
        }),
    );
    out.push_str("Worst combinations: ");
    let worst = found.rows.iter().map(|row| {
        let modes = row.modes.iter().zip(["R", "TT", "TRT"]);
        let modes: Vec<_> = modes.map(|(m, name)| format!("{name} at {}", m.worst_at)).collect();
        format!("{}: {}", row.method, modes.join("; "))
    });
    _ = writeln!(out, "{}.\n", worst.collect::<Vec<_>>().join(". "));
    out.push_str(
        "Brute force, sums of G_j·S over N Fibonacci directions in f64 for the fibres in the middle of the grid; its time is N times \
         one far-field evaluation by one CPU thread, not by the GPU:\n\n",
    );
    table(
        out,
        &["N", "R", "TT", "TRT", "CPU, ns"],
        found.brute_force.iter().map(|row| {
            let mut cells = vec![row.directions.to_string()];
            cells.extend(row.modes.iter().map(|&e| percent(e)));
            cells.push(format!("{:.0}", row.cpu_ns));
            cells
        }),
    );
}

fn picture(out: &mut String, image: &Image) {
    _ = writeln!(
        out,
        "## {}\n\n{} × {} pixels, {} strands, {} of {} points shaded, {} lights: {} evaluations of each integral a \
         frame at most. Truth: {} samples a pixel, of which {} is noise (taken out).\n",
        image.name(),
        image.size[0],
        image.size[1],
        image.strands,
        image.points_shaded,
        image.points,
        image.lights,
        image.points_shaded * image.lights,
        image.truth_samples,
        percent(image.truth_noise)
    );
    table(
        out,
        &["method", "shading, ms", "ns a point and light", "table bytes", "error", "mean ratio"],
        image.frames.iter().map(|row| {
            vec![
                row.method.clone(),
                spread(row.shade_ms, 1),
                format!("{:.0}", row.pair_ns),
                row.table_bytes.to_string(),
                percent(row.error),
                format!("{:.3}", row.mean_ratio),
            ]
        }),
    );
    table(
        out,
        &["path tracing, samples a pixel", "ms", "error"],
        image
            .traced
            .iter()
            .map(|row| vec![row.samples.to_string(), format!("{:.0}", row.ms), percent(row.error)]),
    );
    for causes in &image.causes {
        _ = writeln!(
            out,
            "Causes of {}'s {}: alone / what remains with that part exact. One scattering event alone is {} off, \
             {} with reach, integrals and coverage exact.\n",
            causes.method,
            percent(causes.whole),
            percent(causes.single),
            percent(causes.single_exact)
        );
        let names: Vec<&str> = causes.parts.iter().map(|part| part.name).collect();
        let cells = causes.parts.iter().map(|part| {
            let remaining = part.remaining.map_or("–".to_owned(), percent);
            format!("{} / {remaining}", percent(part.alone))
        });
        table(out, &names, std::iter::once(cells.collect()));
    }
    if !image.by_lights.is_empty() {
        table(
            out,
            &[
                "method",
                "lights fitted",
                "shaded",
                "shading, ms",
                "error",
                "of the fit (blurred by 0.3)",
            ],
            image.by_lights.iter().map(|row| {
                vec![
                    row.method.clone(),
                    row.fitted.to_string(),
                    row.lights.to_string(),
                    spread(row.shade_ms, 1),
                    percent(row.error),
                    percent(row.fit_error),
                ]
            }),
        );
    }
}

/// rms over the three modes.
fn overall(row: &IntegralRow) -> f64 {
    rms(row.modes.iter().map(|mode| mode.rms))
}

fn integral_front(rows: &[IntegralRow]) -> Vec<bool> {
    let points: Vec<_> = rows.iter().map(|r| [r.single_ns.median, overall(r)]).collect();
    pareto(&points)
}

/// Names up to the first space, each once, in order.
fn families<'a>(labels: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut names = Vec::new();
    for name in labels.filter_map(|label| label.split(' ').next()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// A panel of named points (time, error), its Pareto front dashed. An error within the noise has no place.
fn scatter(title: String, x_label: &str, points: &[(String, [f64; 2])]) -> Curves {
    let points: Vec<_> = points.iter().filter(|p| p.1[1] > 0.0).collect();
    let mut series = Vec::new();
    let places: Vec<[f64; 2]> = points.iter().map(|p| p.1).collect();
    let mut front: Vec<[f64; 2]> =
        places.iter().zip(pareto(&places)).filter(|p| p.1).map(|p| *p.0).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    series.push(Series::new("Pareto front", [150, 150, 150], front).stroke(Stroke::Dashed));
    for (k, family) in families(points.iter().map(|p| p.0.as_str())).into_iter().enumerate() {
        let of = points.iter().filter(|p| p.0.split(' ').next() == Some(family));
        let name = family.replace('_', " ");
        let places = of.map(|p| p.1).collect();
        series.push(Series::new(name, COLOURS[k % COLOURS.len()], places).stroke(Stroke::Dots));
    }
    let decades = |axis: usize| {
        let of = || places.iter().map(|p| p[axis]).filter(|v| *v > 0.0);
        let low = of().fold(f64::INFINITY, f64::min).max(1e-9).log10().floor();
        let high = of().fold(0.0, f64::max).max(1e-9).log10().ceil();
        [10f64.powf(low.min(high - 1.0)), 10f64.powf(high)]
    };
    let ([x_low, x_high], [y_low, y_high]) = (decades(0), decades(1));
    Curves {
        title,
        // Marks that would meet are left out.
        x: Axis::log(x_label, x_low, x_high, if x_high > 1e5 * x_low { 100.0 } else { 10.0 }),
        y: Axis::log(ERROR, y_low, y_high, 10.0),
        series,
    }
}

/// Error against time: single evaluations, then frames and path tracing, a panel a picture.
fn error_against_time(bench: &Bench) -> Plot {
    let found = &bench.integrals;
    let rows = found.rows.iter();
    let mut points: Vec<(String, [f64; 2])> = rows
        .map(|row| (row.method.clone(), [row.single_ns.median, 100.0 * overall(row)]))
        .collect();
    points.extend(found.brute_force.iter().map(|row| {
        let error = 100.0 * rms(row.modes.into_iter());
        (format!("sum_over_directions_(CPU) {}", row.directions), [row.cpu_ns, error])
    }));
    let title = "∫G_j S_t cosθ_i dω".to_owned();
    let mut panels = vec![scatter(title, "ns, log scale", &points)];
    for image in &bench.images {
        let frames = image.frames.iter();
        let mut points: Vec<(String, [f64; 2])> = frames
            .map(|row| (row.method.clone(), [row.shade_ms.median, 100.0 * row.error]))
            .collect();
        points.extend(
            image
                .traced
                .iter()
                .map(|row| (format!("path_tracing {}", row.samples), [row.ms, 100.0 * row.error])),
        );
        panels.push(scatter(image.name(), "ms, log scale", &points));
    }
    Plot::Curves { panels, per_row: 2 }
}

/// Stacked bars of what each cause makes alone, a bar a picture, a panel a method.
fn by_cause(bench: &Bench) -> Plot {
    let mut methods: Vec<&str> = Vec::new();
    for causes in bench.images.iter().flat_map(|image| &image.causes) {
        if !methods.contains(&causes.method.as_str()) {
            methods.push(&causes.method);
        }
    }
    let panels = methods.iter().map(|&method| {
        let found: Vec<_> = bench
            .images
            .iter()
            .flat_map(|image| image.causes.iter().map(move |c| (image, c)))
            .filter(|(_, causes)| causes.method == method)
            .collect();
        let parts: Vec<Part> = CAUSES
            .iter()
            .enumerate()
            .map(|(k, name)| Part {
                name: (*name).to_owned(),
                colour: COLOURS[k],
                values: found.iter().map(|(_, c)| 100.0 * c.parts[k].alone).collect(),
            })
            .collect();
        let bars: Vec<String> = found.iter().map(|(image, _)| image.name()).collect();
        let title = format!("{method}: error of each cause alone");
        Bars { title, x: Axis::linear(ERROR, 0.0, 1.0, 1.0), bars, parts }
    });
    let mut panels: Vec<Bars> = panels.collect();
    // One axis for all: bars are there to be compared.
    let most = panels.iter().map(Bars::most).fold(0.0, f64::max);
    let step = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0].into_iter().find(|s| most <= 8.0 * s);
    let step = step.unwrap_or(100.0);
    for panel in &mut panels {
        panel.x = Axis::linear(ERROR, 0.0, (most / step).ceil().max(1.0) * step, step);
    }
    Plot::Bars { panels }
}

//! Capture: a scene in, frames and figures out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};

use crate::environment::LightMeter;
use crate::gpu::Gpu;
use crate::gpu::frame::{Background, Done, Frame, Parts, Renderer, can_be_kept};
use crate::gpu::method::MethodData;
use crate::image::write_frame;
use crate::light::{HairMedium, Lights};
use crate::paint::Paint;
use crate::progress::{Clock, Reporting};
use crate::quality::{self, Costs, Facts, Settings, TRIAL_LIGHTS};
use crate::reference::transmittance::RealStrands;
use crate::scene::{self, Lens, Scattering, Scene};
use crate::srbf::{self, SrbfLight};
use crate::stage::{Geometry, exposure_scale, load_map, shaded_lights, sky_lights};
use crate::stats::{
    Adapter, EnvironmentCounts, FitFigures, HairCounts, ImageFigures, Memory, Quality, Stats,
    Timing, TransportFigures, Work,
};
use crate::transport::draws::transmittance;

/// Pixels that `--verify` casts rays for.
const VERIFIED_PIXELS: usize = 2048;

/// What is asked of a capture beside its scene.
pub struct CaptureOptions<'a> {
    /// What is painted, in place of what the scene names.
    pub paint: Option<&'a Paint>,
    /// Measure transmittance against rays through the real strands.
    pub verify: bool,
    pub reporting: Reporting<'a>,
}

/// Renders the scene's frame, or its turntable, and writes what its output asks for.
pub fn run(scene: &Scene, options: &CaptureOptions) -> Result<()> {
    let mut clock = Clock::new(options.reporting);
    let outputs = Outputs::new(scene)?;
    let stage = Geometry::load_under(options.paint, scene)?;
    let fibres = stage.fibres_under(options.paint, scene)?;
    let method = MethodData::new(scene.fibre.model, fibres, &scene.render)?;
    let Geometry { hair, center, .. } = &stage;
    let center = *center;
    stage.notes.iter().chain(&outputs.left_over(scene)).for_each(|line| clock.note(line));
    clock.step("geometry")?;

    let map = load_map(&scene.environment, &clock)?;
    clock.step("environment")?;

    // Inputs come first: what is wrong with them is said on a machine without an adapter too.
    let gpu = Gpu::new(&scene.render.adapter)?;
    let adapter = Adapter {
        name: gpu.info.name.clone(),
        backend: gpu.info.backend.to_string(),
        device_type: format!("{:?}", gpu.info.device_type),
    };
    clock.step("adapter")?;

    let count = outputs.frames.len();
    let camera = stage.camera(scene)?;
    let lenses: Vec<Lens> = (0..count)
        .map(|i| camera.turned(360.0 * i as f64 / count as f64).lens(center, scene.output.size))
        .collect();
    let pieces = lenses.iter().map(|lens| stage.pieces(lens)).max().unwrap_or(1);
    let parts = parts(scene.render.scattering);

    let mut renderer = Renderer::new(gpu, &method, &stage)?;
    clock.step("upload")?;

    let fit_lights = |count: usize, clock: &Clock| {
        clock
            .watch("fitting lights", |progress| srbf::fit_cached(&map.environment, count, progress))
    };
    let facts = |lights: &[SrbfLight]| {
        Facts::new(&method, lights, stage.width_px(&lenses[0]), parts.multiple())
    };
    let mut settings = Settings::of(scene);
    if let Some(target) = scene.render.quality {
        let trial = fit_lights(TRIAL_LIGHTS, &clock)?;
        let lights = shaded_lights(&trial.lights, scene);
        let error = trial.relative_l2_blurred_0_30;
        let costs = Costs::of_device(&mut renderer, &method, &lenses[0], pieces, lights.len())?;
        let pick = quality::pick(scene, target, &facts(&lights), &costs, error);
        clock.note(&pick.line(target));
        settings = pick.settings;
        clock.step("quality")?;
    }

    let fit = fit_lights(settings.lights as usize, &clock)?;
    clock.step("fit")?;

    // What a lone frame sees is kept for it.
    let sight = match &lenses[..] {
        [lens] if can_be_kept(lens.size) => Some(renderer.look(lens, pieces, settings.samples)?),
        _ => None,
    };
    let (points, head) = match &sight {
        Some(sight) => (sight.points.clone(), sight.head.clone()),
        None => renderer.visible(&lenses, pieces, settings.samples)?,
    };
    if points.is_empty() {
        for lens in &lenses {
            clock.note(&nothing_seen(&stage, lens, settings.samples, &adapter.name)?);
        }
    }
    clock.step("visibility")?;

    let lights = Lights {
        lamps: stage.near_lamps(scene),
        distant: shaded_lights(&fit.lights, scene),
        sky: sky_lights(&fit.lights, scene),
    };
    renderer.negligible = settings.negligible;
    let medium = HairMedium::with_rays(&stage, parts.multiple(), &renderer);
    let lit = clock
        .watch("light transport", |progress| medium.bring(&stage, lights, &points, progress))?;
    let lights = lit.lobes(&stage);
    clock.step("transport")?;
    let field =
        clock.watch("scattered light", |progress| lit.field(&stage, &medium, &method, progress))?;
    clock.step("field")?;
    clock.watch("transmittance", |progress| {
        let at = (&stage, &medium);
        let seen = (&points[..], Some(&head));
        lit.show_at(at, &mut renderer, &method, field.as_ref(), seen, settings.rays, progress)
    })?;
    let gain = 2f64.powf(scene.environment.exposure) as f32;
    renderer.set_environment(
        &map.environment,
        scene.environment.rotation_deg.to_radians() as f32,
        gain,
    );
    clock.step("transmittance")?;
    let setup_ms = clock.total_ms();

    // One for all frames of a turn, so that it does not flicker.
    let scale = exposure_scale(scene, &LightMeter::new(&map.environment), -lenses[0].forward);

    let mut last = None;
    let bar = clock.bar("frames");
    for (index, (path, lens)) in outputs.frames.iter().zip(&lenses).enumerate() {
        let started = Instant::now();
        let frame = match &sight {
            Some(sight) => {
                let seen = renderer
                    .render_seen(sight, background(scene), parts, &|| !clock.cancelled())?;
                seen.context("cancelled")?
            }
            None => renderer.render(lens, settings.samples, background(scene), parts)?,
        };
        let frame_ms = 1e3 * started.elapsed().as_secs_f64();
        if clock.cancelled() {
            bail!("cancelled");
        }
        let figures = ImageFigures::of(&frame, scale);
        if figures.non_finite_pixels > 0 {
            bail!(
                "{} pixels came out NaN or infinite: this is a fault of Hairlight; please report the scene",
                figures.non_finite_pixels
            );
        }
        write_frame(path, &frame, scale)?;
        bar.set_position((1000 * (index + 1) / count) as u64);
        last = Some((frame, figures, frame_ms));
    }
    bar.finish_and_clear();
    let Some((frame, figures, frame_ms)) = last else { bail!("no frame was asked for") };

    let delta_t = if options.verify {
        // Rays go along lobes, which a lamp near the hair has not one of; the sky has no T̃.
        let words = renderer.traced_words(&points)?.split_off(lit.lamps.len());
        let t = |j: usize, k: usize| transmittance(words[j][k]);
        let real = RealStrands::new(&stage);
        real.delta_t(&lenses[0], &points, &lit.lights[..words.len()], t, VERIFIED_PIXELS)
    } else {
        None
    };
    if let Some(delta) = delta_t {
        clock.note(&format!(
            "ΔT̃ over pixels and lights that shine: mean {:+.4}, mean |ΔT̃| {:.4}; by the lights' energy mean |ΔT̃| is \
             {:.3} of the mean T̃, and where light arrives the mean is {}",
            delta.mean,
            delta.mean_abs,
            delta.weighted_abs,
            delta.mean_lit.map_or("unknown".to_owned(), |lit| format!("{lit:+.3}"))
        ));
    }
    clock.note(&format!(
        "{}: {} of {} points shaded in {frame_ms:.0} ms on {}, set up in {setup_ms:.0} ms",
        outputs.frames.last().map_or(Path::new(""), |p| p).display(),
        frame.shaded.len(),
        hair.points.len(),
        adapter.name,
    ));
    let Some(path) = &outputs.stats else { return Ok(()) };
    let done = match lenses.last() {
        Some(lens) => renderer.count(lens, settings.samples, parts)?,
        None => Done::default(),
    };
    let facts = facts(&lights);
    let mut passes = clock.steps.clone();
    let Frame { passes: timed, shaded, .. } = frame;
    if timed.is_empty() {
        passes.insert("frame", frame_ms);
    }
    passes.extend(timed);
    let stats = Stats {
        adapter,
        hair: HairCounts {
            strands: hair.strand_count(),
            points: hair.points.len(),
            points_shaded: shaded.len(),
            mended: stage.mended.mended,
            dropped: stage.mended.dropped,
            fibre_diameter: stage.diameter,
        },
        environment: EnvironmentCounts {
            width: map.environment.width,
            height: map.environment.height,
            mended_nan: map.mended.nan,
            mended_inf: map.mended.inf,
            mended_negative: map.mended.negative,
        },
        fit: FitFigures {
            lights: fit.lights.len(),
            relative_l2: fit.relative_l2,
            relative_l2_blurred_0_15: fit.relative_l2_blurred_0_15,
            relative_l2_blurred_0_30: fit.relative_l2_blurred_0_30,
            energy_ratio: fit.energy_ratio,
            seconds: fit.seconds,
            cached: fit.cached,
        },
        transport: TransportFigures {
            mean_abs_delta_t: delta_t.map(|d| d.mean_abs),
            mean_delta_t: delta_t.map(|d| d.mean),
            mean_delta_t_lit: delta_t.and_then(|d| d.mean_lit),
            weighted_abs_delta_t: delta_t.map(|d| d.weighted_abs),
        },
        work: Work {
            lights: lights.len(),
            lamps: stage.lamps(scene).len(),
            points_shaded: done.points,
            pairs_asked: done.points * lights.len() as u64,
            pairs_lit: done.pairs,
            single_evaluations: done.single,
            global_evaluations: done.global,
            lobes: done.lobes,
            head_vertices: stage.head.as_ref().map_or(0, |head| head.positions.len()),
            transport_looks: lit.brought.iter().map(|brought| brought.looks).sum(),
            rays: renderer.traced_rays(),
            paths: done.points * u64::from(renderer.paths_per_point()),
            field_rounds: field.as_ref().map_or(0, |field| field.rounds),
            bytes: renderer.shading_bytes(),
        },
        quality: Quality {
            settings,
            expected: facts.expected(&settings, fit.relative_l2_blurred_0_30),
            facts,
        },
        timing: Timing { frame_ms, setup_ms, total_ms: clock.total_ms(), passes },
        memory: Memory::now(),
        image: figures,
    };
    stats.write(path)
}

/// The files to write, checked before any work is done.
struct Outputs {
    frames: Vec<PathBuf>,
    stats: Option<PathBuf>,
}

impl Outputs {
    fn new(scene: &Scene) -> Result<Outputs> {
        let path = PathBuf::from(&scene.output.path);
        let frames = match scene.output.turntable {
            0 => vec![path],
            n => (0..n).map(|i| numbered(&path, i, n)).collect(),
        };
        let stats = scene.output.stats.as_ref().map(PathBuf::from);
        let outputs: Vec<&Path> = frames.iter().chain(&stats).map(PathBuf::as_path).collect();
        scene.check_outputs(&outputs)?;
        if let Some(path) = frames.first() {
            crate::image::Format::of(path)?;
        }
        Ok(Outputs { frames, stats })
    }

    /// A note where frames of a longer turn stay beside those of this one.
    fn left_over(&self, scene: &Scene) -> Option<String> {
        let (path, count) = (Path::new(&scene.output.path), scene.output.turntable);
        let there = |i: u32| numbered(path, i, count).exists();
        let end = (count..).find(|&i| !there(i)).filter(|&end| count > 0 && end > count)?;
        Some(format!(
            "{} to {} stay from a longer turn: remove them, or they will be taken for frames of this one",
            numbered(path, count, count).display(),
            numbered(path, end - 1, count).display()
        ))
    }
}

/// `frame.png` to `frame.0007.png`, with as many digits as `count` needs, at least four.
fn numbered(path: &Path, index: u32, count: u32) -> PathBuf {
    let digits = count.to_string().len().max(4);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}.{index:0digits$}.{extension}"))
}

/// A note on a view in which nothing was drawn of the hair.
///
/// # Errors
/// One line, if strands lie before the camera that should have covered something.
pub(crate) fn nothing_seen(
    stage: &Geometry,
    lens: &Lens,
    samples: u32,
    adapter: &str,
) -> Result<String> {
    /// With so many samples to be covered, that chance leaves out all of them is beyond belief.
    const SURE: f64 = 256.0;
    ensure!(
        stage.expected_samples(lens, samples) < SURE,
        "strands lie before the camera, but the adapter `{adapter}` draws none of them: update its driver, or choose \
         another with --adapter"
    );
    Ok("no hair is in the frame: it lies beside or behind the camera, behind the head, or is too small".to_owned())
}

/// What stands behind the hair.
pub(crate) fn background(scene: &Scene) -> Background {
    match scene.output.background {
        scene::Background::Environment => Background::Environment,
        scene::Background::Transparent => Background::Transparent,
        scene::Background::Color(rgb) => Background::Color(rgb.map(|c| c as f32)),
    }
}

/// Which parts of the scattering are asked for.
pub(crate) fn parts(scattering: Scattering) -> Parts {
    let is = |parts: &[Scattering]| parts.contains(&scattering);
    Parts {
        single: is(&[Scattering::Both, Scattering::Single]),
        global: is(&[Scattering::Both, Scattering::Multiple, Scattering::Global]),
        local: is(&[Scattering::Both, Scattering::Multiple, Scattering::Local]),
    }
}

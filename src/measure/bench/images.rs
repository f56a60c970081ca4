//! Error and time of whole frames against the path tracer, groom by groom, map by map, colour by colour.
//!
//! The truth is traced in-process under the map itself; its own noise is taken out of every error by its
//! variance, as `compare` does. A frame's time is that of its shading pass: what a method changes.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::f64::consts::SQRT_2;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::Serialize;

use super::causes::{self, Causes, OfModel};
use super::method::{Method, exact_single, table_bytes};
use super::statistics::Spread;
use super::{Context, Effort, Groom};
use crate::environment::Environment;
use crate::field::Field;
use crate::gpu::Gpu;
use crate::gpu::frame::{Background, Frame, Parts, Renderer};
use crate::gpu::head_light::SeenHead;
use crate::gpu::method::{Integrator, MethodData};
use crate::light::{HairMedium, Lights, LitHair};
use crate::measure::compare::compare;
use crate::measure::read::Picture;
use crate::paint::Fibres;
use crate::progress::Clock;
use crate::quality::Settings;
use crate::reference::Models;
use crate::reference::tracer::film::Film;
use crate::reference::tracer::light::Light;
use crate::reference::tracer::skin::Skin;
use crate::reference::tracer::strands::Strands;
use crate::reference::tracer::{Sampling, TraceScene, trace};
use crate::reference::transmittance::RealStrands;
use crate::scene::{FibreSpec, Lens, PRESETS, Scene};
use crate::srbf;
use crate::stage::{Geometry, load_map, place_lights, shaded_lights, sky_lights};
use crate::transport::draws::Words;

/// The seed of path tracing that is judged; the truth's is 0.
const OTHER_SEED: u32 = 1;

pub(super) const ALL: Parts = Parts { single: true, global: true, local: true };
pub(super) const SINGLE: Parts = Parts { single: true, global: false, local: false };
pub(super) const NONE: Parts = Parts { single: false, global: false, local: false };

/// A method's frame.
#[derive(Clone, Debug, Serialize)]
pub struct FrameRow {
    pub method: String,
    /// Of the shading pass, milliseconds.
    pub shade_ms: Spread,
    /// Nanoseconds of shading for each point and light.
    pub pair_ns: f64,
    pub table_bytes: usize,
    /// Relative L2, the truth's noise taken out.
    pub error: f64,
    /// Frame over truth, mean of the channels.
    pub mean_ratio: f64,
}

/// Path tracing, of the truth's own model and another seed.
#[derive(Clone, Debug, Serialize)]
pub struct TracedRow {
    pub samples: u32,
    /// Wall time on all threads, milliseconds.
    pub ms: f64,
    /// Relative L2, its own noise included and the truth's taken out.
    pub error: f64,
}

/// Another number of lights.
#[derive(Clone, Debug, Serialize)]
pub struct LightsRow {
    pub method: String,
    /// Asked of the fit.
    pub fitted: u32,
    /// Shaded: wide ones are split.
    pub lights: usize,
    pub shade_ms: Spread,
    pub error: f64,
    /// Of the map after a blur of λ = 0.3.
    pub fit_error: f64,
}

/// All that was measured of one picture.
#[derive(Clone, Debug, Serialize)]
pub struct Image {
    pub groom: String,
    pub colour: String,
    pub map: String,
    pub size: [u32; 2],
    pub strands: usize,
    pub points: usize,
    pub points_shaded: usize,
    pub lights: usize,
    /// Samples a pixel of the truth, and the relative L2 of its own noise.
    pub truth_samples: u32,
    pub truth_noise: f64,
    pub frames: Vec<FrameRow>,
    pub traced: Vec<TracedRow>,
    pub causes: Vec<Causes>,
    pub by_lights: Vec<LightsRow>,
}

impl Image {
    pub fn name(&self) -> String {
        format!("{}, {}, {}", self.groom, self.colour, self.map)
    }
}

/// A groom before its camera.
pub(super) struct View<'a> {
    pub stage: &'a Geometry,
    pub medium: HairMedium,
    pub lens: Lens,
    pub renderer: Renderer,
    /// Those that the frame needs.
    pub points: Vec<u32>,
    seen_head: SeenHead,
    strands: Strands<'a>,
    skin: Option<Skin<'a>>,
    samples: u32,
}

impl<'a> View<'a> {
    pub fn new(
        gpu: Gpu,
        method: &MethodData,
        stage: &'a Geometry,
        lens: Lens,
        samples: u32,
    ) -> Result<View<'a>> {
        let mut renderer = Renderer::new(gpu, method, stage)?;
        let pieces = stage.pieces(&lens);
        let (points, seen_head) = renderer.visible(&[lens], pieces, samples)?;
        let Geometry { hair, diameters, frames, head, head_albedo, center, .. } = stage;
        Ok(View {
            medium: HairMedium::new(stage, true),
            stage,
            lens,
            renderer,
            points,
            seen_head,
            strands: Strands::new(hair, diameters, frames, pieces, *center),
            skin: head.as_ref().map(|head| Skin::new(head, *head_albedo, *center)),
            samples,
        })
    }

    /// Sets a method, lights as frames trace them, and a field.
    pub fn show(&mut self, hair: &LitHair, data: &MethodData, field: Option<&Field>) -> Result<()> {
        let (at, rays) = ((self.stage, &self.medium), crate::quality::rays_for(self.samples));
        let seen = (&hair.points[..], Some(&self.seen_head));
        hair.show_at(at, &mut self.renderer, data, field, seen, rays, &|_| true)
    }

    /// The same with T̃ by many rays; the head is lit as frames light it.
    pub fn show_exact(
        &mut self,
        lit: &Lit,
        data: &MethodData,
        field: Option<&Field>,
    ) -> Result<()> {
        let (at, seen) = ((self.stage, &self.medium), Some(&self.seen_head));
        lit.hair.show_known(at, &mut self.renderer, data, field, seen, &lit.exact)
    }

    /// A frame and what its shading took.
    pub fn render(&mut self, parts: Parts) -> Result<(Frame, f64)> {
        let timed = |view: &mut Self, parts| {
            let begun = Instant::now();
            let frame =
                view.renderer.render(&view.lens, view.samples, Background::Transparent, parts)?;
            anyhow::Ok((frame, 1e3 * begun.elapsed().as_secs_f64()))
        };
        let (frame, whole) = timed(self, parts)?;
        let shade = match frame.passes.get("shade") {
            Some(&ms) => ms,
            // Without timestamps: what a frame takes beyond one that sums nothing.
            None => (whole - timed(self, NONE)?.1).max(0.0),
        };
        Ok((frame, shade))
    }

    /// Adds samples to a film.
    pub fn trace(
        &self,
        asked: &Asked,
        film: &mut Film,
        samples: u32,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Result<()> {
        let scene = TraceScene {
            strands: &self.strands,
            skin: self.skin.as_ref(),
            light: asked.light,
            models: asked.models,
            lens: self.lens,
            max_depth: asked.max_depth,
            sampling: Sampling::Both,
            seed: asked.seed,
        };
        if !trace(&scene, film, samples, progress)? {
            bail!("cancelled");
        }
        Ok(())
    }

    pub fn truth(
        &self,
        asked: &Asked,
        samples: u32,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Result<Picture> {
        let mut film = Film::new(self.lens.size);
        self.trace(asked, &mut film, samples, progress)?;
        Ok(Picture::of_film(&film, "the truth"))
    }
}

/// What a path-traced picture is of.
#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub models: &'a Models<'a>,
    pub light: &'a Light<'a>,
    pub max_depth: u32,
    pub seed: u32,
}

/// What one map brings to a groom's points.
pub(super) struct Lit<'a> {
    pub map: Light<'a>,
    /// The lights fitted to it, as the tracer takes them.
    pub fitted: Light<'static>,
    pub hair: LitHair,
    /// T̃ and the other means by many rays, of each light at each point.
    pub exact: Vec<Vec<Words>>,
}

/// The scene's fibre in a preset's colour.
fn preset(scene: &Scene, name: &str) -> FibreSpec {
    let mut fibre = scene.fibre.clone();
    if let Some(preset) = PRESETS.iter().find(|preset| preset.name == name) {
        fibre.set_preset(preset);
    }
    fibre
}

/// Measures all pictures of one groom; hands the device back.
pub fn measure(gpu: Gpu, groom: &Groom, context: &Context) -> Result<(Gpu, Vec<Image>)> {
    let &Context { methods, effort, tables, clock } = context;
    let mut scene = groom.scene.clone();
    scene.output.size = effort.size;
    let stage = Geometry::load(&scene)?;
    let first = methods[0].data(&scene.fibre.resolve(), tables);
    let lens = stage.camera(&scene)?.lens(stage.center, scene.output.size);
    let mut view = View::new(gpu, &first, &stage, lens, effort.samples)?;
    let mut images: Vec<Image> = Vec::new();
    for &map in effort.maps {
        let colours = effort.pictures.iter().filter(|picture| picture.1 == map);
        let colours: Vec<&str> = colours.map(|picture| picture.0).collect();
        if colours.is_empty() {
            continue;
        }
        scene.environment.source = format!("builtin:{map}");
        let environment = load_map(&scene.environment, clock)?.environment;
        let lit = light(&view, &scene, &environment, effort, clock)?;
        let mut first = None;
        for &colour in &colours {
            let begun = Instant::now();
            let names = [groom.name.as_str(), colour, map];
            let fibre = preset(&scene, colour);
            let (image, truth) = picture(&mut view, names, &fibre, &lit, context)?;
            clock.note(&format!("{}: {:.0} s", image.name(), begun.elapsed().as_secs_f64()));
            images.push(image);
            first.get_or_insert((fibre, truth));
        }
        if images.len() == colours.len()
            && let Some((fibre, truth)) = &first
        {
            images[0].by_lights =
                by_lights(&mut view, &scene, &environment, fibre, truth, context)?;
        }
    }
    Ok((view.renderer.gpu, images))
}

/// Fits `count` lights to the map and brings them to the view's points.
fn fit_lights(
    view: &View,
    scene: &Scene,
    environment: &Environment,
    count: u32,
    clock: &Clock,
) -> Result<(srbf::Fit, LitHair)> {
    let fit = clock.watch("fitting lights", |progress| {
        srbf::fit_cached(environment, count as usize, progress)
    })?;
    let lights = Lights {
        lamps: Vec::new(),
        distant: shaded_lights(&fit.lights, scene),
        sky: sky_lights(&fit.lights, scene),
    };
    let hair = clock.watch("light transport", |progress| {
        view.medium.bring(view.stage, lights, &view.points, progress)
    })?;
    Ok((fit, hair))
}

/// Light from a map, as a frame, the tracer and rays through real strands have it.
pub(super) fn light<'a>(
    view: &View,
    scene: &Scene,
    environment: &'a Environment,
    effort: &Effort,
    clock: &Clock,
) -> Result<Lit<'a>> {
    let (fit, hair) = fit_lights(view, scene, environment, Settings::of(scene).lights, clock)?;
    let rays = RealStrands::new(view.stage);
    let done = AtomicUsize::new(0);
    let exact: Option<Vec<Vec<Words>>> = clock.watch("exact transmittance", |progress| {
        let (lights, points) = (&hair.lights, &view.points);
        lights
            .par_iter()
            .map(|light| {
                let of = |&i: &u32| match light.rgb {
                    [0.0, 0.0, 0.0] => Words::default(),
                    _ => rays.moments(i as usize, light, effort.rays).words(),
                };
                let words = points.iter().map(of).collect();
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(done as f32 / lights.len() as f32).then_some(words)
            })
            .collect()
    });
    let Some(exact) = exact else { bail!("cancelled") };
    Ok(Lit {
        map: Light::map(environment, scene.environment.rotation_deg.to_radians(), 1.0)?,
        fitted: Light::lobes(&place_lights(&fit.lights, scene))?,
        exact,
        hair,
    })
}

/// One picture, and the truth of the first method's model.
fn picture(
    view: &mut View,
    [groom, colour, map]: [&str; 3],
    fibre: &FibreSpec,
    lit: &Lit,
    context: &Context,
) -> Result<(Image, Picture)> {
    let &Context { methods, effort, tables, clock } = context;
    let resolved = fibre.resolve();
    let even = Fibres::new(fibre, None);
    let of_model = |model| FibreSpec { model, ..fibre.clone() };
    let truth_of = |view: &View, bcsdf| {
        let spec = of_model(bcsdf);
        let models = &Models::new(&spec, &even);
        let asked = Asked { models, light: &lit.map, max_depth: u32::MAX, seed: 0 };
        clock.watch("truth", |progress| view.truth(&asked, effort.truth_samples, progress))
    };
    let mut truths = BTreeMap::new();
    for method in methods {
        if let Entry::Vacant(place) = truths.entry(method.exact) {
            place.insert(truth_of(view, method.exact)?);
        }
    }
    let truth = |method: &Method| &truths[&method.exact];

    // Path tracing of another seed, judged on its way.
    let spec = of_model(methods[0].exact);
    let models = &Models::new(&spec, &even);
    let asked = Asked { models, light: &lit.map, max_depth: u32::MAX, seed: OTHER_SEED };
    let (mut film, mut ms, mut traced) = (Film::new(view.lens.size), 0.0, Vec::new());
    for &samples in effort.traced {
        let begun = Instant::now();
        clock.watch("path tracing", |progress| view.trace(&asked, &mut film, samples, progress))?;
        ms += 1e3 * begun.elapsed().as_secs_f64();
        let picture = Picture { variance: None, ..Picture::of_film(&film, "path tracing") };
        let error = compare(&picture, truth(&methods[0]))?.error();
        traced.push(TracedRow { samples, ms, error });
    }

    // All methods in each round; the first warms up.
    let data: Vec<_> = methods.iter().map(|method| method.data(&resolved, tables)).collect();
    // Nodes make no difference that a grid could tell: one field a model.
    let mut of_integrators: Vec<(Integrator, Option<Field>)> = Vec::new();
    for data in &data {
        if of_integrators.iter().all(|(integrator, _)| *integrator != data.integrator) {
            let field = clock.watch("scattered light", |progress| {
                lit.hair.field(view.stage, &view.medium, data, progress)
            })?;
            of_integrators.push((data.integrator, field));
        }
    }
    let fields: Vec<Option<&Field>> = data
        .iter()
        .map(|data| {
            let of = of_integrators.iter().find(|(integrator, _)| *integrator == data.integrator);
            of.and_then(|(_, field)| field.as_ref())
        })
        .collect();
    let mut times = vec![Vec::new(); methods.len()];
    let mut last: Vec<Option<Frame>> = methods.iter().map(|_| None).collect();
    for round in 0..=effort.frame_rounds {
        for (k, data) in data.iter().enumerate() {
            view.show(&lit.hair, data, fields[k])?;
            let (frame, shade_ms) = view.render(ALL)?;
            if round > 0 {
                times[k].push(shade_ms);
            }
            last[k] = Some(frame);
            if clock.cancelled() {
                bail!("cancelled");
            }
        }
    }
    let pairs = (view.points.len() * lit.hair.lights.len()) as f64;
    let mut frames = Vec::new();
    let mut found = Vec::new();
    let mut of_models = BTreeMap::new();
    for (k, method) in methods.iter().enumerate() {
        let Some(frame) = &last[k] else { continue };
        let report = compare(&Picture::of_frame(frame), truth(method))?;
        let shade_ms = Spread::of(&times[k]);
        frames.push(FrameRow {
            method: method.label(),
            shade_ms,
            pair_ns: 1e6 * shade_ms.median / pairs,
            table_bytes: table_bytes(&data[k]),
            error: report.error(),
            mean_ratio: report.mean_ratio.iter().flatten().sum::<f64>()
                / report.mean_ratio.iter().flatten().count().max(1) as f64,
        });
        if method.by_cause {
            let model = match of_models.entry(method.exact) {
                Entry::Occupied(there) => there.into_mut(),
                Entry::Vacant(place) => {
                    let spec = of_model(method.exact);
                    let models = Models::new(&spec, &even);
                    let exact = exact_single(method.exact, &resolved);
                    let samples = effort.truth_samples;
                    // The head's light, which has the field in it, is the same with exact integrals.
                    let same = methods.iter().zip(&fields).filter(|(m, _)| m.exact == method.exact);
                    let field = same.filter_map(|(_, field)| *field).next();
                    place.insert(OfModel::new(view, &models, (exact, field), lit, samples, clock)?)
                }
            };
            let subject = causes::Subject {
                method: method.label(),
                data: &data[k],
                field: fields[k],
                lit,
                truth: truth(method),
                model,
            };
            found.push(causes::measure(view, &subject)?);
        }
    }
    // Of two independent pictures as noisy as the truth, √2 of it would be left.
    let truth_noise = compare(truth(&methods[0]), truth(&methods[0]))?
        .noise
        .map_or(0.0, |noise| noise.relative_l2 / SQRT_2);
    let image = Image {
        groom: groom.to_owned(),
        colour: colour.to_owned(),
        map: map.to_owned(),
        size: view.lens.size,
        strands: view.stage.hair.strand_count(),
        points: view.stage.hair.points.len(),
        points_shaded: view.points.len(),
        lights: lit.hair.lights.len(),
        truth_samples: effort.truth_samples,
        truth_noise,
        frames,
        traced,
        causes: found,
        by_lights: Vec::new(),
    };
    Ok((image, truth(&methods[0]).clone()))
}

/// What is taken apart by cause, under other numbers of lights.
fn by_lights(
    view: &mut View,
    scene: &Scene,
    environment: &Environment,
    fibre: &FibreSpec,
    truth: &Picture,
    context: &Context,
) -> Result<Vec<LightsRow>> {
    let &Context { methods, effort, tables, clock } = context;
    let mut rows = Vec::new();
    for &fitted in effort.lights {
        let (fit, hair) = fit_lights(view, scene, environment, fitted, clock)?;
        for method in methods.iter().filter(|method| method.by_cause) {
            let data = method.data(&fibre.resolve(), tables);
            let field = clock.watch("scattered light", |progress| {
                hair.field(view.stage, &view.medium, &data, progress)
            })?;
            view.show(&hair, &data, field.as_ref())?;
            let mut times = Vec::new();
            let mut frame = view.render(ALL)?.0;
            for _ in 0..effort.frame_rounds {
                let (next, ms) = view.render(ALL)?;
                frame = next;
                times.push(ms);
            }
            rows.push(LightsRow {
                method: method.label(),
                fitted,
                lights: hair.lights.len(),
                shade_ms: Spread::of(&times),
                error: compare(&Picture::of_frame(&frame), truth)?.error(),
                fit_error: fit.relative_l2_blurred_0_30,
            });
        }
    }
    Ok(rows)
}

//! The stages of a frame, each kept until what it was made from changes.

use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::light::Coming;
use super::{Light, Picture, Said, Wish, same_paint};
use crate::capture::{background, parts};
use crate::field::Field;
use crate::gpu::Gpu;
use crate::gpu::frame::{Background, Frame, Renderer};
use crate::gpu::method::MethodData;
use crate::image::display_bytes;
use crate::light::{LitHair, Medium};
use crate::paint::{Fibres, Paint};
use crate::quality::Settings;
use crate::scene::{EnvironmentSpec, FibreSpec, HairSpec, HeadSpec, Lens, RenderSpec, Scene};
use crate::srbf;
use crate::stage::{Geometry, exposure_scale, shaded_lights};
use crate::transport::Detail;

/// A hurried picture shall take no longer.
const HURRY_MS: f64 = 150.0;
/// Strand points that a hurried picture rasterises at most, about.
const HURRY_POINTS: usize = 45_000;
/// Pixels of a hurried picture: at least, and at first.
const HURRY_PIXELS: [f64; 2] = [10_000.0, 20_000.0];
/// What a light brings less of than this share is left out of a hurried picture: see `Renderer::negligible`.
const HURRY_NEGLIGIBLE: f64 = 0.03;
/// Cells of the density volume while the light turns.
const HURRY_CELLS: usize = 32;
/// So many lights are summed between two looks at whether to go on.
const LIGHTS_A_LOOK: usize = 8;

/// Something made, and what it was made from.
struct Made<K, T> {
    from: K,
    it: T,
}

/// What geometry is made from: hair without its paint, head, diameter.
type Shape = (HairSpec, HeadSpec, f64);
/// What a method is made from, beside paint in memory: fibre, method, the paint's file.
type Look = (FibreSpec, RenderSpec, Option<String>);

struct Body {
    stage: Arc<Geometry>,
    medium: Medium,
    /// Of [`HURRY_CELLS`].
    coarse: Medium,
}

/// Lit hair, and how well.
struct Lighting {
    lit: LitHair,
    /// By [`Body::coarse`], to the grid's samples alone.
    coarse: bool,
    known: HashSet<u32>,
    /// The points of hurried pictures, and their reach as cells have it.
    rough: Option<(Vec<u32>, Vec<Vec<u32>>)>,
}

/// How a picture was made: see [`Picture`].
struct How {
    finished: bool,
    ms: f64,
    quality: String,
}

/// All that frames of a changing scene are made from.
pub struct Session {
    gpu: Option<Made<String, Renderer>>,
    body: Option<Made<Shape, Body>>,
    light: Option<Arc<Light>>,
    /// The light that is asked for, where that is another.
    coming: Option<Coming>,
    /// The folder of fits made before; None fits each anew.
    pub cache: Option<PathBuf>,
    lighting: Option<Made<(u64, f64), Lighting>>,
    method: Option<Made<Look, MethodData>>,
    paint: Option<Arc<Paint>>,
    field: Option<Made<(u64, u64), Option<Field>>>,
    /// Counts what lighting, lights and fibres were made, for what follows from them.
    lit: u64,
    lights: u64,
    fibres: u64,
    /// The lighting that the renderer is ready to hurry with.
    hurry_ready: Option<u64>,
    hurry_pixels: f64,
    /// The wishes of the last hurried and of the last whole picture, as if nothing moved, with the light they show.
    hurried: Option<Wish>,
    whole: Option<Wish>,
}

/// Told, from any thread, what goes on.
pub type Say<'a> = &'a (dyn Fn(Said) + Sync);
/// Whether to go on with what is not hurried.
pub type GoOn<'a> = &'a (dyn Fn() -> bool + Sync);

impl Default for Session {
    fn default() -> Self {
        Self {
            gpu: None,
            body: None,
            light: None,
            coming: None,
            cache: srbf::cache_folder(),
            lighting: None,
            method: None,
            paint: None,
            field: None,
            lit: 0,
            lights: 0,
            fibres: 0,
            hurry_ready: None,
            hurry_pixels: HURRY_PIXELS[1],
            hurried: None,
            whole: None,
        }
    }
}

impl Session {
    /// Makes what `wish` asks for: a hurried picture where anything changed, then the whole one unless something moves.
    /// While its light is still being made these are under the light there was, and others follow unless something
    /// moves. False where it was given up for `go_on`.
    ///
    /// # Errors
    /// One line, if the wish cannot be seen; what was made before stays.
    pub fn see(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let result = self.try_see(wish, go_on, say);
        match result {
            Err(_) if !go_on() => Ok(false),
            Err(error) => {
                // A device that was lost is opened anew at the next wish.
                if self.gpu.as_ref().is_some_and(|made| made.it.gpu.wait().is_err()) {
                    self.gpu = None;
                    self.body = None;
                }
                (self.hurried, self.whole) = (None, None);
                Err(error)
            }
            done => done,
        }
    }

    fn try_see(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let scene = &wish.scene;
        self.ask_light(scene);
        self.make_body(scene, say)?;
        if self.light.is_none() && !self.await_light(scene, go_on, say)? {
            return Ok(false);
        }
        loop {
            if self.coming.as_ref().is_some_and(|coming| coming.ready()()) {
                self.take_light(scene, say)?;
            }
            // A light that comes meanwhile is worth more than a picture under the old one.
            let ready = self.coming.as_ref().map(Coming::ready);
            let on = || go_on() && !ready.as_ref().is_some_and(|ready| ready());
            match self.show(wish, &on, say) {
                Err(error) if on() => return Err(error),
                Ok(true) if self.coming.is_none() || wish.moving => return Ok(true),
                _ if !self.await_light(scene, go_on, say)? => return Ok(false),
                _ => {}
            }
        }
    }

    /// Sees to it that the light that the scene asks for is there or coming.
    fn ask_light(&mut self, scene: &Scene) {
        if self.light.as_ref().is_some_and(|light| light.is_of(scene)) {
            self.coming = None;
        } else if self.coming.as_ref().is_none_or(|coming| !coming.is_of(scene)) {
            let before = self.coming.take();
            let known = self.light.as_deref();
            self.coming = Some(Coming::new(scene, known, self.cache.as_deref(), before));
        }
    }

    /// Waits for the light that is coming, and takes it; false where it was given up.
    fn await_light(&mut self, scene: &Scene, go_on: GoOn, say: Say) -> Result<bool> {
        const LOOK: Duration = Duration::from_millis(5);
        let mut told = None;
        while let Some(coming) = self.coming.as_ref().filter(|_| go_on()) {
            if coming.over() {
                self.take_light(scene, say)?;
                break;
            }
            let progress = coming.progress();
            if told.replace(progress) != Some(progress) {
                say(Said::Progress(progress.0, progress.1));
            }
            std::thread::sleep(LOOK);
        }
        Ok(go_on())
    }

    fn take_light(&mut self, scene: &Scene, say: Say) -> Result<()> {
        let Some(coming) = self.coming.take() else { return Ok(()) };
        let light = Arc::new(coming.take()?);
        if light.map.mended.any() && self.light.as_ref().is_none_or(|l| l.source != light.source) {
            say(Said::Note(format!("{}: {}", light.source, light.map.mended)));
        }
        say(Said::Light(light.clone()));
        self.light = Some(light);
        self.lights += 1;
        self.set_map(scene);
        Ok(())
    }

    /// The pictures of a wish under the light that there is.
    fn show(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let scene = &wish.scene;
        let Some(light) = &self.light else { bail!("no light") };
        let mut shown = wish.clone();
        shown.scene.environment.source.clone_from(&light.source);
        shown.scene.environment.lights = Some(light.wanted);
        self.make_method(wish)?;
        if self.hurried.as_ref().is_none_or(|hurried| !hurried.same(&shown)) {
            self.make_lighting(scene, wish.moving, go_on, say)?;
            self.hurry(wish, say)?;
            self.hurried = Some(shown.clone());
        }
        if wish.moving || !go_on() {
            return Ok(wish.moving);
        }
        if self.coming.is_some() && self.whole.as_ref().is_some_and(|whole| whole.same(&shown)) {
            return Ok(true);
        }
        self.whole = None;
        self.make_lighting(scene, false, go_on, say)?;
        let whole = self.finish(wish, go_on, say)?;
        self.whole = whole.then_some(shown);
        Ok(whole)
    }

    fn make_body(&mut self, scene: &Scene, say: Say) -> Result<()> {
        let hair = HairSpec { paint: None, ..scene.hair.clone() };
        let from = (hair, scene.head.clone(), scene.fibre.diameter);
        let adapter = &scene.render.adapter;
        let has_gpu = self.gpu.as_ref().is_some_and(|made| made.from == *adapter);
        if self.body.as_ref().is_some_and(|made| made.from == from) && has_gpu {
            return Ok(());
        }
        say(Said::Progress("loading hair", 0.0));
        let stage = Arc::new(Geometry::load(scene)?);
        stage.notes.iter().for_each(|line| say(Said::Note(line.clone())));
        let medium = Medium::new(&stage, &Detail::USUAL);
        let coarse = medium.with_cells(&stage, HURRY_CELLS);
        // Another method is set before anything is shown.
        let even = Fibres::even(&scene.fibre.resolve());
        let method = MethodData::new(scene.fibre.model, even, &scene.render)?;
        let gpu = match self.gpu.take() {
            Some(made) if has_gpu => made.it.gpu,
            _ => Gpu::new(adapter)?,
        };
        let renderer = Renderer::new(gpu, &method, &stage)?;
        self.gpu = Some(Made { from: adapter.clone(), it: renderer });
        say(Said::Geometry(stage.clone()));
        self.body = Some(Made { from, it: Body { stage, medium, coarse } });
        self.lighting = None;
        self.method = None;
        self.field = None;
        self.hurry_ready = None;
        self.set_map(scene);
        Ok(())
    }

    /// Puts the map behind the hair.
    fn set_map(&mut self, scene: &Scene) {
        if let (Some(renderer), Some(light)) = (&mut self.gpu, &self.light) {
            let turn = scene.environment.rotation_deg.to_radians() as f32;
            renderer.it.set_environment(&light.map.environment, turn, 1.0);
        }
    }

    fn make_method(&mut self, wish: &Wish) -> Result<()> {
        let Wish { scene, paint, .. } = wish;
        let render = RenderSpec { samples: None, quality: None, ..scene.render.clone() };
        let from = (scene.fibre.clone(), render, scene.hair.paint.clone());
        if same_paint(paint, &self.paint)
            && self.method.as_ref().is_some_and(|made| made.from == from)
        {
            return Ok(());
        }
        let Some(body) = &self.body else { bail!("no hair") };
        let fibres = match paint {
            Some(paint) if paint.points() != body.it.stage.hair.points.len() => {
                bail!("the paint is of other hair: it comes back with it")
            }
            Some(paint) => Fibres::new(&scene.fibre, Some(paint)),
            None => body.it.stage.fibres(scene)?,
        };
        let it = MethodData::new(scene.fibre.model, fibres, &scene.render)?;
        if let Some(renderer) = &mut self.gpu {
            renderer.it.set_method(&it);
        }
        self.method = Some(Made { from, it });
        self.paint = paint.clone();
        self.fibres += 1;
        Ok(())
    }

    /// `hurry`: what is there will do, or else what coarse cells say.
    fn make_lighting(&mut self, scene: &Scene, hurry: bool, go_on: GoOn, say: Say) -> Result<()> {
        let (Some(body), Some(light)) = (&self.body, &self.light) else {
            bail!("no hair or light")
        };
        let from = (self.lights, scene.environment.rotation_deg);
        let good =
            |made: &Made<(u64, f64), Lighting>| made.from == from && (hurry || !made.it.coarse);
        if self.lighting.as_ref().is_some_and(good) {
            return Ok(());
        }
        let lights = shaded_lights(&light.fit.lights, &unexposed(scene));
        let medium = if hurry { &body.it.coarse } else { &body.it.medium };
        let turned = self.lighting.as_ref().is_none_or(|made| made.from != from);
        let lit = medium.bring(&body.it.stage, lights, &[], &|done| {
            if !hurry {
                say(Said::Progress("light through hair", done));
            }
            hurry || go_on()
        })?;
        self.lighting = Some(Made {
            from,
            it: Lighting { lit, coarse: hurry, known: HashSet::new(), rough: None },
        });
        self.lit += 1;
        if let Some(renderer) = self.gpu.as_mut().filter(|_| turned) {
            renderer.it.turn_environment(scene.environment.rotation_deg.to_radians() as f32);
        }
        Ok(())
    }

    /// A picture at once.
    fn hurry(&mut self, wish: &Wish, say: Say) -> Result<()> {
        let begun = Instant::now();
        let scene = &wish.scene;
        let share = (self.hurry_pixels / pixels(wish.size)).sqrt().min(1.0);
        let size = wish.size.map(|s| (f64::from(s) * share).round().max(1.0) as u32);
        let asked = parts(scene.render.scattering);
        let (lit, ready) = (self.lit, self.hurry_ready);
        let Some((body, renderer, lighting, _)) = self.parts() else { bail!("no hair") };
        let stage = &body.stage;
        let lens = lens(stage, scene, size)?;
        let thinning = stage.hair.points.len().div_ceil(HURRY_POINTS).max(1);
        if ready != Some(lit) {
            let (points, reach) = lighting.rough.get_or_insert_with(|| {
                let strands = stage.hair.strands().step_by(thinning);
                let points: Vec<u32> = strands.flatten().map(|i| i as u32).collect();
                let reach = body.medium.rough_reach(stage, &lighting.lit, &points);
                (points, reach)
            });
            renderer.set_thinning(thinning as u32);
            renderer.negligible = HURRY_NEGLIGIBLE;
            renderer.lights_a_group = usize::MAX;
            lighting.lit.show_at(renderer, points, reach);
        }
        if !asked.multiple() {
            renderer.clear_field();
        }
        let frame = renderer.render(&lens, 4, live_background(scene), asked)?;
        let strands = match thinning {
            1 => String::new(),
            n => format!(", 1 of {n} strands"),
        };
        self.hurry_ready = Some(lit);
        let ms = 1e3 * begun.elapsed().as_secs_f64();
        let quality = format!("{} × {}, 4 samples{strands}", size[0], size[1]);
        self.say_picture(wish, &frame, &lens, How { finished: false, ms, quality }, say)?;
        let wanted = self.hurry_pixels * (HURRY_MS / ms.max(1.0)).powf(0.7);
        self.hurry_pixels = wanted.clamp(HURRY_PIXELS[0], 1e7);
        Ok(())
    }

    /// The frame that `capture` makes.
    fn finish(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let begun = Instant::now();
        let scene = &wish.scene;
        let asked = parts(scene.render.scattering);
        let settings = Settings::of(scene);
        self.hurry_ready = None;
        let Some((body, renderer, lighting, _)) = self.parts() else { bail!("no hair") };
        let stage = &body.stage;
        let lens = lens(stage, scene, wish.size)?;
        renderer.set_thinning(1);
        renderer.negligible = settings.negligible;
        renderer.lights_a_group = LIGHTS_A_LOOK;
        let seen = renderer.visible_points(&[lens], stage.pieces(&lens), settings.samples)?;
        if !go_on() {
            return Ok(false);
        }
        let new: Vec<u32> = seen.iter().copied().filter(|i| !lighting.known.contains(i)).collect();
        if !new.is_empty() {
            body.medium.extend(stage, &mut lighting.lit, &new, &|done| {
                say(Said::Progress("light through hair", done));
                go_on()
            })?;
            lighting.known.extend(&new);
        }
        let from = (self.lit, self.fibres);
        if self.field.as_ref().is_none_or(|made| made.from != from) && asked.multiple() {
            let Some((body, _, lighting, method)) = self.parts() else { bail!("no hair") };
            let it = lighting.lit.field(&body.stage, &body.medium, method, &|done| {
                say(Said::Progress("light between strands", done));
                go_on()
            })?;
            self.field = Some(Made { from, it });
        }
        let field = self.field.take().filter(|_| asked.multiple());
        let Some((_, renderer, lighting, method)) = self.parts() else { bail!("no hair") };
        lighting.lit.show(renderer, method, field.as_ref().and_then(|made| made.it.as_ref()));
        self.field = field;
        say(Said::Progress("shading", 0.5));
        let Some(renderer) = self.gpu.as_mut() else { bail!("no device") };
        let looked = || go_on();
        let frame = renderer.it.render_while(
            &lens,
            settings.samples,
            live_background(scene),
            asked,
            Some(&looked),
        )?;
        let Some(frame) = frame else { return Ok(false) };
        let ms = 1e3 * begun.elapsed().as_secs_f64();
        let [width, height] = wish.size;
        let quality = format!(
            "{width} × {height}, {} samples, {} points",
            settings.samples,
            frame.shaded.len()
        );
        let finished = self.coming.is_none();
        self.say_picture(wish, &frame, &lens, How { finished, ms, quality }, say)?;
        Ok(true)
    }

    fn say_picture(
        &self,
        wish: &Wish,
        frame: &Frame,
        lens: &Lens,
        how: How,
        say: Say,
    ) -> Result<()> {
        let How { finished, ms, quality } = how;
        let Some(light) = &self.light else { bail!("no light") };
        if frame.pixels.iter().flatten().any(|v| !v.is_finite()) {
            bail!(
                "some pixels came out NaN or infinite: this is a fault of Hairlight; please report the scene"
            );
        }
        let scene = &wish.scene;
        let gain = 2f64.powf(scene.environment.exposure) as f32;
        let scale = exposure_scale(scene, light.mean_radiance) * gain;
        let rgba = display_bytes(&frame.pixels, scale);
        let lens = Lens { size: frame.size, ..*lens };
        say(Said::Picture(Picture { size: frame.size, rgba, finished, ms, quality, lens }));
        Ok(())
    }

    fn parts(&mut self) -> Option<(&Body, &mut Renderer, &mut Lighting, &MethodData)> {
        Some((
            &self.body.as_ref()?.it,
            &mut self.gpu.as_mut()?.it,
            &mut self.lighting.as_mut()?.it,
            &self.method.as_ref()?.it,
        ))
    }
}

fn pixels([width, height]: [u32; 2]) -> f64 {
    f64::from(width) * f64::from(height)
}

/// The scene's camera for a picture of another size than its own.
fn lens(stage: &Geometry, scene: &Scene, size: [u32; 2]) -> Result<Lens> {
    let mut scene = scene.clone();
    scene.output.size = size;
    Ok(stage.camera(&scene)?.lens(stage.center, size))
}

/// The light's exposure is a factor on all of the picture.
fn unexposed(scene: &Scene) -> Scene {
    let environment = EnvironmentSpec { exposure: 0.0, ..scene.environment.clone() };
    Scene { environment, ..scene.clone() }
}

/// What stands behind the hair, before that factor.
fn live_background(scene: &Scene) -> Background {
    match background(scene) {
        Background::Color(rgb) => {
            Background::Color(rgb.map(|c| c / 2f64.powf(scene.environment.exposure) as f32))
        }
        other => other,
    }
}

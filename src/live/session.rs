//! The stages of a frame, each kept until what it was made from changes.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, bail};

use super::{Picture, Said, Wish, same_paint};
use crate::capture::{background, parts};
use crate::environment::{self, Loaded};
use crate::field::Field;
use crate::file::catch_panic;
use crate::gpu::Gpu;
use crate::gpu::frame::{Background, Frame, Renderer};
use crate::gpu::method::MethodData;
use crate::image::display_bytes;
use crate::light::{LitHair, Medium};
use crate::paint::{Fibres, Paint};
use crate::quality::Settings;
use crate::scene::{EnvironmentSpec, FibreSpec, HairSpec, HeadSpec, Lens, RenderSpec, Scene};
use crate::srbf::{self, Fit};
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
    map: Option<Made<String, Loaded>>,
    fit: Option<Made<(String, u32), Fit>>,
    lighting: Option<Made<(u64, f64), Lighting>>,
    method: Option<Made<Look, MethodData>>,
    paint: Option<Arc<Paint>>,
    field: Option<Made<(u64, u64), Option<Field>>>,
    /// Counts what lighting and fibres were made, for what follows from them.
    lit: u64,
    fits: u64,
    fibres: u64,
    /// The lighting that the renderer is ready to hurry with.
    hurry_ready: Option<u64>,
    hurry_pixels: f64,
    /// The wish of the last hurried picture, as if nothing moved.
    hurried: Option<Wish>,
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
            map: None,
            fit: None,
            lighting: None,
            method: None,
            paint: None,
            field: None,
            lit: 0,
            fits: 0,
            fibres: 0,
            hurry_ready: None,
            hurry_pixels: HURRY_PIXELS[1],
            hurried: None,
        }
    }
}

impl Session {
    /// Makes what `wish` asks for: a hurried picture where anything changed, then the whole one unless something moves.
    /// False where it was given up for `go_on`.
    ///
    /// # Errors
    /// One line, if the wish cannot be seen; what was made before stays.
    pub fn see(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let mut seen = catch_panic(|| self.try_see(wish, go_on, say));
        // A device that is gone panics in some places and is an error in others.
        let lost = !matches!(seen, Ok(Ok(_))) && self.gpu().is_some_and(Gpu::lost);
        if lost {
            say(Said::Failed("the graphics device was lost: another one is opened".to_owned()));
        }
        if lost || seen.is_err() {
            // All that was on it is made again.
            self.gpu = None;
            self.hurried = None;
            seen = catch_panic(|| self.try_see(wish, go_on, say));
        }
        let result = seen.unwrap_or_else(|panic| {
            let words = panic.downcast_ref::<String>().map(String::as_str).unwrap_or_default();
            bail!(
                "this is a fault of Hairlight; please report the scene: {}",
                words.replace('\n', " ")
            )
        });
        match result {
            Err(_) if !go_on() => Ok(false),
            Err(error) => {
                self.hurried = None;
                Err(error)
            }
            done => done,
        }
    }

    /// The device that pictures are made on, once there is one.
    pub fn gpu(&self) -> Option<&Gpu> {
        Some(&self.gpu.as_ref()?.it.gpu)
    }

    fn try_see(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let scene = &wish.scene;
        self.make_body(scene, say)?;
        self.make_map(scene, say)?;
        self.make_fit(scene, go_on, say)?;
        self.make_method(wish)?;
        if self.hurried.as_ref().is_none_or(|hurried| !hurried.same(wish)) {
            self.make_lighting(scene, wish.moving, go_on, say)?;
            self.hurry(wish, say)?;
            self.hurried = Some(wish.clone());
        }
        if wish.moving || !go_on() {
            return Ok(wish.moving);
        }
        self.make_lighting(scene, false, go_on, say)?;
        self.finish(wish, go_on, say)
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
        say(Said::Geometry(from.0.clone(), stage.clone()));
        self.body = Some(Made { from, it: Body { stage, medium, coarse } });
        self.lighting = None;
        self.method = None;
        self.field = None;
        self.hurry_ready = None;
        self.set_map(scene);
        Ok(())
    }

    fn make_map(&mut self, scene: &Scene, say: Say) -> Result<()> {
        let source = &scene.environment.source;
        if self.map.as_ref().is_none_or(|made| made.from != *source) {
            say(Said::Progress("loading light", 0.0));
            let it = environment::load(source)?;
            if it.mended.any() {
                say(Said::Note(format!("{source}: {}", it.mended)));
            }
            self.map = Some(Made { from: source.clone(), it });
            self.set_map(scene);
        }
        Ok(())
    }

    /// Puts the map behind the hair.
    fn set_map(&mut self, scene: &Scene) {
        if let (Some(renderer), Some(map)) = (&mut self.gpu, &self.map) {
            let turn = scene.environment.rotation_deg.to_radians() as f32;
            renderer.it.set_environment(&map.it.environment, turn, 1.0);
        }
    }

    fn make_fit(&mut self, scene: &Scene, go_on: GoOn, say: Say) -> Result<()> {
        let Some(map) = &self.map else { bail!("no light") };
        let from = (map.from.clone(), Settings::of(scene).lights);
        if self.fit.as_ref().is_none_or(|made| made.from != from) {
            let it = srbf::fit_cached(&map.it.environment, from.1 as usize, &|done| {
                say(Said::Progress("fitting lights", done));
                go_on()
            })?;
            self.fit = Some(Made { from, it });
            self.fits += 1;
        }
        Ok(())
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
        let fibres = body.it.stage.fibres_under(paint.as_deref(), scene)?;
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
        let (Some(body), Some(fit)) = (&self.body, &self.fit) else { bail!("no hair or light") };
        let from = (self.fits, scene.environment.rotation_deg);
        let good =
            |made: &Made<(u64, f64), Lighting>| made.from == from && (hurry || !made.it.coarse);
        if self.lighting.as_ref().is_some_and(good) {
            return Ok(());
        }
        let lights = shaded_lights(&fit.it.lights, &unexposed(scene));
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
        self.say_picture(wish, &frame, &lens, How { finished: true, ms, quality }, say)?;
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
        let Some(map) = &self.map else { bail!("no light") };
        if frame.pixels.iter().flatten().any(|v| !v.is_finite()) {
            bail!(
                "some pixels came out NaN or infinite: this is a fault of Hairlight; please report the scene"
            );
        }
        let scene = &wish.scene;
        let gain = 2f64.powf(scene.environment.exposure) as f32;
        let scale = exposure_scale(scene, &map.it.environment) * gain;
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

//! The stages of a frame, each kept until what it was made from changes.

mod pick;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::light::Coming;
use super::{Figures, Light, Picture, Refusal, Said, ScenePart, Wish, same, unexposed};
use crate::capture::{background, nothing_seen, parts};
use crate::field::Field;
use crate::file::catch_panic;
use crate::gpu::Gpu;
use crate::gpu::frame::{Background, Frame, Renderer, Sight};
use crate::gpu::method::MethodData;
use crate::gpu::shaders::Shaders;
use crate::image::display_bytes;
use crate::light::{HairMedium, Lights, LitHair};
use crate::paint::{Channel, Fibres, Layer, Paint};
use crate::quality::{self, Costs, Facts, Pick, Settings};
use crate::scene::{
    FibreSpec, HairSpec, HeadSpec, LAMPS, LampSpec, Lens, RenderSpec, Scene, frame_within,
};
use crate::srbf::{self, sky_of, split_weak, split_wide};
use crate::stage::{Geometry, exposure_scale, load_hair, place_lights, suns};

/// A hurried picture shall take no longer.
const HURRY_MS: f64 = 150.0;
/// Strand points that a hurried picture rasterises at most, about.
const HURRY_POINTS: usize = 32_000;
/// Pixels of a hurried picture: at least, and at first.
const HURRY_PIXELS: [f64; 2] = [10_000.0, 20_000.0];
/// What a light brings less of than this share is left out of a hurried picture: see `Renderer::negligible`.
const HURRY_NEGLIGIBLE: f64 = 0.03;
/// Narrow lights that are brought through hair anew while the light turns; others are shared out among ordinates, which
/// stay where they are.
const HURRY_LIGHTS: usize = 6;
/// While nothing moves, rays are added until there are so many times as many as at first.
const MOST_RAYS: u32 = 16;
/// Of rest before it is made what the next pictures may take; what T̃ of points that nothing shows yet may take.
const FORESEE_AFTER: Duration = Duration::from_millis(300);
const FORESEEN_BYTES: usize = 256 << 20;

/// Something made, and what it was made from.
struct Made<K, T> {
    from: K,
    it: T,
}

/// What geometry is made from: hair without its paint, head without its colour, diameter.
type Shape = (HairSpec, HeadSpec, f64);
/// What a method is made from, beside paint in memory: fibre, method, the paint's file.
type Look = (FibreSpec, RenderSpec, Option<String>);

struct Body {
    stage: Arc<Geometry>,
    /// What is painted of its thickness.
    thickness: Option<Layer>,
    medium: HairMedium,
    /// Whether the medium has another thickness than the stage.
    stale: bool,
}

impl Body {
    fn new(stage: Arc<Geometry>, thickness: Option<Layer>) -> Body {
        let medium = HairMedium::new(&stage, true);
        Body { stage, thickness, medium, stale: false }
    }
}

/// The fit, its rotation and the lamps that hair is lit by.
type Turned = (u64, f64, [LampSpec; LAMPS]);

/// How a picture was made: see [`Picture`].
struct How {
    ms: f64,
    quality: String,
    /// Of a finished one.
    figures: Option<Figures>,
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
    /// While the light turns, with few narrow lights, and at rest.
    coarse: Option<Made<Turned, LitHair>>,
    fine: Option<Made<Turned, LitHair>>,
    /// Of the last whole picture, for its lens and samples.
    sight: Option<Made<(Lens, u32), Arc<Sight>>>,
    method: Option<Made<Look, MethodData>>,
    paint: Option<Arc<Paint>>,
    /// Of the scene's own paint.
    file_thickness: Option<Made<HairSpec, Option<Layer>>>,
    /// Those that were tried last.
    shaders: Option<Arc<Shaders>>,
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
    /// Milliseconds of what was made for the whole picture under way.
    stages: Vec<(&'static str, f64)>,
    facts: Option<Made<(u64, u64), Facts>>,
    /// For the scene's quality, of a wish without exposure.
    picked: Option<Made<Wish, Pick>>,
    /// The part of the scene in use now: an error is that part's fault.
    using: Option<ScenePart>,
    /// A scene of the parts that could be used last.
    usable: Scene,
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
            coarse: None,
            fine: None,
            sight: None,
            method: None,
            paint: None,
            file_thickness: None,
            shaders: None,
            field: None,
            lit: 0,
            lights: 0,
            fibres: 0,
            hurry_ready: None,
            hurry_pixels: HURRY_PIXELS[1],
            hurried: None,
            whole: None,
            stages: Vec::new(),
            facts: None,
            picked: None,
            using: None,
            usable: Scene::default(),
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
        let mut seen = catch_panic(|| self.try_see(wish, go_on, say));
        // A device that is gone panics in some places and is an error in others.
        let lost = !matches!(seen, Ok(Ok(_))) && self.gpu().is_some_and(Gpu::lost);
        if lost {
            say(Said::Failed("the graphics device was lost: another one is opened".to_owned()));
        }
        if lost || seen.is_err() {
            // All that was on it is made again.
            (self.gpu, self.sight) = (None, None);
            (self.hurried, self.whole) = (None, None);
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
            // What cannot be loaded is said whatever is asked for meanwhile, or it would be tried again and again.
            Err(_) if !go_on() && matches!(self.using, None | Some(ScenePart::Quality)) => {
                Ok(false)
            }
            Err(error) => {
                (self.hurried, self.whole) = (None, None);
                Err(error)
            }
            done => done,
        }
    }

    /// What to tell of an error of [`Session::see`]: the part of `scene` at fault with what can be used in its place,
    /// where both are known.
    pub fn refusal(&self, scene: &Scene, error: &anyhow::Error) -> Said {
        let line = format!("{error:#}");
        let Some(part) = self.using else { return Said::Failed(line) };
        let bare = |scene: &Scene| HairSpec { paint: None, ..scene.hair.clone() };
        let mut headless = Scene::default();
        headless.head.source = "none".to_owned();
        // Paint belongs to its hair.
        let usable = Some(self.usable.clone())
            .filter(|usable| part != ScenePart::Paint || bare(usable) == bare(scene));
        let mut others = usable.into_iter().chain([Scene::default(), headless]);
        match others.find(|other| !part.same(other, scene)) {
            Some(instead) => {
                Said::Refused(Box::new(Refusal { part, line, refused: scene.clone(), instead }))
            }
            None => Said::Failed(line),
        }
    }

    /// Notes that these parts of a scene can be used.
    fn can_use(&mut self, parts: &[ScenePart], scene: &Scene) {
        parts.iter().for_each(|part| part.copy(scene, &mut self.usable));
        self.using = None;
    }

    /// While nothing else is asked for: adds rays to the picture of `wish`, which is whole, until its T̃ stands still, and
    /// makes what the next pictures may take, so that they need not wait for it.
    pub fn idle(&mut self, wish: &Wish, go_on: GoOn, say: Say) {
        let begun = Instant::now();
        while begun.elapsed() < FORESEE_AFTER {
            if !go_on() {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        self.foresee_lighting(wish, go_on);
        let mut rays = 1;
        // Given up, what was traced is kept.
        while rays < MOST_RAYS && matches!(self.add_rays(wish, rays, go_on, say), Ok(true)) {
            rays *= 2;
        }
        self.foresee_points(go_on);
    }

    /// Doubles the rays of the whole picture, of which each light has `rays` times as many as it was shown with at first;
    /// false where it was given up.
    fn add_rays(&mut self, wish: &Wish, rays: u32, go_on: GoOn, say: Say) -> Result<bool> {
        let begun = Instant::now();
        let scene = &wish.scene;
        let settings = self.settings(scene);
        let turned = (self.lights, scene.environment.rotation_deg, scene.lamps);
        let Some(sight) = self.sight.as_ref().map(|sight| sight.it.clone()) else {
            return Ok(false);
        };
        if self.whole.is_none() || self.hurry_ready.is_some() {
            return Ok(false);
        }
        let Some((body, renderer, ..)) = self.parts(turned) else { return Ok(false) };
        let host = body.medium.rays(&body.stage, renderer);
        if !renderer.add_rays(&body.stage, &sight.points, rays, host, &|_| go_on())? {
            return Ok(false);
        }
        let (background, asked) = (live_background(scene), parts(scene.render.scattering));
        let frame = renderer.render_seen(&sight, background, asked, go_on)?;
        let Some(frame) = frame else { return Ok(false) };
        let lens = lens(&body.stage, scene, wish.size)?;
        let [width, height] = wish.size;
        let quality = format!(
            "{width} × {height}, {} samples, {} points, {} × rays",
            settings.samples,
            sight.points.len(),
            2 * rays
        );
        let figures = Some(self.figures(scene, &settings, &frame, &lens)?);
        self.say_picture(wish, frame, &lens, How { ms: ms_since(begun), quality, figures }, say)?;
        Ok(true)
    }

    /// What the first hurried pictures take: of another camera, and of light that turns.
    fn foresee_lighting(&mut self, wish: &Wish, go_on: GoOn) {
        let scene = &wish.scene;
        let Some(Made { it: body, .. }) = self.body.as_ref().filter(|body| !body.it.stale) else {
            return;
        };
        let (stage, Some(fine), Some(light)) = (&body.stage, &mut self.fine, &self.light) else {
            return;
        };
        let (_, points) = hurried_points(stage);
        body.medium.compute_coarse(stage, &mut fine.it, &points);
        let coarse = self.coarse.get_or_insert_with(|| not_lit(scene));
        if coarse.from != fine.from {
            let lights = lights_of(stage, light, scene, true);
            if body.medium.update_lights(stage, &mut coarse.it, lights, &|_| go_on()).is_err() {
                return;
            }
            body.medium.compute_coarse(stage, &mut coarse.it, &points);
            coarse.from = fine.from;
        }
    }

    /// T̃ that any whole picture of another camera takes.
    fn foresee_points(&mut self, go_on: GoOn) {
        let (Some(body), Some(fine), Some(renderer)) = (&self.body, &self.fine, &mut self.gpu)
        else {
            return;
        };
        let Body { stage, medium, stale, .. } = &body.it;
        let points = stage.hair.points.len();
        let fits = 4 * points * fine.it.brought.len() <= FORESEEN_BYTES;
        if fits && !stale && self.whole.is_some() && self.hurry_ready.is_none() {
            let all: Vec<u32> = (0..points as u32).collect();
            let rays = medium.rays(stage, &renderer.it);
            // Given up, what was traced is kept.
            let _ = renderer.it.foresee(stage, &all, rays, &|_| go_on());
        }
    }

    /// The device that pictures are made on, once there is one.
    pub fn gpu(&self) -> Option<&Gpu> {
        Some(&self.gpu.as_ref()?.it.gpu)
    }

    fn try_see(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let scene = &wish.scene;
        self.using = None;
        self.ask_light(scene);
        self.make_body(wish, say)?;
        self.can_use(&[ScenePart::Hair, ScenePart::Head, ScenePart::Adapter], scene);
        self.using = Some(ScenePart::Paint);
        self.make_thickness(wish, say)?;
        self.using = None;
        self.make_shaders(wish, say);
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
        self.using = Some(ScenePart::Map);
        let light = Arc::new(coming.take()?);
        self.can_use(&[ScenePart::Map], scene);
        if self.light.as_ref().is_none_or(|known| !Arc::ptr_eq(&known.map, &light.map)) {
            let notes = light.map.notes();
            notes.iter().for_each(|note| say(Said::Note(format!("{}: {note}", light.source))));
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
        if let Some(renderer) = &mut self.gpu {
            renderer.it.turn_environment(scene.environment.rotation_deg.to_radians() as f32);
        }
        let mut shown = wish.clone();
        shown.scene.environment.source.clone_from(&light.source);
        shown.scene.environment.layer.clone_from(&light.layer);
        shown.scene.environment.lights = Some(light.wanted);
        self.using = Some(ScenePart::Paint);
        self.make_method(wish)?;
        self.can_use(&[ScenePart::Paint], scene);
        self.using = Some(ScenePart::Camera);
        if let Some(body) = &self.body {
            lens(&body.it.stage, scene, wish.size)?;
        }
        self.can_use(&[ScenePart::Camera], scene);
        if self.hurried.as_ref().is_none_or(|hurried| !hurried.same(&shown)) {
            self.make_lighting(scene, wish.moving, go_on, say)?;
            if self.field.is_none() {
                // Without light between strands pale hair would be black at first.
                self.make_field(scene, &|| true, say)?;
                let field = self.field.as_ref().and_then(|made| made.it.as_ref());
                if let (Some(renderer), Some(field)) = (&mut self.gpu, field) {
                    renderer.it.set_field(field);
                }
            }
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
        self.using = Some(ScenePart::Quality);
        if !self.pick(wish, go_on, say)? {
            self.using = None;
            return Ok(true);
        }
        self.can_use(&[ScenePart::Quality], scene);
        let begun = Instant::now();
        self.make_medium();
        self.make_lighting(scene, false, go_on, say)?;
        self.stages = vec![("light through hair", ms_since(begun))];
        let whole = self.finish(wish, go_on, say)?;
        self.whole = whole.then_some(shown);
        Ok(whole)
    }

    /// What is painted of the thickness of `stage`.
    fn thickness(&mut self, wish: &Wish, stage: &Geometry) -> Result<Option<Layer>> {
        if let Some(paint) = &wish.paint {
            let fits = paint.points() == stage.groom().points.len();
            return Ok(paint.layer(Channel::Thickness).filter(|_| fits).cloned());
        }
        let from = &wish.scene.hair;
        if self.file_thickness.as_ref().is_none_or(|made| made.from != *from) {
            let paint = stage.paint(&wish.scene)?;
            let it = paint.and_then(|paint| paint.layer(Channel::Thickness).cloned());
            self.file_thickness = Some(Made { from: from.clone(), it });
        }
        Ok(self.file_thickness.as_ref().and_then(|made| made.it.clone()))
    }

    /// Strands are drawn at once as thick as they are painted; how dense the hair is follows in [`Self::make_medium`].
    fn make_thickness(&mut self, wish: &Wish, say: Say) -> Result<()> {
        let Some((of, stage)) =
            self.body.as_ref().map(|body| (body.from.0.clone(), body.it.stage.clone()))
        else {
            return Ok(());
        };
        let thickness = self.thickness(wish, &stage)?;
        let (Some(body), Some(renderer)) = (&mut self.body, &mut self.gpu) else { return Ok(()) };
        let body = &mut body.it;
        if body.thickness != thickness {
            let mut stage = Geometry::clone(&stage);
            stage.thicken(thickness.as_ref());
            renderer.it.set_diameters(&stage);
            self.sight = None;
            body.stage = Arc::new(stage);
            (body.thickness, body.stale) = (thickness, true);
            say(Said::Geometry(of, body.stage.clone()));
        }
        Ok(())
    }

    fn make_medium(&mut self) {
        let Some(body) = self.body.as_mut().filter(|body| body.it.stale) else { return };
        body.it = Body::new(body.it.stage.clone(), body.it.thickness.take());
        (self.coarse, self.fine) = (None, None);
    }

    fn make_body(&mut self, wish: &Wish, say: Say) -> Result<()> {
        let scene = &wish.scene;
        let hair = HairSpec { paint: None, ..scene.hair.clone() };
        let head = HeadSpec { color: HeadSpec::default().color, ..scene.head.clone() };
        let from = (hair, head, scene.fibre.diameter);
        let adapter = &scene.render.adapter;
        let has_gpu = self.gpu.as_ref().is_some_and(|made| made.from == *adapter);
        if self.body.as_ref().is_some_and(|made| made.from == from) && has_gpu {
            self.color_head(scene, say);
            return Ok(());
        }
        let known = self.body.as_ref().filter(|made| made.from == from);
        let body = match known {
            // Its files are not read again for another device: they may be gone.
            Some(_) => None,
            None => Some(self.load_body(wish, say)?),
        };
        let made = body.as_ref().or(self.body.as_ref().map(|made| &made.it));
        let Some(stage) = made.map(|body| body.stage.clone()) else { bail!("no hair") };
        // Another method is set before anything is shown.
        let even = Fibres::even(&scene.fibre.resolve());
        let method = MethodData::new(scene.fibre.model, even, &scene.render)?;
        self.using = Some(ScenePart::Adapter);
        let gpu = match self.gpu.take() {
            Some(made) if has_gpu => made.it.gpu,
            _ => {
                self.shaders = None;
                Gpu::new(adapter)?
            }
        };
        if body.is_some() {
            self.using = Some(ScenePart::Hair);
        }
        let renderer = Renderer::new(gpu, &method, &stage)?;
        self.gpu = Some(Made { from: adapter.clone(), it: renderer });
        if let Some(it) = body {
            say(Said::Geometry(from.0.clone(), stage));
            self.body = Some(Made { from, it });
            (self.coarse, self.fine) = (None, None);
        }
        self.sight = None;
        self.method = None;
        self.field = None;
        self.hurry_ready = None;
        self.set_map(scene);
        Ok(())
    }

    fn color_head(&mut self, scene: &Scene, say: Say) {
        let Some(body) = &mut self.body else { return };
        let albedo = scene.head.albedo();
        if body.it.stage.head_albedo == albedo {
            return;
        }
        let mut stage = Geometry::clone(&body.it.stage);
        stage.head_albedo = albedo;
        body.it.stage = Arc::new(stage);
        self.field = None;
        self.hurry_ready = None;
        say(Said::Geometry(body.from.0.clone(), body.it.stage.clone()));
    }

    fn load_body(&mut self, wish: &Wish, say: Say) -> Result<Body> {
        let scene = &wish.scene;
        say(Said::Progress("loading hair", 0.0));
        self.using = Some(ScenePart::Hair);
        let loaded = Geometry::load_bare(scene);
        if loaded.is_err() {
            // Of two that are wrong the hair is said first.
            let mut headless = scene.clone();
            headless.head.source = "none".to_owned();
            load_hair(&headless)?;
            self.using = Some(ScenePart::Head);
        }
        let mut stage = loaded?;
        stage.notes.iter().for_each(|line| say(Said::Note(line.clone())));
        self.using = Some(ScenePart::Paint);
        let thickness = self.thickness(wish, &stage)?;
        self.using = Some(ScenePart::Hair);
        stage.thicken(thickness.as_ref());
        Ok(Body::new(Arc::new(stage), thickness))
    }

    /// Tells what is wrong with shaders, and goes on with the last good ones.
    fn make_shaders(&mut self, wish: &Wish, say: Say) {
        let Some(renderer) = self.gpu.as_mut().filter(|_| !same(&self.shaders, &wish.shaders))
        else {
            return;
        };
        let built_in = Shaders::default();
        if let Err(error) = renderer.it.set_shaders(wish.shaders.as_deref().unwrap_or(&built_in)) {
            say(Said::Failed(format!("{error:#}")));
        }
        self.shaders = wish.shaders.clone();
        self.sight = None;
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
        if same(paint, &self.paint) && self.method.as_ref().is_some_and(|made| made.from == from) {
            return Ok(());
        }
        let Some(body) = &self.body else { bail!("no hair") };
        let stage = &body.it.stage;
        let painted = |paint: &Option<Arc<Paint>>| {
            paint.clone().filter(|paint| paint.points() == stage.groom().points.len())
        };
        let known = self.method.as_ref().filter(|made| made.from == from);
        let fibres = match (known, painted(&self.paint), painted(paint)) {
            (Some(known), Some(before), Some(paint)) => {
                known.it.fibres.repainted(&stage.at_points(&before), &stage.at_points(&paint))
            }
            _ => wish.fibres(stage)?,
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
        let from = (self.lights, scene.environment.rotation_deg, scene.lamps);
        let good = |made: &Option<Made<Turned, LitHair>>| {
            made.as_ref().is_some_and(|made| made.from == from)
        };
        if good(&self.fine) || hurry && good(&self.coarse) {
            return Ok(());
        }
        let lights = lights_of(&body.it.stage, light, scene, hurry);
        let made = if hurry { &mut self.coarse } else { &mut self.fine };
        let begun = made.get_or_insert_with(|| not_lit(scene));
        body.it.medium.update_lights(&body.it.stage, &mut begun.it, lights, &|done| {
            if !hurry {
                say(Said::Progress("light through hair", done));
            }
            hurry || go_on()
        })?;
        begun.from = from;
        self.lit += 1;
        Ok(())
    }

    /// A picture at once.
    fn hurry(&mut self, wish: &Wish, say: Say) -> Result<()> {
        let begun = Instant::now();
        let scene = &wish.scene;
        let share = (self.hurry_pixels / pixels(wish.size)).sqrt().min(1.0);
        let size = wish.size.map(|s| (f64::from(s) * share).round().max(1.0) as u32);
        let asked = parts(scene.render.scattering);
        let (now, ready) = (self.lit, self.hurry_ready);
        let turned = (self.lights, scene.environment.rotation_deg, scene.lamps);
        let Some((body, renderer, lit, _)) = self.parts(turned) else { bail!("no hair") };
        let stage = &body.stage;
        let lens = Lens { size, ..lens(stage, scene, wish.size)? };
        let (thinning, points) = hurried_points(stage);
        if ready != Some(now) {
            body.medium.compute_coarse(stage, lit, &points);
            renderer.set_thinning(thinning as u32);
            renderer.negligible = HURRY_NEGLIGIBLE;
            lit.show_coarse(stage, renderer, &points)?;
        }
        if !asked.multiple() {
            renderer.clear_field();
        }
        let frame = renderer.render(&lens, 4, live_background(scene), asked)?;
        let strands = match thinning {
            1 => String::new(),
            n => format!(", 1 of {n} strands"),
        };
        self.hurry_ready = Some(now);
        let ms = ms_since(begun);
        let quality = format!("{} × {}, 4 samples{strands}", size[0], size[1]);
        self.say_picture(wish, frame, &lens, How { ms, quality, figures: None }, say)?;
        let wanted = self.hurry_pixels * (HURRY_MS / ms.max(1.0)).powf(0.7);
        self.hurry_pixels = wanted.clamp(HURRY_PIXELS[0], 1e7);
        Ok(())
    }

    /// The frame that `capture` makes.
    fn finish(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let begun = Instant::now();
        let scene = &wish.scene;
        let asked = parts(scene.render.scattering);
        let settings = self.settings(scene);
        self.hurry_ready = None;
        let turned = (self.lights, scene.environment.rotation_deg, scene.lamps);
        let Some(body) = &self.body else { bail!("no hair") };
        let from = (lens(&body.it.stage, scene, wish.size)?, settings.samples);
        let known = self.sight.take().filter(|sight| sight.from == from);
        let Some((body, renderer, _, _)) = self.parts(turned) else { bail!("no hair") };
        let stage = &body.stage;
        renderer.set_thinning(1);
        renderer.negligible = settings.negligible;
        let (lens, samples) = from;
        let sight = match known {
            Some(sight) => sight.it,
            None => {
                let sight = renderer.look(&lens, stage.pieces(&lens), samples)?;
                if sight.points.is_empty() {
                    let adapter = &renderer.gpu.info.name;
                    say(Said::Note(nothing_seen(stage, &lens, samples, adapter)?));
                }
                Arc::new(sight)
            }
        };
        let seen_ms = ms_since(begun);
        let new = renderer.untraced(&sight.points);
        self.sight = Some(Made { from, it: sight.clone() });
        if !go_on() {
            return Ok(false);
        }
        let begun_field = Instant::now();
        self.make_field(scene, go_on, say)?;
        let field_ms = ms_since(begun_field);
        let begun_light = Instant::now();
        let field = self.field.take().filter(|_| asked.multiple());
        let Some((body, renderer, lit, method)) = self.parts(turned) else { bail!("no hair") };
        let shown = field.as_ref().and_then(|made| made.it.as_ref());
        let at = (&*body.stage, &body.medium);
        let seen = (&sight.points[..], Some(&sight.head));
        let lit = lit.show_at(at, renderer, method, shown, seen, settings.rays, &|done| {
            say(Said::Progress("light through hair", done));
            go_on()
        });
        self.field = field;
        lit?;
        self.stages[0].1 += ms_since(begun_light);
        let begun_frame = Instant::now();
        self.stages.extend([("what is seen", seen_ms), ("light between strands", field_ms)]);
        say(Said::Progress("shading", 0.5));
        let Some(renderer) = self.gpu.as_mut() else { bail!("no device") };
        let frame = renderer.it.render_seen(&sight, live_background(scene), asked, go_on)?;
        let Some(frame) = frame else { return Ok(false) };
        self.stages.push(("the frame", ms_since(begun_frame)));
        let ms = ms_since(begun);
        let figures = Figures { brought: new, ..self.figures(scene, &settings, &frame, &lens)? };
        let [width, height] = wish.size;
        let quality = format!(
            "{width} × {height}, {} samples, {} points",
            settings.samples,
            frame.shaded.len()
        );
        // Under an old light nothing is finished.
        let figures = Some(figures).filter(|_| self.coming.is_none());
        self.say_picture(wish, frame, &lens, How { ms, quality, figures }, say)?;
        Ok(true)
    }

    /// Light between strands, of the best lighting that there is, where the scene asks for it.
    fn make_field(&mut self, scene: &Scene, go_on: GoOn, say: Say) -> Result<()> {
        let from = (self.lit, self.fibres);
        let known = self.field.as_ref().is_some_and(|made| made.from == from);
        if known || !parts(scene.render.scattering).multiple() {
            return Ok(());
        }
        let turned = (self.lights, scene.environment.rotation_deg, scene.lamps);
        let Some((body, _, lit, method)) = self.parts(turned) else { bail!("no hair") };
        let it = lit.field(&body.stage, &body.medium, method, &|done| {
            say(Said::Progress("light between strands", done));
            go_on()
        })?;
        self.field = Some(Made { from, it });
        Ok(())
    }

    /// What a finished frame cost, and the error to expect of it.
    fn figures(
        &mut self,
        scene: &Scene,
        settings: &Settings,
        frame: &Frame,
        lens: &Lens,
    ) -> Result<Figures> {
        let multiple = parts(scene.render.scattering).multiple();
        let from = (self.lit, self.fibres);
        let Some(light) = &self.light else { bail!("no light") };
        let (Some(body), Some(lit), Some(method)) = (&self.body, &self.fine, &self.method) else {
            bail!("no hair")
        };
        let lights = &lit.it.lobes(&body.it.stage);
        let mut facts = match self.facts.take().filter(|made| made.from == from) {
            Some(made) => made.it,
            None => Facts::new(&method.it, lights, 1.0, multiple),
        };
        facts.multiple = multiple;
        facts.width_px = body.it.stage.width_px(lens);
        self.facts = Some(Made { from, it: facts });
        let (fitted, fit_error) = (light.fit.lights.len(), light.fit.relative_l2_blurred_0_30);
        let (points, lights) = (frame.shaded.len(), lights.len());
        let shade = frame.passes.get("shade").copied();
        let costs = shade.map(|shade_ms| {
            let gather_ms = frame.passes.get("gather").copied().unwrap_or(0.0);
            let rest_ms = frame.passes.values().sum::<f64>() - shade_ms - gather_ms;
            Costs::measured(settings, points, lights, [shade_ms, gather_ms, rest_ms])
        });
        let picked = self.picked.as_ref().zip(scene.render.quality);
        Ok(Figures {
            picked: picked.map(|(picked, target)| picked.it.line(target)),
            stages: self.stages.clone(),
            points,
            lights,
            brought: 0,
            fitted,
            fit_error,
            expected: facts.expected(settings, fit_error),
            front: costs.map_or(Vec::new(), |costs| {
                quality::front(&facts, &costs, (settings.lights, fit_error))
            }),
            frame_ms: costs.map(|costs| costs.frame_ms(settings)),
        })
    }

    fn say_picture(
        &self,
        wish: &Wish,
        frame: Frame,
        lens: &Lens,
        how: How,
        say: Say,
    ) -> Result<()> {
        let How { ms, quality, figures } = how;
        let Some(light) = &self.light else { bail!("no light") };
        if frame.pixels.iter().flatten().any(|v| !v.is_finite()) {
            bail!(
                "some pixels came out NaN or infinite: this is a fault of Hairlight; please report the scene"
            );
        }
        let scene = &wish.scene;
        let gain = 2f64.powf(scene.environment.exposure) as f32;
        let scale = exposure_scale(scene, &light.meter, -lens.forward) * gain;
        let rgba = display_bytes(&frame.pixels, scale);
        let lens = Lens { size: frame.size, ..*lens };
        let (size, finished) = (frame.size, figures.is_some());
        let (frame, figures) = (Arc::new(frame), figures.map(Arc::new));
        say(Said::Picture(Picture {
            size,
            rgba,
            finished,
            ms,
            quality,
            lens,
            frame,
            scale,
            figures,
        }));
        Ok(())
    }

    /// With the best lighting that there is, turned so.
    fn parts(
        &mut self,
        turned: Turned,
    ) -> Option<(&Body, &mut Renderer, &mut LitHair, &MethodData)> {
        let mut lit = [&mut self.fine, &mut self.coarse].into_iter().flatten();
        Some((
            &self.body.as_ref()?.it,
            &mut self.gpu.as_mut()?.it,
            &mut lit.find(|made| made.from == turned)?.it,
            &self.method.as_ref()?.it,
        ))
    }
}

fn ms_since(begun: Instant) -> f64 {
    1e3 * begun.elapsed().as_secs_f64()
}

/// Hair that no light was brought to yet.
fn not_lit(scene: &Scene) -> Made<Turned, LitHair> {
    /// Of no fit.
    const NOT_YET: u64 = u64::MAX;
    Made { from: (NOT_YET, 0.0, scene.lamps), it: LitHair::default() }
}

/// What hair is lit by, before the light's exposure: in a hurry few narrow lights are kept.
fn lights_of(stage: &Geometry, light: &Light, scene: &Scene, hurry: bool) -> Lights {
    let scene = &unexposed(scene);
    let placed = place_lights(&light.fit.lights, scene);
    let split = if hurry { split_weak(&placed, HURRY_LIGHTS) } else { split_wide(&placed) };
    Lights {
        lamps: stage.near_lamps(scene),
        distant: [suns(scene), split].concat(),
        sky: sky_of(&placed),
    }
}

/// One of how many strands a hurried picture has, and their points.
fn hurried_points(stage: &Geometry) -> (usize, Vec<u32>) {
    let thinning = stage.hair.points.len().div_ceil(HURRY_POINTS).max(1);
    let strands = stage.hair.strands().step_by(thinning);
    (thinning, strands.flatten().map(|i| i as u32).collect())
}

fn pixels([width, height]: [u32; 2]) -> f64 {
    f64::from(width) * f64::from(height)
}

/// The scene's camera for a picture of `size`, in the middle of which the scene's own frame lies.
fn lens(stage: &Geometry, scene: &Scene, size: [u32; 2]) -> Result<Lens> {
    let frame = frame_within(scene.output.size, size);
    Ok(stage.camera(scene)?.lens(stage.center, frame).around(size))
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

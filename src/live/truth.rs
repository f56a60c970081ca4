//! The truth of what is shown, path traced on a thread while it is looked at.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;

use super::session::GoOn;
use super::{Picture, Wish, Worker, unexposed};
use crate::image::display_bytes;
use crate::measure::bench::causes::Causes;
use crate::measure::bench::here;
use crate::measure::compare::{Judged, judge};
use crate::measure::read;
use crate::reference::Models;
use crate::reference::render::Shot;
use crate::reference::tracer::film::Film;
use crate::reference::tracer::light::Light;
use crate::reference::tracer::skin::Skin;
use crate::reference::tracer::strands::Strands;
use crate::reference::tracer::{Sampling, TraceScene, trace};
use crate::scene::Lens;
use crate::stage::Geometry;

/// The first picture has this share of the columns and rows, and so many samples a pixel.
const FIRST: (u32, u32) = (4, 4);
/// Samples a pixel at most.
const MOST_SAMPLES: u32 = 4096;

/// A finished picture, and what it is of.
#[derive(Clone)]
pub struct Question {
    pub wish: Wish,
    pub stage: Arc<Geometry>,
    pub light: Arc<super::Light>,
    /// Whether the causes of the picture's error are to be measured first.
    pub causes: bool,
    pub picture: Picture,
}

/// What the path tracer has so far.
pub enum Answer {
    Traced(Box<Traced>),
    /// What is measured of the causes, and the share done.
    Measuring(&'static str, f32),
    /// Each alone, in a picture of this size.
    Causes(Box<Causes>, [u32; 2]),
    /// In one line, why there is no truth.
    Failed(String),
}

/// A truth that still gains samples.
pub struct Traced {
    pub size: [u32; 2],
    /// sRGB with straight alpha, rows from the top, exposed as the picture is.
    pub rgba: Vec<u8>,
    /// A pixel.
    pub samples: u32,
    /// Path segments and shadow rays traced.
    pub segments: u64,
    /// Since it was asked for.
    pub seconds: f64,
    /// The picture against it, once both are of one size and its noise is known.
    pub judged: Option<Judged>,
}

/// A thread that traces the newest question; None ends what it traces.
pub type Tracer = Worker<Option<Question>, Answer>;

/// `wake` is called, from the thread, when there is an answer.
pub fn tracer(wake: impl Fn() + Send + Sync + 'static) -> Tracer {
    Worker::with(wake, |question: &Option<Question>, go_on, say| {
        let Some(question) = question else { return };
        let measured = || match question.causes {
            true => question.measure(go_on, say),
            false => Ok(()),
        };
        let traced = |_| question.trace(go_on, &|traced| say(Answer::Traced(Box::new(traced))));
        match measured().and_then(traced) {
            Err(error) if go_on() => say(Answer::Failed(format!("{error:#}"))),
            _ => {}
        }
    })
}

impl Question {
    fn measure(&self, go_on: GoOn, say: &(dyn Fn(Answer) + Sync)) -> Result<()> {
        let Question { wish, stage, light, picture, .. } = self;
        let told = |what, done| {
            say(Answer::Measuring(what, done));
            go_on()
        };
        let fibres = wish.fibres(stage)?;
        let map = &light.map.environment;
        let scene = unexposed(&wish.scene);
        let (causes, size) = here::causes(&scene, stage, &fibres, map, &picture.lens, &told)?;
        say(Answer::Causes(Box::new(causes), size));
        Ok(())
    }

    /// Tells `say` more and more of the truth, until it has [`MOST_SAMPLES`] or `go_on` says no.
    ///
    /// # Errors
    /// One line: a black light, paint that cannot be read, or a sample that is not finite.
    pub fn trace(&self, go_on: GoOn, say: &dyn Fn(Traced)) -> Result<()> {
        let begun = Instant::now();
        let Question { wish, stage, light, picture, .. } = self;
        // As frames are: the light's exposure is a factor on the whole.
        let scene = unexposed(&wish.scene);
        let map = &light.map.environment;
        let light = Light::map(map, scene.environment.rotation_deg.to_radians(), 1.0)?
            .with_lamps(&stage.lamps(&scene), stage.center);
        let fibres = wish.fibres(stage)?;
        let models = Models::new(&scene.fibre, &fibres);
        let Geometry { hair, diameters, frames, head, head_albedo, center, .. } = &**stage;
        let pieces = stage.pieces(&picture.lens);
        let strands = Strands::new(hair, diameters, frames, pieces, *center);
        let skin = head.as_ref().map(|head| Skin::new(head, *head_albedo, *center));
        let frame = read::Picture::of_frame(&picture.frame);
        let first = picture.lens.size.map(|side| side.div_ceil(FIRST.0));
        for (size, most) in [(first, FIRST.1), (picture.lens.size, MOST_SAMPLES)] {
            let lens = Lens { size, ..picture.lens };
            let traced = TraceScene {
                strands: &strands,
                skin: skin.as_ref(),
                light: &light,
                models: &models,
                lens,
                sampling: Sampling::Both,
                max_depth: u32::MAX,
                seed: 0,
            };
            let shot = Shot { scene: &scene, map, lens: &lens };
            let mut film = Film::new(size);
            while film.samples < most {
                // Each picture has a quarter more samples than the one before.
                let until = most.min(film.samples + (film.samples / 4).max(1));
                if !trace(&traced, &mut film, until, &|_| go_on())? {
                    return Ok(());
                }
                let pixels = shot.composed(&film);
                let whole = size == picture.lens.size && film.samples > 1;
                let judged = if whole { judge(&frame, &truth(&film, &pixels)).ok() } else { None };
                say(Traced {
                    size,
                    rgba: display_bytes(&pixels, picture.scale),
                    samples: film.samples,
                    segments: film.segments,
                    seconds: begun.elapsed().as_secs_f64(),
                    judged,
                });
            }
        }
        Ok(())
    }
}

/// The film over its backdrop, as frames are.
fn truth(film: &Film, pixels: &[[f32; 4]]) -> read::Picture {
    let rgb = pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    read::Picture { rgb, ..read::Picture::of_film(film, "the truth") }
}

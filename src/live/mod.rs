//! Live: a scene that changes, seen again and again, with no more made anew than what changed asks for.
//!
//! - [`Session`]: the stages of a frame, each kept with what it was made from: geometry ← hair, head; light ← map,
//!   number of lights; lit hair ← light, rotation, lamps; fibres ← fibre, paint; field ← lit hair, fibres. Exposure is a factor.
//! - [`Light`]: a map and its fit, made on a thread of its own while pictures go on under the light there was.
//! - [`Worker`]: a session on a thread of its own. Only the newest wish counts.
//! - [`truth`]: the same picture path traced, on another thread.
//!
//! A picture comes in two steps: one in a hurry (smaller, of fewer and wider strands, with T̃ of cells of 1/32
//! and the field that there was), then, once nothing moves, the very frame that `capture` makes; and while nothing is asked
//! for the same with ever more rays.

mod light;
mod part;
mod session;
pub mod truth;
mod worker;

use std::sync::Arc;

use anyhow::Result;

use crate::gpu::frame::Frame;
use crate::gpu::shaders::Shaders;
use crate::paint::{Fibres, Paint};
use crate::quality::{Expected, Pick};
use crate::scene::{EnvironmentSpec, HairSpec, Scene};
use crate::stage::Geometry;

pub use light::Light;
pub use part::{Refusal, ScenePart, file_name};
pub use session::Session;
pub use worker::Worker;

/// What is to be seen.
#[derive(Clone)]
pub struct Wish {
    pub scene: Scene,
    /// What is painted, in place of what the scene names; equal where it is the same in memory.
    pub paint: Option<Arc<Paint>>,
    /// Of the picture in pixels, at least 1. The frame of the scene's own shape lies in its middle, as large as fits:
    /// see [`crate::scene::frame_within`].
    pub size: [u32; 2],
    /// Something is being dragged: no time for more than the hurried picture.
    pub moving: bool,
    /// In place of the built-in ones; equal where they are the same in memory.
    pub shaders: Option<Arc<Shaders>>,
}

impl Wish {
    /// A scene at rest, as it is.
    pub fn new(scene: Scene, size: [u32; 2]) -> Self {
        Wish { scene, paint: None, size, moving: false, shaders: None }
    }

    /// Whether it is the same picture, moving or not.
    pub fn same(&self, other: &Wish) -> bool {
        let Wish { scene, paint, size, shaders, .. } = other;
        same(&self.paint, paint)
            && same(&self.shaders, shaders)
            && (&self.scene, &self.size) == (scene, size)
    }

    /// The fibre at each point of `stage`.
    ///
    /// # Errors
    /// One line: the paint is of other hair, or cannot be read.
    pub fn fibres(&self, stage: &Geometry) -> Result<Fibres> {
        stage.fibres_under(self.paint.as_deref(), &self.scene)
    }
}

/// Whether two are the same in memory.
pub fn same<T>(a: &Option<Arc<T>>, b: &Option<Arc<T>>) -> bool {
    a.as_ref().map(Arc::as_ptr) == b.as_ref().map(Arc::as_ptr)
}

/// A picture of a wish.
#[derive(Clone)]
pub struct Picture {
    pub size: [u32; 2],
    /// sRGB with straight alpha, rows from the top.
    pub rgba: Vec<u8>,
    /// Whether it is all that `capture` would make. Under the light there was, it is not.
    pub finished: bool,
    /// Wall time of the picture alone, and what it is made with, in words.
    pub ms: f64,
    pub quality: String,
    /// Of the scene's camera, relative to the hair's centre: for what is to be put over the picture.
    pub lens: crate::scene::Lens,
    /// In linear radiance, before the light's exposure.
    pub frame: Arc<Frame>,
    /// What that was multiplied by before tone mapping.
    pub scale: f32,
    /// What a finished picture cost.
    pub figures: Option<Arc<Figures>>,
}

/// Time, counts and the error to expect of a finished picture.
#[derive(Clone, Debug)]
pub struct Figures {
    /// What was picked for the scene's quality, where it asks for one.
    pub picked: Option<String>,
    /// Milliseconds of what was made anew for it, in order.
    pub stages: Vec<(&'static str, f64)>,
    /// Strand points shaded, and lights that each may have been shaded with: wide ones are ordinates.
    pub points: usize,
    pub lights: usize,
    /// Of those points, the ones that light had not been brought to for a picture before.
    pub brought: usize,
    /// Lights fitted to the map, and the relative L2 that the fit leaves after a blur of λ = 0.3.
    pub fitted: usize,
    pub fit_error: f64,
    /// The error to expect against path tracing, by cause.
    pub expected: Expected,
    /// What other settings are expected to give, the fastest first: see [`crate::quality::front`]. Empty where the
    /// device tells no times.
    pub front: Vec<Pick>,
    /// Milliseconds that the frame itself takes, as `front` counts them.
    pub frame_ms: Option<f64>,
}

/// What a session tells while it works.
#[derive(Clone)]
pub enum Said {
    Picture(Picture),
    /// What is being done, and the share done.
    Progress(&'static str, f32),
    /// Geometry that came to be, of this hair without its paint: for who paints on it or asks its size.
    Geometry(HairSpec, Arc<crate::stage::Geometry>),
    /// Light that came to be, for who looks at it.
    Light(Arc<Light>),
    /// What was assumed and mended.
    Note(String),
    /// In one line, what is wrong with the wish as a whole, or with the device; the last good stage stays.
    Failed(String),
    /// The part of the scene that no picture can be made of; the last good stage stays.
    Refused(Box<Refusal>),
}

/// The light's exposure is a factor on all of the picture.
fn unexposed(scene: &Scene) -> Scene {
    let environment = EnvironmentSpec { exposure: 0.0, ..scene.environment.clone() };
    Scene { environment, ..scene.clone() }
}

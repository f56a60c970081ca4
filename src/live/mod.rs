//! Live: a scene that changes, seen again and again, with no more made anew than what changed asks for.
//!
//! - [`Session`]: the stages of a frame, each kept with what it was made from: geometry ← hair, head; map; fit ← map,
//!   lights; lit hair ← fit, rotation; fibres ← fibre, paint; field ← lit hair, fibres. Exposure is a factor.
//! - [`Worker`]: a session on a thread of its own. Only the newest wish counts.
//!
//! A picture comes in two steps: one in a hurry (smaller, of fewer and wider strands, with the reach of cells of 1/32
//! and the field that there was), then, once nothing moves, the very frame that `capture` makes.

mod session;
mod worker;

use std::sync::Arc;

use crate::paint::Paint;
use crate::scene::{HairSpec, Scene};

pub use session::Session;
pub use worker::Worker;

/// What is to be seen.
#[derive(Clone)]
pub struct Wish {
    pub scene: Scene,
    /// What is painted, in place of what the scene names; equal where it is the same in memory.
    pub paint: Option<Arc<Paint>>,
    /// Of the picture in pixels, at least 1; the scene's own size does not count.
    pub size: [u32; 2],
    /// Something is being dragged: no time for more than the hurried picture.
    pub moving: bool,
}

impl Wish {
    /// Whether it is the same picture, moving or not.
    pub fn same(&self, other: &Wish) -> bool {
        let Wish { scene, paint, size, .. } = other;
        same_paint(&self.paint, paint) && (&self.scene, &self.size) == (scene, size)
    }
}

/// Whether two are the same in memory.
pub fn same_paint(a: &Option<Arc<Paint>>, b: &Option<Arc<Paint>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// A picture of a wish.
#[derive(Clone)]
pub struct Picture {
    pub size: [u32; 2],
    /// sRGB with straight alpha, rows from the top.
    pub rgba: Vec<u8>,
    /// Whether it is all that `capture` would make.
    pub finished: bool,
    /// Wall time of the picture alone, and what it is made with, in words.
    pub ms: f64,
    pub quality: String,
    /// Of the scene's camera, relative to the hair's centre: for what is to be put over the picture.
    pub lens: crate::scene::Lens,
}

/// What a session tells while it works.
#[derive(Clone)]
pub enum Said {
    Picture(Picture),
    /// What is being done, and the share done.
    Progress(&'static str, f32),
    /// Geometry that came to be, of this hair without its paint: for who paints on it or asks its size.
    Geometry(HairSpec, Arc<crate::stage::Geometry>),
    /// What was assumed and mended.
    Note(String),
    /// In one line, what is wrong with the wish, or with the device; the last good stage stays.
    Failed(String),
}

//! The causes of error of a scene as it is, small.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;

use super::Effort;
use super::causes::{Causes, OfModel, Subject, measure};
use super::images::{Asked, View, light};
use super::method::exact_single;
use crate::environment::Environment;
use crate::gpu::Gpu;
use crate::gpu::method::MethodData;
use crate::paint::Fibres;
use crate::progress::{Clock, Reporting};
use crate::reference::Models;
use crate::scene::{Lens, Scene};
use crate::stage::Geometry;

/// Pixels of the pictures that are compared, about, and samples a pixel of their truth.
const PIXELS: f64 = 8000.0;
const SAMPLES: u32 = 48;

/// Takes the error of a scene's frame apart, lit by its map alone, in a picture of at most some 8,000 pixels through `lens`; and its size.
///
/// # Errors
/// One line: no adapter, a method without the scene's model, `told` what is done and which share of it, and
/// said no.
pub fn causes(
    scene: &Scene,
    stage: &Geometry,
    fibres: &Fibres,
    map: &Environment,
    lens: &Lens,
    told: &(dyn Fn(&'static str, f32) -> bool + Sync),
) -> Result<(Causes, [u32; 2])> {
    let scene = &Scene { lamps: Default::default(), ..scene.clone() };
    let cancelled = AtomicBool::new(false);
    let told = |what, done| {
        if !told(what, done) {
            cancelled.store(true, Ordering::Relaxed);
        }
    };
    let clock = Clock::new(Reporting { quiet: true, cancelled: &cancelled, told: Some(&told) });
    let effort = Effort { truth_samples: SAMPLES, ..Effort::QUICK };
    let pixels = f64::from(lens.size[0]) * f64::from(lens.size[1]);
    let share = (PIXELS / pixels).sqrt().min(1.0);
    let size = lens.size.map(|side| (share * f64::from(side)).round().max(1.0) as u32);
    let data = MethodData::new(scene.fibre.model, fibres.clone(), &scene.render)?;
    let gpu = Gpu::new(&scene.render.adapter)?;
    let lens = Lens { size, ..*lens };
    let mut view = View::new(gpu, &data, stage, lens, effort.samples)?;
    let lit = light(&view, scene, map, &effort, &clock)?;
    let models = Models::new(&scene.fibre, fibres);
    let asked = Asked { models: &models, light: &lit.map, max_depth: u32::MAX, seed: 0 };
    let truth = clock.watch("truth", |progress| view.truth(&asked, SAMPLES, progress))?;
    let exact = exact_single(scene.fibre.model, fibres.base()).filter(|_| !fibres.painted());
    let field = clock.watch("scattered light", |progress| {
        lit.hair.field(stage, &view.medium, &data, progress)
    })?;
    let exact = (exact, field.as_ref());
    let model = OfModel::new(&mut view, &models, exact, &lit, SAMPLES, &clock)?;
    let method = scene.render.method.word().to_owned();
    let (data, field) = (&data, field.as_ref());
    let subject = Subject { method, data, field, lit: &lit, truth: &truth, model: &model };
    Ok((measure(&mut view, &subject)?, size))
}

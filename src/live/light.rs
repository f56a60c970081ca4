//! A session's light: a map and what is fitted to it, made on a thread of its own.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Result, anyhow};

use crate::environment::{self, Environment, LightMeter, Loaded};
use crate::quality::Settings;
use crate::scene::{EnvironmentSpec, Scene};
use crate::srbf::{self, Fit};

/// The longer side of [`Light::seen`], pixels at most.
const SEEN_SIDE: usize = 512;

/// A map and the lights fitted to it.
pub struct Light {
    /// What the map was read from, as a scene names it.
    pub source: String,
    /// The layer of it that the scene names.
    pub layer: Option<String>,
    /// Lights asked for; there may be fewer.
    pub wanted: u32,
    pub map: Arc<Loaded>,
    /// Of the map over the sphere.
    pub mean_radiance: [f64; 3],
    pub meter: LightMeter,
    pub fit: Fit,
    /// For the eye, not turned: the map and the radiance of its lights, both in one size of at most 512 a side.
    pub seen: [Environment; 2],
}

/// What a light is made from: the map's source and layer, and the lights asked for.
#[derive(Clone, PartialEq)]
struct Asked {
    source: String,
    layer: Option<String>,
    wanted: u32,
}

fn asked(scene: &Scene) -> Asked {
    let EnvironmentSpec { source, layer, .. } = scene.environment.clone();
    Asked { source, layer, wanted: Settings::of(scene).lights }
}

impl Light {
    /// Whether it is what the scene asks for. A quality picks lights where the scene sets none.
    pub fn is_of(&self, scene: &Scene) -> bool {
        let picked = scene.render.quality.is_some() && scene.environment.lights.is_none();
        let asked = asked(scene);
        self.is_map_of(&asked) && (picked || self.wanted == asked.wanted)
    }

    fn is_map_of(&self, asked: &Asked) -> bool {
        self.source == asked.source && self.layer == asked.layer
    }

    fn make(
        Asked { source, layer, wanted }: Asked,
        map: Option<Arc<Loaded>>,
        make_fit: impl FnOnce(&Environment) -> Result<Fit>,
    ) -> Result<Light> {
        let map = match map {
            Some(map) => map,
            None => Arc::new(environment::load_layer(&source, layer.as_deref())?),
        };
        let fit = make_fit(&map.environment)?;
        let small = map.environment.shrunk(SEEN_SIDE);
        let lights = srbf::preview(&fit.lights, small.width, small.height);
        let mean_radiance = map.environment.mean_radiance();
        let meter = LightMeter::new(&map.environment);
        let seen = [small, lights];
        Ok(Light { source, layer, wanted, map, mean_radiance, meter, fit, seen })
    }
}

struct Work {
    given_up: AtomicBool,
    ready: AtomicBool,
    /// What is being done, and the share done.
    progress: Mutex<(&'static str, f32)>,
}

/// A light that is being made; one that is dropped is given up.
pub(super) struct Coming {
    from: Asked,
    work: Arc<Work>,
    thread: Option<JoinHandle<Result<Light>>>,
}

impl Coming {
    /// Begins to make what the scene asks for, once `before`, given up, has ended: two large maps at a time are a lot
    /// of memory. `known` lends its map where that is the one; fits are remembered in `cache`.
    pub(super) fn new(
        scene: &Scene,
        known: Option<&Light>,
        cache: Option<&Path>,
        before: Option<Coming>,
    ) -> Coming {
        let from = asked(scene);
        let map = known.filter(|light| light.is_map_of(&from)).map(|light| light.map.clone());
        let cache = cache.map(Path::to_owned);
        let before = before.and_then(|mut coming| coming.thread.take());
        let work = Arc::new(Work {
            given_up: AtomicBool::new(false),
            ready: AtomicBool::new(false),
            progress: Mutex::new(("loading light", 0.0)),
        });
        // Pictures that go on meanwhile shall not queue behind the fit.
        let cores = rayon::current_num_threads();
        let few = || rayon::ThreadPoolBuilder::new().num_threads((cores - 1).max(1)).build();
        let pool = known.and_then(|_| few().ok());
        let (own, wanted) = (work.clone(), from.clone());
        let thread = std::thread::spawn(move || {
            if let Some(before) = before {
                let _ = before.join();
            }
            let make = || {
                own.go_on()?;
                let count = wanted.wanted as usize;
                let progress = |done| {
                    own.tell("fitting lights", done);
                    own.go_on().is_ok()
                };
                Light::make(wanted, map, |map| match cache {
                    Some(folder) => srbf::fit_cached_in(&folder, map, count, &progress),
                    None => srbf::fit(map, count, &progress),
                })
            };
            let light = match pool {
                Some(pool) => pool.install(make),
                None => make(),
            };
            own.ready.store(light.is_ok(), Ordering::Release);
            light
        });
        Coming { from, work, thread: Some(thread) }
    }

    /// Whether it is what the scene asks for.
    pub(super) fn is_of(&self, scene: &Scene) -> bool {
        self.from == asked(scene)
    }

    /// Tells whether it is there.
    pub(super) fn ready(&self) -> impl Fn() -> bool + Sync + use<> {
        let work = self.work.clone();
        move || work.ready.load(Ordering::Acquire)
    }

    /// Whether it is there, or failed.
    pub(super) fn over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    pub(super) fn progress(&self) -> (&'static str, f32) {
        *self.work.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What came; waits for it.
    ///
    /// # Errors
    /// One line: the map cannot be read, or no lights fitted to it.
    pub(super) fn take(mut self) -> Result<Light> {
        let broken = || anyhow!("{}: the fit broke off; please report the map", self.from.source);
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(light)) => light,
            _ => Err(broken()),
        }
    }
}

impl Drop for Coming {
    fn drop(&mut self) {
        self.work.given_up.store(true, Ordering::Relaxed);
    }
}

impl Work {
    fn go_on(&self) -> Result<()> {
        match self.given_up.load(Ordering::Relaxed) {
            true => Err(anyhow!("cancelled")),
            false => Ok(()),
        }
    }

    fn tell(&self, what: &'static str, done: f32) {
        *self.progress.lock().unwrap_or_else(PoisonError::into_inner) = (what, done);
    }
}

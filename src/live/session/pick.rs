//! A scene's quality, followed: what `capture` would pick for the picture that is asked for.

use anyhow::{Result, bail};

use super::{GoOn, Made, Say, Session, lens};
use crate::capture::parts;
use crate::live::light::Coming;
use crate::live::{Said, Wish, unexposed};
use crate::quality::{self, Costs, Facts, Settings, TRIAL_LIGHTS};
use crate::scene::Scene;
use crate::srbf;
use crate::stage::shaded_lights;

impl Session {
    /// What the whole picture is made with.
    pub(super) fn settings(&self, scene: &Scene) -> Settings {
        self.picked.as_ref().map_or_else(|| Settings::of(scene), |picked| picked.it.settings)
    }

    /// Picks what the scene's quality asks for, under its own light; false where that is other lights, which then are
    /// coming.
    pub(super) fn pick(&mut self, wish: &Wish, go_on: GoOn, say: Say) -> Result<bool> {
        let Some(target) = wish.scene.render.quality else {
            self.picked = None;
            return Ok(true);
        };
        let Some(light) = self.light.clone() else { bail!("no light") };
        if self.coming.is_some() {
            return Ok(true);
        }
        let wish = Wish { scene: unexposed(&wish.scene), ..wish.clone() };
        if self.picked.as_ref().is_none_or(|picked| !picked.from.same(&wish)) {
            say(Said::Progress("picking lights and samples", 0.0));
            let map = &light.map.environment;
            let progress = |_| go_on();
            let trial = match &self.cache {
                Some(folder) => srbf::fit_cached_in(folder, map, TRIAL_LIGHTS, &progress),
                None => srbf::fit(map, TRIAL_LIGHTS, &progress),
            }?;
            let lights = shaded_lights(&trial.lights, &wish.scene);
            let (Some(body), Some(renderer), Some(method)) =
                (&self.body, &mut self.gpu, &self.method)
            else {
                bail!("no hair")
            };
            let (stage, renderer) = (&body.it.stage, &mut renderer.it);
            let lens = lens(stage, &wish.scene, wish.size)?;
            self.hurry_ready = None;
            renderer.set_thinning(1);
            let pieces = stage.pieces(&lens);
            let costs = Costs::of_device(renderer, &method.it, &lens, pieces, lights.len())?;
            let multiple = parts(wish.scene.render.scattering).multiple();
            let facts = Facts::new(&method.it, &lights, stage.width_px(&lens), multiple);
            let error = trial.relative_l2_blurred_0_30;
            let it = quality::pick(&wish.scene, target, &facts, &costs, error);
            self.picked = Some(Made { from: wish.clone(), it });
        }
        let lights = self.settings(&wish.scene).lights;
        if light.wanted == lights {
            return Ok(true);
        }
        let mut scene = wish.scene;
        scene.environment.lights = Some(lights);
        self.coming = Some(Coming::new(&scene, Some(&light), self.cache.as_deref(), None));
        Ok(false)
    }
}

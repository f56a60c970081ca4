//! The light's section of the scene panel: the map, how it is turned, what is fitted to it.

use eframe::egui::{self, Ui};

use super::Editor;
use crate::editor::fields::field;
use crate::image::luminance;
use crate::scene::{FIELDS, LampKind, LampSpec, Scene};

impl Editor {
    pub(super) fn light_section(&mut self, ui: &mut Ui) {
        let scene = &mut self.document.scene;
        let toward = self.shown.picture.as_ref().map(|picture| -picture.lens.forward);
        egui::CollapsingHeader::new("Light").default_open(true).show(ui, |ui| {
            field(ui, "environment.source", scene);
            ui.with_layout(egui::Layout::right_to_left(egui::Align::TOP), |ui| {
                if ui.button("Browse maps…").clicked() {
                    self.maps.open = !self.maps.open;
                }
            });
            self.light.ui(ui, scene, toward);
            for key in [
                "environment.layer",
                "environment.lights",
                "environment.rotation_deg",
                "environment.exposure",
                "output.background",
                "output.exposure",
            ] {
                field(ui, key, scene);
            }
            let mean = self.light.light().map(|light| light.mean_radiance);
            lamps(ui, scene, &mut self.light.lamp, mean);
        });
        self.maps.show(ui.ctx(), scene);
    }
}

/// Lamps to choose from, the fields of the `chosen` one, and a button for one more: as bright as a map of this mean
/// radiance.
fn lamps(ui: &mut Ui, scene: &mut Scene, chosen: &mut Option<usize>, mean: Option<[f64; 3]>) {
    let there = |scene: &Scene, k: usize| scene.lamps[k].kind != LampKind::None;
    ui.separator();
    ui.horizontal_wrapped(|ui| {
        for k in (0..scene.lamps.len()).filter(|&k| there(scene, k)) {
            if ui.selectable_label(*chosen == Some(k), format!("Lamp {}", k + 1)).clicked() {
                *chosen = Some(k);
            }
        }
        let free = (0..scene.lamps.len()).find(|&k| !there(scene, k));
        let add = ui.add_enabled(free.is_some(), egui::Button::new("Add lamp"));
        let add = add.on_hover_text("A sphere near the head, as bright as the map; up to four");
        if let Some(k) = free.filter(|_| add.clicked()) {
            let bright = mean.map_or(1.0, |rgb| f64::from(luminance(rgb.map(|c| c as f32))));
            let irradiance = std::f64::consts::PI * if bright > 0.0 { bright } else { 1.0 };
            // Each in a place of its own.
            let azimuth_deg = [45.0, -45.0, 135.0, -135.0][k % 4];
            let kind = LampKind::Sphere;
            scene.lamps[k] = LampSpec { kind, azimuth_deg, irradiance, ..LampSpec::default() };
            *chosen = Some(k);
        }
    });
    let Some(k) = chosen.filter(|&k| there(scene, k)) else { return };
    let group = FIELDS.iter().filter(|field| field.group() == format!("lamp{}", k + 1));
    group.for_each(|of| field(ui, of.key, scene));
    if ui.button(format!("Remove lamp {}", k + 1)).clicked() {
        scene.lamps[k].kind = LampKind::None;
        *chosen = None;
    }
}

//! The light's section of the scene panel: the map, how it is turned, what is fitted to it.

use eframe::egui::{self, Ui};

use super::Editor;
use crate::editor::fields::field;

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
                "environment.lights",
                "environment.rotation_deg",
                "environment.exposure",
                "output.background",
                "output.exposure",
            ] {
                field(ui, key, scene);
            }
        });
        self.maps.show(ui.ctx(), scene);
    }
}

//! The light's section of the scene panel: the map, how it is turned, what is fitted to it.

use eframe::egui::{self, Ui};

use super::Editor;
use crate::editor::fields::field;

impl Editor {
    pub(super) fn light_section(&mut self, ui: &mut Ui) {
        let scene = &mut self.document.scene;
        egui::CollapsingHeader::new("Light").default_open(true).show(ui, |ui| {
            for key in [
                "environment.source",
                "environment.rotation_deg",
                "environment.exposure",
                "environment.lights",
                "output.background",
                "output.exposure",
            ] {
                field(ui, key, scene);
            }
        });
    }
}

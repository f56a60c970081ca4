//! The fibre's section of the scene panel: colour, lobes, shape.

use eframe::egui::{self, Ui, Vec2};

use super::Editor;
use crate::editor::fields::{self, field};
use crate::scene::PRESETS;

impl Editor {
    pub(super) fn fibre_section(&mut self, ui: &mut Ui) {
        let scene = &mut self.document.scene;
        egui::CollapsingHeader::new("Fibre").default_open(true).show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                for preset in PRESETS {
                    let chosen = scene.fibre.preset == preset.name;
                    if ui.selectable_label(chosen, preset.name).clicked() {
                        scene.fibre.set_preset(preset);
                    }
                }
            });
            let whole = fields::assembly_color(scene.fibre.pigment.sigma_a());
            ui.horizontal(|ui| {
                let (rect, _) = ui.allocate_exact_size(Vec2::new(40.0, 16.0), egui::Sense::hover());
                ui.painter().rect_filled(rect, 3.0, fields::swatch(whole));
                ui.weak("of the hair as a whole");
            });
            fields::alternatives(ui, "the colour of the fibre", "Colour by", scene);
            for key in [
                "fibre.beta_r_deg",
                "fibre.beta_tt_deg",
                "fibre.beta_trt_deg",
                "fibre.alpha_r_deg",
                "fibre.alpha_tt_deg",
                "fibre.alpha_trt_deg",
                "fibre.w_c",
                "fibre.eta",
                "fibre.eccentricity",
                "fibre.diameter",
                "fibre.model",
            ] {
                field(ui, key, scene);
            }
        });
    }
}

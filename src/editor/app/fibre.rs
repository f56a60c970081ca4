//! The fibre's section of the scene panel: presets, colour, lobes, shape.

use eframe::egui::{self, Ui, Vec2};

use super::Editor;
use crate::editor::fields;
use crate::editor::hints::Hints;
use crate::editor::lobe_plot::{self, LobePlot};
use crate::editor::thumbnails::Thumbnails;
use crate::scattering::fibre::Fibre;
use crate::scene::Scene;

/// The lobes as artists know them, and what each has of its own.
const LOBES: [(&str, [&str; 4]); 3] = [
    (
        "R: reflection off the surface",
        ["fibre.tint_r", "fibre.intensity_r", "fibre.beta_r_deg", "fibre.alpha_r_deg"],
    ),
    (
        "TT: light passing through",
        ["fibre.tint_tt", "fibre.intensity_tt", "fibre.beta_tt_deg", "fibre.alpha_tt_deg"],
    ),
    (
        "TRT: inner reflection, the second highlight",
        ["fibre.tint_trt", "fibre.intensity_trt", "fibre.beta_trt_deg", "fibre.alpha_trt_deg"],
    ),
];

/// What the section keeps from frame to frame.
#[derive(Default)]
pub(super) struct FibreSection {
    thumbnails: Thumbnails,
    pub(super) hints: Hints,
    lobes: LobePlot,
}

impl Editor {
    pub(super) fn fibre_section(&mut self, ui: &mut Ui) {
        let (scene, own) = (&mut self.document.scene, &mut self.fibre);
        egui::CollapsingHeader::new("Fibre").default_open(true).show(ui, |ui| {
            if let Some(preset) = own.thumbnails.buttons(ui, &scene.fibre.preset) {
                scene.fibre.set_preset(preset);
            }
            let hints = &mut own.hints;
            let mut explain = |ui: &mut Ui, key: &str, scene: &Scene| hints.show(ui, key, scene);
            let whole = fields::assembly_color(scene.fibre.pigment.sigma_a());
            ui.horizontal(|ui| {
                let (rect, _) = ui.allocate_exact_size(Vec2::new(40.0, 16.0), egui::Sense::hover());
                ui.painter().rect_filled(rect, 3.0, fields::swatch(whole));
                let tinted = scene.fibre.resolve().tint != Fibre::UNTINTED;
                let condition = if tinted { ", were no lobe tinted" } else { "" };
                ui.weak(format!("of the hair as a whole{condition}"));
            });
            fields::alternatives(ui, fields::COLOR, "Colour by", scene, &mut explain);
            egui::CollapsingHeader::new("Lobes").default_open(true).show(ui, |ui| {
                own.lobes.show(ui, scene);
            });
            for (p, (title, keys)) in LOBES.into_iter().enumerate() {
                let title = egui::RichText::new(title).color(lobe_plot::color(ui, p));
                egui::CollapsingHeader::new(title).default_open(true).show(ui, |ui| {
                    keys.iter().for_each(|key| fields::explained(ui, key, scene, &mut explain));
                });
            }
            for key in
                ["fibre.w_c", "fibre.eta", "fibre.eccentricity", "fibre.diameter", "fibre.model"]
            {
                fields::explained(ui, key, scene, &mut explain);
            }
        });
    }
}

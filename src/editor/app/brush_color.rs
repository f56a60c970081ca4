//! The brush's colour, stated as a scene states its own: as the hair's colour, by melanin, or by absorption.

use eframe::egui::{Sense, Ui, Vec2};

use crate::editor::brush::Brush;
use crate::editor::fields::{self, COLOR};
use crate::editor::hints::Hints;
use crate::scene::{FibreSpec, PRESETS, Pigment, Scene, assembly_color};

/// How the brush's colour is stated.
pub(super) struct BrushColor {
    /// Its pigment alone counts.
    scene: Scene,
}

impl Default for BrushColor {
    fn default() -> Self {
        let mut scene = Scene::default();
        scene.fibre.pigment = Pigment::Color(assembly_color(Brush::default().sigma_a()));
        Self { scene }
    }
}

impl BrushColor {
    pub(super) fn show(&mut self, ui: &mut Ui, brush: &mut Brush, hints: &mut Hints) {
        // What was picked up is stated in the same way where that way has it.
        let stated = &mut self.scene.fibre.pigment;
        if !near(stated, brush) {
            *stated = stated.restate(brush.sigma_a());
            if !near(stated, brush) {
                *stated = Pigment::Absorption(brush.sigma_a());
            }
        }
        let before = *stated;
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(Vec2::new(40.0, 16.0), Sense::hover());
            let whole = fields::swatch(assembly_color(brush.sigma_a()));
            ui.painter().rect_filled(rect, 3.0, whole);
            ui.weak("of the hair as a whole");
        });
        let mut explain = |ui: &mut Ui, key: &str, scene: &Scene| hints.show(ui, key, scene);
        fields::alternatives(ui, COLOR, "Colour by", &mut self.scene, &mut explain);
        ui.horizontal_wrapped(|ui| {
            for preset in PRESETS {
                if ui.small_button(preset.name).on_hover_text("Its pigment").clicked() {
                    let mut fibre = FibreSpec::default();
                    fibre.set_preset(preset);
                    self.scene.fibre.pigment = fibre.pigment;
                }
            }
        });
        let stated = &self.scene.fibre.pigment;
        if *stated != before {
            brush.value = roots(stated);
        }
    }
}

fn roots(pigment: &Pigment) -> [f32; 3] {
    pigment.sigma_a().map(|s| s.sqrt() as f32)
}

/// Whether a pigment is the brush's, to the halves that paint is kept in.
fn near(pigment: &Pigment, brush: &Brush) -> bool {
    roots(pigment).iter().zip(brush.value).all(|(a, b)| (a - b).abs() <= 1e-3 * b.abs().max(0.1))
}

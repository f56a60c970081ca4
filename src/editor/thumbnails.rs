//! Presets as pictures: a small groom in each, rendered beforehand.

use eframe::egui::{self, Align2, Color32, FontId, Pos2, Rect, Role, Sense, Ui, Vec2};

use crate::scene::{Background, Orbit, PRESETS, Preset, Scene, View};

/// Pixels of a side.
pub const SIDE: u32 = 96;
/// Points between buttons.
const GAP: f32 = 4.0;

/// Frames of [`preset_scene`] for all of [`PRESETS`], side by side, as a PNG.
const STRIP: &[u8] = include_bytes!("../../assets/presets.png");

/// Pictures of [`PRESETS`].
#[derive(Default)]
pub struct Thumbnails {
    strip: Option<egui::TextureHandle>,
}

impl Thumbnails {
    /// A button for each preset, to be found by its name; the one that was clicked.
    pub fn buttons(&mut self, ui: &mut Ui, chosen: &str) -> Option<&'static Preset> {
        let strip = self.strip.get_or_insert_with(|| load(ui.ctx()));
        let mut clicked = None;
        let all = PRESETS.len() as f32;
        let side = (ui.available_width() - GAP * (all - 1.0)) / all;
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing = Vec2::splat(GAP);
            for (k, preset) in PRESETS.iter().enumerate() {
                let x = |k: usize| k as f32 / all;
                let part = Rect::from_min_max(Pos2::new(x(k), 0.0), Pos2::new(x(k + 1), 1.0));
                let side = side.clamp(24.0, SIDE as f32);
                if button(ui, side, (strip.id(), part), preset, preset.name == chosen) {
                    clicked = Some(preset);
                }
            }
        });
        clicked
    }
}

fn load(ctx: &egui::Context) -> egui::TextureHandle {
    let strip = image::load_from_memory(STRIP).expect("a PNG of this program").into_rgb8();
    let size = [strip.width(), strip.height()].map(|s| s as usize);
    let strip = egui::ColorImage::from_rgb(size, strip.as_raw());
    ctx.load_texture("presets", strip, egui::TextureOptions::LINEAR)
}

/// What a preset's picture shows, [`SIDE`] pixels a side.
pub fn preset_scene(preset: &Preset) -> Scene {
    let mut scene = Scene::default();
    scene.hair.source = "builtin:wavy".to_owned();
    scene.hair.strands = 3000;
    scene.head.source = "none".to_owned();
    scene.environment.lights = Some(12);
    // Close up from behind, where hair is all that is seen.
    scene.camera.view =
        View::Orbit(Orbit { azimuth_deg: 150.0, elevation_deg: 5.0, distance: Some(1.9) });
    scene.output.background = Background::Color([0.02; 3]);
    scene.output.size = [SIDE; 2];
    scene.fibre.set_preset(preset);
    scene
}

/// A preset's picture, part of a texture, over its name; whether it was clicked.
fn button(
    ui: &mut Ui,
    side: f32,
    (texture, part): (egui::TextureId, Rect),
    preset: &Preset,
    chosen: bool,
) -> bool {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(side, side + 16.0), Sense::click());
    response.widget_info(|| egui::WidgetInfo::selected(Role::Button, true, chosen, preset.name));
    let visuals = ui.style().interact_selectable(&response, chosen);
    let painter = ui.painter();
    if chosen || response.hovered() || response.has_focus() {
        painter.rect_filled(rect, 3.0, visuals.bg_fill);
    }
    let square = Rect::from_min_size(rect.min, Vec2::splat(side)).shrink(2.0);
    painter.image(texture, square, part, Color32::WHITE);
    let at = rect.center_bottom() - Vec2::new(0.0, 8.0);
    let font = FontId::proportional(11.0);
    painter.text(at, Align2::CENTER_CENTER, preset.name, font, visuals.text_color());
    if response.has_focus() {
        let stroke = ui.visuals().selection.stroke;
        painter.rect_stroke(rect, 3.0, stroke, egui::StrokeKind::Inside);
    }
    response.on_hover_text(preset.rationale).clicked()
}

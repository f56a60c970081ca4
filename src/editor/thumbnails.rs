//! Presets as pictures: a small groom in each, by the renderer itself, on a thread that ends with the last.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use eframe::egui::{self, Align2, FontId, Rect, Role, Sense, Ui, Vec2};

use super::viewport::Pane;
use crate::live::{Picture, Said, Session, Wish};
use crate::scene::{Background, Orbit, PRESETS, Preset, Scene, View};

/// Pixels of a side.
const SIDE: u32 = 96;
/// Points between buttons.
const GAP: f32 = 4.0;

/// Of presets in order, as many as there are: made once for all windows.
static KNOWN: Mutex<Vec<Picture>> = Mutex::new(Vec::new());

/// Pictures of [`PRESETS`], in order, as far as they are there.
#[derive(Default)]
pub struct Thumbnails {
    shown: Vec<Pane>,
    making: Option<Making>,
}

struct Making {
    pictures: Receiver<Picture>,
    go_on: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Making {
    fn drop(&mut self) {
        self.go_on.store(false, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Thumbnails {
    /// Begins where nothing was begun, and takes what is there. `adapter` as in `render.adapter`.
    pub fn listen(&mut self, ctx: &egui::Context, adapter: &str) {
        let making = self.making.get_or_insert_with(|| Making::new(ctx, adapter));
        for picture in making.pictures.try_iter() {
            let mut shown = Pane::default();
            shown.put(ctx, picture.size, &picture.rgba);
            self.shown.push(shown);
        }
    }

    /// A button for each preset, to be found by its name; the one that was clicked.
    pub fn buttons(&self, ui: &mut Ui, chosen: &str) -> Option<&'static Preset> {
        let mut clicked = None;
        let all = PRESETS.len() as f32;
        let side = (ui.available_width() - GAP * (all - 1.0)) / all;
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing = Vec2::splat(GAP);
            for (k, preset) in PRESETS.iter().enumerate() {
                let shown = self.shown.get(k);
                if button(ui, side.clamp(24.0, SIDE as f32), shown, preset, preset.name == chosen) {
                    clicked = Some(preset);
                }
            }
        });
        clicked
    }
}

impl Making {
    fn new(ctx: &egui::Context, adapter: &str) -> Making {
        let (sender, pictures) = channel();
        let go_on = Arc::new(AtomicBool::new(true));
        let (own, ctx, adapter) = (go_on.clone(), ctx.clone(), adapter.to_owned());
        let thread = std::thread::spawn(move || {
            let mut session = Session::default();
            let go_on = || own.load(Ordering::Relaxed);
            for (k, preset) in PRESETS.iter().enumerate() {
                let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
                if known.len() <= k {
                    let Some(picture) = picture(&mut session, preset, &adapter, &go_on) else {
                        return;
                    };
                    known.push(picture);
                }
                let sent = sender.send(known[k].clone());
                if !go_on() || sent.is_err() {
                    return;
                }
                ctx.request_repaint();
            }
        });
        Making { pictures, go_on, thread: Some(thread) }
    }
}

/// A picture of a preset; none where there is no device, which the window says of its own picture, or no time.
fn picture(
    session: &mut Session,
    preset: &Preset,
    adapter: &str,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Option<Picture> {
    let mut scene = Scene::default();
    scene.hair.source = "builtin:wavy".to_owned();
    scene.hair.strands = 3000;
    scene.head.source = "none".to_owned();
    scene.environment.lights = Some(4);
    // Close up from behind, where hair is all that is seen.
    scene.camera.view =
        View::Orbit(Orbit { azimuth_deg: 150.0, elevation_deg: 5.0, distance: Some(1.9) });
    scene.output.size = [SIDE; 2];
    scene.output.background = Background::Color([0.02; 3]);
    scene.render.samples = Some(4);
    scene.render.adapter = adapter.to_owned();
    scene.fibre.set_preset(preset);
    let wish = Wish::new(scene, [SIDE; 2]);
    let whole = Mutex::new(None);
    let say = |said| {
        if let Said::Picture(picture) = said
            && picture.finished
        {
            *whole.lock().unwrap_or_else(PoisonError::into_inner) = Some(picture);
        }
    };
    session.see(&wish, go_on, &say).ok()?;
    whole.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// A preset's picture, as far as there is one, over its name; whether it was clicked.
fn button(ui: &mut Ui, side: f32, shown: Option<&Pane>, preset: &Preset, chosen: bool) -> bool {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(side, side + 16.0), Sense::click());
    response.widget_info(|| egui::WidgetInfo::selected(Role::Button, true, chosen, preset.name));
    let visuals = ui.style().interact_selectable(&response, chosen);
    let painter = ui.painter();
    if chosen || response.hovered() || response.has_focus() {
        painter.rect_filled(rect, 3.0, visuals.bg_fill);
    }
    let square = Rect::from_min_size(rect.min, Vec2::splat(side)).shrink(2.0);
    match shown {
        Some(shown) => shown.paint(ui, square, square),
        None => _ = painter.rect_filled(square, 2.0, visuals.weak_bg_fill),
    }
    let at = rect.center_bottom() - Vec2::new(0.0, 8.0);
    let font = FontId::proportional(11.0);
    painter.text(at, Align2::CENTER_CENTER, preset.name, font, visuals.text_color());
    if response.has_focus() {
        let stroke = ui.visuals().selection.stroke;
        painter.rect_stroke(rect, 3.0, stroke, egui::StrokeKind::Inside);
    }
    response.on_hover_text(preset.rationale).clicked()
}

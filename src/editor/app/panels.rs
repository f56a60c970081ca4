//! Panels around the picture: menu, status, tools, the scene.

use std::path::Path;

use eframe::egui::{self, Ui};

use super::files::{Leaving, PromptKind};
use super::picture::bare;
use super::{Editor, Tool};
use crate::editor::brush::{Falloff, Mode, Reach};
use crate::editor::fields::{self, field};
use crate::editor::viewport;
use crate::paint::Channel;

impl Editor {
    pub(super) fn menu(&mut self, ui: &mut Ui) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| {
                if ui.button("New").clicked() {
                    self.leave(Leaving::New);
                }
                if ui.button("Open…").clicked() {
                    self.ask_path(PromptKind::Open);
                }
                self.recent_menu(ui);
                ui.separator();
                if ui.button("Save").clicked() {
                    self.save();
                }
                if ui.button("Save as…").clicked() {
                    self.ask_path(PromptKind::Save);
                }
                if ui.button("Save picture…").clicked() {
                    self.ask_path(PromptKind::Picture);
                }
                ui.separator();
                if ui.button("Quit").clicked() {
                    ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
                }
            });
            ui.menu_button("Edit", |ui| {
                let (steps, done) = self.history.steps();
                let (can_undo, can_redo) = (done > 0, done < steps.len());
                if ui.add_enabled(can_undo, egui::Button::new("Undo")).clicked() {
                    self.undo(false);
                }
                if ui.add_enabled(can_redo, egui::Button::new("Redo")).clicked() {
                    self.undo(true);
                }
                ui.separator();
                if ui.button("Copy picture").clicked() {
                    self.copy_picture(ui.ctx());
                }
            });
            ui.menu_button("View", |ui| {
                if ui.button("Frame the hair").clicked() {
                    viewport::frame(&mut self.document.scene, self.stage.as_deref());
                }
                ui.checkbox(&mut self.frame_only, "Output frame only");
                ui.checkbox(&mut self.truth.on, "Truth beside the frame");
                let mut turning = self.turning.is_some();
                if ui.checkbox(&mut turning, "Turntable").clicked() {
                    self.set_turning(turning);
                }
                ui.separator();
                ui.menu_button("Interface size", egui::gui_zoom::zoom_menu_buttons);
                let mut theme = ui.ctx().options(|options| options.theme_preference);
                ui.horizontal(|ui| {
                    use egui::ThemePreference::{Dark, Light, System};
                    for (other, word) in
                        [(System, "As the desktop"), (Dark, "Dark"), (Light, "Light")]
                    {
                        ui.radio_value(&mut theme, other, word);
                    }
                });
                ui.ctx().set_theme(theme);
            });
            if ui.button("?").on_hover_text("Shortcuts").clicked() {
                self.shortcuts = !self.shortcuts;
            }
            let name = self.document.path.as_deref().and_then(Path::file_name);
            let name = name.map_or("untitled".into(), |name| name.to_string_lossy());
            let mark = if self.document.changed() { " •" } else { "" };
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.weak(format!("{name}{mark}"));
            });
        });
    }

    pub(super) fn status(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some((line, wrong)) = &self.message {
                let color =
                    if *wrong { ui.visuals().error_fg_color } else { ui.visuals().text_color() };
                let label = egui::Label::new(egui::RichText::new(line).color(color));
                // One that is cut off is shown whole under the pointer; several stand one below another.
                ui.add(if line.contains('\n') { label.extend() } else { label.truncate() });
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                // What is said comes first.
                const ROOM: f32 = 320.0;
                if let Some(picture) =
                    self.shown.picture.as_ref().filter(|_| ui.available_width() > ROOM)
                {
                    ui.weak(format!("{} in {:.0} ms", picture.quality, picture.ms));
                }
                if let Some((what, done)) = self.progress {
                    ui.add(egui::ProgressBar::new(done).desired_width(60.0).desired_height(6.0));
                    ui.weak(what);
                }
                self.saving_status(ui);
            });
        });
    }

    pub(super) fn tool_panel(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut self.tool, Tool::View, "View").on_hover_text("V");
            ui.selectable_value(&mut self.tool, Tool::Paint, "Paint").on_hover_text("B");
        });
        ui.separator();
        if self.tool == Tool::Paint {
            self.brush_panel(ui);
            ui.separator();
        }
        self.truth_section(ui);
        self.history_panel(ui);
    }

    pub(super) fn brush_panel(&mut self, ui: &mut Ui) {
        let brush = &mut self.brush;
        let before = brush.channel;
        ui.label("What to paint");
        for channel in Channel::ALL {
            ui.radio_value(&mut brush.channel, channel, channel.name());
        }
        if brush.channel != before {
            brush.value = bare(&self.document.scene, brush.channel);
        }
        match brush.channel {
            Channel::Absorption => self.brush_color.show(ui, brush, &mut self.fibre.hints),
            channel => {
                let [least, most] = channel.range();
                let unit = match channel {
                    Channel::Roughness | Channel::Tilt => "°",
                    _ => "",
                };
                fields::number(ui, "Value", fields::parse_number, |ui, parser| {
                    let slider = egui::Slider::new(&mut brush.value[0], least..=most).suffix(unit);
                    ui.add(slider.custom_parser(parser).text("Value"))
                });
            }
        }
        ui.separator();
        ui.horizontal_wrapped(|ui| {
            for mode in Mode::ALL {
                ui.selectable_value(&mut brush.mode, mode, mode.word());
            }
        });
        percent(ui, "Radius", &mut brush.radius, 0.003..=0.5)
            .on_hover_text("Of the picture's height; [ and ]");
        percent(ui, "Strength", &mut brush.strength, 0.0..=1.0);
        percent(ui, "Spacing", &mut brush.spacing, 0.05..=1.0);
        egui::ComboBox::from_label("Falloff").selected_text(brush.falloff.word()).show_ui(
            ui,
            |ui| {
                for falloff in Falloff::ALL {
                    ui.selectable_value(&mut brush.falloff, falloff, falloff.word());
                }
            },
        );
        egui::ComboBox::from_label("Reach").selected_text(brush.reach.word()).show_ui(ui, |ui| {
            for reach in Reach::ALL {
                ui.selectable_value(&mut brush.reach, reach, reach.word());
            }
        });
        percent(ui, "At the root", &mut brush.gradient[0], 0.0..=1.0);
        percent(ui, "At the tip", &mut brush.gradient[1], 0.0..=1.0);
        ui.checkbox(&mut brush.mirror, "Mirror left and right");
    }

    pub(super) fn history_panel(&mut self, ui: &mut Ui) {
        let (steps, done) = self.history.steps();
        let megabytes = self.history.bytes() as f64 / f64::from(1 << 20);
        ui.label("History").on_hover_text(format!("{megabytes:.1} MB kept"));
        if self.history.forgotten > 0 {
            ui.weak(format!("{} older steps let go for memory", self.history.forgotten));
        }
        let mut wanted = None;
        if ui.selectable_label(done == 0, "Opened").clicked() {
            wanted = Some(0);
        }
        for (k, step) in steps.iter().enumerate() {
            let label = egui::RichText::new(step.label());
            let label = if k < done { label } else { label.weak() };
            let shown = ui.push_id(k, |ui| ui.selectable_label(k + 1 == done, label)).inner;
            if shown.accessible_name(format!("Step {}: {}", k + 1, step.label())).clicked() {
                wanted = Some(k + 1);
            }
        }
        if let Some(wanted) = wanted {
            let steps = wanted.abs_diff(done);
            (0..steps).for_each(|_| self.undo(wanted > done));
        }
    }

    pub(super) fn scene_panel(&mut self, ui: &mut Ui) {
        self.fibre_section(ui);
        self.light_section(ui);
        let scene = &mut self.document.scene;
        egui::CollapsingHeader::new("Camera").show(ui, |ui| {
            for key in [
                "camera.fov_deg",
                "camera.azimuth_deg",
                "camera.elevation_deg",
                "camera.distance",
                "camera.position",
                "camera.target",
            ] {
                field(ui, key, scene);
            }
        });
        egui::CollapsingHeader::new("Hair and head").show(ui, |ui| {
            for key in [
                "hair.source",
                "hair.up",
                "hair.scale",
                "hair.reverse",
                "head.source",
                "head.up",
                "head.scale",
                "head.offset",
                "head.color",
            ] {
                field(ui, key, scene);
            }
            if scene.hair.source.starts_with("builtin:") {
                for key in [
                    "hair.strands",
                    "hair.length",
                    "hair.curl",
                    "hair.clump",
                    "hair.flyaway",
                    "hair.seed",
                ] {
                    field(ui, key, scene);
                }
            }
            // What was painted since stands for the file.
            if self.document.paint.is_none() {
                field(ui, "hair.paint", scene);
            }
            self.notes.iter().rev().take(4).for_each(|line| {
                ui.weak(line);
            });
        });
        let scene = &mut self.document.scene;
        egui::CollapsingHeader::new("Rendering").show(ui, |ui| {
            for key in [
                "render.method",
                "render.nodes",
                "render.segments",
                "render.samples",
                "render.quality",
                "render.scattering",
                "render.adapter",
                "output.size",
                "output.path",
            ] {
                field(ui, key, scene);
            }
            let picture = self.shown.picture.as_ref();
            if let Some(line) = picture.and_then(|p| p.figures.as_ref()?.picked.as_ref()) {
                // The interface's fonts lack this sign.
                ui.weak(line.replace(" ⊕", ","));
            }
        });
    }
}

/// A slider in per cent; a range that does not begin at 0 is logarithmic where it is wide.
pub(super) fn percent(
    ui: &mut Ui,
    what: &str,
    x: &mut f32,
    range: std::ops::RangeInclusive<f32>,
) -> egui::Response {
    let wide = *range.start() > 0.0 && range.end() / range.start() > 100.0;
    fields::number(ui, what, fields::parse_percent, |ui, parser| {
        let slider = egui::Slider::new(x, range).logarithmic(wide).text(what);
        let shown = |x: f64, _| format!("{:.0} %", 100.0 * x);
        ui.add(slider.custom_formatter(shown).custom_parser(parser))
    })
}

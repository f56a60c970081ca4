//! A browser of maps: the builtin ones, and those of folders that the user adds. A thread reads them, one at a time,
//! and nothing is kept of them but thumbnails.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

use anyhow::{Context, Result};
use eframe::egui::{self, Align2, Color32, FontId, Rect, Sense, Stroke, Ui, Vec2};

use super::{desktop, light_view};
use crate::environment;
use crate::file::typed_path;
use crate::image::luminance;
use crate::scene::{Kind, Scene, field_named};

/// Of a thumbnail, pixels; and of its place with what stands below it, points.
const THUMBNAIL: usize = 128;
const CELL: Vec2 = Vec2::new(136.0, 104.0);

struct Map {
    /// As a scene names it.
    source: String,
    name: String,
    look: Look,
}

enum Look {
    Coming,
    Seen {
        /// Pixels and megabytes, in words.
        size: String,
        texture: egui::TextureHandle,
    },
    /// In one line, why it cannot be seen.
    Broken(String),
}

/// The maps of one folder; of none, the builtin ones.
struct Shelf {
    folder: Option<PathBuf>,
    maps: Result<Vec<Map>, String>,
}

/// A map in small.
struct Thumbnail {
    size: String,
    picture: egui::ColorImage,
}

enum Ask {
    Look(PathBuf),
    Forget(PathBuf),
}

enum News {
    Listed(PathBuf, Result<Vec<PathBuf>>),
    Seen(String, Result<Thumbnail>),
}

#[derive(Default)]
pub struct Maps {
    pub open: bool,
    shelves: Vec<Shelf>,
    /// A folder as it is typed.
    typed: String,
    dialog: Option<Receiver<Option<PathBuf>>>,
    /// From the first look on.
    reader: Option<(Sender<Ask>, Receiver<News>)>,
}

impl Maps {
    /// The window, where it is open: a click puts a map into the scene.
    pub fn show(&mut self, ctx: &egui::Context, scene: &mut Scene) {
        if !self.open {
            return;
        }
        if self.reader.is_none() {
            self.begin(ctx, scene);
        }
        self.listen(ctx);
        let mut open = true;
        let window = egui::Window::new("Maps").open(&mut open);
        window.default_pos([270.0, 60.0]).default_size([580.0, 480.0]).show(ctx, |ui| {
            self.folder_row(ui);
            ui.separator();
            egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                self.shelves(ui, scene);
            });
        });
        self.open = open;
    }

    fn begin(&mut self, ctx: &egui::Context, scene: &Scene) {
        let builtins = match field_named("environment.source").map(|field| field.kind) {
            Ok(Kind::Source { builtins, .. }) => builtins,
            _ => &[],
        };
        let map = |name: &&str| Map {
            source: format!("builtin:{name}"),
            name: (*name).to_owned(),
            look: Look::Coming,
        };
        let maps: Vec<Map> = builtins.iter().map(map).collect();
        let waiting = maps.iter().map(|map| map.source.clone()).collect();
        self.shelves = vec![Shelf { folder: None, maps: Ok(maps) }];
        let source = Path::new(&scene.environment.source);
        if let Some(folder) = source.parent().filter(|_| source.is_file()) {
            self.typed = folder.to_string_lossy().into_owned();
        }
        let (ask, asked) = channel();
        let (tell, news) = channel();
        let ctx = ctx.clone();
        std::thread::spawn(move || {
            read(waiting, &asked, |what| {
                let told = tell.send(what).is_ok();
                ctx.request_repaint();
                told
            });
        });
        self.reader = Some((ask, news));
    }

    fn listen(&mut self, ctx: &egui::Context) {
        let Some((_, news)) = &self.reader else { return };
        for what in news.try_iter() {
            match what {
                News::Listed(folder, found) => {
                    let map = |path: PathBuf| Map {
                        name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                        source: path.to_string_lossy().into_owned(),
                        look: Look::Coming,
                    };
                    let of = |shelf: &&mut Shelf| shelf.folder.as_ref() == Some(&folder);
                    if let Some(shelf) = self.shelves.iter_mut().find(of) {
                        let found = found.map(|paths| paths.into_iter().map(map).collect());
                        shelf.maps = found.map_err(|error| format!("{error:#}"));
                    }
                }
                News::Seen(source, seen) => {
                    let maps = self.shelves.iter_mut().filter_map(|shelf| shelf.maps.as_mut().ok());
                    let Some(map) = maps.flatten().find(|map| map.source == source) else {
                        continue;
                    };
                    map.look = match seen {
                        Ok(Thumbnail { size, picture }) => {
                            let options = egui::TextureOptions::LINEAR;
                            Look::Seen { size, texture: ctx.load_texture("map", picture, options) }
                        }
                        Err(error) => {
                            let line = format!("{error:#}");
                            let reason = line.strip_prefix(&source).unwrap_or(&line);
                            Look::Broken(reason.trim_start_matches([':', ' ']).to_owned())
                        }
                    };
                }
            }
        }
    }

    fn folder_row(&mut self, ui: &mut Ui) {
        if let Some(Ok(chosen)) = self.dialog.as_ref().map(Receiver::try_recv) {
            self.dialog = None;
            if let Some(folder) = chosen {
                self.add(&folder);
            }
        }
        ui.horizontal(|ui| {
            let label = ui.label("Folder");
            let edit = egui::TextEdit::singleline(&mut self.typed).desired_width(300.0);
            let edit = ui.add(edit.hint_text("of .exr and .hdr files")).labelled_by(label.id);
            let entered = edit.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter));
            let there = !self.typed.trim().is_empty();
            let add = ui.add_enabled(there, egui::Button::new("Add")).clicked();
            if (add || entered) && there {
                self.add(&PathBuf::from(typed_path(&self.typed)));
            }
            let browse = egui::Button::new("Browse…");
            if ui.add_enabled(self.dialog.is_none(), browse).clicked() {
                self.dialog = Some(desktop::ask(ui.ctx(), |dialog| dialog.pick_folder()));
            }
        });
    }

    /// Shows the maps of a folder, anew where it is shown.
    fn add(&mut self, folder: &Path) {
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let of = |shelf: &Shelf| shelf.folder.as_ref() == Some(&folder);
        if !self.shelves.iter().any(of) {
            self.shelves.push(Shelf { folder: Some(folder.clone()), maps: Ok(Vec::new()) });
        }
        self.ask(Ask::Look(folder));
    }

    fn ask(&self, what: Ask) {
        if let Some((ask, _)) = &self.reader {
            let _ = ask.send(what);
        }
    }

    fn shelves(&mut self, ui: &mut Ui, scene: &mut Scene) {
        let mut removed = None;
        for (k, shelf) in self.shelves.iter().enumerate() {
            ui.horizontal(|ui| match &shelf.folder {
                None => _ = ui.strong("Builtin"),
                Some(folder) => {
                    let name = folder.display().to_string();
                    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                        let button = ui.small_button("Remove");
                        super::fields::name_it(&button, &format!("Remove {name}"));
                        if button.on_hover_text("From this list; files stay").clicked() {
                            removed = Some(k);
                        }
                        ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                            ui.add(egui::Label::new(egui::RichText::new(name).strong()).truncate());
                        });
                    });
                }
            });
            match &shelf.maps {
                Err(reason) => _ = ui.colored_label(ui.visuals().error_fg_color, reason),
                Ok(maps) if maps.is_empty() => _ = ui.weak("No .exr or .hdr files"),
                Ok(maps) => {
                    ui.horizontal_wrapped(|ui| maps.iter().for_each(|map| cell(ui, map, scene)));
                }
            }
            ui.add_space(6.0);
        }
        if let Some(folder) = removed.and_then(|k| self.shelves.remove(k).folder) {
            self.ask(Ask::Forget(folder));
        }
    }
}

/// A map's thumbnail, name and size.
fn cell(ui: &mut Ui, map: &Map, scene: &mut Scene) {
    let sense = match map.look {
        Look::Broken(_) => Sense::hover(),
        _ => Sense::click(),
    };
    let (rect, response) = ui.allocate_exact_size(CELL, sense);
    let now = &scene.environment.source;
    let chosen = *now == map.source
        || std::path::absolute(now).is_ok_and(|path| path.as_path() == Path::new(&map.source));
    let label = match &map.look {
        Look::Broken(reason) => format!("Map {}: {reason}", map.name),
        _ => format!("Map {}", map.name),
    };
    response.widget_info(|| {
        egui::WidgetInfo::selected(egui::Role::Button, true, chosen, label.clone())
    });
    if response.clicked() {
        scene.environment.set_source(map.source.clone());
    }
    if !ui.is_rect_visible(rect) {
        return;
    }
    let visuals = ui.style().interact_selectable(&response, chosen);
    if chosen || response.hovered() || response.has_focus() {
        ui.painter().rect(
            rect,
            4.0,
            visuals.weak_bg_fill,
            if response.has_focus() { ui.visuals().selection.stroke } else { Stroke::NONE },
            egui::StrokeKind::Inside,
        );
    }
    let side = THUMBNAIL as f32;
    let picture = Rect::from_min_size(rect.min + Vec2::splat(4.0), Vec2::new(side, 0.5 * side));
    let painter = ui.painter_at(rect);
    let small = FontId::proportional(10.0);
    let mut below = String::new();
    match &map.look {
        Look::Seen { size, texture } => {
            let whole = Rect::from_min_max(egui::Pos2::ZERO, egui::pos2(1.0, 1.0));
            painter.image(texture.id(), picture, whole, Color32::WHITE);
            below.clone_from(size);
        }
        Look::Coming => {
            painter.rect_filled(picture, 0.0, ui.visuals().extreme_bg_color);
            let color = ui.visuals().weak_text_color();
            painter.text(picture.center(), Align2::CENTER_CENTER, "reading", small.clone(), color);
        }
        Look::Broken(reason) => {
            painter.rect_filled(picture, 0.0, ui.visuals().extreme_bg_color);
            let color = ui.visuals().error_fg_color;
            let galley = painter.layout(reason.clone(), small.clone(), color, side - 8.0);
            painter.with_clip_rect(picture).galley(picture.min + Vec2::splat(4.0), galley, color);
        }
    }
    let text = if chosen { visuals.text_color() } else { ui.visuals().text_color() };
    let mut name = egui::text::LayoutJob::simple_singleline(
        map.name.clone(),
        FontId::proportional(12.0),
        text,
    );
    name.wrap = egui::text::TextWrapping::truncate_at_width(side);
    let name = painter.layout_job(name);
    painter.galley(picture.left_bottom() + Vec2::new(0.0, 2.0), name, text);
    let at = picture.left_bottom() + Vec2::new(0.0, 18.0);
    painter.text(at, Align2::LEFT_TOP, below, small, ui.visuals().weak_text_color());
    let full = match &map.look {
        Look::Broken(reason) => format!("{}\n{reason}", map.source),
        _ => map.source.clone(),
    };
    response.on_hover_text(full);
}

/// Lists folders and makes thumbnails until nobody asks or listens any more.
fn read(mut waiting: VecDeque<String>, asked: &Receiver<Ask>, tell: impl Fn(News) -> bool) {
    loop {
        // A new folder is listed before thumbnails go on.
        let ask = match waiting.is_empty() {
            true => asked.recv().map_err(|_| TryRecvError::Disconnected),
            false => asked.try_recv(),
        };
        let told = match ask {
            Err(TryRecvError::Disconnected) => false,
            Err(TryRecvError::Empty) => match waiting.pop_front() {
                Some(source) => {
                    let seen = thumbnail(&source);
                    tell(News::Seen(source, seen))
                }
                None => true,
            },
            Ok(Ask::Forget(folder)) => {
                waiting.retain(|source| Path::new(source).parent() != Some(&folder));
                true
            }
            Ok(Ask::Look(folder)) => {
                waiting.retain(|source| Path::new(source).parent() != Some(&folder));
                let found = list(&folder);
                let paths = found.iter().flatten();
                waiting.extend(paths.map(|path| path.to_string_lossy().into_owned()));
                tell(News::Listed(folder, found))
            }
        };
        if !told {
            return;
        }
    }
}

/// The .exr and .hdr files of a folder, by name.
fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = || -> std::io::Result<Vec<PathBuf>> {
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect()
    };
    let mut paths = read().context("the folder cannot be read")?;
    let is_map = |path: &PathBuf| {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        (extension == "exr" || extension == "hdr") && path.is_file()
    };
    paths.retain(is_map);
    paths.sort();
    Ok(paths)
}

fn thumbnail(source: &str) -> Result<Thumbnail> {
    let map = environment::load(source)?.environment;
    let mut size = format!("{} × {}", map.width, map.height);
    if let Ok(file) = std::fs::metadata(source) {
        let bytes = file.len() as f64;
        size += &match bytes < 1e6 {
            true => format!(", {:.0} kB", (bytes / 1e3).max(1.0)),
            false => format!(", {:.1} MB", bytes / 1e6),
        };
    }
    let mean = luminance(map.mean_radiance().map(|c| c as f32));
    let scale = if mean > 0.0 { 1.0 / mean } else { 1.0 };
    let small = map.shrunk(THUMBNAIL);
    Ok(Thumbnail { size, picture: light_view::shown(&small, scale) })
}

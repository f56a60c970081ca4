//! The truth beside the frame: path traced while nothing moves, judged, and what the frame cost.

use eframe::egui::{self, Align2, Color32, FontId, Grid, Pos2, Rect, Ui, pos2};

use super::Editor;
use crate::editor::speed_plot::speed_plot;
use crate::editor::viewport::Pane;
use crate::live::truth::{Answer, Question, Traced, Tracer, tracer};
use crate::measure::bench::causes::Causes;
use crate::measure::compare::Judged;

/// What is shown on the right of the divider.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Side {
    #[default]
    Traced,
    Signed,
    Flip,
}

impl Side {
    const ALL: [(Side, &'static str, &'static str); 3] = [
        (Side::Traced, "path traced", "What the frame approximates"),
        (Side::Signed, "difference", "Red where the frame is brighter, blue where it is darker"),
        (Side::Flip, "FLIP", "What an eye sees when it flips between the two"),
    ];
}

/// What the path tracer was asked, and what it said.
pub(super) struct Truth {
    pub(super) on: bool,
    /// When the section was shown last: it opens with the truth.
    was_on: bool,
    /// Share of the width on its left.
    divider: f32,
    side: Side,
    /// Once it was asked.
    tracer: Option<Tracer>,
    /// Number of the question that is traced, that of the wish whose picture it is about, and whether causes were asked.
    of: Option<(u64, (u64, bool))>,
    /// Of the wish whose causes of error are to be measured.
    causes_of: Option<u64>,
    causes: Option<(Box<Causes>, [u32; 2])>,
    measuring: Option<(&'static str, f32)>,
    said: Option<Result<Box<Traced>, String>>,
    pane: Pane,
}

impl Default for Truth {
    fn default() -> Self {
        Self {
            on: false,
            was_on: false,
            divider: 0.5,
            side: Side::default(),
            tracer: None,
            of: None,
            causes_of: None,
            causes: None,
            measuring: None,
            said: None,
            pane: Pane::default(),
        }
    }
}

impl Truth {
    fn traced(&self) -> Option<&Traced> {
        self.said.as_ref()?.as_ref().ok().map(|traced| &**traced)
    }

    fn line(&self, rect: Rect) -> f32 {
        rect.min.x + self.divider * rect.width()
    }

    /// Whether the divider is at `at`.
    pub(super) fn divides(&self, at: Pos2, rect: Rect) -> bool {
        const NEAR: f32 = 6.0;
        self.on && rect.contains(at) && (at.x - self.line(rect)).abs() < NEAR
    }

    /// Moves the divider by a share of the width.
    pub(super) fn divide(&mut self, by: f32) {
        self.divider = (self.divider + by).clamp(0.0, 1.0);
    }

    /// Puts what is to be shown of what was said on the screen.
    fn put(&mut self, ctx: &egui::Context) {
        let Some(Ok(traced)) = &self.said else { return };
        let clear = |pixels: &[[u8; 3]]| -> Vec<u8> {
            pixels.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect()
        };
        match (self.side, &traced.judged) {
            (Side::Signed, Some(judged)) => self.pane.put(ctx, traced.size, &clear(&judged.signed)),
            (Side::Flip, Some(judged)) => self.pane.put(ctx, traced.size, &clear(&judged.flip)),
            _ => self.pane.put(ctx, traced.size, &traced.rgba),
        }
    }
}

impl Editor {
    /// The truth so far.
    pub fn truth(&self) -> Option<&Traced> {
        self.truth.traced()
    }

    /// Asks for the truth of a picture once it is finished, and no more once it is not.
    pub(super) fn ask_truth(&mut self, ctx: &egui::Context) {
        let finished = self.finished();
        let truth = &mut self.truth;
        if truth.causes_of.is_some_and(|wish| wish != self.shown_of) {
            (truth.causes_of, truth.causes) = (None, None);
        }
        let causes = truth.causes_of.is_some();
        let wanted = (truth.on && finished).then_some((self.shown_of, causes));
        if let Some(tracer) = &truth.tracer {
            let of = truth.of.map(|(number, _)| number);
            let mut newer = false;
            for (_, answer) in tracer.said().filter(|(number, _)| Some(*number) == of) {
                truth.measuring = None;
                match answer {
                    Answer::Measuring(what, done) => truth.measuring = Some((what, done)),
                    Answer::Causes(causes, size) => truth.causes = Some((causes, size)),
                    Answer::Traced(traced) => (truth.said, newer) = (Some(Ok(traced)), true),
                    Answer::Failed(line) => truth.said = Some(Err(line)),
                }
            }
            if newer {
                truth.put(ctx);
            }
        }
        if truth.of.map(|(_, wish)| wish) == wanted {
            return;
        }
        truth.said = None;
        let question = wanted.and_then(|_| {
            Some(Question {
                wish: self.asked.as_ref()?.1.clone(),
                stage: self.stage.clone()?,
                light: self.light.light()?.clone(),
                picture: self.shown.picture.clone()?,
                causes,
            })
        });
        let waking = ctx.clone();
        let tracer = truth.tracer.get_or_insert_with(|| tracer(move || waking.request_repaint()));
        let number = tracer.ask(question);
        truth.of = wanted.map(|wanted| (number, wanted));
        truth.measuring = None;
    }

    /// The right side of the picture.
    pub(super) fn paint_truth(&self, ui: &Ui, rect: Rect) {
        let truth = &self.truth;
        if !truth.on {
            return;
        }
        let x = truth.line(rect);
        let right = Rect::from_min_max(pos2(x, rect.min.y), rect.max);
        if truth.traced().is_some() {
            truth.pane.paint(ui, rect, right);
        }
        let painter = ui.painter_at(rect);
        let line = [pos2(x, rect.min.y), pos2(x, rect.max.y)];
        painter.line_segment(line, egui::Stroke::new(3.0, Color32::from_black_alpha(120)));
        painter.line_segment(line, egui::Stroke::new(1.0, Color32::WHITE));
        let label = |at: Pos2, align: Align2, text: String| {
            let font = FontId::proportional(12.0);
            let text = painter.layout_no_wrap(text, font, Color32::WHITE);
            let room = align.anchor_size(at, text.size());
            painter.rect_filled(room.expand(3.0), 3.0, Color32::from_black_alpha(140));
            painter.galley(room.min, text, Color32::WHITE);
        };
        let said = match &truth.said {
            Some(Ok(traced)) => match (truth.side, &traced.judged) {
                (Side::Signed, Some(_)) => "frame − truth".to_owned(),
                (Side::Flip, Some(_)) => "FLIP".to_owned(),
                _ => format!("path traced, {} samples", traced.samples),
            },
            Some(Err(_)) => "no truth".to_owned(),
            None => "path traced: soon".to_owned(),
        };
        label(pos2(x - 8.0, rect.min.y + 8.0), Align2::RIGHT_TOP, "frame".to_owned());
        label(pos2(x + 8.0, rect.min.y + 8.0), Align2::LEFT_TOP, said);
    }

    pub(super) fn truth_section(&mut self, ui: &mut Ui) {
        let opened = self.truth.on && !self.truth.was_on;
        self.truth.was_on = self.truth.on;
        let header = egui::CollapsingHeader::new("Truth and cost").open(opened.then_some(true));
        header.show(ui, |ui| {
            let truth = &mut self.truth;
            ui.checkbox(&mut truth.on, "Path traced beside the frame").on_hover_text("R");
            if truth.on {
                super::panels::percent(ui, "Divider", &mut truth.divider, 0.0..=1.0);
                let before = truth.side;
                ui.horizontal_wrapped(|ui| {
                    for (side, word, help) in Side::ALL {
                        ui.radio_value(&mut truth.side, side, word).on_hover_text(help);
                    }
                });
                if truth.side != before {
                    truth.put(ui.ctx());
                }
                match &truth.said {
                    Some(Ok(traced)) => errors(ui, traced),
                    Some(Err(line)) => _ = ui.colored_label(ui.visuals().error_fg_color, line),
                    None if truth.measuring.is_some() => {}
                    None => _ = ui.weak("once the frame is finished"),
                }
            }
            if self.truth.on && self.truth.causes.is_none() {
                match self.truth.measuring {
                    Some((what, done)) => {
                        ui.add(egui::ProgressBar::new(done).text(what));
                        if ui.button("Cancel measuring").clicked() {
                            self.truth.causes_of = None;
                        }
                    }
                    None => {
                        let wish = self.finished().then_some(self.shown_of);
                        let asked = self.truth.causes_of.is_some();
                        let button = egui::Button::new("Measure causes");
                        let button = ui.add_enabled(wish.is_some() && !asked, button);
                        if button
                            .on_hover_text(
                                "Path traces small pictures with one part exact at a time",
                            )
                            .clicked()
                        {
                            self.truth.causes_of = wish;
                        }
                    }
                }
            }
            self.cost(ui);
        });
    }

    /// The causes of the frame's error, once they were measured.
    pub fn causes(&self) -> Option<&Causes> {
        self.truth.causes.as_ref().map(|(causes, _)| &**causes)
    }

    /// What the frame cost, by stage and pass, and the error to expect of it by cause.
    fn cost(&self, ui: &mut Ui) {
        let picture = self.shown.picture.as_ref();
        let Some((picture, figures)) = picture.and_then(|p| Some((p, p.figures.as_ref()?))) else {
            return;
        };
        ui.separator();
        let expected = &figures.expected;
        let measured = self.truth.causes.as_ref();
        let alone = |name: &str| {
            let parts = &measured?.0.parts;
            Some(parts.iter().find(|part| part.name == name)?.alone)
        };
        let title = match measured {
            Some((_, [width, height])) => {
                format!("Error by cause: expected, measured at {width} × {height}")
            }
            None => "Error to expect, by cause".to_owned(),
        };
        ui.label(title).on_hover_text(
            "Relative L2 against path tracing. Squares of what is expected add up; what is measured is each cause alone",
        );
        Grid::new("causes").num_columns(3).striped(true).show(ui, |ui| {
            for (name, expected, measured) in [
                ("in all", expected.total, measured.map(|(causes, _)| causes.whole)),
                ("light fit", expected.fit, alone("light fit")),
                ("scattering integrals", expected.integrals, alone("scattering integral")),
                ("transmittance", expected.transmittance, alone("transmittance")),
                ("multiple scattering", expected.multiple, alone("multiple scattering")),
                ("between points", expected.points, None),
                ("coverage", expected.coverage, alone("coverage")),
                ("what is skipped", expected.skipping, None),
            ] {
                ui.weak(name);
                ui.label(percent(expected));
                ui.label(measured.map_or(String::new(), percent));
                ui.end_row();
            }
        });
        ui.separator();
        let ms = |ms: f64| format!("{ms:.1} ms");
        rows(
            ui,
            "Time of what was made anew",
            "Wall time on all threads; what did not change is not made again",
            figures.stages.iter().map(|&(name, spent)| (name, ms(spent))),
        );
        rows(
            ui,
            "Passes of the frame",
            "By the device's own clock",
            picture.frame.passes.iter().map(|(&name, &spent)| (name, ms(spent))),
        );
        rows(
            ui,
            "Counts",
            "",
            [
                ("points shaded", figures.points.to_string()),
                ("lights of each, at most", figures.lights.to_string()),
                ("lights fitted", figures.fitted.to_string()),
                ("fit's own error, blurred by 0.3", percent(figures.fit_error)),
            ],
        );
        ui.separator();
        ui.label("Speed against error").on_hover_text(
            "Best settings to be had for this view (line), this frame as expected (ring) and as measured (dot)",
        );
        let judged = self.truth.traced().and_then(|traced| traced.judged.as_ref());
        speed_plot(ui, figures, judged.map(|judged| judged.report.error()));
    }
}

fn percent(x: f64) -> String {
    format!("{:.*} %", usize::from(x < 0.0995), 100.0 * x)
}

/// How far the frame is from what is traced so far.
fn errors(ui: &mut Ui, traced: &Traced) {
    let rate = traced.segments as f64 / traced.seconds.max(1e-9) / 1e6;
    let mut lines = vec![
        ("samples a pixel", traced.samples.to_string()),
        ("traced for", format!("{:.0} s", traced.seconds)),
        ("million rays a second", format!("{rate:.1}")),
    ];
    if let Some(Judged { report, .. }) = &traced.judged {
        let ratio = report.mean_ratio.map(|r| r.map_or("–".into(), |r| format!("{r:.2}")));
        lines.push(("relative L2", percent(report.relative_l2)));
        if let Some(noise) = report.noise {
            lines.push(("of which noise", percent(noise.relative_l2)));
            lines.push(("without noise", percent(noise.relative_l2_without)));
        }
        lines.push(("frame / truth", ratio.join(" ")));
        lines.push(("FLIP, mean", format!("{:.3}", report.flip_mean)));
    }
    rows(
        ui,
        "Error against the truth",
        "In linear radiance, weighted by the truth's coverage by hair",
        lines,
    );
}

/// A small table under a title.
fn rows(
    ui: &mut Ui,
    title: &'static str,
    help: &str,
    lines: impl IntoIterator<Item = (&'static str, String)>,
) {
    let mut lines = lines.into_iter().peekable();
    if lines.peek().is_none() {
        return;
    }
    let title_label = ui.label(title);
    if !help.is_empty() {
        title_label.on_hover_text(help);
    }
    Grid::new(title).num_columns(2).striped(true).show(ui, |ui| {
        for (name, value) in lines {
            ui.weak(name);
            ui.label(value);
            ui.end_row();
        }
    });
}

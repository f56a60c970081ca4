//! Speed against error, for the view that is shown.

use eframe::egui::{self, Align2, Color32, FontId, Pos2, Rect, Sense, Stroke, Ui, Vec2};

use crate::live::Figures;

/// A logarithmic axis.
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    /// Around all of `values`, with ends among 1, 2 and 5 of a decade.
    fn around(values: impl Iterator<Item = f64> + Clone) -> Axis {
        let low = values.clone().fold(f64::INFINITY, f64::min);
        let high = values.fold(0.0, f64::max);
        let below = ticks(low / 5.0, low).last().unwrap_or(low);
        let above = ticks(high, high * 5.0).next().unwrap_or(high);
        Axis { low: below, high: above.max(2.0 * below) }
    }

    /// From 0 to 1.
    fn at(&self, x: f64) -> f32 {
        ((x / self.low).ln() / (self.high / self.low).ln()) as f32
    }
}

/// 1, 2 and 5 of each decade from `low` to `high`, both above 0.
fn ticks(low: f64, high: f64) -> impl Iterator<Item = f64> {
    let first = low.log10().floor() as i32;
    let last = high.log10().ceil() as i32;
    (first..=last)
        .flat_map(|decade| [1.0, 2.0, 5.0].map(|k| k * 10f64.powi(decade)))
        .filter(move |&x| x >= low * (1.0 - 1e-9) && x <= high * (1.0 + 1e-9))
}

/// The best settings to be had, this frame as it is expected to be, and `measured`, its relative L2 if it is known.
/// Nothing where the device tells no times.
pub fn speed_plot(ui: &mut Ui, figures: &Figures, measured: Option<f64>) {
    let Some(frame_ms) = figures.frame_ms.filter(|ms| *ms > 0.0) else {
        ui.weak("this device tells no times of its passes");
        return;
    };
    let measured = measured.filter(|e| *e > 0.0);
    let expected = figures.expected.total;
    let front = || figures.front.iter().map(|pick| (pick.frame_ms, pick.expected.total));
    let x = Axis::around(front().map(|p| p.0).chain([frame_ms]));
    let y = Axis::around(front().map(|p| p.1).chain([expected]).chain(measured));

    let size = Vec2::new(ui.available_width().min(320.0), 170.0);
    let (room, response) = ui.allocate_exact_size(size, Sense::hover());
    crate::editor::fields::name_it(&response, "Speed against error");
    let inner =
        Rect::from_min_max(room.min + Vec2::new(38.0, 6.0), room.max - Vec2::new(8.0, 30.0));
    let painter = ui.painter_at(room);
    let (ink, weak) = (ui.visuals().text_color(), ui.visuals().weak_text_color());
    let faint = Stroke::new(0.5, weak.gamma_multiply(0.5));
    let font = FontId::proportional(10.0);
    let place = |ms: f64, error: f64| {
        inner.left_bottom() + Vec2::new(x.at(ms) * inner.width(), -y.at(error) * inner.height())
    };
    for ms in ticks(x.low, x.high) {
        let at = place(ms, y.low);
        painter.line_segment([at, Pos2::new(at.x, inner.top())], faint);
        painter.text(at + Vec2::new(0.0, 3.0), Align2::CENTER_TOP, short(ms), font.clone(), weak);
    }
    for error in ticks(y.low, y.high) {
        let at = place(x.low, error);
        painter.line_segment([at, Pos2::new(inner.right(), at.y)], faint);
        let text = format!("{} %", short(100.0 * error));
        painter.text(at - Vec2::new(3.0, 0.0), Align2::RIGHT_CENTER, text, font.clone(), weak);
    }
    let below = Pos2::new(inner.center().x, room.bottom());
    painter.text(below, Align2::CENTER_BOTTOM, "milliseconds of the frame", font, weak);
    let line: Vec<Pos2> = front().map(|(ms, error)| place(ms, error)).collect();
    painter.add(egui::Shape::line(line, Stroke::new(1.5, ink)));
    let accent = Color32::from_rgb(230, 120, 40);
    painter.circle_stroke(place(frame_ms, expected), 4.5, Stroke::new(1.5, accent));
    if let Some(error) = measured {
        painter.circle_filled(place(frame_ms, error), 4.0, accent);
    }
    // What the pointer is over.
    let near = response.hover_pos().and_then(|at| {
        let away = |pick: &&crate::quality::Pick| {
            place(pick.frame_ms, pick.expected.total).distance_sq(at)
        };
        figures.front.iter().min_by(|a, b| away(a).total_cmp(&away(b)))
    });
    if let Some(pick) = near {
        let crate::quality::Settings { lights, samples, rays, negligible } = pick.settings;
        response.on_hover_text(format!(
            "{:.0} ms and {} %: {lights} lights, {samples} samples, {rays} × rays, {} % negligible",
            pick.frame_ms,
            short(100.0 * pick.expected.total),
            100.0 * negligible
        ));
    }
}

/// Two figures that count.
fn short(x: f64) -> String {
    let decimals = (1.0 - x.abs().log10().floor()).clamp(0.0, 3.0) as usize;
    let text = format!("{x:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

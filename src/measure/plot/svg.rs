//! The drawing: panels laid out on a page, as SVG.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write;

use super::{Bars, Colour, Curves, Plot, Polar, Series, Stroke, Swatches, minus};
use crate::image::srgb8;

/// Width of every plot, px: what a README shows without scaling.
const WIDTH: f64 = 900.0;
const TITLE_SIZE: f64 = 17.0;
const TEXT_SIZE: f64 = 14.0;
/// Height of a line of text.
const LINE: f64 = 21.0;
/// Width of a letter over the size of its text, on the mean: legends break lines by it.
const LETTER: f64 = 0.52;
pub(super) const INK: &str = "#222";
const GRID: &str = "#e3e3e3";

impl Plot {
    /// The picture as SVG.
    pub fn svg(&self) -> String {
        let mut svg = Svg::default();
        let mut bottom = 0f64;
        match self {
            Plot::Curves { panels, per_row } => {
                let width = WIDTH / *per_row as f64;
                let height = if *per_row == 1 { 440.0 } else { 0.64 * width };
                for row in panels.chunks(*per_row) {
                    let header =
                        row.iter().map(|p| header_height(&p.series, width)).fold(0.0, f64::max);
                    for (k, panel) in row.iter().enumerate() {
                        svg.curves(panel, [k as f64 * width, bottom], [width, height], header);
                    }
                    bottom += header + height;
                }
            }
            Plot::Polar { panels } => {
                let width = WIDTH / panels.len() as f64;
                for (k, panel) in panels.iter().enumerate() {
                    bottom = bottom.max(svg.polar(panel, k as f64 * width, width));
                }
            }
            Plot::Swatches { panels } => {
                for panel in panels {
                    bottom = svg.swatches(panel, bottom);
                }
            }
            Plot::Bars { panels } => {
                for panel in panels {
                    bottom = svg.bars(panel, bottom);
                }
            }
        }
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{bottom:.0}\" \
             viewBox=\"0 0 {WIDTH} {bottom:.0}\" font-family=\"Ubuntu, 'Segoe UI', Helvetica, Arial, \
             sans-serif\" font-size=\"{TEXT_SIZE}\" fill=\"{INK}\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{}</svg>\n",
            svg.0
        )
    }
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Width of a legend's entry, px.
fn entry_width(series: &Series) -> f64 {
    let letters = series.name.chars().filter(|&c| c != '_').count();
    46.0 + LETTER * TEXT_SIZE * letters as f64
}

/// The series by lines of the legend.
fn legend_lines(series: &[Series], width: f64) -> Vec<Vec<&Series>> {
    let mut lines: Vec<Vec<&Series>> = Vec::new();
    let mut left = 0.0;
    for one in series.iter().filter(|s| s.listed) {
        let needed = entry_width(one);
        match lines.last_mut() {
            Some(line) if left >= needed => line.push(one),
            _ => {
                lines.push(vec![one]);
                left = width;
            }
        }
        left -= needed;
    }
    lines
}

/// Height of what stands above a panel's axes: title, legend, the y axis' label.
fn header_height(series: &[Series], width: f64) -> f64 {
    18.0 + LINE * (2.0 + legend_lines(series, width - MARGINS[0] - MARGINS[1]).len() as f64)
}

/// Left, right and bottom of a panel's axes, px.
const MARGINS: [f64; 3] = [64.0, 24.0, 54.0];

/// SVG elements, one after another.
#[derive(Default)]
struct Svg(String);

impl Svg {
    fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], colour: &str) {
        _ = writeln!(
            self.0,
            "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{colour}\" stroke-width=\"1\"/>"
        );
    }

    /// Text with its baseline at `y`; `anchor` is start, middle or end.
    fn text(&mut self, text: &str, [x, y]: [f64; 2], size: f64, anchor: &str) {
        let mut body = String::new();
        let mut parts = text.split('_');
        body += &escaped(parts.next().unwrap_or_default());
        for part in parts {
            let end = part.find(|c: char| !c.is_alphanumeric()).unwrap_or(part.len());
            let (below, rest) = part.split_at(end);
            let (drop, small) = (0.25 * size, 0.72 * size);
            _ = write!(
                body,
                "<tspan dy=\"{drop:.1}\" font-size=\"{small:.1}\">{}</tspan>\
                 <tspan dy=\"-{drop:.1}\">{}</tspan>",
                escaped(below),
                // A tspan's shift needs a letter to act on.
                if rest.is_empty() { "\u{200b}".to_owned() } else { escaped(rest) }
            );
        }
        _ = writeln!(
            self.0,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\" \
             xml:space=\"preserve\">{body}</text>"
        );
    }

    /// A series through points in pixels.
    fn series(&mut self, points: &[[f64; 2]], colour: Colour, stroke: Stroke, clip: &str) {
        let colour = hex(colour);
        if stroke == Stroke::Dots {
            _ = writeln!(self.0, "<g fill=\"{colour}\"{clip}>");
            for [x, y] in points {
                _ = writeln!(self.0, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.2\"/>");
            }
            self.0 += "</g>\n";
            return;
        }
        let dash = if stroke == Stroke::Dashed { " stroke-dasharray=\"7 5\"" } else { "" };
        _ = write!(
            self.0,
            "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" \
             stroke-linejoin=\"round\"{dash}{clip} points=\""
        );
        for [x, y] in points {
            _ = write!(self.0, "{x:.1},{y:.1} ");
        }
        self.0 += "\"/>\n";
    }

    /// Title and legend from the top; the height that they take.
    fn header(&mut self, title: &str, series: &[Series], [left, top]: [f64; 2], width: f64) -> f64 {
        let mut y = top + LINE;
        self.text(title, [left, y], TITLE_SIZE, "start");
        for line in legend_lines(series, width) {
            y += LINE;
            let mut x = left;
            for one in line {
                let middle = y - 0.33 * TEXT_SIZE;
                let sample: Vec<_> = match one.stroke {
                    Stroke::Dots => vec![[x + 12.0, middle]],
                    _ => vec![[x, middle], [x + 24.0, middle]],
                };
                self.series(&sample, one.colour, one.stroke, "");
                self.text(&one.name, [x + 30.0, y], TEXT_SIZE, "start");
                x += entry_width(one);
            }
        }
        y - top
    }

    fn curves(
        &mut self,
        panel: &Curves,
        [x0, y0]: [f64; 2],
        [width, height]: [f64; 2],
        header: f64,
    ) {
        let [margin_left, margin_right, margin_bottom] = MARGINS;
        let (left, right) = (x0 + margin_left, x0 + width - margin_right);
        let (top, bottom) = (y0 + header, y0 + header + height - margin_bottom);
        let at = |[x, y]: [f64; 2]| {
            // Far outside is as good as just outside, and keeps the numbers short.
            let [x, y] = [panel.x.place(x), panel.y.place(y)].map(|v| v.clamp(-9.0, 10.0));
            [left + x * (right - left), bottom + y * (top - bottom)]
        };
        self.header(&panel.title, &panel.series, [left, y0], right - left);
        self.text(&panel.y.label, [left - 40.0, top - 14.0], TEXT_SIZE, "start");
        for (value, name) in &panel.y.ticks {
            let [_, y] = at([panel.x.low, *value]);
            self.line([left, y], [right, y], GRID);
            self.text(name, [left - 8.0, y + 0.35 * TEXT_SIZE], TEXT_SIZE, "end");
        }
        for (value, name) in &panel.x.ticks {
            let [x, _] = at([*value, panel.y.low]);
            self.line([x, top], [x, bottom], GRID);
            self.text(name, [x, bottom + 19.0], TEXT_SIZE, "middle");
        }
        self.line([left, bottom], [right, bottom], INK);
        self.text(&panel.x.label, [0.5 * (left + right), bottom + 41.0], TEXT_SIZE, "middle");
        // Lines may overhang by their own width.
        let id = self.0.len();
        _ = writeln!(
            self.0,
            "<clipPath id=\"c{id}\"><rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>\
             </clipPath>",
            left - 2.0,
            top - 2.0,
            right - left + 4.0,
            bottom - top + 4.0
        );
        let clip = format!(" clip-path=\"url(#c{id})\"");
        for series in &panel.series {
            let points: Vec<_> = series.points.iter().map(|&p| at(p)).collect();
            self.series(&points, series.colour, series.stroke, &clip);
        }
    }

    /// Returns the panel's height.
    fn polar(&mut self, panel: &Polar, x0: f64, width: f64) -> f64 {
        let radius = 0.5 * width - 60.0;
        let top = self.header(&panel.title, &panel.series, [x0 + 40.0, 0.0], width - 60.0) + 44.0;
        let centre = [x0 + 0.5 * width, top + radius];
        let at = |[angle, r]: [f64; 2]| {
            let r = radius * r / panel.radius;
            [centre[0] + r * angle.cos(), centre[1] - r * angle.sin()]
        };
        let rings = (panel.radius / panel.ring + 1e-9) as usize;
        for ring in (1..=rings).map(|k| k as f64 * panel.ring) {
            let r = radius * ring / panel.radius;
            _ = writeln!(
                self.0,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{r:.1}\" fill=\"none\" stroke=\"{GRID}\"/>",
                centre[0], centre[1]
            );
        }
        for k in 0..12 {
            let angle = f64::from(k) * TAU / 12.0;
            self.line(centre, at([angle, panel.radius]), GRID);
            let [x, y] = at([angle, panel.radius * (1.0 + 20.0 / radius)]);
            let degrees = angle.to_degrees().round();
            self.text(&format!("{degrees}°"), [x, y + 0.35 * TEXT_SIZE], TEXT_SIZE, "middle");
        }
        for series in &panel.series {
            let points: Vec<_> = series.points.iter().map(|&p| at(p)).collect();
            self.series(&points, series.colour, series.stroke, "");
        }
        for ring in (1..=rings).map(|k| k as f64 * panel.ring) {
            let [x, y] = at([FRAC_PI_2, ring]);
            self.text(&minus(&format!("{ring}")), [x + 4.0, y + 15.0], TEXT_SIZE, "start");
        }
        top + 2.0 * radius + 40.0
    }

    /// Returns where the panel ends.
    fn swatches(&mut self, panel: &Swatches, top: f64) -> f64 {
        // White swatches are to be seen, strips to be seamless.
        let outline = if panel.gap > 0.0 { format!(" stroke=\"{GRID}\"") } else { String::new() };
        let names = panel.rows.iter().map(|r| r.chars().count()).max().unwrap_or(0) as f64;
        let (left, right) = (24.0 + LETTER * TEXT_SIZE * names, WIDTH - 24.0);
        let mut y = top + LINE;
        self.text(&panel.title, [24.0, y], TITLE_SIZE, "start");
        y += 12.0;
        for (name, colours) in panel.rows.iter().zip(&panel.colours) {
            let width = (right - left) / colours.len() as f64;
            let height = panel.row_height;
            self.text(name, [left - 10.0, y + 0.5 * height + 0.35 * TEXT_SIZE], TEXT_SIZE, "end");
            for (k, colour) in colours.iter().enumerate() {
                let colour = hex(colour.map(|c| srgb8(c as f32)));
                _ = writeln!(
                    self.0,
                    "<rect x=\"{:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{height:.1}\" \
                     fill=\"{colour}\" shape-rendering=\"crispEdges\"{outline}/>",
                    left + k as f64 * width,
                    // Seamless strips overlap, so that rounding leaves no line between them.
                    if panel.gap > 0.0 { width - panel.gap } else { width + 0.5 }
                );
            }
            y += height + panel.gap;
        }
        let width = (right - left) / panel.columns.len() as f64;
        for (k, name) in panel.columns.iter().enumerate() {
            let x = left + (k as f64 + 0.5) * width;
            self.text(name, [x, y + 17.0], TEXT_SIZE, "middle");
        }
        self.text(&panel.x_label, [0.5 * (left + right), y + 39.0], TEXT_SIZE, "middle");
        y + 58.0
    }

    /// Returns where the panel ends.
    fn bars(&mut self, panel: &Bars, top: f64) -> f64 {
        /// Height of a bar and of its row, px.
        const BAR: [f64; 2] = [20.0, 30.0];
        let names = panel.bars.iter().map(|b| b.chars().count()).max().unwrap_or(0) as f64;
        let (left, right) = (24.0 + LETTER * TEXT_SIZE * names, WIDTH - 24.0);
        // The legend is that of lines.
        let legend: Vec<Series> =
            panel.parts.iter().map(|p| Series::new(&p.name, p.colour, Vec::new())).collect();
        let top = top + self.header(&panel.title, &legend, [24.0, top], right - 24.0) + 14.0;
        let bottom = top + BAR[1] * panel.bars.len() as f64;
        let at = |x: f64| left + panel.x.place(x) * (right - left);
        for (value, name) in &panel.x.ticks {
            self.line([at(*value), top], [at(*value), bottom], GRID);
            self.text(name, [at(*value), bottom + 19.0], TEXT_SIZE, "middle");
        }
        for (k, name) in panel.bars.iter().enumerate() {
            let y = top + BAR[1] * k as f64 + 0.5 * (BAR[1] - BAR[0]);
            self.text(name, [left - 10.0, y + 0.5 * BAR[0] + 0.35 * TEXT_SIZE], TEXT_SIZE, "end");
            for ([from, to], part) in panel.spans(k).into_iter().zip(&panel.parts) {
                _ = writeln!(
                    self.0,
                    "<rect x=\"{:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                    at(from),
                    at(to) - at(from),
                    BAR[0],
                    hex(part.colour)
                );
            }
        }
        self.line([left, top], [left, bottom], INK);
        self.text(&panel.x.label, [0.5 * (left + right), bottom + 41.0], TEXT_SIZE, "middle");
        bottom + 58.0
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

//! Plots: numbers in, one SVG out, its PNG rasterised from that SVG, and the numbers as CSV.
//!
//! A [`Plot`] holds every number that is drawn, so that the CSV and the picture cannot differ. Labels take
//! `_` before letters and digits as a subscript (`θ_i`).

mod png;
mod svg;

use anyhow::Result;

/// sRGB.
pub type Colour = [u8; 3];

/// Colours that the colour-blind tell apart (Okabe and Ito 2008).
pub const COLOURS: [Colour; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [80, 80, 80],
];

/// Colours of an ordered series, t in [0, 1]: from dark blue through red to orange, ever lighter.
pub fn ramp(t: f64) -> Colour {
    const STOPS: [[f64; 3]; 4] =
        [[33.0, 36.0, 104.0], [122.0, 33.0, 122.0], [211.0, 67.0, 93.0], [248.0, 160.0, 74.0]];
    let x = t.clamp(0.0, 1.0) * 3.0;
    let i = (x as usize).min(2);
    std::array::from_fn(|c| (STOPS[i][c] + (x - i as f64) * (STOPS[i + 1][c] - STOPS[i][c])) as u8)
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    Line,
    Dashed,
    Dots,
}

/// Points (x, y), or (angle in radians, radius) in a polar panel.
#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    pub points: Vec<[f64; 2]>,
    pub colour: Colour,
    pub stroke: Stroke,
    /// Whether the legend names it.
    pub listed: bool,
}

impl Series {
    /// A line.
    pub fn new(name: impl Into<String>, colour: Colour, points: Vec<[f64; 2]>) -> Series {
        Series { name: name.into(), points, colour, stroke: Stroke::Line, listed: true }
    }

    /// A line through f at `count` ≥ 2 even steps from `low` to `high`.
    pub fn sampled(
        name: impl Into<String>,
        colour: Colour,
        [low, high]: [f64; 2],
        count: usize,
        f: impl Fn(f64) -> f64,
    ) -> Series {
        let step = (high - low) / (count - 1) as f64;
        let points = (0..count).map(|i| low + i as f64 * step).map(|x| [x, f(x)]).collect();
        Series::new(name, colour, points)
    }

    pub fn stroke(self, stroke: Stroke) -> Series {
        Series { stroke, ..self }
    }

    /// For what belongs to a series that the legend names.
    pub fn unlisted(self) -> Series {
        Series { listed: false, ..self }
    }
}

/// One axis: what it measures, its ends, and where it is marked with what.
#[derive(Clone, Debug)]
pub struct Axis {
    pub label: String,
    pub low: f64,
    pub high: f64,
    pub ticks: Vec<(f64, String)>,
    pub log: bool,
}

impl Axis {
    /// Marked at multiples of `step`.
    pub fn linear(label: &str, low: f64, high: f64, step: f64) -> Axis {
        // Enough to write the step in full.
        let written = |d: &i32| {
            let scaled = step * 10f64.powi(*d);
            (scaled - scaled.round()).abs() < 1e-9
        };
        let decimals = (0..6).find(written).unwrap_or(6) as usize;
        Self::marked(label, low, high, step, |v| format!("{v:.decimals$}"))
    }

    /// In radians, marked in degrees at multiples of `step` degrees.
    pub fn degrees(label: &str, low: f64, high: f64, step: f64) -> Axis {
        let [low, high, step] = [low, high, step].map(f64::to_radians);
        Self::marked(label, low, high, step, |v| format!("{:.0}°", v.to_degrees()))
    }

    /// Logarithmic, marked at powers of `base`.
    pub fn log(label: &str, low: f64, high: f64, base: f64) -> Axis {
        let power = |x: f64| x.ln() / base.ln();
        let powers = (power(low) - 1e-9).ceil() as i32..=(power(high) + 1e-9).floor() as i32;
        let ticks = powers.map(|e| base.powi(e)).map(|v| (v, format!("{}", v as f32))).collect();
        Axis { label: label.to_owned(), low, high, ticks, log: true }
    }

    fn marked(label: &str, low: f64, high: f64, step: f64, name: impl Fn(f64) -> String) -> Axis {
        let range = (low / step - 1e-9).ceil() as i64..=(high / step + 1e-9).floor() as i64;
        let ticks = range.map(|k| k as f64 * step).map(|v| (v, minus(&name(v)))).collect();
        Axis { label: label.to_owned(), low, high, ticks, log: false }
    }

    /// Where a value lies, 0 at the low end and 1 at the high one.
    fn place(&self, value: f64) -> f64 {
        if self.log {
            (value.max(f64::MIN_POSITIVE) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }
}

/// A typographic minus.
fn minus(text: &str) -> String {
    text.replace('-', "−")
}

/// Curves over two axes.
#[derive(Clone, Debug)]
pub struct Curves {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
}

/// Curves round a pole, the angle counted anticlockwise from the right.
#[derive(Clone, Debug)]
pub struct Polar {
    pub title: String,
    /// Radius of the outermost ring.
    pub radius: f64,
    /// Radius between rings.
    pub ring: f64,
    pub series: Vec<Series>,
}

/// Colours in rows and columns.
#[derive(Clone, Debug)]
pub struct Swatches {
    pub title: String,
    pub x_label: String,
    /// Marks below the columns, by column; columns without one stay bare.
    pub columns: Vec<String>,
    pub rows: Vec<String>,
    /// `colours[row][column]`, linear RGB.
    pub colours: Vec<Vec<[f64; 3]>>,
    /// Height of a row, px.
    pub row_height: f64,
    /// Pixels between swatches.
    pub gap: f64,
}

/// One of the parts that bars are stacked from.
#[derive(Clone, Debug)]
pub struct Part {
    pub name: String,
    pub colour: Colour,
    /// ≥ 0, one a bar.
    pub values: Vec<f64>,
}

/// Bars that lie, a row each, their parts end to end.
#[derive(Clone, Debug)]
pub struct Bars {
    pub title: String,
    pub x: Axis,
    /// Their names, from the top.
    pub bars: Vec<String>,
    pub parts: Vec<Part>,
}

impl Bars {
    /// Where each part of a bar begins and ends.
    pub fn spans(&self, bar: usize) -> Vec<[f64; 2]> {
        let ends = self.parts.iter().scan(0.0, |end, part| {
            let begin = *end;
            *end += part.values[bar];
            Some([begin, *end])
        });
        ends.collect()
    }

    /// The length of the longest bar.
    pub fn most(&self) -> f64 {
        let end = |bar| self.spans(bar).last().map_or(0.0, |span| span[1]);
        (0..self.bars.len()).map(end).fold(0.0, f64::max)
    }
}

/// A figure: panels of one kind, beside each other in `per_row`s.
#[derive(Clone, Debug)]
pub enum Plot {
    Curves {
        panels: Vec<Curves>,
        per_row: usize,
    },
    Polar {
        panels: Vec<Polar>,
    },
    Swatches {
        panels: Vec<Swatches>,
    },
    /// One below the other.
    Bars {
        panels: Vec<Bars>,
    },
}

impl Plot {
    /// The numbers: `panel,series,x,y` (angle in radians and radius where polar), `panel,row,column,r,g,b`
    /// in linear RGB, or `panel,bar,part,value`.
    pub fn csv(&self) -> Result<Vec<u8>> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        let number = |v: f64| format!("{v:.6e}");
        let series: Vec<(&str, &[Series])> = match self {
            Plot::Curves { panels, .. } => {
                panels.iter().map(|p| (p.title.as_str(), p.series.as_slice())).collect()
            }
            Plot::Polar { panels } => {
                panels.iter().map(|p| (p.title.as_str(), p.series.as_slice())).collect()
            }
            Plot::Bars { panels } => {
                csv.write_record(["panel", "bar", "part", "value"])?;
                for panel in panels {
                    for (k, bar) in panel.bars.iter().enumerate() {
                        for part in &panel.parts {
                            let value = number(part.values[k]);
                            csv.write_record([&panel.title, bar, &part.name, &value])?;
                        }
                    }
                }
                return Ok(csv.into_inner()?);
            }
            Plot::Swatches { panels } => {
                csv.write_record(["panel", "row", "column", "r", "g", "b"])?;
                for panel in panels {
                    for (row, colours) in panel.rows.iter().zip(&panel.colours) {
                        for (column, colour) in colours.iter().enumerate() {
                            let [r, g, b] = colour.map(number);
                            let column = column.to_string();
                            csv.write_record([&panel.title, row, &column, &r, &g, &b])?;
                        }
                    }
                }
                return Ok(csv.into_inner()?);
            }
        };
        csv.write_record(["panel", "series", "x", "y"])?;
        for (title, series) in series {
            for one in series {
                for point in &one.points {
                    let [x, y] = point.map(number);
                    csv.write_record([title, &one.name, &x, &y])?;
                }
            }
        }
        Ok(csv.into_inner()?)
    }
}

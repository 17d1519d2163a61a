//! A panel of a plot over training steps or frames: phases shaded, lines with a legend.

use std::ops::Range;

use anyhow::Result;
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, DashedPathElement, IntoDynElement, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::{BitMapBackend, IntoLogRange};
use plotters::series::{DashedLineSeries, LineSeries};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, RGBColor, ShapeStyle, TextStyle, WHITE};

use super::canvas::{INK, drawn, font};

/// Backgrounds of the phases, in turn.
const SHADES: [RGBColor; 2] = [RGBColor(243, 245, 248), RGBColor(230, 236, 243)];
const PHASE_INK: RGBColor = RGBColor(110, 120, 134);
const GRID: RGBColor = RGBColor(212, 218, 226);
const FONT_SIZE: u32 = 24;
const DASH: u32 = 12;
/// A panel of values that span more than this factor gets a log axis.
const LOG_FROM: f64 = 20.0;

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stroke {
    /// Thin and pale, behind the others.
    Pale,
    /// With a dot at each point.
    Dotted,
    Plain,
    Dashed,
    /// The pale area within a closed line.
    Filled,
}

/// A line of a panel; points are (step, value).
#[derive(Debug)]
pub(super) struct Line {
    pub label: &'static str,
    pub colour: RGBColor,
    pub stroke: Stroke,
    /// Pieces that are not joined to each other.
    pub pieces: Vec<Vec<(f64, f64)>>,
}

/// Steps during which a phase ran; the two are equal for one that takes no steps.
#[derive(Debug)]
pub(super) struct Phase {
    pub name: String,
    pub steps: (f64, f64),
}

/// A plot of values over steps or frames.
pub(super) struct Panel<'a> {
    pub title: String,
    /// What is counted on the horizontal axis.
    pub axis: &'static str,
    pub phases: &'a [Phase],
    pub lines: Vec<Line>,
    /// Whether the value axis is logarithmic; none lets the values decide.
    pub log: Option<bool>,
    /// Where the lines leave room.
    pub legend: SeriesLabelPosition,
}

impl Panel<'_> {
    /// Draws the panel over the whole area. A log axis leaves out values that are not positive.
    pub(super) fn draw(mut self, area: &DrawingArea<BitMapBackend<'_>, Shift>) -> Result<()> {
        let positive = self.values().all(|value| value > 0.0);
        let (low, high) = self.value_range();
        let log = self.log.unwrap_or(positive && high / low > LOG_FROM);
        if !log {
            let margin = if high > low { 0.08 * (high - low) } else { 0.1 * high.abs().max(1.0) };
            return self.draw_with(area, low - margin..high + margin, 0.0, |range| range);
        }
        for piece in self.lines.iter_mut().flat_map(|line| &mut line.pieces) {
            piece.retain(|(_, value)| *value > 0.0);
        }
        let (low, high) = self.value_range();
        self.draw_with(area, low / 1.3..high * 1.6, 0.35, |range| range.log_scale())
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.lines.iter().flat_map(|line| line.pieces.iter().flatten()).map(|(_, value)| *value)
    }

    /// The least and the greatest value; 1 and 1 without any.
    fn value_range(&self) -> (f64, f64) {
        let range = self.values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if range.0.is_finite() { range } else { (1.0, 1.0) }
    }

    /// `fine_grid`: strength of the lines between the labelled ones, from 0 to 1.
    fn draw_with<Y>(
        &self,
        area: &DrawingArea<BitMapBackend<'_>, Shift>,
        values: Range<f64>,
        fine_grid: f64,
        axis: impl Fn(Range<f64>) -> Y,
    ) -> Result<()>
    where
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let last = self.phases.last().map_or(1.0, |phase| phase.steps.1).max(1.0);
        let mut chart = drawn(
            ChartBuilder::on(area)
                .caption(&self.title, TextStyle::from(font(30)).color(&INK))
                .margin(16)
                .margin_right(40)
                .x_label_area_size(66)
                .y_label_area_size(96)
                .build_cartesian_2d(0.0..last, axis(values.clone())),
        )?;
        let with_steps = self.phases.iter().filter(|phase| phase.steps.0 < phase.steps.1);
        for (phase, shade) in with_steps.zip(SHADES.iter().cycle()) {
            let (from, to) = phase.steps;
            let block = Rectangle::new([(from, values.start), (to, values.end)], shade.filled());
            drawn(chart.draw_series([block]))?;
        }
        drawn(
            chart
                .configure_mesh()
                .x_desc(self.axis)
                .x_labels(11)
                .y_labels(8)
                .x_label_formatter(&|step| format!("{step:.0}"))
                .y_label_formatter(&|value| short(*value))
                .label_style(text(&INK))
                .axis_desc_style(text(&INK))
                .axis_style(INK.stroke_width(1))
                .bold_line_style(GRID.stroke_width(1))
                .light_line_style(GRID.mix(fine_grid))
                .draw(),
        )?;
        for phase in self.phases {
            let (from, to) = phase.steps;
            let wall = PathElement::new([(from, values.start), (from, values.end)], PHASE_INK.stroke_width(1));
            drawn(chart.draw_series([wall]))?;
            // A phase without steps is a line, its name left of it: the next phase begins there.
            let align = if from < to { HPos::Left } else { HPos::Right };
            let style = text(&PHASE_INK).pos(Pos::new(align, VPos::Bottom));
            drawn(chart.draw_series([Text::new(format!(" {} ", phase.name), (from, values.start), style)]))?;
        }
        for line in &self.lines {
            let stroke = line.style();
            let mut labelled = false;
            for piece in line.pieces.iter().filter(|piece| !piece.is_empty()) {
                let points = piece.iter().copied();
                let series = match line.stroke {
                    Stroke::Filled => drawn(chart.draw_series([Polygon::new(piece.clone(), stroke)]))?,
                    Stroke::Dashed => drawn(chart.draw_series(DashedLineSeries::new(points, DASH, DASH, stroke)))?,
                    _ => drawn(chart.draw_series(LineSeries::new(points, stroke)))?,
                };
                if !labelled {
                    let kind = line.stroke;
                    series.label(line.label).legend(move |(x, y)| {
                        let (end, half) = (x + 3 * DASH as i32, DASH as i32 / 2);
                        let ends = [(x, y), (end, y)];
                        match kind {
                            Stroke::Filled => Rectangle::new([(x, y - half), (end, y + half)], stroke).into_dyn(),
                            Stroke::Dashed => DashedPathElement::new(ends, DASH, DASH, stroke).into_dyn(),
                            _ => PathElement::new(ends, stroke).into_dyn(),
                        }
                    });
                    labelled = true;
                }
                // A single point has no line and shows only as a dot.
                if line.stroke == Stroke::Dotted || piece.len() == 1 {
                    let dots = piece.iter().map(|point| Circle::new(*point, 4, line.colour.filled()));
                    drawn(chart.draw_series(dots))?;
                }
            }
        }
        drawn(
            chart
                .configure_series_labels()
                .position(self.legend.clone())
                .label_font(text(&INK))
                .background_style(WHITE.mix(0.85))
                .border_style(GRID)
                .margin(14)
                .legend_area_size(46)
                .draw(),
        )
    }
}

impl Line {
    fn style(&self) -> ShapeStyle {
        match self.stroke {
            Stroke::Pale => self.colour.mix(0.4).stroke_width(2),
            Stroke::Dotted | Stroke::Plain => self.colour.stroke_width(3),
            Stroke::Dashed => self.colour.stroke_width(2),
            Stroke::Filled => self.colour.mix(0.25).filled(),
        }
    }
}

fn text(colour: &RGBColor) -> TextStyle<'_> {
    TextStyle::from(font(FONT_SIZE)).color(colour)
}

/// A number in at most four digits: 0.05, 12.5, 2000, 3e-5.
fn short(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

//! Plots of values over training steps or frames: spans shaded, lines with a legend.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result};
use plotters::chart::{ChartBuilder, ChartContext, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, DashedPathElement, DynElement, IntoDynElement, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::{BitMapBackend, DrawingBackend, IntoLogRange};
use plotters::series::{DashedLineSeries, LineSeries};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, RGBColor, ShapeStyle, TextStyle, WHITE};

use super::canvas::{Canvas, INK, drawn, font};

pub const GREY: RGBColor = RGBColor(120, 128, 140);
pub const GREEN: RGBColor = RGBColor(36, 145, 84);
pub const BLUE: RGBColor = RGBColor(24, 119, 190);
pub const ORANGE: RGBColor = RGBColor(222, 106, 16);
pub const RED: RGBColor = RGBColor(196, 40, 58);

/// Backgrounds of the spans, in turn.
const SHADES: [RGBColor; 2] = [RGBColor(243, 245, 248), RGBColor(230, 236, 243)];
const SPAN_INK: RGBColor = RGBColor(110, 120, 134);
const GRID: RGBColor = RGBColor(212, 218, 226);
const WIDTH: u32 = 1600;
const FONT_SIZE: u32 = 24;
const DASH: u32 = 12;
/// Of a legend beside the plot, pixels: its width, where its rows begin, a row.
const BESIDE: [u32; 3] = [390, 70, 40];
/// Values that span more than this factor get a log axis.
const LOG_FROM: f64 = 20.0;

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// Thin and pale, behind the others.
    Pale,
    /// With a dot at each point.
    Dotted,
    Plain,
    Dashed,
    /// The pale area within a closed line.
    Filled,
}

/// A line of a chart; points are (step, value).
#[derive(Debug)]
pub struct Line {
    /// In the legend; an empty one does not stand there.
    pub label: String,
    pub colour: RGBColor,
    pub stroke: Stroke,
    /// Pieces that are not joined to each other.
    pub pieces: Vec<Vec<(f64, f64)>>,
}

/// Steps or frames that belong together; first and last are equal for a phase that takes no steps.
#[derive(Debug, Clone)]
pub struct Span {
    pub name: String,
    pub first: f64,
    pub last: f64,
}

/// A plot of values over steps or frames.
pub struct Chart {
    pub title: String,
    /// What is counted on the horizontal axis.
    pub axis: &'static str,
    /// What the lines are, with its unit.
    pub values: &'static str,
    /// Spans of the horizontal axis, up to its end.
    pub spans: Vec<Span>,
    /// What comes later lies on top.
    pub lines: Vec<Line>,
    /// A value that is marked over the whole width: label, colour, value.
    pub level: Option<(&'static str, RGBColor, f64)>,
    /// Whether the value axis is logarithmic; none lets the values decide.
    pub log: Option<bool>,
    /// Where the lines leave room; none puts it beside the plot, for many lines.
    pub legend: Option<SeriesLabelPosition>,
}

/// Draws charts one above the other, each so high, without those that have no point. False and no file if none has one.
pub fn write(path: &Path, height: u32, charts: Vec<Chart>) -> Result<bool> {
    let drawing = drawing(height, charts).with_context(|| format!("plot {}", path.display()))?;
    drawing.iter().try_for_each(|drawing| drawing.write_png(path))?;
    Ok(drawing.is_some())
}

/// The same as a picture; none where no chart has a point.
pub(super) fn drawing(height: u32, mut charts: Vec<Chart>) -> Result<Option<Canvas>> {
    charts.retain(|chart| chart.lines.iter().flat_map(|line| &line.pieces).any(|piece| !piece.is_empty()));
    if charts.is_empty() {
        return Ok(None);
    }
    let mut canvas = Canvas::new(WIDTH, height * charts.len() as u32);
    {
        let area = canvas.area();
        let parts = area.split_evenly((charts.len(), 1));
        for (chart, part) in charts.iter_mut().zip(&parts) {
            chart.draw(part)?;
        }
        drawn(area.present())?;
    }
    Ok(Some(canvas))
}

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
type Plot<'a, 'b, Y> = ChartContext<'a, BitMapBackend<'b>, Cartesian2d<RangedCoordf64, Y>>;

impl Chart {
    /// Draws the chart over the whole area. A log axis leaves out values that are not positive.
    fn draw(&mut self, area: &Area) -> Result<()> {
        if let Some((label, colour, value)) = self.level {
            let pieces = vec![vec![(0.0, value), (self.end(), value)]];
            self.lines.push(Line { label: label.into(), colour, stroke: Stroke::Dashed, pieces });
        }
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

    /// Where the horizontal axis ends.
    fn end(&self) -> f64 {
        self.spans.last().map(|span| span.last).filter(|last| *last > 0.0).unwrap_or(1.0)
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
        area: &Area,
        values: Range<f64>,
        fine_grid: f64,
        axis: impl Fn(Range<f64>) -> Y,
    ) -> Result<()>
    where
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let beside = if self.legend.is_none() { BESIDE[0] } else { 0 };
        let (area, legend) = area.split_horizontally(area.dim_in_pixel().0 - beside);
        let mut plot = drawn(
            ChartBuilder::on(&area)
                .caption(&self.title, TextStyle::from(font(30)).color(&INK))
                .margin(16)
                .margin_right(40)
                .x_label_area_size(66)
                .y_label_area_size(124)
                .build_cartesian_2d(0.0..self.end(), axis(values.clone())),
        )?;
        let with_steps = self.spans.iter().filter(|span| span.first < span.last);
        for (span, shade) in with_steps.zip(SHADES.iter().cycle()) {
            let block = Rectangle::new([(span.first, values.start), (span.last, values.end)], shade.filled());
            drawn(plot.draw_series([block]))?;
        }
        drawn(
            plot.configure_mesh()
                .x_desc(self.axis)
                .y_desc(self.values)
                .x_labels(11)
                .y_labels(8)
                .x_label_formatter(&|place| if place.fract() == 0.0 { format!("{place:.0}") } else { short(*place) })
                .y_label_formatter(&|value| short(*value))
                .label_style(text(&INK))
                .axis_desc_style(text(&INK))
                .axis_style(INK.stroke_width(1))
                .bold_line_style(GRID.stroke_width(1))
                .light_line_style(GRID.mix(fine_grid))
                .draw(),
        )?;
        for span in &self.spans {
            span.draw(&mut plot, &values)?;
        }
        for line in &self.lines {
            line.draw(&mut plot)?;
        }
        let Some(position) = self.legend.clone() else {
            return self.draw_legend(&legend);
        };
        drawn(
            plot.configure_series_labels()
                .position(position)
                .label_font(text(&INK))
                .background_style(WHITE.mix(0.85))
                .border_style(GRID)
                .margin(14)
                .legend_area_size(46)
                .draw(),
        )
    }

    /// The lines' names, one below the other.
    fn draw_legend(&self, area: &Area) -> Result<()> {
        let [_, top, row] = BESIDE.map(|pixels| pixels as i32);
        let middle = Pos::new(HPos::Left, VPos::Center);
        for (place, line) in self.lines.iter().filter(|line| !line.label.is_empty()).enumerate() {
            let y = top + row * place as i32;
            drawn(area.draw(&sample((0, y), line.stroke, line.style())))?;
            drawn(area.draw(&Text::new(line.label.clone(), (4 * DASH as i32, y), text(&INK).pos(middle))))?;
        }
        Ok(())
    }
}

impl Span {
    /// Its first step as a line, and its name.
    fn draw<Y: Ranged<ValueType = f64>>(&self, plot: &mut Plot<Y>, values: &Range<f64>) -> Result<()> {
        let start = PathElement::new([(self.first, values.start), (self.first, values.end)], SPAN_INK.stroke_width(1));
        drawn(plot.draw_series([start]))?;
        // A span without steps has its name to the left: the next one begins there.
        let align = if self.first < self.last { HPos::Left } else { HPos::Right };
        let style = text(&SPAN_INK).pos(Pos::new(align, VPos::Bottom));
        drawn(plot.draw_series([Text::new(format!(" {} ", self.name), (self.first, values.start), style)]))?;
        Ok(())
    }
}

impl Line {
    /// Its pieces; the first one names it in the legend.
    fn draw<'a, 'b: 'a, Y: Ranged<ValueType = f64> + 'a>(&self, plot: &mut Plot<'a, 'b, Y>) -> Result<()> {
        let (style, stroke) = (self.style(), self.stroke);
        for (place, piece) in self.pieces.iter().filter(|piece| !piece.is_empty()).enumerate() {
            let points = piece.iter().copied();
            let series = match stroke {
                Stroke::Filled => drawn(plot.draw_series([Polygon::new(piece.clone(), style)]))?,
                Stroke::Dashed => drawn(plot.draw_series(DashedLineSeries::new(points, DASH, DASH, style)))?,
                _ => drawn(plot.draw_series(LineSeries::new(points, style)))?,
            };
            if place == 0 && !self.label.is_empty() {
                series.label(self.label.clone()).legend(move |place| sample(place, stroke, style));
            }
            // A single point has no line and shows only as a dot.
            if stroke == Stroke::Dotted || piece.len() == 1 {
                let dots = piece.iter().map(|point| Circle::new(*point, 4, self.colour.filled()));
                drawn(plot.draw_series(dots))?;
            }
        }
        Ok(())
    }

    fn style(&self) -> ShapeStyle {
        match self.stroke {
            Stroke::Pale => self.colour.mix(0.4).stroke_width(2),
            Stroke::Dotted | Stroke::Plain => self.colour.stroke_width(3),
            Stroke::Dashed => self.colour.stroke_width(2),
            Stroke::Filled => self.colour.mix(0.25).filled(),
        }
    }
}

/// A short piece of a line, for a legend.
fn sample<B: DrawingBackend>(
    (x, y): (i32, i32),
    stroke: Stroke,
    style: ShapeStyle,
) -> DynElement<'static, B, (i32, i32)> {
    let (end, half) = (x + 3 * DASH as i32, DASH as i32 / 2);
    let ends = [(x, y), (end, y)];
    match stroke {
        Stroke::Filled => Rectangle::new([(x, y - half), (end, y + half)], style).into_dyn(),
        Stroke::Dashed => DashedPathElement::new(ends, DASH, DASH, style).into_dyn(),
        _ => PathElement::new(ends, style).into_dyn(),
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

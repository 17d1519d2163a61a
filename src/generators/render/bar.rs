//! A pendulum: a red bar that turns about a black hub in the middle of a white frame.
//!
//! Sizes and colours are those of OpenAI Gym's `Pendulum`, the ends of the bar rounded as there. The paper's own frames
//! were never released.

use std::ops::Range;

use crate::generators::film::quantise;
use crate::generators::resize::Resize;
use crate::tasks::scene::{BAR_HALF_WIDTH, BAR_VIEW};

const HUB_RADIUS: f64 = 0.05;
/// Red, green and blue of the bar, 0..1.
const COLOUR: [f64; 3] = [0.8, 0.3, 0.3];
/// The canvas is this many times as large as the frame.
const SCALE: usize = 10;

/// Draws one bar, upright at angle 0; the angle grows clockwise.
#[derive(Debug, Clone)]
pub struct Bar {
    side: usize,
    /// Canvas pixels in the pendulum's unit of length.
    unit: f64,
    length: f64,
    shrink: Resize,
    /// How much of each pixel the hub covers, 0..1.
    hub: Vec<f64>,
}

impl Bar {
    /// A bar of this length, in the pendulum's unit, in frames of `side` pixels.
    pub fn new(side: usize, length: f64) -> Self {
        let unit = (side * SCALE) as f64 / (2.0 * BAR_VIEW);
        let mut bar = Self { side, unit, length, shrink: Resize::shrink(side, SCALE), hub: Vec::new() };
        let mut canvas = bar.canvas();
        bar.fill([0.0, 0.0], HUB_RADIUS, 1.0, &mut canvas);
        bar.hub = bar.shrink.apply(&canvas);
        bar
    }

    /// An empty canvas for [`Self::draw`].
    pub fn canvas(&self) -> Vec<f64> {
        vec![0.0; (self.side * SCALE).pow(2)]
    }

    /// Draws the bar at this angle, radians, into a colour frame. The canvas is empty before and after.
    pub fn draw(&self, angle: f64, canvas: &mut [f64], frame: &mut [u8]) {
        quantise(&self.levels(angle, canvas), COLOUR.len(), frame);
    }

    /// The same before the levels become grey levels: channel by channel.
    pub fn levels(&self, angle: f64, canvas: &mut [f64]) -> Vec<f64> {
        let end = [self.length * angle.sin(), -self.length * angle.cos()];
        let [columns, rows] = self.fill(end, BAR_HALF_WIDTH, 1.0, canvas);
        let mut cover = vec![0.0; self.side * self.side];
        let (window_rows, window_columns) = (self.shrink.reached(rows), self.shrink.reached(columns));
        self.shrink.apply_window(canvas, window_rows, window_columns, &mut Vec::new(), &mut cover);
        self.fill(end, BAR_HALF_WIDTH, 0.0, canvas);
        let plane = |colour: f64| {
            // Shrinking is linear and the hub lies wholly on the bar: white, less what the bar takes away, less what the
            // hub takes away from the bar.
            let covers = cover.iter().zip(&self.hub);
            covers.map(move |(bar, hub)| 1.0 - (1.0 - colour) * bar - colour * hub)
        };
        COLOUR.into_iter().flat_map(plane).collect()
    }

    /// Sets the canvas pixels whose centres are nearer than `reach` to the line from the hub to `end`, and returns the
    /// columns and rows among which they are.
    fn fill(&self, end: [f64; 2], reach: f64, value: f64, canvas: &mut [f64]) -> [Range<usize>; 2] {
        let side = self.side * SCALE;
        let centre = side as f64 / 2.0;
        let (end, reach) = (end.map(|along| along * self.unit), reach * self.unit);
        let ranges = end.map(|along| {
            let inside = |edge: f64| edge.clamp(0.0, side as f64) as usize;
            inside(centre + along.min(0.0) - reach)..inside((centre + along.max(0.0) + reach).ceil())
        });
        let squared_length = end[0] * end[0] + end[1] * end[1];
        let [columns, rows] = ranges.clone();
        for row in rows {
            for column in columns.clone() {
                let [x, y] = [column, row].map(|pixel| pixel as f64 + 0.5 - centre);
                let share = if squared_length > 0.0 { (x * end[0] + y * end[1]) / squared_length } else { 0.0 };
                let share = share.clamp(0.0, 1.0);
                let (dx, dy) = (x - share * end[0], y - share * end[1]);
                if dx * dx + dy * dy < reach * reach {
                    canvas[row * side + column] = value;
                }
            }
        }
        ranges
    }
}

//! What a model will learn from: frames of videos with the square that is cut out, and below each what is left of it.

use std::path::Path;

use anyhow::Result;
use image::RgbImage;
use image::imageops::{self, FilterType};
use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;

use paig::viz::canvas::{Canvas, INK};

/// Side of the cells, space between them and lines of text, pixels.
const CELL: u32 = 240;
const GAP: u32 = 10;
const LINE: u32 = 26;
const FONT_SIZE: u32 = 15;
/// The cut-out's outline: its colour and width.
const OUTLINE: RGBColor = RGBColor(225, 40, 40);
const OUTLINE_WIDTH: i64 = 2;

/// The frames of one video.
#[derive(Debug)]
pub struct SheetRow {
    pub title: String,
    pub cells: Vec<SheetCell>,
}

/// One frame, before and after.
#[derive(Debug)]
pub struct SheetCell {
    pub caption: String,
    /// The frame as it was filmed, of any scale.
    pub filmed: RgbImage,
    /// Left, top and side of the cut-out, as parts of the width of `filmed`.
    pub square: [f64; 3],
    /// The frame as the model sees it, `[S, S]`.
    pub seen: RgbImage,
}

/// Draws the sheet.
///
/// # Errors
/// A file that cannot be written.
pub fn write_contact_sheet(path: &Path, rows: &[SheetRow]) -> Result<()> {
    let columns = rows.iter().map(|row| row.cells.len()).max().unwrap_or(0) as u32;
    let row_height = 2 * (CELL + GAP) + 2 * LINE;
    let mut canvas = Canvas::new(GAP + columns.max(3) * (CELL + GAP), rows.len() as u32 * row_height + GAP);
    for (row, top) in rows.iter().zip((0..).map(|row| row * row_height)) {
        canvas.text(&row.title, (GAP, top + LINE / 2), FONT_SIZE, HPos::Left, INK)?;
        for (cell, left) in row.cells.iter().zip((0..).map(|column| GAP + column * (CELL + GAP))) {
            canvas.text(&cell.caption, (left + CELL / 2, top + LINE + LINE / 2), FONT_SIZE, HPos::Center, INK)?;
            let top = top + 2 * LINE;
            filmed(&mut canvas, cell, (left, top));
            // Whole multiples keep the pixels square.
            let times = (CELL / cell.seen.width()).max(1);
            let side = cell.seen.width() * times;
            let filter = if side <= CELL { FilterType::Nearest } else { FilterType::Triangle };
            let shown = side.min(CELL);
            let picture = imageops::resize(&cell.seen, shown, shown, filter);
            canvas.paste(&picture, (left + (CELL - shown) / 2, top + CELL + GAP));
        }
    }
    canvas.write_png(path)
}

/// The filmed frame, fitted into a cell, with the outline of the cut-out.
fn filmed(canvas: &mut Canvas, cell: &SheetCell, (left, top): (u32, u32)) {
    let (width, height) = cell.filmed.dimensions();
    let scale = f64::from(CELL) / f64::from(width.max(height));
    let fitted = |side: u32| ((f64::from(side) * scale).round() as u32).clamp(1, CELL);
    let (width, height) = (fitted(width), fitted(height));
    let corner = (left + (CELL - width) / 2, top + (CELL - height) / 2);
    canvas.paste(&imageops::resize(&cell.filmed, width, height, FilterType::Triangle), corner);
    let [x, y, side] = cell.square.map(|part| (part * f64::from(width)).round() as i64);
    // Only what lies within the cell is drawn.
    let bar = |canvas: &mut Canvas, x: i64, y: i64, width: i64, height: i64| {
        let within = |at: i64, length: i64, corner: u32, cell: u32| {
            let (start, end) = (i64::from(corner) + at, i64::from(corner) + at + length);
            (start.clamp(i64::from(cell), i64::from(cell + CELL)), end.clamp(i64::from(cell), i64::from(cell + CELL)))
        };
        let ((x0, x1), (y0, y1)) = (within(x, width, corner.0, left), within(y, height, corner.1, top));
        canvas.fill((x0 as u32, y0 as u32), ((x1 - x0) as u32, (y1 - y0) as u32), OUTLINE);
    };
    for end in [0, side - OUTLINE_WIDTH] {
        bar(canvas, x, y + end, side, OUTLINE_WIDTH);
        bar(canvas, x + end, y, OUTLINE_WIDTH, side);
    }
}

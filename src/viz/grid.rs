//! Cells of one size in rows and columns, labels to their left and captions above them.

use anyhow::Result;
use plotters::style::text_anchor::HPos;

use super::canvas::{Canvas, INK};
use crate::network::System;

/// Screen pixels for one pixel of a frame: small frames are enlarged to about the size of the digits' ones.
pub(super) fn enlargement(system: &System) -> u32 {
    if system.side >= 64 { 2 } else { 4 }
}

/// Where the cells of a picture stand. All lengths are pixels of the picture.
#[derive(Debug, Clone)]
pub struct Grid {
    pub rows: usize,
    pub columns: usize,
    /// Side of a cell.
    pub cell: u32,
    /// Space between two cells, and what some columns have before them besides.
    pub gap: u32,
    pub breaks: Vec<(usize, u32)>,
    /// Space for the labels to the left, of which so much is free between a label and its row.
    pub left: u32,
    pub label_gap: u32,
    /// Space for the captions above.
    pub top: u32,
    /// Free space to the right and below.
    pub margin: u32,
    pub font_size: u32,
}

impl Grid {
    /// Cells as large as an enlarged frame of the task, without breaks.
    pub(super) fn of_frames(system: &System, rows: usize, columns: usize) -> Self {
        let cell = system.side as u32 * enlargement(system);
        let (breaks, label_gap, margin, font_size) = (Vec::new(), 10, 12, 22);
        Grid { rows, columns, cell, gap: 4, breaks, left: margin, label_gap, top: 42, margin, font_size }
    }

    /// Top left corner (x, y) of a cell.
    pub fn corner(&self, row: usize, column: usize) -> (u32, u32) {
        let breaks: u32 = self.breaks.iter().filter(|(first, _)| *first <= column).map(|(_, space)| space).sum();
        let x = self.left + column as u32 * (self.cell + self.gap) + breaks;
        (x, self.top + row as u32 * (self.cell + self.gap))
    }

    /// Width and height of the picture.
    pub fn size(&self) -> (u32, u32) {
        let (x, y) = self.corner(self.rows - 1, self.columns - 1);
        (x + self.cell + self.margin, y + self.cell + self.margin)
    }

    /// An empty picture.
    pub(super) fn canvas(&self) -> Canvas {
        let (width, height) = self.size();
        Canvas::new(width, height)
    }

    /// Writes the label of a row, one line below the other.
    pub(super) fn label(&self, canvas: &mut Canvas, row: usize, lines: &[&str]) -> Result<()> {
        let middle = self.corner(row, 0).1 + self.cell / 2;
        let first = middle - (lines.len() as u32 - 1) * self.font_size / 2;
        (0..).zip(lines).try_for_each(|(line, text)| {
            let at = (self.left - self.label_gap, first + line * self.font_size);
            canvas.text(text, at, self.font_size, HPos::Right, INK)
        })
    }

    /// Writes above the middle of a column.
    pub(super) fn caption(&self, canvas: &mut Canvas, column: usize, text: &str) -> Result<()> {
        let at = (self.corner(0, column).0 + self.cell / 2, self.top / 2);
        canvas.text(text, at, self.font_size, HPos::Center, INK)
    }
}

//! Future frames of several models below the true ones.
//!
//! Paper: the galleries of future-frame prediction.

use std::path::Path;

use anyhow::Result;
use tch::Tensor;

use super::canvas::pictures;
use super::grid::{Grid, enlargement};
use crate::network::System;
use crate::support::error::Error;

/// Draws a row of frames (`[frames, C, S, S]` in \[0, 1\]) for each label; `places` are those of the frames in the clip.
///
/// # Errors
/// A file that cannot be written, frames with neither 1 nor 3 channels.
pub fn write_gallery(path: &Path, system: &System, rows: &[(String, Tensor)], places: &[usize]) -> Result<(), Error> {
    let frames = Grid::of_frames(system, rows.len(), places.len());
    let grid = Grid { left: 330, ..frames };
    let mut canvas = grid.canvas();
    for (column, place) in places.iter().enumerate() {
        let boundary = if *place < system.input_steps + system.pred_steps { "T_pred" } else { "T_ext" };
        grid.caption(&mut canvas, column, &format!("{place} {boundary}"))?;
    }
    for (row, (label, frames)) in rows.iter().enumerate() {
        grid.label(&mut canvas, row, &[label])?;
        for (column, picture) in pictures(frames, enlargement(system))?.iter().enumerate() {
            canvas.paste(picture, grid.corner(row, column));
        }
    }
    Ok(canvas.write_png(path)?)
}

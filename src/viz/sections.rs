//! The three parts of a clip: input, trained prediction, extrapolation.

use plotters::style::RGBColor;

use crate::network::System;

/// One part of a clip with the colour that marks it in every picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Section {
    pub name: &'static str,
    /// Symbol of its length in the paper.
    pub symbol: &'static str,
    pub colour: RGBColor,
    pub first: usize,
    pub frames: usize,
}

/// The part that a frame belongs to.
pub(super) fn section_at(sections: &[Section], frame: usize) -> &Section {
    sections.iter().rfind(|section| section.first <= frame).expect("the first section begins at 0")
}

/// The parts of clips of `time` frames, in order; without T_ext if nothing follows the prediction.
pub(super) fn sections(system: &System, time: usize) -> Vec<Section> {
    let parts = [
        ("input", "L", RGBColor(92, 103, 117), system.input_steps),
        ("prediction", "T_pred", RGBColor(24, 119, 190), system.pred_steps),
        ("extrapolation", "T_ext", RGBColor(222, 106, 16), time - system.input_steps - system.pred_steps),
    ];
    let mut first = 0;
    let sections = parts.into_iter().map(|(name, symbol, colour, frames)| {
        first += frames;
        Section { name, symbol, colour, first: first - frames, frames }
    });
    sections.filter(|section| section.frames > 0).collect()
}

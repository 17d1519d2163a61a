//! The three parts of a clip: input, trained prediction, extrapolation.

use plotters::style::RGBColor;

use crate::tasks::Task;

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
pub(super) fn sections(task: &Task, time: usize) -> Vec<Section> {
    let parts = [
        ("input", "L", RGBColor(92, 103, 117), task.input_steps),
        ("prediction", "T_pred", RGBColor(24, 119, 190), task.pred_steps),
        ("extrapolation", "T_ext", RGBColor(222, 106, 16), time - task.input_steps - task.pred_steps),
    ];
    let mut first = 0;
    let mut sections = Vec::new();
    for (name, symbol, colour, frames) in parts {
        if frames > 0 {
            sections.push(Section { name, symbol, colour, first, frames });
        }
        first += frames;
    }
    sections
}

//! Equations that come with the program, made comparable: for the same frames, times and objects.

use std::sync::Arc;

use paig::network::cells::text::{Accelerations, EquationTable};
use paig::network::cells::{CellKind, Coordinates, Equations};
use paig::network::system::EquationEntry;
use paig::tasks::equation_file::EquationFile;
use paig::tasks::gallery::GALLERY;

/// Equations by name that are tried. Those of the gallery that repeat one of them begin with `text_`.
const BUILT_IN: [&str; 4] = ["falling", "spring", "damped_spring", "gravity"];
const REPEATED: &str = "text_";
/// Side of the frames in whose pixels all candidates are.
pub(super) const SIDE: usize = 64;
/// Two bounds are widened on both sides by so many times what lies between them: a pivot may be far outside of the picture.
const WIDENED: f64 = 4.0;
/// Those of a parameter without a unit cannot be converted: they are moved out by this factor.
const UNKNOWN: f64 = 16.0;

/// An equation that may explain what moves.
#[derive(Debug, Clone)]
pub(super) struct EquationCandidate {
    pub name: String,
    /// What moves by it, in one line.
    pub summary: String,
    pub cell: Arc<CellKind>,
}

/// All equations for so many objects, in frames of [`SIDE`] pixels that are `interval` seconds apart. Walls at the edges of the
/// frame are only real where somebody chose the frame.
pub(super) fn candidates(objects: usize, interval: f64, walls_at_edges: bool) -> Vec<EquationCandidate> {
    let built_in = BUILT_IN.iter().map(|name| EquationFile::built_in(name));
    let gallery = GALLERY.iter().filter(|entry| !entry.name.starts_with(REPEATED));
    let gallery = gallery.map(|entry| EquationFile::named(entry.name).expect("the gallery is sound, by a test"));
    let candidate = |file: EquationFile| {
        let entry = for_frames(&file, SIDE, interval);
        let cell = entry.kind(objects, &Equations::default()).ok()?;
        let for_so_many = cell.objects.is_none_or(|written_for| written_for == objects)
            && (!acts_between(&file.equation, &cell) || objects > 1)
            && !is_constrained(&file.equation);
        let fits = for_so_many && cell.coordinates == Coordinates::Position && (walls_at_edges || !cell.walls);
        fits.then_some(EquationCandidate { name: file.name, summary: file.summary, cell })
    };
    built_in.chain(gallery).filter_map(candidate).collect()
}

/// Whether an equation has surfaces or strings: one that was not asked for would explain an impact by a surface of its own.
fn is_constrained(entry: &EquationEntry) -> bool {
    matches!(entry, EquationEntry::Text(table) if table.is_constrained())
}

/// Whether an equation is about what objects do to each other.
fn acts_between(entry: &EquationEntry, cell: &CellKind) -> bool {
    let texts = |table: &EquationTable| {
        let of_objects = match &table.acceleration {
            Accelerations::ForAll(text) => std::slice::from_ref(text),
            Accelerations::ForEach(texts) => texts,
        };
        of_objects.iter().chain(table.definitions.values()).any(|text| text.contains("others("))
    };
    match entry {
        EquationEntry::Text(table) => texts(table),
        EquationEntry::Name(_) => cell.table().as_ref().is_none_or(texts),
    }
}

/// The equation of a file for frames of `side` pixels that are `interval` seconds apart: starts and bounds that the file gives for
/// its own side and `dt` are converted, bounds on both sides of a parameter with a unit are moved apart.
pub(super) fn for_frames(file: &EquationFile, side: usize, interval: f64) -> EquationEntry {
    let EquationEntry::Text(table) = &file.equation else { return file.equation.clone() };
    let mut table: EquationTable = table.clone();
    let per_second = file.dt.map_or(1.0, |dt| dt / interval);
    let per_pixel = file.side.map_or(1.0, |own| side as f64 / own as f64);
    table.scale_lengths(per_pixel);
    for parameter in table.parameters.values_mut() {
        let Some([length, time]) = parameter.unit else {
            if let (Some(low), Some(high)) = (&mut parameter.low, &mut parameter.high) {
                (*low, *high) = (*low * UNKNOWN, *high * UNKNOWN);
            }
            continue;
        };
        let factor = per_second.powi(-time) * per_pixel.powi(length);
        for number in [&mut parameter.start, &mut parameter.low, &mut parameter.high, &mut parameter.fixed] {
            number.iter_mut().for_each(|number| *number *= factor);
        }
        if let (Some(low), Some(high)) = (&mut parameter.low, &mut parameter.high)
            && [length, time] != [0, 0]
        {
            let apart = WIDENED * (*high - *low);
            (*low, *high) = (*low - apart, *high + apart);
        }
    }
    EquationEntry::Text(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(objects: usize, walls: bool) -> Vec<String> {
        candidates(objects, 1.0 / 30.0, walls).into_iter().map(|candidate| candidate.name).collect()
    }

    #[test]
    fn candidates_are_those_for_so_many_objects() {
        let one = names(1, false);
        for expected in ["falling", "swing", "mass_on_a_spring", "bounce_on_a_floor", "sliding_block"] {
            assert!(one.iter().any(|name| name == expected), "{one:?}");
        }
        for other in
            ["spring", "gravity", "charges", "double_pendulum", "lossy_bounce", "text_pendulum", "slack_pendulum"]
        {
            assert!(!one.iter().any(|name| name == other), "{other} is about another number of objects, or obstacles");
        }
        assert!(names(1, true).contains(&"lossy_bounce".to_string()));
        let two = names(2, false);
        assert!(two.contains(&"spring".to_string()) && two.contains(&"double_pendulum".to_string()), "{two:?}");
        assert!(names(3, false).contains(&"spring_chain".to_string()));
    }

    /// A start of 10 pixels in frames of 32 is 20 in frames of 64; a rate of 2 per unit of 0.5 s is 4 per second, and frames that are
    /// a tenth of a second apart count time in tenths of the file's units for a dt of 0.1.
    #[test]
    fn starts_and_bounds_are_converted_to_the_frames() {
        let text = "[system]\nside = 32\nobjects = 1\ndt = 0.5\n[system.equation]\nacceleration = \"-k * (p - vec(x, x))\"\n\
                    [system.equation.parameters]\nk = { unit = [0, -2], start = 4.0 }\nx = { unit = [1, 0], start = 10.0 }";
        let file = EquationFile::from_text("own", text).unwrap();
        let EquationEntry::Text(table) = for_frames(&file, 64, 0.1) else { panic!("a text stays one") };
        let start = |name: &str| table.parameters[name].start.unwrap();
        assert!((start("k") - 100.0).abs() < 1e-9 && (start("x") - 20.0).abs() < 1e-9, "{table:?}");
    }
}

//! Evidence that the camera stands although most corners move: marks all over the frame that stay where they are.
//!
//! An object that fills the frame carries most of its corners, so the largest group of corners shows the object's motion. The
//! background still has marks that stay in place in all frames, and no travelling camera leaves such marks all over the frame.

use rayon::prelude::*;

use crate::corners::{corners, displaced};
use crate::grey::pyramid;
use crate::plane::Plane;
use crate::similarity::Similarity;
use crate::statistics::{NORMAL_MAD, median, quantile};

/// Frames of the median image.
const MEDIAN_FRAMES: usize = 25;
/// Frames in which its corners are looked for.
pub(crate) const LOOKED_AT: usize = 120;
/// Levels of the pyramids: a mark that stays is near, and coarser levels show the object around it.
const LEVELS: usize = 2;
/// Least share of the frames in which a mark is found.
const LEAST_FOUND: f64 = 0.4;
/// Standard deviation over time, reduced pixels, of the place of a mark that stays.
const STAYS: f64 = 0.12;
/// Distance of such a mark from its usual place in a frame, reduced pixels.
const IN_PLACE: f64 = 0.3;
/// Fewest marks that stay, and fewest in place in a frame, as a share of those.
const LEAST_MARKS: usize = 8;
const LEAST_IN_PLACE: f64 = 0.34;
/// Share of the frames in which so many must be in place.
const MOST_FRAMES: f64 = 0.97;
/// Share of the width and of the height over which the marks lie, and fewest in each half of the frame.
const SPREAD: f64 = 0.5;
const IN_HALF: usize = 2;

/// Maps from the usual places of marks that stay to their places in reduced images, at most [`LOOKED_AT`]. `None` where the
/// images have no such marks all over the picture.
pub(crate) fn poses(images: &[Plane]) -> Option<Vec<Similarity>> {
    let count = MEDIAN_FRAMES.min(images.len());
    let some: Vec<&Plane> = (0..count).map(|k| &images[(2 * k + 1) * images.len() / (2 * count)]).collect();
    let reference = median_image(&some)?;
    let reference = first_levels(&reference);
    let marks = corners(&reference[0]);
    let expected: Vec<[f64; 2]> = marks.iter().map(|mark| mark.at).collect();
    let places: Vec<Vec<Option<[f64; 2]>>> =
        images.par_iter().map(|frame| displaced(&reference, &first_levels(frame), &marks, &expected)).collect();
    let staying: Vec<(usize, [f64; 2])> =
        (0..marks.len()).filter_map(|mark| Some((mark, usual_place(&places, mark)?))).collect();
    if !all_over(&staying, &reference[0]) {
        return None;
    }
    let least = (LEAST_IN_PLACE * staying.len() as f64).ceil() as usize;
    let poses: Vec<Similarity> = places
        .iter()
        .filter_map(|places| {
            let found = staying.iter().filter_map(|&(mark, usual)| Some((usual, places[mark]?)));
            let pairs: Vec<_> =
                found.filter(|(usual, there)| Similarity::IDENTITY.distance(usual, there) < IN_PLACE).collect();
            if pairs.len() < least { None } else { Similarity::IDENTITY.refined(&pairs, IN_PLACE) }
        })
        .collect();
    (poses.len() as f64 >= MOST_FRAMES * images.len() as f64).then_some(poses)
}

fn first_levels(image: &Plane) -> Vec<Plane> {
    let mut levels = pyramid(image);
    levels.truncate(LEVELS);
    levels
}

/// Median of each pixel.
pub(crate) fn median_image(images: &[&Plane]) -> Option<Plane> {
    let first = images.first()?;
    let mut image = Plane::zeros(first.width, first.height);
    image.values.par_iter_mut().enumerate().for_each(|(place, value)| {
        let mut values: Vec<f32> = images.iter().map(|image| image.values[place]).collect();
        let middle = values.len() / 2;
        *value = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
    });
    Some(image)
}

/// Median place of a mark that stays; `None` for one that moves or is rarely found.
fn usual_place(places: &[Vec<Option<[f64; 2]>>], mark: usize) -> Option<[f64; 2]> {
    let found: Vec<[f64; 2]> = places.iter().filter_map(|frame| frame[mark]).collect();
    if (found.len() as f64) < LEAST_FOUND * places.len() as f64 {
        return None;
    }
    let mut usual = [0.0; 2];
    for axis in 0..2 {
        let mut values: Vec<f64> = found.iter().map(|place| place[axis]).collect();
        usual[axis] = median(&mut values)?;
        values.iter_mut().for_each(|value| *value = (*value - usual[axis]).abs());
        if NORMAL_MAD * median(&mut values)? > STAYS {
            return None;
        }
    }
    Some(usual)
}

/// Whether marks lie all over an image.
fn all_over(marks: &[(usize, [f64; 2])], image: &Plane) -> bool {
    let sides = [image.width, image.height].map(|side| side as f64);
    marks.len() >= LEAST_MARKS
        && (0..2).all(|axis| {
            let mut places: Vec<f64> = marks.iter().map(|(_, at)| at[axis]).collect();
            let range = quantile(&mut places, 1.0).unwrap_or(0.0) - quantile(&mut places, 0.0).unwrap_or(0.0);
            let before = places.iter().filter(|place| **place < 0.5 * sides[axis]).count();
            range > SPREAD * sides[axis] && before.min(places.len() - before) >= IN_HALF
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{MovingEllipse, SyntheticScene};
    use crate::test_videos::reduced_images;

    /// An object over two thirds of the frame that swings and turns by some pixels, before a wall with marks.
    fn large() -> SyntheticScene {
        SyntheticScene::of(MovingEllipse {
            positions: (0..40).map(|f| [160.0 + 9.0 * (f as f64 * 0.4).sin(), 120.0]).collect(),
            angles: (0..40).map(|f| 0.05 * (f as f64 * 0.3).cos()).collect(),
            axes: [150.0, 105.0],
            texture: 60.0,
            ..MovingEllipse::default()
        })
    }

    #[test]
    fn marks_around_an_object_that_fills_the_frame_show_that_the_camera_stands() {
        let found = poses(&reduced_images(&large())).expect("marks in the corners of the frame");
        assert!(found.len() >= 39);
        assert!(found.iter().all(|pose| pose.displacement(320, 240) < 0.2), "{found:?}");
    }

    #[test]
    fn a_camera_that_follows_an_object_leaves_no_marks_all_over_the_frame() {
        let positions: Vec<[f64; 2]> = (0..40).map(|f| [160.0 + 6.0 * f as f64, 120.0]).collect();
        let camera = positions.iter().map(|p| [160.0 - p[0], 0.0, 0.0]).collect();
        let scene = SyntheticScene {
            camera,
            ..SyntheticScene::of(MovingEllipse { axes: [60.0, 50.0], texture: 60.0, ..MovingEllipse::at(positions) })
        };
        assert_eq!(poses(&reduced_images(&scene)), None);
    }
}

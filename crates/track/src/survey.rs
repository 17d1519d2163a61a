//! First pass over a video: changes from frame to frame, and each frame's place in the scene by corners of reduced images.

use std::ops::Range;

use crate::corners::{Corner, corners, displaced};
use crate::error::TrackError;
use crate::grey::{pyramid, reduced, reduction};
use crate::pictures::{Change, change};
use crate::plane::Plane;
use crate::similarity::Similarity;
use crate::statistics::quantile;
use crate::video::{FrameSource, Size};

/// Frames that are registered before it is known that the camera moves.
const LOOKED_AT: usize = 450;
/// Memory for reduced images, bytes: a moving camera is registered from them without another pass over the video.
const REDUCED_BYTES: usize = 128 << 20;
/// Distance of a corner from where the background's motion takes it, reduced pixels, up to which it belongs to the background.
const AGREES: f64 = 0.6;
/// Fewest corners, and cells that hold them, of a registration.
const LEAST_CORNERS: usize = 8;
const LEAST_CELLS: usize = 4;
/// Cells that stay at the expected place, over those of the largest moving group, from which on they are the background:
/// an object may cover most of the frame.
const STAYS: f64 = 0.33;
/// Share of the frame's width and height over which the corners of a background lie: those of a moving object, or of its
/// string, lie in one place.
const SPREAD: f64 = 0.4;
/// Width of the border in which some of a background's corners must lie, as a share of the shorter side, and how many.
const BORDER: f64 = 0.16;
const AT_BORDER: usize = 4;
/// Fewest cells with corners of a background that shows whether the camera moves: in all, and in each quarter of the frame.
const TEXTURED: [usize; 2] = [12, 2];
/// Share of the key frame's corners that must stay in view.
const IN_VIEW: f64 = 0.65;
/// Pairs of corners from which a motion is guessed.
const GUESSES: usize = 120;
/// Frames in a row without a registration after which a new scene begins.
const LOST: usize = 8;

/// Place of a frame in the scene, from reduced images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coarse {
    pub(crate) frame: usize,
    /// From the frame to the scene of its shot, reduced pixels; `None` where the background was not found.
    pub(crate) pose: Option<Similarity>,
    /// Share of the followed corners that agrees on the pose.
    pub(crate) agreeing: f64,
    /// Whether the key frame has corners enough to show a motion of the camera.
    pub(crate) textured: bool,
    /// Number of the scene: registrations of two scenes are not connected.
    pub(crate) scene: usize,
}

/// What a pass over a video found.
pub(crate) struct Survey {
    pub(crate) size: Size,
    pub(crate) factor: usize,
    /// One for each frame.
    pub(crate) changes: Vec<Change>,
    /// Registrations, of every frame or of some.
    pub(crate) coarse: Vec<Coarse>,
    /// Frames kept as they are, `[height, width, 3]`.
    pub(crate) kept: Vec<(usize, Vec<u8>)>,
    /// Reduced images of every frame, or of every so many-th where there are more than fit into memory.
    images: Vec<(usize, Reduced)>,
}

/// Reduced image, rounded to levels.
struct Reduced {
    width: usize,
    height: usize,
    levels: Vec<u8>,
}

impl Reduced {
    fn of(image: &Plane) -> Self {
        let levels = image.values.iter().map(|level| (level + 0.5) as u8).collect();
        Self { width: image.width, height: image.height, levels }
    }

    fn plane(&self) -> Plane {
        let values = self.levels.iter().map(|&level| f32::from(level)).collect();
        Plane { width: self.width, height: self.height, values }
    }
}

impl Survey {
    /// Reads the frames of a range, registers every `stride`-th and keeps those listed in `keep` (ascending).
    ///
    /// # Errors
    /// Errors of the source; [`TrackError::FrameSize`] and [`TrackError::MissingFrame`] for a source that contradicts itself.
    pub(crate) fn read(
        video: &dyn FrameSource,
        range: Range<usize>,
        stride: usize,
        keep: &[usize],
    ) -> Result<Self, TrackError> {
        let size = video.size();
        let factor = reduction(size);
        let (changes, coarse, kept, images) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut survey = Self { size, factor, changes, coarse, kept, images };
        let of_one = (size.width / factor) * (size.height / factor);
        let every = (range.len() * of_one).div_ceil(REDUCED_BYTES).max(1);
        let mut registrar = Registrar::default();
        let mut before: Option<[Plane; 2]> = None;
        let first = range.start;
        video.visit(&|frame| range.contains(&frame), &mut |frame, bytes| {
            let expected = size.pixels() * 3;
            if bytes.len() != expected {
                return Err(TrackError::FrameSize { frame, expected, found: bytes.len() });
            }
            let image = reduced(bytes, size, factor);
            survey.changes.push(change(frame, before.as_ref().map(|[a, b]| (a, b)), &image));
            if survey.changes.last().is_some_and(Change::is_cut) {
                registrar.begin_scene();
            }
            if (frame - first).is_multiple_of(stride) {
                survey.coarse.push(registrar.register(frame, &image));
            }
            if (frame - first).is_multiple_of(every) {
                survey.images.push((frame, Reduced::of(&image)));
            }
            if keep.binary_search(&frame).is_ok() {
                survey.kept.push((frame, bytes.to_vec()));
            }
            before = Some(match before.take() {
                Some([_, last]) => [last, image],
                None => [image.clone(), image],
            });
            Ok(())
        })?;
        if survey.changes.len() < range.len() {
            return Err(TrackError::MissingFrame { frame: first + survey.changes.len() });
        }
        Ok(survey)
    }

    /// Registers every frame of a range, from the reduced images where there are enough of them.
    ///
    /// # Errors
    /// As [`Survey::read`].
    pub(crate) fn register_all(
        &self,
        video: &dyn FrameSource,
        range: &Range<usize>,
    ) -> Result<Vec<Coarse>, TrackError> {
        let images: Vec<&(usize, Reduced)> = self.images.iter().filter(|(frame, _)| range.contains(frame)).collect();
        if images.len() < range.len() {
            return Ok(Self::read(video, range.clone(), 1, &[])?.coarse);
        }
        let cuts: Vec<usize> =
            self.changes.iter().filter(|change| change.is_cut()).map(|change| change.frame).collect();
        let mut registrar = Registrar::default();
        let register = |(frame, image): &(usize, Reduced)| {
            if cuts.binary_search(frame).is_ok() {
                registrar.begin_scene();
            }
            registrar.register(*frame, &image.plane())
        };
        Ok(images.into_iter().map(register).collect())
    }

    /// Reduced images of a range, at most so many, evenly spread.
    pub(crate) fn images(&self, range: &Range<usize>, most: usize) -> Vec<Plane> {
        let images: Vec<&Reduced> =
            self.images.iter().filter(|(frame, _)| range.contains(frame)).map(|(_, image)| image).collect();
        let count = most.min(images.len());
        (0..count).map(|k| images[(2 * k + 1) * images.len() / (2 * count)].plane()).collect()
    }

    /// Stride at which a range is looked at first.
    pub(crate) fn stride(frames: usize) -> usize {
        frames.div_ceil(LOOKED_AT).max(1)
    }
}

/// Frame against which others are registered.
struct Key {
    pyramid: Vec<Plane>,
    corners: Vec<Corner>,
    textured: bool,
    /// From the key frame to the scene.
    pose: Similarity,
}

impl Key {
    fn new(pyramid: Vec<Plane>, pose: Similarity) -> Self {
        let corners = corners(&pyramid[0]);
        let textured = textured(&corners, &pyramid[0]);
        Self { pyramid, textured, corners, pose }
    }
}

/// Whether corners lie in many cells and in every quarter of an image.
fn textured(corners: &[Corner], image: &Plane) -> bool {
    let middle = [0.5 * image.width as f64, 0.5 * image.height as f64];
    let quarter = |corner: &Corner| usize::from(corner.at[0] > middle[0]) + 2 * usize::from(corner.at[1] > middle[1]);
    let mut cells: Vec<(usize, usize)> = corners.iter().map(|corner| (quarter(corner), corner.cell)).collect();
    cells.sort_unstable();
    cells.dedup();
    let in_quarter = |quarter: usize| cells.iter().filter(|cell| cell.0 == quarter).count();
    cells.len() >= TEXTURED[0] && (0..4).all(|quarter| in_quarter(quarter) >= TEXTURED[1])
}

#[derive(Default)]
struct Registrar {
    key: Option<Key>,
    /// Frame before, where it is not the key.
    last: Option<(Vec<Plane>, Similarity)>,
    /// From the key to the frame before.
    motion: Option<Similarity>,
    scene: usize,
    lost: usize,
}

/// Motion of the background from a key frame.
struct BackgroundMotion {
    map: Similarity,
    followed: usize,
    agreeing: usize,
    cells: usize,
    /// Whether the corners that agree lie all over the frame, near its border, too.
    spread: bool,
}

impl Registrar {
    fn begin_scene(&mut self) {
        self.scene += usize::from(self.key.is_some());
        (self.key, self.last, self.motion, self.lost) = (None, None, None, 0);
    }

    fn register(&mut self, frame: usize, image: &Plane) -> Coarse {
        let pyramid = pyramid(image);
        let guess = self.motion.unwrap_or(Similarity::IDENTITY);
        let Some(key) = &self.key else {
            let key = Key::new(pyramid, Similarity::IDENTITY);
            let found = Coarse {
                frame,
                pose: (key.corners.len() >= LEAST_CORNERS).then_some(Similarity::IDENTITY),
                agreeing: 1.0,
                textured: key.textured,
                scene: self.scene,
            };
            self.key = Some(key);
            return found;
        };
        let mut found = motion(key, &pyramid, guess).map(|motion| (key.pose, motion));
        if found.as_ref().is_none_or(|(_, motion)| !motion.is_good())
            && let Some((last, pose)) = self.last.take()
        {
            let last = Key::new(last, pose);
            found = motion(&last, &pyramid, Similarity::IDENTITY)
                .filter(BackgroundMotion::is_good)
                .map(|m| (pose, m))
                .or(found);
        }
        let Some((from, motion)) = found.filter(|(_, motion)| motion.spread && motion.cells >= LEAST_CELLS) else {
            self.lost += 1;
            let (scene, textured) = (self.scene, key.textured);
            if self.lost >= LOST {
                self.begin_scene();
            }
            return Coarse { frame, pose: None, agreeing: 0.0, textured, scene };
        };
        self.lost = 0;
        let pose = from.after(&motion.map.inverse());
        let map = pose.inverse().after(&key.pose);
        let (width, height) = (image.width as f64, image.height as f64);
        let in_view = |corner: &&Corner| {
            let [x, y] = map.apply(corner.at);
            (0.0..width).contains(&x) && (0.0..height).contains(&y)
        };
        let share = key.corners.iter().filter(in_view).count() as f64 / key.corners.len().max(1) as f64;
        let textured = key.textured;
        if share < IN_VIEW || (motion.agreeing * 3 < key.corners.len() && motion.is_good()) {
            (self.key, self.last, self.motion) = (Some(Key::new(pyramid, pose)), None, None);
        } else {
            (self.last, self.motion) = (Some((pyramid, pose)), Some(map));
        }
        let agreeing = motion.agreeing as f64 / motion.followed as f64;
        Coarse { frame, pose: Some(pose), agreeing, textured, scene: self.scene }
    }
}

impl BackgroundMotion {
    fn is_good(&self) -> bool {
        self.agreeing * 2 >= self.followed && self.cells >= 2 * LEAST_CELLS && self.spread
    }
}

/// Motion of the background from a key frame to another: that of the corners that stay at the expected place where they are
/// widely spread, else that of the most widely spread group.
fn motion(key: &Key, pyramid: &[Plane], guess: Similarity) -> Option<BackgroundMotion> {
    let expected: Vec<[f64; 2]> = key.corners.iter().map(|corner| guess.apply(corner.at)).collect();
    let places = displaced(&key.pyramid, pyramid, &key.corners, &expected);
    let (mut pairs, mut cells) = (Vec::new(), Vec::new());
    for (corner, there) in key.corners.iter().zip(places) {
        if let Some(there) = there {
            pairs.push((corner.at, there));
            cells.push(corner.cell);
        }
    }
    if pairs.len() < LEAST_CORNERS {
        return None;
    }
    let spread = |map: &Similarity| {
        let mut found: Vec<usize> = pairs
            .iter()
            .zip(&cells)
            .filter(|((from, to), _)| map.distance(from, to) < AGREES)
            .map(|(_, &cell)| cell)
            .collect();
        found.sort_unstable();
        found.dedup();
        found.len()
    };
    let mut best = (0, guess);
    let count = pairs.len();
    for k in 0..GUESSES {
        // Pairs of corners at many distances, without chance.
        let (i, j) = (k * 7919 % count, (k * 104_729 + count / 2 + k) % count);
        let Some(map) = Similarity::of_pairs([pairs[i].0, pairs[j].0], [pairs[i].1, pairs[j].1]) else { continue };
        if (map.scale() - 1.0).abs() > 0.3 {
            continue;
        }
        let found = spread(&map);
        if found > best.0 {
            best = (found, map);
        }
    }
    let known = [Similarity::IDENTITY, guess].map(|map| (spread(&map), map));
    let known = if known[0].0 >= known[1].0 { known[0] } else { known[1] };
    let start = if known.0 >= LEAST_CELLS && known.0 as f64 >= STAYS * best.0 as f64 { known.1 } else { best.1 };
    let map = start.refined(&pairs, 2.0 * AGREES)?;
    let agreeing: Vec<[f64; 2]> =
        pairs.iter().filter(|(from, to)| map.distance(from, to) < AGREES).map(|pair| pair.0).collect();
    let sides = [key.pyramid[0].width, key.pyramid[0].height].map(|side| side as f64);
    let all_over = (0..2).all(|axis| {
        let mut places: Vec<f64> = agreeing.iter().map(|place| place[axis]).collect();
        let range = quantile(&mut places, 0.95).unwrap_or(0.0) - quantile(&mut places, 0.05).unwrap_or(0.0);
        range > SPREAD * sides[axis]
    });
    let border = BORDER * sides[0].min(sides[1]);
    let at_border = |place: &&[f64; 2]| (0..2).any(|axis| !(border..sides[axis] - border).contains(&place[axis]));
    let all_over = all_over && agreeing.iter().filter(at_border).count() >= AT_BORDER;
    // What stays where it was is no object that moves.
    let stays = map.displacement(key.pyramid[0].width, key.pyramid[0].height) < AGREES;
    Some(BackgroundMotion {
        map,
        followed: count,
        agreeing: agreeing.len(),
        cells: spread(&map),
        spread: all_over || stays,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{MovingEllipse, SyntheticScene};
    use crate::video::Clip;

    fn survey(scene: &SyntheticScene) -> Vec<Coarse> {
        let clip = Clip::new(scene.render()).unwrap();
        Survey::read(&clip, 0..scene.frames(), 1, &[]).unwrap().coarse
    }

    fn furthest(coarse: &[Coarse], camera: impl Fn(usize) -> [f64; 2]) -> f64 {
        let error = |c: &Coarse| {
            let pose = c.pose.unwrap_or_else(|| panic!("frame {} was not registered", c.frame));
            let (now, first) = (camera(c.frame), camera(0));
            let [x, y] = pose.apply([160.0, 120.0]);
            (x - 160.0 + now[0] - first[0]).hypot(y - 120.0 + now[1] - first[1])
        };
        coarse.iter().map(error).fold(0.0, f64::max)
    }

    #[test]
    fn a_large_object_before_a_standing_camera_leaves_the_background_where_it_is() {
        let positions = (0..40).map(|f| [60.0 + 5.0 * f64::from(f), 120.0]).collect();
        // 100 pixels wide and high: two thirds of the frame's height.
        let scene =
            SyntheticScene::of(MovingEllipse { axes: [80.0, 90.0], texture: 60.0, ..MovingEllipse::at(positions) });
        let furthest = furthest(&survey(&scene), |_| [0.0; 2]);
        assert!(furthest < 0.15, "{furthest}");
    }

    #[test]
    fn a_pan_is_followed_over_more_than_a_frame() {
        let camera = |frame: usize| [-9.0 * frame as f64, 25.0 * (frame as f64 * 0.2).sin()];
        let positions = (0..60).map(|f| [150.0 + 9.0 * f as f64, 120.0]).collect();
        let scene = SyntheticScene {
            camera: (0..60).map(|f| [camera(f)[0], camera(f)[1], 0.0]).collect(),
            ..SyntheticScene::of(MovingEllipse::at(positions))
        };
        // Seven key frames, each registered to a few hundredths of a pixel.
        let furthest = furthest(&survey(&scene), camera);
        assert!(furthest < 0.5, "{furthest}");
    }
}

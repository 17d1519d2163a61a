//! Objects that move by less than their own size: their middle covers the background in every frame, and is in the median.
//!
//! Around such a middle lie pixels with two states, and from the middle outwards the median turns from the object's state into
//! the background's. Where the middle is background itself, the median turns twice or not at all. What is covered is filled
//! from its surroundings: its true levels are seen rarely or never, and not needed within the object.

use ndarray::Array3;

use crate::resting::neighbours;

/// Fewest pixels of a part with two states.
const LEAST_AREA: usize = 10;
/// Size of the smaller of two parts of one object, relative to the larger.
const COMPARABLE: f64 = 0.1;
/// Most parts that are looked at, the largest first.
const MOST_PARTS: usize = 60;
/// Distance of the states of two parts of one object, levels: light and texture.
const SAME_STATES: f32 = 45.0;
/// Share of the outermost pixels that may have the object's state: sides along which it moves.
const OPEN: f64 = 0.3;
/// Least difference of the two states, levels: less are marks and edges that tremble.
const LEAST_CONTRAST: f32 = 30.0;
/// Least side of an object relative to its longest: longer things are edges.
const LEAST_ASPECT: f64 = 0.25;
/// Least pixels with two states, relative to those with what they enclose.
const LEAST_MOVING: f64 = 0.15;
/// Least pixels of an object that is in the median, relative to those with two states.
const LEAST_HELD: f64 = 0.2;

/// A connected part of the pixels with two states.
struct TwoStatePart {
    pixels: Vec<usize>,
    /// First and last column and row.
    first: [usize; 2],
    last: [usize; 2],
    /// Mean of each state; which is the object's is not known.
    states: [[f32; 3]; 2],
}

/// Levels of the background and the other state of each pixel, NaN where there is none, both `[height, width, 3]`.
struct PixelStates<'a> {
    levels: &'a Array3<f32>,
    other: &'a Array3<f32>,
}

/// Pixels that an object covers in most frames, by the levels and other states of [`super::resting`]. Row by row.
pub(crate) fn covered(levels: &Array3<f32>, other: &Array3<f32>) -> Vec<usize> {
    let states = PixelStates { levels, other };
    let mut found: Vec<usize> =
        groups(states.parts()).iter().filter_map(|group| states.covered_within(group)).flatten().collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Fills pixels from their surroundings inwards, each with the mean of its neighbours that are known.
pub(crate) fn fill(levels: &mut Array3<f32>, pixels: &[usize]) {
    let (height, width, _) = levels.dim();
    let mut unknown = vec![false; width * height];
    pixels.iter().for_each(|&place| unknown[place] = true);
    let mut left = pixels.to_vec();
    while !left.is_empty() {
        let mut filled = Vec::new();
        for &place in &left {
            let known: Vec<usize> = around(place, width, height).filter(|&beside| !unknown[beside]).collect();
            if !known.is_empty() {
                let mean = |c: usize| {
                    known.iter().map(|p| levels[[p / width, p % width, c]]).sum::<f32>() / known.len() as f32
                };
                filled.push((place, [0, 1, 2].map(mean)));
            }
        }
        if filled.is_empty() {
            return;
        }
        for &(place, level) in &filled {
            unknown[place] = false;
            (0..3).for_each(|c| levels[[place / width, place % width, c]] = level[c]);
        }
        left.retain(|&place| unknown[place]);
    }
}

impl PixelStates<'_> {
    fn size(&self) -> [usize; 2] {
        [self.levels.dim().1, self.levels.dim().0]
    }

    fn level(&self, place: usize) -> [f32; 3] {
        let width = self.size()[0];
        [0, 1, 2].map(|c| self.levels[[place / width, place % width, c]])
    }

    fn other(&self, place: usize) -> Option<[f32; 3]> {
        let width = self.size()[0];
        let state = [0, 1, 2].map(|c| self.other[[place / width, place % width, c]]);
        (!state[0].is_nan()).then_some(state)
    }

    /// The largest parts of the pixels with two states.
    fn parts(&self) -> Vec<TwoStatePart> {
        let [width, height] = self.size();
        let two: Vec<usize> = (0..width * height).filter(|&place| self.other(place).is_some()).collect();
        let found = connected(&two, width, height, around).into_iter().filter(|part| part.len() >= LEAST_AREA);
        let mut parts: Vec<TwoStatePart> = found.map(|pixels| self.part(pixels)).collect();
        parts.sort_by_key(|part| std::cmp::Reverse(part.pixels.len()));
        parts.truncate(MOST_PARTS);
        parts
    }

    fn part(&self, pixels: Vec<usize>) -> TwoStatePart {
        let (first, last) = extent(&pixels, self.size()[0]);
        let pair = |place: usize| [self.level(place), self.other(place).unwrap_or_default()];
        let reference = pair(pixels[0]);
        let mut totals = [[0.0_f32; 3]; 2];
        for &place in &pixels {
            let states = pair(place);
            let turned = distance(states[1], reference[0]) < distance(states[0], reference[0]);
            for (total, state) in totals.iter_mut().zip([0, 1].map(|k| states[k ^ usize::from(turned)])) {
                (0..3).for_each(|c| total[c] += state[c]);
            }
        }
        let states = totals.map(|total| total.map(|sum| sum / pixels.len() as f32));
        TwoStatePart { pixels, first, last, states }
    }

    /// What an object covers of a group of parts and between them; `None` where the median shows no object.
    fn covered_within(&self, group: &[TwoStatePart]) -> Option<Vec<usize>> {
        let [width, height] = self.size();
        let states = group[0].states;
        if distance(states[0], states[1]) < LEAST_CONTRAST {
            return None;
        }
        let two: Vec<usize> = group.iter().flat_map(|part| part.pixels.iter().copied()).collect();
        let within: Vec<usize> = two.iter().copied().chain(enclosed(&two, width, height)).collect();
        if (two.len() as f64) < LEAST_MOVING * within.len() as f64 {
            return None;
        }
        let mut is_within = vec![false; width * height];
        within.iter().for_each(|&place| is_within[place] = true);
        let has_first = |place: usize| distance(self.level(place), states[0]) < distance(self.level(place), states[1]);
        let is_outermost = |place: &usize| neighbours(*place, width, height).any(|it| !is_within[it]);
        let outermost: Vec<usize> = two.iter().copied().filter(is_outermost).collect();
        let outer = outermost.iter().filter(|&&place| has_first(place)).count() as f64 / outermost.len().max(1) as f64;
        if outer.min(1.0 - outer) > OPEN {
            return None;
        }
        let is_surroundings = outer > 0.5;
        let held: Vec<usize> = within.into_iter().filter(|&place| has_first(place) != is_surroundings).collect();
        let bodies = connected(&held, width, height, neighbours);
        let largest = bodies.iter().max_by_key(|body| body.len())?;
        if (largest.len() as f64) < LEAST_HELD * two.len() as f64 || aspect(largest, width) < LEAST_ASPECT {
            return None;
        }
        let bodies = bodies.iter().filter(|body| body.len() >= LEAST_AREA);
        // With their edges, in which both states mix.
        let widened = bodies.flatten().flat_map(|&place| around(place, width, height).chain([place]));
        Some(widened.filter(|&place| is_within[place]).collect())
    }
}

/// Parts of one object: near each other, with the same two states.
fn groups(parts: Vec<TwoStatePart>) -> Vec<Vec<TwoStatePart>> {
    let mut groups: Vec<Vec<TwoStatePart>> = Vec::new();
    for part in parts {
        let (joined, apart) =
            groups.into_iter().partition(|group: &Vec<TwoStatePart>| group.iter().any(|it| of_one(it, &part)));
        groups = apart;
        groups.push(joined.into_iter().flatten().chain([part]).collect());
    }
    groups
}

fn of_one(a: &TwoStatePart, b: &TwoStatePart) -> bool {
    let length = |part: &TwoStatePart| (0..2).map(|axis| part.last[axis] - part.first[axis] + 1).max().unwrap_or(0);
    let reach = length(a).max(length(b));
    let near = (0..2).all(|axis| a.first[axis] <= b.last[axis] + reach && b.first[axis] <= a.last[axis] + reach);
    let apart = |k: usize| (0..2).map(|i| distance(a.states[i], b.states[i ^ k])).fold(0.0, f32::max);
    let sizes = [a.pixels.len(), b.pixels.len()].map(|size| size as f64);
    let comparable = sizes[0].min(sizes[1]) >= COMPARABLE * sizes[0].max(sizes[1]);
    near && comparable && apart(0).min(apart(1)) < SAME_STATES
}

/// First and last column and row of some pixels.
fn extent(pixels: &[usize], width: usize) -> ([usize; 2], [usize; 2]) {
    let (mut first, mut last) = ([usize::MAX; 2], [0; 2]);
    for place in pixels {
        for (axis, value) in [place % width, place / width].into_iter().enumerate() {
            (first[axis], last[axis]) = (first[axis].min(value), last[axis].max(value));
        }
    }
    (first, last)
}

/// Shorter side of some pixels over the longer one.
fn aspect(pixels: &[usize], width: usize) -> f64 {
    let (first, last) = extent(pixels, width);
    let sides = [0, 1].map(|axis| (last[axis] - first[axis] + 1) as f64);
    sides[0].min(sides[1]) / sides[0].max(sides[1])
}

/// Pixels without two states that lie between pixels with two in their row or column.
fn enclosed(two: &[usize], width: usize, height: usize) -> Vec<usize> {
    let mut rows = vec![(usize::MAX, 0); height];
    let mut columns = vec![(usize::MAX, 0); width];
    let mut is_two = vec![false; width * height];
    for &place in two {
        let (x, y) = (place % width, place / width);
        is_two[place] = true;
        rows[y] = (rows[y].0.min(x), rows[y].1.max(x));
        columns[x] = (columns[x].0.min(y), columns[x].1.max(y));
    }
    let between = |range: (usize, usize), value: usize| range.0 < value && value < range.1;
    (0..width * height)
        .filter(|&place| !is_two[place])
        .filter(|&place| between(rows[place / width], place % width) || between(columns[place % width], place / width))
        .collect()
}

/// The connected parts of some pixels, by the pixels that count as `beside` one.
fn connected<I: Iterator<Item = usize>>(
    pixels: &[usize],
    width: usize,
    height: usize,
    beside: impl Fn(usize, usize, usize) -> I,
) -> Vec<Vec<usize>> {
    let mut left = vec![false; width * height];
    pixels.iter().for_each(|&place| left[place] = true);
    let part = |&seed: &usize| {
        let mut part = Vec::new();
        if std::mem::take(&mut left[seed]) {
            part.push(seed);
        }
        let mut next = 0;
        while next < part.len() {
            part.extend(beside(part[next], width, height).filter(|&it| std::mem::take(&mut left[it])));
            next += 1;
        }
        part
    };
    pixels.iter().map(part).filter(|part| !part.is_empty()).collect()
}

/// Largest difference of two colours.
pub(crate) fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
}

/// The eight neighbours of a pixel within the frame.
fn around(place: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (place % width, place / width);
    let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
    rows.flat_map(move |row| (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |column| row * width + column))
        .filter(move |&it| it != place)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJECT: f32 = 200.0;
    const SCENE: f32 = 80.0;

    /// Levels and other states of an object of 10 pixels that moves by 4 to either side of the middle of a frame of 30 x 20.
    fn swing(middle: f32) -> (Array3<f32>, Array3<f32>) {
        let state = |x: usize, y: usize| match (x, y) {
            (_, y) if !(2..18).contains(&y) => (SCENE, f32::NAN),
            (6..10 | 20..24, _) => (SCENE, OBJECT),
            (10..14 | 16..20, _) => (OBJECT, SCENE),
            (14..16, _) => (middle, f32::NAN),
            _ => (SCENE, f32::NAN),
        };
        let array = |of: fn((f32, f32)) -> f32| Array3::from_shape_fn((20, 30, 3), |(y, x, _)| of(state(x, y)));
        (array(|it| it.0), array(|it| it.1))
    }

    #[test]
    fn what_an_object_covers_is_found_and_filled() {
        let (mut levels, other) = swing(OBJECT);
        let places = covered(&levels, &other);
        let expected: Vec<usize> = (2..18).flat_map(|y| (9..21).map(move |x| y * 30 + x)).collect();
        assert_eq!(places, expected);
        fill(&mut levels, &places);
        assert!(levels.iter().all(|&level| level == SCENE));
    }

    /// Two objects, each beside its own part of the background.
    #[test]
    fn background_between_two_movers_is_not_covered() {
        let (levels, other) = swing(SCENE);
        let swapped = |x: usize| (10..14).contains(&x) || (16..20).contains(&x);
        let state = |of: &Array3<f32>, rest: &Array3<f32>| {
            Array3::from_shape_fn((20, 30, 3), |(y, x, c)| {
                if swapped(x) && (2..18).contains(&y) { rest[[y, x, c]] } else { of[[y, x, c]] }
            })
        };
        assert_eq!(covered(&state(&levels, &other), &state(&other, &levels)), [] as [usize; 0]);
    }
}

//! Thick parts of a moving region: a bob without its string, two balls joined by a line.

use crate::components::Blob;
use crate::mask::Mask;

/// Share of the largest inscribed radius below which a part is thin.
const THIN: f32 = 0.45;
/// Smallest inscribed radius, pixels, of a region that is divided.
const LEAST_RADIUS: f32 = 3.0;
/// Share of the area from which on a single thick part stands for the whole region.
const MOST_OF_IT: f64 = 0.85;
/// Share of the region's area that a part needs.
const LEAST_SHARE: f64 = 0.08;

/// Pixels of a bounding box with a margin of one.
struct PixelGrid {
    width: usize,
    origin: [usize; 2],
    inside: Vec<bool>,
}

impl PixelGrid {
    fn new(blob: &Blob) -> Self {
        let [left, top, right, bottom] = blob.bounds;
        let (width, height) = (right - left + 3, bottom - top + 3);
        let mut inside = vec![false; width * height];
        for &(y, first, end) in blob.mask.runs() {
            let start = (y as usize - top + 1) * width + first as usize - left + 1;
            inside[start..start + (end - first) as usize].fill(true);
        }
        Self { width, origin: [left, top], inside }
    }

    /// Distance of every pixel from the nearest one of `sources`, by the 3-4 chamfer, pixels; also that source's label.
    fn distances(&self, sources: &[u32]) -> (Vec<f32>, Vec<u32>) {
        let mut labels = sources.to_vec();
        let mut distances: Vec<f32> = labels.iter().map(|&l| if l > 0 { 0.0 } else { f32::MAX }).collect();
        let width = self.width as isize;
        let before = [(-1, 1.0), (-width - 1, 4.0 / 3.0), (-width, 1.0), (-width + 1, 4.0 / 3.0)];
        let count = distances.len() as isize;
        let mut relax = |place: isize, step: isize, length: f32| {
            let other = place + step;
            if (0..count).contains(&other) && distances[other as usize] + length < distances[place as usize] {
                distances[place as usize] = distances[other as usize] + length;
                labels[place as usize] = labels[other as usize];
            }
        };
        for place in 0..count {
            before.iter().for_each(|&(step, length)| relax(place, step, length));
        }
        for place in (0..count).rev() {
            before.iter().for_each(|&(step, length)| relax(place, -step, length));
        }
        (distances, labels)
    }

    /// Labels of the 4-connected components, from 1; 0 outside.
    fn label(&self, inside: &[bool]) -> Vec<u32> {
        let mut labels = vec![0; inside.len()];
        let mut next = 0;
        let mut stack = Vec::new();
        for seed in 0..inside.len() {
            if !inside[seed] || labels[seed] > 0 {
                continue;
            }
            next += 1;
            labels[seed] = next;
            stack.push(seed);
            while let Some(place) = stack.pop() {
                for other in [place - 1, place + 1, place - self.width, place + self.width] {
                    if inside[other] && labels[other] == 0 {
                        labels[other] = next;
                        stack.push(other);
                    }
                }
            }
        }
        labels
    }
}

/// Masks of the thick parts of a region, or the region's own where it is thick throughout.
pub(crate) fn thick_parts(blob: &Blob) -> Vec<Mask> {
    let whole = || vec![blob.mask.clone()];
    let grid = PixelGrid::new(blob);
    let outside: Vec<u32> = grid.inside.iter().map(|&inside| u32::from(!inside)).collect();
    let (depth, _) = grid.distances(&outside);
    let radius = depth.iter().fold(0.0_f32, |m, &d| m.max(d));
    if radius < LEAST_RADIUS {
        return whole();
    }
    let limit = THIN * radius;
    let cores: Vec<bool> = depth.iter().map(|&d| d > limit).collect();
    let cores = grid.label(&cores);
    let (distance, nearest) = grid.distances(&cores);
    let parts = cores.iter().max().map_or(0, |&m| m as usize);
    let mut runs: Vec<Vec<(u32, u32, u32)>> = vec![Vec::new(); parts];
    let mut areas = vec![0_usize; parts];
    for place in 0..grid.inside.len() {
        if grid.inside[place] && distance[place] <= limit + 1.0 {
            let part = nearest[place] as usize - 1;
            let x = (place % grid.width + grid.origin[0] - 1) as u32;
            let y = (place / grid.width + grid.origin[1] - 1) as u32;
            areas[part] += 1;
            match runs[part].last_mut() {
                Some(run) if run.0 == y && run.2 == x => run.2 = x + 1,
                _ => runs[part].push((y, x, x + 1)),
            }
        }
    }
    let large = |area: usize| area as f64 > LEAST_SHARE * blob.area as f64;
    if parts == 1 && areas[0] as f64 > MOST_OF_IT * blob.area as f64 {
        return whole();
    }
    runs.into_iter().zip(areas).filter(|&(_, area)| large(area)).map(|(runs, _)| Mask::from_runs(runs)).collect()
}

#[cfg(test)]
mod tests {
    use crate::components::components;

    fn image(inside: impl Fn(i32, i32) -> bool) -> Vec<f32> {
        (0..60 * 80).map(|i| if inside(i % 80, i / 80) { 1.0 } else { 0.0 }).collect()
    }

    fn disc(x: i32, y: i32, cx: i32, cy: i32, radius: i32) -> bool {
        (x - cx).pow(2) + (y - cy).pow(2) <= radius * radius
    }

    #[test]
    fn a_bob_loses_its_string() {
        let pixels = image(|x, y| disc(x, y, 40, 45, 9) || ((39..42).contains(&x) && y < 40));
        let parts = components(&pixels, 80, 0.5, 5, 9);
        assert_eq!(parts.len(), 1);
        assert!(
            (parts[0].centre[0] - 40.0).abs() < 0.2 && (parts[0].centre[1] - 45.0).abs() < 0.7,
            "{:?}",
            parts[0].centre
        );
    }

    #[test]
    fn two_balls_on_a_line_are_two_parts() {
        let pixels = image(|x, y| disc(x, y, 15, 30, 7) || disc(x, y, 62, 30, 8) || (y == 30 && (15..62).contains(&x)));
        let parts = components(&pixels, 80, 0.5, 5, 9);
        assert_eq!(parts.len(), 2);
        assert!((parts[0].centre[0] - 62.0).abs() < 0.5 && (parts[1].centre[0] - 15.0).abs() < 0.5);
    }

    #[test]
    fn a_disc_and_a_bar_stay_whole() {
        for shape in
            [image(|x, y| disc(x, y, 40, 30, 12)), image(|x, y| (20..60).contains(&x) && (25..35).contains(&y))]
        {
            let blobs = components(&shape, 80, 0.5, 5, 9);
            assert_eq!(blobs.len(), 1);
            assert_eq!(blobs[0].area as f32, shape.iter().sum::<f32>());
        }
    }
}

//! Connected components of a thresholded difference image.

use crate::mask::Mask;
use crate::thick_parts::thick_parts;

/// Moving region of one frame.
#[derive(Debug, Clone)]
pub(crate) struct Blob {
    /// Sum of the differences.
    pub(crate) weight: f64,
    /// Weighted centroid `[x, y]`, pixels.
    pub(crate) centre: [f64; 2],
    /// Pixels.
    pub(crate) area: usize,
    /// Left, top, right and bottom pixel.
    pub(crate) bounds: [usize; 4],
    pub(crate) mask: Mask,
}

impl Blob {
    /// Whether the region reaches the border of the frame.
    pub(crate) fn touches_border(&self, width: usize, height: usize) -> bool {
        let [left, top, right, bottom] = self.bounds;
        left <= 1 || top <= 1 || right + 2 >= width || bottom + 2 >= height
    }

    /// Diameter of a disc of the same area, pixels.
    pub(crate) fn diameter(&self) -> f64 {
        (4.0 * self.area as f64 / std::f64::consts::PI).sqrt()
    }
}

/// Thick parts of the components of `image > threshold` (neighbours share an edge or a corner) of at least `least_area`
/// pixels: the `most` heaviest, in descending order of weight.
pub(crate) fn components(image: &[f32], width: usize, threshold: f32, least_area: usize, most: usize) -> Vec<Blob> {
    let mut runs: Vec<(u32, u32, u32)> = Vec::new();
    let mut parents: Vec<u32> = Vec::new();
    let (mut above_first, mut above_end) = (0, 0);
    for (y, row) in image.chunks_exact(width).enumerate() {
        let row_first = runs.len();
        let mut x = 0;
        let mut above = above_first;
        while let Some(start) = row[x..].iter().position(|&v| v > threshold).map(|skip| x + skip) {
            let end = row[start..].iter().position(|&v| v <= threshold).map_or(width, |length| start + length);
            let label = parents.len() as u32;
            parents.push(label);
            runs.push((y as u32, start as u32, end as u32));
            while above < above_end && runs[above].2 < start as u32 {
                above += 1;
            }
            let mut touching = above;
            while touching < above_end && runs[touching].1 <= end as u32 {
                unite(&mut parents, touching as u32, label);
                touching += 1;
            }
            x = end;
        }
        (above_first, above_end) = (row_first, runs.len());
    }
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); runs.len()];
    for run in 0..runs.len() as u32 {
        members[root(&mut parents, run) as usize].push(run);
    }
    let mut blobs: Vec<Blob> = members
        .iter()
        .filter(|m| !m.is_empty())
        .map(|m| blob(image, width, Mask::from_runs(m.iter().map(|&run| runs[run as usize]).collect())))
        .filter(|blob| blob.area >= least_area)
        .flat_map(|whole| {
            let parts = thick_parts(&whole);
            if parts.len() == 1 && parts[0] == whole.mask {
                vec![whole]
            } else {
                parts.into_iter().map(|part| blob(image, width, part)).collect()
            }
        })
        .collect();
    blobs.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    blobs.truncate(most);
    blobs
}

fn root(parents: &mut [u32], mut run: u32) -> u32 {
    while parents[run as usize] != run {
        parents[run as usize] = parents[parents[run as usize] as usize];
        run = parents[run as usize];
    }
    run
}

fn unite(parents: &mut [u32], one: u32, other: u32) {
    let (one, other) = (root(parents, one), root(parents, other));
    parents[one.max(other) as usize] = one.min(other);
}

fn blob(image: &[f32], width: usize, mask: Mask) -> Blob {
    let (mut weight, mut moment, mut area) = (0.0, [0.0; 2], 0);
    let mut bounds = [usize::MAX, usize::MAX, 0, 0];
    for &(y, first, end) in mask.runs() {
        let (y, first, end) = (y as usize, first as usize, end as usize);
        area += end - first;
        bounds = [bounds[0].min(first), bounds[1].min(y), bounds[2].max(end - 1), bounds[3].max(y)];
        for x in first..end {
            let value = image[y * width + x];
            weight += f64::from(value);
            moment[0] += f64::from(value) * x as f64;
            moment[1] += f64::from(value) * y as f64;
        }
    }
    Blob { weight, centre: [moment[0] / weight, moment[1] / weight], area, bounds, mask }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(rows: &[&str]) -> (Vec<f32>, usize) {
        (rows.iter().flat_map(|r| r.bytes().map(|b| f32::from(b - b'0'))).collect(), rows[0].len())
    }

    #[test]
    fn diagonal_neighbours_and_the_arms_of_a_u_are_one_component() {
        let (pixels, width) = image(&["1010000", "1010003", "1110030", "0000000"]);
        let blobs = components(&pixels, width, 0.5, 1, 9);
        assert_eq!(blobs.iter().map(|b| b.area).collect::<Vec<_>>(), [7, 2]);
        assert_eq!(blobs[0].bounds, [0, 0, 2, 2]);
        assert_eq!(blobs[1].centre, [5.5, 1.5]);
    }

    #[test]
    fn the_centroid_is_weighted_and_small_components_are_dropped() {
        let (pixels, width) = image(&["0000009", "0130000", "0000000"]);
        let blobs = components(&pixels, width, 0.5, 2, 9);
        assert_eq!(blobs.len(), 1);
        assert_eq!(blobs[0].centre, [1.75, 1.0]);
    }

    #[test]
    fn runs_at_the_right_border_do_not_join_the_next_row() {
        let (pixels, width) = image(&["0001", "1000"]);
        assert_eq!(components(&pixels, width, 0.5, 1, 9).len(), 2);
    }
}

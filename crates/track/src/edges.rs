//! Fine registration of frames on the edges of the background.

use nalgebra::{Matrix6, Vector6};

use crate::mosaic::Mosaic;
use crate::plane::cubic;
use crate::similarity::Similarity;
use crate::statistics::{NORMAL_MAD, median};
use crate::video::Size;

/// Cells of a grid along the longer side of a frame; each gives its strongest edges.
const CELLS: usize = 24;
const EDGES: usize = 8;
/// Least gradient of an edge, levels per pixel.
const LEAST_GRADIENT: f32 = 3.0;
/// Frames that must show an edge.
const LEAST_SHOWN: u8 = 2;
/// Fewest edges within a frame.
const LEAST_EDGES: usize = 40;
const BIWEIGHT: f64 = 4.685;
/// Distance of levels from which on edges do not fit at all.
const FAR: f64 = 30.0;
const ROUNDS: usize = 12;
/// Change of the corners of a frame, pixels, at which a registration has converged.
const CONVERGED: f64 = 0.002;

/// Edge: place, grey level and gradient of the background.
struct Edge {
    at: [f64; 2],
    level: f64,
    gradient: [f64; 2],
}

/// Edges of the background against which frames are registered.
pub(crate) struct Edges {
    edges: Vec<Edge>,
}

/// Registration of a frame: the map from the background to the frame, and the share of the edges that agree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Registered {
    pub(crate) map: Similarity,
    pub(crate) agreeing: f64,
}

impl Edges {
    /// Strongest edges of each part of a mosaic of frames of a size.
    pub(crate) fn find(mosaic: &Mosaic, frame: Size) -> Self {
        let Size { width, height } = mosaic.size;
        let cell = (frame.width.max(frame.height) / CELLS).max(8);
        let level = |x: usize, y: usize| {
            let pixel = &mosaic.levels[(y * width + x) * 3..][..3];
            0.25 * (pixel[0] + 2.0 * pixel[1] + pixel[2])
        };
        let shown = |x: usize, y: usize| mosaic.covered[y * width + x] >= LEAST_SHOWN;
        let mut edges = Vec::new();
        for top in (2..height.saturating_sub(2)).step_by(cell) {
            for left in (2..width.saturating_sub(2)).step_by(cell) {
                let mut found = Vec::new();
                for y in top..(top + cell).min(height - 2) {
                    for x in left..(left + cell).min(width - 2) {
                        if !shown(x - 2, y - 2) || !shown(x + 2, y - 2) || !shown(x - 2, y + 2) || !shown(x + 2, y + 2)
                        {
                            continue;
                        }
                        let gradient =
                            [0.5 * (level(x + 1, y) - level(x - 1, y)), 0.5 * (level(x, y + 1) - level(x, y - 1))];
                        let size = gradient[0].hypot(gradient[1]);
                        if size > LEAST_GRADIENT {
                            found.push((size, [x, y], gradient));
                        }
                    }
                }
                found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
                edges.extend(found.into_iter().take(EDGES).map(|(_, at, gradient)| Edge {
                    at: at.map(|place| place as f64),
                    level: f64::from(level(at[0], at[1])),
                    gradient: gradient.map(f64::from),
                }));
            }
        }
        Self { edges }
    }

    /// Mean distance of the edges' levels in a frame from those of the background, less their median: how badly a map fits.
    /// Large distances count alike. `None` where too few edges lie within the frame.
    pub(crate) fn misfit(&self, frame: &[u8], size: Size, map: &Similarity) -> Option<f64> {
        let (width, height) = (size.width as f64, size.height as f64);
        let mut residuals: Vec<f64> = self
            .edges
            .iter()
            .map(|edge| (edge, map.apply(edge.at)))
            .filter(|(_, [x, y])| (2.0..width - 3.0).contains(x) && (2.0..height - 3.0).contains(y))
            .map(|(edge, at)| sample(frame, size, at) - edge.level)
            .collect();
        if residuals.len() < LEAST_EDGES {
            return None;
        }
        let offset = median(&mut residuals)?;
        Some(residuals.iter().map(|r| (r - offset).abs().min(FAR)).sum::<f64>() / residuals.len() as f64)
    }

    /// Registers a frame, `[height, width, 3]`, by robust Gauss-Newton on a similarity, a gain and an offset. `start` maps
    /// from the background to the frame. `None` where too few edges lie within the frame or the steps do not converge.
    pub(crate) fn register(&self, frame: &[u8], size: Size, start: Similarity) -> Option<Registered> {
        let (width, height) = (size.width as f64, size.height as f64);
        let (reach, middle) = (0.5 * width.hypot(height), start.inverse().apply([0.5 * width, 0.5 * height]));
        let (mut map, mut light) = (start, [1.0, 0.0]);
        let mut agreeing = 0.0;
        for round in 0..ROUNDS {
            let inside = |edge: &&Edge| {
                let [x, y] = map.apply(edge.at);
                (2.0..width - 3.0).contains(&x) && (2.0..height - 3.0).contains(&y)
            };
            let used: Vec<&Edge> = self.edges.iter().filter(inside).collect();
            if used.len() < LEAST_EDGES {
                return None;
            }
            let residuals: Vec<f64> = used
                .iter()
                .map(|edge| sample(frame, size, map.apply(edge.at)) - light[0] * edge.level - light[1])
                .collect();
            let scale = median(&mut residuals.iter().map(|r| r.abs()).collect::<Vec<_>>())? * NORMAL_MAD;
            let limit = BIWEIGHT * scale.max(1.5);
            let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
            let mut near = 0;
            for (residual, edge) in residuals.iter().zip(&used) {
                let z = residual / limit;
                if z.abs() < 1.0 {
                    let weight = (1.0 - z * z).powi(2);
                    let [p, q] = [(edge.at[0] - middle[0]) / reach, (edge.at[1] - middle[1]) / reach];
                    // The frame's gradient is the background's, turned and scaled as the frame is.
                    let square = map.a * map.a + map.b * map.b;
                    let [g, h] = edge.gradient;
                    let slope = [(map.a * g - map.b * h) / square, (map.b * g + map.a * h) / square];
                    let slope = slope.map(|s| s * light[0]);
                    let row = Vector6::new(
                        slope[0] * p + slope[1] * q,
                        slope[1] * p - slope[0] * q,
                        slope[0],
                        slope[1],
                        -edge.level / 64.0,
                        -1.0,
                    );
                    normal += weight * row * row.transpose();
                    right -= weight * *residual * row;
                    near += 1;
                }
            }
            agreeing = f64::from(near) / used.len() as f64;
            // Keeps what the edges do not determine where it is.
            for (k, prior) in [1.0, 1.0, 1e-3, 1e-3, 10.0, 1e-3].into_iter().enumerate() {
                normal[(k, k)] += prior;
            }
            let step = normal.cholesky()?.solve(&right);
            let most = [0, 1, 2, 3].map(|k| step[k]).into_iter().fold(0.0_f64, |m, s| m.max(s.abs()));
            let damping = (2.0 / most.max(1e-12)).min(1.0);
            let [da, db] = [damping * step[0] / reach, damping * step[1] / reach];
            map.u += damping * step[2] - da * middle[0] + db * middle[1];
            map.v += damping * step[3] - db * middle[0] - da * middle[1];
            map.a += da;
            map.b += db;
            light = [light[0] + step[4] / 64.0, light[1] + step[5]];
            if most < CONVERGED && round > 1 {
                return Some(Registered { map, agreeing });
            }
        }
        // Steps that still shrink at the last round are within hundredths.
        Some(Registered { map, agreeing })
    }
}

/// Grey level of a frame at a place at least a pixel within it, by cubic convolution.
fn sample(frame: &[u8], size: Size, [x, y]: [f64; 2]) -> f64 {
    let (left, top) = (x.floor(), y.floor());
    let (across, down) = (cubic((x - left) as f32), cubic((y - top) as f32));
    let first = ((top as usize - 1) * size.width + left as usize - 1) * 3;
    let mut sum = 0.0;
    for (row, weight) in down.iter().enumerate() {
        let line = &frame[first + row * size.width * 3..][..12];
        for (pixel, share) in line.chunks_exact(3).zip(&across) {
            let grey = u32::from(pixel[0]) + 2 * u32::from(pixel[1]) + u32::from(pixel[2]);
            sum += weight * share * grey as f32;
        }
    }
    f64::from(0.25 * sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(x: f64, y: f64) -> f64 {
        120.0 + 50.0 * (x * 0.31).sin() * (y * 0.23).cos() + 30.0 * (x * 0.11 + y * 0.17).sin()
    }

    #[test]
    fn a_turned_darker_frame_is_registered_behind_an_object() {
        let size = Size { width: 160, height: 120 };
        let levels = (0..160 * 120 * 3).map(|i| level((i / 3 % 160) as f64, (i / 480) as f64) as f32).collect();
        let mosaic = Mosaic::new(size, levels, vec![9; 160 * 120]);
        let map = Similarity { a: 1.01, b: 0.01, u: 2.3, v: -1.6 };
        let back = map.inverse();
        let frame: Vec<u8> = (0..160 * 120 * 3)
            .map(|i| {
                let (x, y) = (i / 3 % 160, i / 480);
                let hidden = (40..80).contains(&x) && (30..90).contains(&y);
                let [u, v] = back.apply([x as f64, y as f64]);
                if hidden { 255 } else { (0.9 * level(u, v) + 4.0).round() as u8 }
            })
            .collect();
        let start = Similarity { u: 3.0, v: -1.0, ..Similarity::IDENTITY };
        let found = Edges::find(&mosaic, size).register(&frame, size, start).unwrap();
        assert!(found.agreeing > 0.7, "{found:?}");
        for corner in [[0.0, 0.0], [159.0, 119.0], [159.0, 0.0]] {
            // Rounding of some hundred levels, and cubic sampling of waves of 20 pixels.
            assert!(found.map.distance(&corner, &map.apply(corner)) < 0.02, "{found:?}");
        }
    }
}

//! Similarities of the plane: rotation, scale and translation.

use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};

use crate::statistics::{NORMAL_MAD, median};

/// Distance, in standard deviations, from which on a pair does not count. Less than usual: a third of the pairs may be wrong.
const REACH: f64 = 3.0;

/// Map `[x, y]` to `[a x - b y + u, b x + a y + v]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    pub a: f64,
    pub b: f64,
    pub u: f64,
    pub v: f64,
}

impl Similarity {
    pub const IDENTITY: Self = Self { a: 1.0, b: 0.0, u: 0.0, v: 0.0 };

    /// Translation by `[x, y]`.
    pub fn translation([u, v]: [f64; 2]) -> Self {
        Self { u, v, ..Self::IDENTITY }
    }

    /// Image of a point.
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.a * x - self.b * y + self.u, self.b * x + self.a * y + self.v]
    }

    /// This map after another.
    pub fn after(&self, first: &Self) -> Self {
        let [u, v] = self.apply([first.u, first.v]);
        Self { a: self.a * first.a - self.b * first.b, b: self.b * first.a + self.a * first.b, u, v }
    }

    /// Inverse map. The scale must not be zero.
    pub fn inverse(&self) -> Self {
        let square = self.a * self.a + self.b * self.b;
        let (a, b) = (self.a / square, -self.b / square);
        Self { a, b, u: b * self.v - a * self.u, v: -b * self.u - a * self.v }
    }

    /// Factor on lengths.
    pub fn scale(&self) -> f64 {
        self.a.hypot(self.b)
    }

    /// Angle of rotation, radians; positive from x to y.
    pub fn angle(&self) -> f64 {
        self.b.atan2(self.a)
    }

    /// The same map in pixels that are `factor` times as small; pixel centres are integers on both grids.
    pub(crate) fn enlarged(&self, factor: usize) -> Self {
        // A coarse pixel's centre lies at `factor * c + (factor - 1) / 2` of the fine grid.
        let (factor, middle) = (factor as f64, 0.5 * (factor as f64 - 1.0));
        let fine = Self { a: factor, b: 0.0, u: middle, v: middle };
        fine.after(self).after(&fine.inverse())
    }

    /// Largest distance by which the corners of a frame move, pixels.
    pub fn displacement(&self, width: usize, height: usize) -> f64 {
        let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
        [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]]
            .into_iter()
            .map(|corner| {
                let [x, y] = self.apply(corner);
                (x - corner[0]).hypot(y - corner[1])
            })
            .fold(0.0, f64::max)
    }

    /// Map that takes two points to two others; `None` where the first two coincide.
    pub(crate) fn of_pairs([p, q]: [[f64; 2]; 2], [s, t]: [[f64; 2]; 2]) -> Option<Self> {
        let (d, e) = ([q[0] - p[0], q[1] - p[1]], [t[0] - s[0], t[1] - s[1]]);
        let square = d[0] * d[0] + d[1] * d[1];
        (square > 0.0).then(|| {
            let a = (d[0] * e[0] + d[1] * e[1]) / square;
            let b = (d[0] * e[1] - d[1] * e[0]) / square;
            Self { a, b, u: s[0] - a * p[0] + b * p[1], v: s[1] - b * p[0] - a * p[1] }
        })
    }

    /// Refines the map on pairs `(from, to)` by reweighted least squares (biweight), starting with the pairs within `limit`.
    /// `None` where fewer than three pairs remain.
    pub(crate) fn refined(&self, pairs: &[([f64; 2], [f64; 2])], limit: f64) -> Option<Self> {
        let mut map = *self;
        let mut limit = limit;
        for _ in 0..10 {
            let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
            let mut count = 0;
            for (from, to) in pairs {
                let distance = map.distance(from, to);
                if distance < limit {
                    let weight = (1.0 - (distance / limit).powi(2)).powi(2);
                    let rows = [
                        (Vector4::new(from[0], -from[1], 1.0, 0.0), to[0]),
                        (Vector4::new(from[1], from[0], 0.0, 1.0), to[1]),
                    ];
                    for (row, value) in rows {
                        normal += weight * row * row.transpose();
                        right += weight * value * row;
                    }
                    count += 1;
                }
            }
            if count < 3 {
                return None;
            }
            let solution = normal.lu().solve(&right)?;
            map = Self { a: solution[0], b: solution[1], u: solution[2], v: solution[3] };
            let mut near: Vec<f64> =
                pairs.iter().map(|(from, to)| map.distance(from, to)).filter(|&d| d < limit).collect();
            let scale = median(&mut near)? * NORMAL_MAD;
            limit = (REACH * scale).clamp(0.1, limit);
        }
        Some(map)
    }

    /// Distance between the image of a point and another point.
    pub(crate) fn distance(&self, from: &[f64; 2], to: &[f64; 2]) -> f64 {
        let [x, y] = self.apply(*from);
        (x - to[0]).hypot(y - to[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: Similarity = Similarity { a: 1.1, b: 0.3, u: -5.0, v: 2.0 };

    #[test]
    fn inverse_composition_and_pairs_agree() {
        let there_and_back = MAP.inverse().after(&MAP);
        let [x, y] = there_and_back.apply([30.0, -7.0]);
        assert!((x - 30.0).abs() < 1e-12 && (y + 7.0).abs() < 1e-12);
        let (p, q) = ([1.0, 2.0], [40.0, -3.0]);
        let found = Similarity::of_pairs([p, q], [MAP.apply(p), MAP.apply(q)]).unwrap();
        assert!(MAP.distance(&[9.0, 9.0], &found.apply([9.0, 9.0])) < 1e-12);
    }

    #[test]
    fn a_map_between_coarse_pixels_moves_fine_ones_alike() {
        // The fine pixel 10 of a grid three times as fine is the centre of the coarse pixel 3.
        let [x, y] = MAP.enlarged(3).apply([10.0, 10.0]);
        let [u, v] = MAP.apply([3.0, 3.0]);
        assert!((x - (3.0 * u + 1.0)).abs() < 1e-12 && (y - (3.0 * v + 1.0)).abs() < 1e-12);
    }

    #[test]
    fn a_third_of_wrong_pairs_does_not_count() {
        let pairs: Vec<_> = (0..60)
            .map(|i| {
                let from = [f64::from(i * 37 % 101), f64::from(i * 53 % 89)];
                let [x, y] = MAP.apply(from);
                (from, if i % 3 == 0 { [x + 1.5, y - 0.7] } else { [x, y] })
            })
            .collect();
        let near = Similarity { u: MAP.u + 0.3, ..MAP };
        let found = near.refined(&pairs, 2.5).unwrap();
        assert!(MAP.distance(&[50.0, 50.0], &found.apply([50.0, 50.0])) < 1e-6, "{found:?}");
    }
}

//! Winograd's minimal filtering: the transforms of convolutions 3x3 and of the gradients of their weights.
//!
//! Along an axis four results take six products, `A^T [(G w) * (B^T d)]`, where plain sums take twelve (Lavin and Gray 2016,
//! section 4, F(4, 3)): `d` are the six numbers that the results depend on, `w` the three taps of the kernel. The taps'
//! gradients take the same `B^T`, with four gradients of results in the place of the taps and three sums in that of the
//! results, F(3, 4). On both axes a tile of 4 x 4 pixels takes 36 products, where plain sums take 144. The points are 0, ±a,
//! ±1/a and infinity with `a = 1/√2`, which keep all constants between 1/6 and 3: the rounding is two to four times that of
//! plain sums.

use std::ops::Range;

use super::planes::Planes;
use super::simd::{Lanes, dispatched};

/// Pixels of a tile along an axis.
pub(super) const PIXELS: usize = 4;
/// Pixels that a tile depends on along an axis, and the points of its transform.
pub(super) const POINTS: usize = PIXELS + 2;
pub(super) const PRODUCTS: usize = POINTS * POINTS;

const A: f32 = std::f32::consts::FRAC_1_SQRT_2;
const B: f32 = std::f32::consts::SQRT_2;

/// `x + c y`.
///
/// # Safety
/// As of [`Lanes`].
#[inline(always)]
unsafe fn plus<L: Lanes>(x: L, c: f32, y: L) -> L {
    unsafe { x.add_product(L::splat(c), y) }
}

/// `G w` of three taps, each of some kernels.
#[inline(always)]
pub(super) fn of_taps<const N: usize>([w0, w1, w2]: [[f32; N]; 3]) -> [[f32; N]; POINTS] {
    let mut points = [[0.0; N]; POINTS];
    for i in 0..N {
        let (even_a, odd_a) = (-2.0 / 3.0 * w0[i] - 1.0 / 3.0 * w2[i], -2.0 / 3.0 * A * w1[i]);
        let (even_b, odd_b) = (1.0 / 6.0 * w0[i] + 1.0 / 3.0 * w2[i], 1.0 / 6.0 * B * w1[i]);
        let of_one = [w0[i], even_a + odd_a, even_a - odd_a, even_b + odd_b, even_b - odd_b, w2[i]];
        points.iter_mut().zip(of_one).for_each(|(point, value)| point[i] = value);
    }
    points
}

/// `B^T d` of six pixels.
///
/// # Safety
/// As of [`Lanes`].
#[inline(always)]
unsafe fn of_pixels<L: Lanes>([d0, d1, d2, d3, d4, d5]: [L; POINTS]) -> [L; POINTS] {
    unsafe {
        let (even_a, odd_a) = (plus(d4, -2.0, d2), plus(d3, -2.0, d1));
        let (even_b, odd_b) = (plus(d4, -0.5, d2), plus(d3, -0.5, d1));
        [
            plus(d0.add(d4), -2.5, d2),
            plus(even_a, A, odd_a),
            plus(even_a, -A, odd_a),
            plus(even_b, B, odd_b),
            plus(even_b, -B, odd_b),
            plus(d1.add(d5), -2.5, d3),
        ]
    }
}

/// `A^T m`: four results.
///
/// # Safety
/// As of [`Lanes`].
#[inline(always)]
pub(super) unsafe fn results<L: Lanes>([m0, m1, m2, m3, m4, m5]: [L; POINTS]) -> [L; PIXELS] {
    unsafe {
        let (even_a, odd_a) = (m1.add(m2), m1.sub(m2));
        let (even_b, odd_b) = (m3.add(m4), m3.sub(m4));
        [
            m0.add(even_a).add(even_b),
            plus(odd_a.mul(L::splat(A)), B, odd_b),
            plus(even_a.mul(L::splat(0.5)), 2.0, even_b),
            plus(plus(m5, 0.5 * A, odd_a), 2.0 * B, odd_b),
        ]
    }
}

/// `G g` of four gradients.
///
/// # Safety
/// As of [`Lanes`].
#[inline(always)]
unsafe fn of_gradients<L: Lanes>([g0, g1, g2, g3]: [L; PIXELS]) -> [L; POINTS] {
    unsafe {
        let (even_a, odd_a) = (plus(g0, 0.5, g2).mul(L::splat(-2.0 / 3.0)), plus(g1, 0.5, g3));
        let (even_b, odd_b) = (plus(g0, 2.0, g2).mul(L::splat(1.0 / 6.0)), plus(g1, 2.0, g3));
        let (slope_a, slope_b) = (-2.0 / 3.0 * A, 1.0 / 6.0 * B);
        [
            g0,
            plus(even_a, slope_a, odd_a),
            plus(even_a, -slope_a, odd_a),
            plus(even_b, slope_b, odd_b),
            plus(even_b, -slope_b, odd_b),
            g3,
        ]
    }
}

/// `A^T m`: the gradients of three taps.
///
/// # Safety
/// As of [`Lanes`].
#[inline(always)]
unsafe fn of_sums<L: Lanes>([m0, m1, m2, m3, m4, m5]: [L; POINTS]) -> [L; 3] {
    unsafe {
        let (even_a, odd_a) = (m1.add(m2), m1.sub(m2));
        let (even_b, odd_b) = (m3.add(m4), m3.sub(m4));
        [m0.add(even_a).add(even_b), plus(odd_a.mul(L::splat(A)), B, odd_b), plus(plus(m5, 0.5, even_a), 2.0, even_b)]
    }
}

/// The gradients of a kernel's taps, `[y][x]`, from sums of products, whose points `[x][y]` stand `apart` floats.
///
/// # Safety
/// As of [`Lanes`]; there are vectors at all those points.
#[inline(always)]
pub(super) unsafe fn taps<L: Lanes>(sums: *const f32, apart: usize) -> [[L; 3]; 3] {
    unsafe {
        let mut columns = [[L::splat(0.0); 3]; POINTS];
        for (x, column) in columns.iter_mut().enumerate() {
            let mut sum = [L::splat(0.0); POINTS];
            sum.iter_mut().enumerate().for_each(|(y, sum)| *sum = L::load(sums.add((x * POINTS + y) * apart)));
            *column = of_sums::<L>(sum);
        }
        let mut taps = [[L::splat(0.0); 3]; 3];
        for (y, taps) in taps.iter_mut().enumerate() {
            let mut row = [L::splat(0.0); POINTS];
            row.iter_mut().zip(&columns).for_each(|(value, column)| *value = column[y]);
            *taps = of_sums::<L>(row);
        }
        taps
    }
}

/// Some tiles: those of some columns in some rows.
#[derive(Debug, Clone)]
pub struct Tiles {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
}

impl Tiles {
    pub fn count(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// Vectors from one point to the next where some channels stand at each, `[channel][tile]`. One more than those of the
    /// channels: without it the points of a tile would share a set of the cache.
    pub fn apart(&self, channels: usize) -> usize {
        channels * self.count() + 1
    }

    /// Vectors of some channels, transformed.
    pub fn transformed(&self, channels: usize) -> usize {
        PRODUCTS * self.apart(channels)
    }

    /// Vectors between the transforms along y and along x.
    pub fn between(&self) -> usize {
        POINTS * (PIXELS * self.columns.len() + POINTS - PIXELS)
    }
}

dispatched! {
    /// `B^T d` on both axes of all channels: `[x][y][channel][tile]`.
    fn transform_input(input: Planes, tiles: &Tiles, between: &mut [f32], into: &mut [f32]) = transform_input_lanes
}

#[inline(always)]
fn transform_input_lanes<L: Lanes>(input: Planes, tiles: &Tiles, between: &mut [f32], into: &mut [f32]) {
    input.check::<L>();
    tiles.check::<L>(input, between, into);
    let apart = tiles.apart(input.channels) * L::LANES;
    for channel in 0..input.channels {
        for (place, row) in tiles.rows.clone().enumerate() {
            let (next, below) = if channel + 1 < input.channels { (channel + 1, row) } else { (0, row + 1) };
            let place = (channel * tiles.count() + place * tiles.columns.len()) * L::LANES;
            // SAFETY: tiles of the planes, and room for their transforms, as was checked.
            unsafe {
                fetch_row::<L>(input, next, below, &tiles.columns);
                transform_columns::<L>(input, channel, row, &tiles.columns, between.as_mut_ptr());
                let into = into.as_mut_ptr().add(place);
                transform_rows::<L>(between.as_ptr(), tiles.columns.len(), into, [POINTS * apart, apart]);
            }
        }
    }
}

impl Tiles {
    fn check<L: Lanes>(&self, planes: Planes, between: &[f32], into: &[f32]) {
        let tiles = planes.side.div_ceil(PIXELS);
        assert!(self.rows.end <= tiles && self.columns.end <= tiles, "tiles beyond the planes");
        assert!(
            between.len() >= self.between() * L::LANES && into.len() >= self.transformed(planes.channels) * L::LANES
        );
    }
}

/// Asks for what a row of tiles sees that the row above it did not.
///
/// # Safety
/// As of [`Lanes`]. What is asked for need not be there.
#[inline(always)]
unsafe fn fetch_row<L: Lanes>(planes: Planes, channel: usize, row: usize, columns: &Range<usize>) {
    unsafe {
        for y in row * PIXELS + 1..=(row + 1) * PIXELS {
            let from = planes.data.as_ptr().wrapping_add(planes.place::<L>(channel, y, columns.start * PIXELS));
            for pixel in 0..=columns.len() * PIXELS {
                L::fetch(from.wrapping_add(pixel * L::LANES));
            }
        }
    }
}

/// `B^T d` along y, of the columns of pixels that some tiles see: `[column][y]`. Pixels beyond the border are 0.
///
/// # Safety
/// As of [`Lanes`]; a channel of planes made for them, and room for the columns.
#[inline(always)]
unsafe fn transform_columns<L: Lanes>(
    input: Planes,
    channel: usize,
    row: usize,
    columns: &Range<usize>,
    into: *mut f32,
) {
    unsafe {
        let (y, end) = (row * PIXELS, input.side + 2);
        let start = input.data.as_ptr().add(channel * input.plane::<L>());
        // The border above is as what lies below the one below.
        let line = |i: usize| start.add(if y + i < end { y + i } else { 0 } * input.row::<L>());
        let lines = [line(0), line(1), line(2), line(3), line(4), line(5)];
        for (place, x) in (columns.start * PIXELS..columns.end * PIXELS + POINTS - PIXELS).enumerate() {
            let mut pixels = [L::splat(0.0); POINTS];
            if x < end {
                pixels.iter_mut().zip(lines).for_each(|(pixel, line)| *pixel = L::load(line.add(x * L::LANES)));
            }
            for (point, value) in of_pixels::<L>(pixels).into_iter().enumerate() {
                value.store(into.add((place * POINTS + point) * L::LANES));
            }
        }
    }
}

/// `B^T d` along x, of so many tiles. Their points along x and y stand `apart`.
///
/// # Safety
/// As of [`Lanes`]; there are the columns that the tiles see, and room for their points.
#[inline(always)]
unsafe fn transform_rows<L: Lanes>(columns: *const f32, tiles: usize, into: *mut f32, apart: [usize; 2]) {
    unsafe {
        for tile in 0..tiles {
            for y in 0..POINTS {
                let columns = columns.add((tile * PIXELS * POINTS + y) * L::LANES);
                let mut pixels = [L::splat(0.0); POINTS];
                let column = |x: usize| columns.add(x * POINTS * L::LANES);
                pixels.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = L::load(column(x)));
                let into = into.add(y * apart[1] + tile * L::LANES);
                for (x, value) in of_pixels::<L>(pixels).into_iter().enumerate() {
                    value.store(into.add(x * apart[0]));
                }
            }
        }
    }
}

dispatched! {
    /// `G g` on both axes of all channels: `[x][y][channel][tile]`.
    fn transform_gradient(gradient: Planes, tiles: &Tiles, between: &mut [f32], into: &mut [f32]) = transform_gradient_lanes
}

#[inline(always)]
fn transform_gradient_lanes<L: Lanes>(gradient: Planes, tiles: &Tiles, between: &mut [f32], into: &mut [f32]) {
    gradient.check::<L>();
    tiles.check::<L>(gradient, between, into);
    let (side, apart) = (gradient.side, tiles.apart(gradient.channels) * L::LANES);
    for channel in 0..gradient.channels {
        for (place, row) in tiles.rows.clone().enumerate() {
            let place = channel * tiles.count() + place * tiles.columns.len();
            // SAFETY: tiles of the planes, and room for their transforms, as was checked. Below the last row lies the
            // border.
            unsafe {
                let line = |i: usize| gradient.at::<L>(channel, (row * PIXELS + i).min(side), 0);
                let lines = [line(0), line(1), line(2), line(3)];
                for (tile, column) in tiles.columns.clone().enumerate() {
                    let into = into.as_mut_ptr().add((place + tile) * L::LANES);
                    transform_gradient_tile::<L>(lines, column * PIXELS..side, between.as_mut_ptr(), into, apart);
                }
            }
        }
    }
}

/// Of the tile that begins with the first of some columns. Columns beyond the last are 0.
///
/// # Safety
/// As of [`Lanes`]; the lines have the columns that are there, and there is room between and for the points.
#[inline(always)]
unsafe fn transform_gradient_tile<L: Lanes>(
    lines: [*const f32; PIXELS],
    there: Range<usize>,
    between: *mut f32,
    into: *mut f32,
    apart: usize,
) {
    unsafe {
        for i in 0..PIXELS {
            let mut pixels = [L::splat(0.0); PIXELS];
            if there.start + i < there.end {
                let x = (there.start + i) * L::LANES;
                pixels.iter_mut().zip(lines).for_each(|(pixel, line)| *pixel = L::load(line.add(x)));
            }
            for (point, value) in of_gradients::<L>(pixels).into_iter().enumerate() {
                value.store(between.add((i * POINTS + point) * L::LANES));
            }
        }
        for y in 0..POINTS {
            let column = |i: usize| between.add((i * POINTS + y) * L::LANES);
            let row = [L::load(column(0)), L::load(column(1)), L::load(column(2)), L::load(column(3))];
            for (x, value) in of_gradients::<L>(row).into_iter().enumerate() {
                value.store(into.add((x * POINTS + y) * apart));
            }
        }
    }
}

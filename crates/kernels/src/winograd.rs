//! Convolutions 3x3 with zero padding, stride 1, on blocks of frames, by Winograd's [minimal filtering](super::filtering).

use std::ops::Range;

use super::filtering::{PIXELS, POINTS, PRODUCTS, Tiles, of_taps, results, transform_input};
use super::planes::{Planes, PlanesMut, Workspace};
use super::simd::{Instructions, Lanes, dispatched};
use super::threads::side_by_side;

/// Tiles side by side whose products are summed in registers.
const STRIP: usize = 3;
/// Floats of the tiles that are transformed together: half of a second cache.
const CHUNK: usize = 1 << 17;
/// Input channels whose weights are transformed together.
const TOGETHER: usize = 16;
/// How many input channels ahead weights are asked for: those of a wide layer stand in the third cache.
const AHEAD: usize = 64;

/// What becomes of a convolution's result.
#[derive(Debug, Clone, Copy)]
pub enum Finish<'a> {
    Linear,
    Relu,
    /// 0 where these planes are not above 0: the gradient through a ReLU that gave them.
    WherePositive(Planes<'a>),
}

/// Transformed weights in the order in which the kernel reads them: `[outputs / tile][x][y][inputs][tile]`.
#[derive(Debug, Clone)]
pub struct WinogradWeights {
    transformed: Vec<f32>,
    bias: Vec<f32>,
}

impl WinogradWeights {
    /// Of a convolution, `weight` being `[outputs, inputs, 3, 3]`.
    pub fn forward(instructions: Instructions, weight: &[f32], bias: &[f32]) -> Self {
        let inputs = weight.len() / (9 * bias.len());
        Self::new(instructions, inputs, bias.to_vec(), |o, i, tap| weight[(o * inputs + i) * 9 + tap])
    }

    /// Of the convolution that takes the gradient of the result to that of the input: inputs and outputs exchanged, the
    /// kernel turned.
    pub fn backward(instructions: Instructions, weight: &[f32], outputs: usize) -> Self {
        let inputs = weight.len() / (9 * outputs);
        Self::new(instructions, outputs, vec![0.0; inputs], |i, o, tap| weight[(o * inputs + i) * 9 + 8 - tap])
    }

    fn new(
        instructions: Instructions,
        inputs: usize,
        bias: Vec<f32>,
        weight: impl Fn(usize, usize, usize) -> f32,
    ) -> Self {
        let (outputs, tile) = (bias.len(), instructions.tile());
        assert!(outputs.is_multiple_of(tile), "{outputs} channels do not fill tiles of {tile}");
        let mut transformed = vec![0.0; outputs * inputs * PRODUCTS];
        let mut kernels = vec![0.0; inputs * 9 * tile];
        for (number, transformed) in transformed.chunks_mut(PRODUCTS * inputs * tile).enumerate() {
            for (place, taps) in kernels.chunks_mut(tile).enumerate() {
                let (input, tap) = (place / 9, place % 9);
                taps.iter_mut().enumerate().for_each(|(i, to)| *to = weight(number * tile + i, input, tap));
            }
            transform_kernels(instructions, &kernels, transformed);
        }
        WinogradWeights { transformed, bias }
    }
}

dispatched! {
    /// `G w` on both axes of a tile's kernels: `[input][y][x][output]` to `[x][y][input][output]`.
    fn transform_kernels(kernels: &[f32], into: &mut [f32]) = transform_kernels_lanes
}

#[inline(always)]
fn transform_kernels_lanes<L: Lanes>(kernels: &[f32], into: &mut [f32]) {
    match L::OUTPUTS {
        8 => transform_tile::<8>(kernels, into),
        _ => transform_tile::<4>(kernels, into),
    }
}

/// Of `N` outputs.
#[inline(always)]
fn transform_tile<const N: usize>(kernels: &[f32], into: &mut [f32]) {
    let (kernels, _) = kernels.as_chunks::<N>();
    let (into, _) = into.as_chunks_mut::<N>();
    let inputs = kernels.len() / 9;
    assert!(into.len() == PRODUCTS * inputs);
    // Some inputs at a time: what a point takes of them stands side by side.
    let mut points = [[[0.0; N]; TOGETHER]; PRODUCTS];
    for first in (0..inputs).step_by(TOGETHER) {
        let some = TOGETHER.min(inputs - first);
        for (place, taps) in kernels[first * 9..][..some * 9].chunks_exact(9).enumerate() {
            let rows = [0, 3, 6].map(|row| of_taps([taps[row], taps[row + 1], taps[row + 2]]));
            for x in 0..POINTS {
                for (y, value) in of_taps(rows.map(|row| row[x])).into_iter().enumerate() {
                    points[x * POINTS + y][place] = value;
                }
            }
        }
        for (point, values) in points.iter().enumerate() {
            into[point * inputs + first..][..some].copy_from_slice(&values[..some]);
        }
    }
}

/// Those of some output channels.
#[derive(Debug, Clone, Copy)]
pub struct SomeWeights<'a> {
    transformed: &'a [f32],
    bias: &'a [f32],
}

impl WinogradWeights {
    fn all(&self) -> SomeWeights<'_> {
        SomeWeights { transformed: &self.transformed, bias: &self.bias }
    }
}

impl SomeWeights<'_> {
    fn part(&self, first: usize, channels: usize) -> Self {
        let each = self.transformed.len() / self.bias.len();
        SomeWeights {
            transformed: &self.transformed[first * each..(first + channels) * each],
            bias: &self.bias[first..first + channels],
        }
    }
}

/// `output = finish(weights * input + bias)`, on as many threads as there are workspaces: each computes channels of its own.
pub fn convolve(
    instructions: Instructions,
    weights: &WinogradWeights,
    input: Planes,
    output: PlanesMut,
    finish: Finish,
    workspaces: &mut [Workspace],
) {
    let (side, plane) = (output.side, output.data.len() / output.channels);
    let channels = (output.channels / instructions.tile()).div_ceil(workspaces.len()) * instructions.tile();
    let parts = output.data.chunks_mut(channels * plane).enumerate().map(|(part, data)| {
        let (first, channels) = (part * channels, data.len() / plane);
        (weights.all().part(first, channels), PlanesMut { data, channels, side }, finish.part(first, channels))
    });
    side_by_side(workspaces, parts.collect(), |workspace, (weights, output, finish)| {
        convolve_some(instructions, weights, input, output, finish, workspace);
    });
}

impl Finish<'_> {
    /// Of some output channels.
    fn part(&self, first: usize, channels: usize) -> Self {
        match *self {
            Finish::WherePositive(gate) => Finish::WherePositive(gate.part(first, channels)),
            finish => finish,
        }
    }
}

fn convolve_some(
    instructions: Instructions,
    weights: SomeWeights,
    input: Planes,
    mut output: PlanesMut,
    finish: Finish,
    workspace: &mut Workspace,
) {
    let (inputs, vector, together) = (input.channels, instructions.lanes(), instructions.tile());
    assert!(output.side == input.side && output.channels == weights.bias.len());
    assert!(output.channels.is_multiple_of(together));
    assert!(weights.transformed.len() == output.channels * inputs * PRODUCTS);
    let columns = input.side.div_ceil(PIXELS);
    let most = ((CHUNK / (PRODUCTS * inputs * vector * STRIP)).max(1) * STRIP).min(columns);
    let largest = Tiles { rows: 0..1, columns: 0..most };
    let [between, seen, products] = workspace.parts([
        largest.between() * vector,
        largest.transformed(inputs) * vector,
        PRODUCTS * together * STRIP * vector,
    ]);
    for first in (0..columns).step_by(most) {
        for row in 0..columns {
            let tiles = Tiles { rows: row..row + 1, columns: first..columns.min(first + most) };
            transform_input(instructions, input, &tiles, between, seen);
            for channel in (0..output.channels).step_by(together) {
                let weights = weights.part(channel, together);
                let mut column = tiles.columns.start;
                while column < tiles.columns.end {
                    let count = match tiles.columns.end - column {
                        1 => 1,
                        2 | 4 => 2,
                        _ => STRIP,
                    };
                    let strip = TileStrip { channel, row, columns: column..column + count };
                    fetch_results(instructions, &output, finish, &strip);
                    multiply(instructions, weights.transformed, inputs, &tiles, seen, &strip, products);
                    write(instructions, products, weights.bias, finish, &mut output, &strip);
                    column += count;
                }
            }
        }
    }
}

/// Output channels that are computed together, from the first on, of some tiles beside each other.
#[derive(Debug)]
pub struct TileStrip {
    channel: usize,
    row: usize,
    columns: Range<usize>,
}

dispatched! {
    /// Asks for what [`write()`] will write, and what it will compare: the multiplications leave time.
    fn fetch_results(output: &PlanesMut, finish: Finish, strip: &TileStrip) = fetch_results_lanes
}

#[inline(always)]
fn fetch_results_lanes<L: Lanes>(output: &PlanesMut, finish: Finish, strip: &TileStrip) {
    let output = output.as_ref();
    for channel in strip.channel..strip.channel + L::OUTPUTS {
        for y in strip.row * PIXELS..(strip.row + 1) * PIXELS {
            let start = output.place::<L>(channel, y, strip.columns.start * PIXELS);
            for place in (start..).step_by(L::LANES).take(strip.columns.len() * PIXELS) {
                // SAFETY: a hint, which reads nothing.
                unsafe {
                    L::fetch(output.data.as_ptr().wrapping_add(place));
                    if let Finish::WherePositive(gate) = finish {
                        L::fetch(gate.data.as_ptr().wrapping_add(place));
                    }
                }
            }
        }
    }
}

dispatched! {
    /// The products of a strip, summed over the input channels: `[output][tile][x][y]`. `seen` are the transformed pixels of
    /// `tiles`.
    fn multiply(
        weights: &[f32],
        inputs: usize,
        tiles: &Tiles,
        seen: &[f32],
        strip: &TileStrip,
        products: &mut [f32],
    ) = multiply_lanes
}

#[inline(always)]
fn multiply_lanes<L: Lanes>(
    weights: &[f32],
    inputs: usize,
    tiles: &Tiles,
    seen: &[f32],
    strip: &TileStrip,
    products: &mut [f32],
) {
    let place = strip.columns.start - tiles.columns.start;
    assert!(strip.columns.end <= tiles.columns.end && weights.len() == L::OUTPUTS * inputs * PRODUCTS);
    assert!(seen.len() >= tiles.transformed(inputs) * L::LANES);
    assert!(products.len() >= PRODUCTS * L::OUTPUTS * strip.columns.len() * L::LANES);
    // SAFETY: the strip's tiles and weights, and room for its products, as was checked.
    unsafe {
        let seen = seen.as_ptr().add(place * L::LANES);
        let layer = WinogradLayer { weights: weights.as_ptr(), inputs, seen, tiles, products: products.as_mut_ptr() };
        match (L::OUTPUTS, strip.columns.len()) {
            (8, 1) => layer.multiply::<L, 8, 1>(),
            (8, 2) => layer.multiply::<L, 8, 2>(),
            (8, _) => layer.multiply::<L, 8, STRIP>(),
            (_, 1) => layer.multiply::<L, 4, 1>(),
            (_, 2) => layer.multiply::<L, 4, 2>(),
            _ => layer.multiply::<L, 4, STRIP>(),
        }
    }
}

struct WinogradLayer<'a> {
    weights: *const f32,
    inputs: usize,
    /// From the strip's first tile on.
    seen: *const f32,
    tiles: &'a Tiles,
    products: *mut f32,
}

impl WinogradLayer<'_> {
    /// `O` output channels of `P` tiles.
    ///
    /// # Safety
    /// As of [`Lanes`]; weights, tiles and products are there, as many as the layer says.
    #[inline(always)]
    unsafe fn multiply<L: Lanes, const O: usize, const P: usize>(&self) {
        unsafe {
            let (mut weights, apart) = (self.weights, self.tiles.apart(self.inputs));
            for point in 0..PRODUCTS {
                let mut seen = self.seen.add(point * apart * L::LANES);
                let mut products = [[L::splat(0.0); P]; O];
                for _ in 0..self.inputs {
                    L::fetch(weights.wrapping_add(O * AHEAD));
                    let pixels: [L; P] = std::array::from_fn(|p| L::load(seen.add(p * L::LANES)));
                    for (o, products) in products.iter_mut().enumerate() {
                        let weight = L::splat(*weights.add(o));
                        for (product, &pixel) in products.iter_mut().zip(&pixels) {
                            *product = product.add_product(weight, pixel);
                        }
                    }
                    seen = seen.add(self.tiles.count() * L::LANES);
                    weights = weights.add(O);
                }
                for (place, product) in products.as_flattened().iter().enumerate() {
                    product.store(self.products.add((place * PRODUCTS + point) * L::LANES));
                }
            }
        }
    }
}

dispatched! {
    /// From the products of a strip to the result: `A^T m` on both axes, and what becomes of it.
    fn write(
        products: &[f32],
        bias: &[f32],
        finish: Finish,
        output: &mut PlanesMut,
        strip: &TileStrip,
    ) = write_lanes
}

#[inline(always)]
fn write_lanes<L: Lanes>(products: &[f32], bias: &[f32], finish: Finish, output: &mut PlanesMut, strip: &TileStrip) {
    let (side, tiles) = (output.side, strip.columns.len());
    output.check::<L>();
    if let Finish::WherePositive(gate) = finish {
        gate.check::<L>();
        assert!(gate.side == side && gate.channels == output.channels);
    }
    assert!(products.len() >= PRODUCTS * bias.len() * tiles * L::LANES);
    assert!(strip.channel + bias.len() <= output.channels && strip.columns.end <= side.div_ceil(PIXELS));
    assert!(strip.row < side.div_ceil(PIXELS));
    for (o, bias) in bias.iter().enumerate() {
        for (tile, column) in strip.columns.clone().enumerate() {
            // SAFETY: products and tiles as was checked.
            unsafe {
                let products = products.as_ptr().add((o * tiles + tile) * PRODUCTS * L::LANES);
                write_tile::<L>(products, *bias, finish, output, strip.channel + o, [strip.row, column]);
            }
        }
    }
}

/// Of a tile, as far as it lies within the picture.
///
/// # Safety
/// As of [`Lanes`]; a tile of the output, its products, and a gate of the same shape.
#[inline(always)]
unsafe fn write_tile<L: Lanes>(
    products: *const f32,
    bias: f32,
    finish: Finish,
    output: &mut PlanesMut,
    channel: usize,
    tile: [usize; 2],
) {
    unsafe {
        let [y, x] = tile.map(|place| place * PIXELS);
        let side = output.side;
        let mut columns = [[L::splat(0.0); PIXELS]; POINTS];
        for (x, column) in columns.iter_mut().enumerate() {
            let mut points = [L::splat(0.0); POINTS];
            let product = |y: usize| products.add((x * POINTS + y) * L::LANES);
            points.iter_mut().enumerate().for_each(|(y, point)| *point = L::load(product(y)));
            *column = results::<L>(points);
        }
        for row in 0..PIXELS.min(side - y) {
            let place = output.as_ref().place::<L>(channel, y + row, x);
            let mut points = [L::splat(0.0); POINTS];
            points.iter_mut().zip(&columns).for_each(|(point, column)| *point = column[row]);
            for (i, result) in results::<L>(points).into_iter().enumerate().take(side - x) {
                let (result, place) = (result.add(L::splat(bias)), place + i * L::LANES);
                let result = match finish {
                    Finish::Linear => result,
                    Finish::Relu => L::splat(0.0).max(result),
                    Finish::WherePositive(gate) => result.where_positive(L::load(gate.data.as_ptr().add(place))),
                };
                result.store(output.data.as_mut_ptr().add(place));
            }
        }
    }
}

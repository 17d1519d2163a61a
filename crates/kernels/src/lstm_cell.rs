//! A step of a long short-term memory after its gates' affine map, forward and backward, in one pass each.

use super::exponential::reduced;
use super::simd::{Instructions, Lanes, dispatched};
use super::threads::in_parallel;

/// What a step leaves for its gradient.
#[derive(Debug)]
pub struct LstmPass {
    /// The gates i, f, g, o after their activations, `[batch, 4, units]`.
    gates: Vec<f32>,
    /// `tanh c'`, `[batch, units]`.
    bounded: Vec<f32>,
}

/// `c' = f c + i g` and `h' = o tanh c'`, written to `after` as `[h, c]`, each `[batch, units]`; `gates` `[batch, 4, units]`
/// are i, f, g, o before their activations, to f's of which `forget_bias` is added.
pub fn forward(
    instructions: Instructions,
    units: usize,
    gates: &[f32],
    before: &[f32],
    forget_bias: f32,
    after: [&mut [f32]; 2],
) -> LstmPass {
    let [h, c] = after;
    assert!(gates.len() == 4 * before.len() && h.len() == before.len() && c.len() == before.len());
    let mut pass = LstmPass { gates: gates.to_vec(), bounded: vec![0.0; before.len()] };
    let after = h.chunks_mut(units).zip(c.chunks_mut(units)).zip(pass.bounded.chunks_mut(units));
    let clips: Vec<_> = pass.gates.chunks_mut(4 * units).zip(before.chunks(units)).zip(after).collect();
    in_parallel(clips, |((gates, before), ((h, c), bounded))| {
        step(instructions, forget_bias, gates, before, [h, c, bounded]);
    });
    pass
}

impl LstmPass {
    /// From the gradients of h' and c' those of the gates before their activations and of c.
    pub fn backward(
        &self,
        instructions: Instructions,
        units: usize,
        before: &[f32],
        pull: [&[f32]; 2],
        by: [&mut [f32]; 2],
    ) {
        let ([of_h, of_c], [by_gates, by_before]) = (pull, by);
        let seen = self.gates.chunks(4 * units).zip(self.bounded.chunks(units)).zip(before.chunks(units));
        let pulls = of_h.chunks(units).zip(of_c.chunks(units));
        let by = by_gates.chunks_mut(4 * units).zip(by_before.chunks_mut(units));
        let clips: Vec<_> = seen.zip(pulls).zip(by).collect();
        in_parallel(clips, |((((gates, bounded), before), (of_h, of_c)), (by_gates, by_before))| {
            step_backward(instructions, [gates, bounded, before, of_h, of_c], by_gates, by_before);
        });
    }
}

dispatched! {
    /// Activates the gates of a clip, and writes h', c' and `tanh c'`.
    fn step(forget_bias: f32, gates: &mut [f32], before: &[f32], after: [&mut [f32]; 3]) = step_lanes
}

/// Written for single numbers: the compiler makes vectors of them, of the width that the caller is compiled for.
#[inline(always)]
fn step_lanes<L: Lanes>(forget_bias: f32, gates: &mut [f32], before: &[f32], after: [&mut [f32]; 3]) {
    let units = before.len();
    let [h, c, bounded] = after;
    let (i, rest) = gates.split_at_mut(units);
    let (f, rest) = rest.split_at_mut(units);
    let (g, o) = rest.split_at_mut(units);
    assert!([o.len(), h.len(), c.len(), bounded.len()] == [units; 4]);
    for unit in 0..units {
        i[unit] = sigmoid(i[unit]);
        f[unit] = sigmoid(f[unit] + forget_bias);
        g[unit] = tanh(g[unit]);
        o[unit] = sigmoid(o[unit]);
        c[unit] = f[unit] * before[unit] + i[unit] * g[unit];
        bounded[unit] = tanh(c[unit]);
        h[unit] = o[unit] * bounded[unit];
    }
}

dispatched! {
    /// Of a clip: `seen` are its gates, `tanh c'`, c, and the gradients of h' and c'.
    fn step_backward(seen: [&[f32]; 5], by_gates: &mut [f32], by_before: &mut [f32]) = step_backward_lanes
}

#[inline(always)]
fn step_backward_lanes<L: Lanes>(seen: [&[f32]; 5], by_gates: &mut [f32], by_before: &mut [f32]) {
    let [gates, bounded, before, of_h, of_c] = seen;
    let units = before.len();
    let (i, rest) = gates.split_at(units);
    let (f, rest) = rest.split_at(units);
    let (g, o) = rest.split_at(units);
    let (by_i, rest) = by_gates.split_at_mut(units);
    let (by_f, rest) = rest.split_at_mut(units);
    let (by_g, by_o) = rest.split_at_mut(units);
    assert!([o.len(), bounded.len(), of_h.len(), of_c.len(), by_o.len(), by_before.len()] == [units; 6]);
    for unit in 0..units {
        let pull = of_c[unit] + of_h[unit] * o[unit] * (1.0 - bounded[unit] * bounded[unit]);
        by_i[unit] = pull * g[unit] * i[unit] * (1.0 - i[unit]);
        by_f[unit] = pull * before[unit] * f[unit] * (1.0 - f[unit]);
        by_g[unit] = pull * i[unit] * (1.0 - g[unit] * g[unit]);
        by_o[unit] = of_h[unit] * bounded[unit] * o[unit] * (1.0 - o[unit]);
        by_before[unit] = pull * f[unit];
    }
}

/// `[2^n, e^r - 1]` with `e^x = 2^n e^r` and `|r| <= ln 2 / 2`; x from -87 to 88, beyond which it is taken as that. The
/// seventh order of the series leaves 2e-8 of `e^r - 1`.
#[inline(always)]
fn parts_of_exponential(x: f32) -> [f32; 2] {
    let [power, r] = reduced(x.clamp(-87.0, 88.0));
    let series = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0];
    let series = series.iter().fold(1.0 / 5040.0, |sum, term| sum * r + term);
    [power, series * r]
}

#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    let [power, rest] = parts_of_exponential(-x);
    1.0 / (1.0 + power + power * rest)
}

/// `(e^2x - 1) / (e^2x + 1)`, exact to rounding also near 0.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    let [power, rest] = parts_of_exponential(2.0 * x);
    let less_one = power * rest + (power - 1.0);
    less_one / (less_one + 2.0)
}

#[cfg(test)]
mod tests {
    use super::{sigmoid, tanh};

    /// Against the same in double precision: three roundings of float32 (6e-8 each), near 0 and far from it. What is not a
    /// number stays so.
    #[test]
    fn activations_are_exact_to_rounding() {
        let magnitudes = (-300..=20).map(|tenth| 10f32.powf(tenth as f32 / 10.0));
        for x in magnitudes.flat_map(|x| [x, -x]).chain([0.0, 60.0, -60.0, 1e30, -1e30]) {
            let exact = f64::from(x);
            let off = |ours: f32, theirs: f64| ((f64::from(ours) - theirs) / theirs.abs().max(1e-30)).abs();
            assert!(off(tanh(x), exact.tanh()) < 3e-7, "tanh {x}: {} for {}", tanh(x), exact.tanh());
            // Below e^-87 it is taken as that.
            let theirs = 1.0 / (1.0 + (-exact.max(-87.0)).exp());
            assert!(off(sigmoid(x), theirs) < 3e-7, "sigmoid {x}: {} for {theirs}", sigmoid(x));
        }
        assert!(tanh(f32::NAN).is_nan() && sigmoid(f32::NAN).is_nan());
    }
}

//! Functions of single-precision numbers without branches and calls, so that the compiler computes several at a time.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, LN_2};

/// Added and taken off again, this rounds a number of up to some millions to a whole one.
const ROUNDS: f32 = 12_582_912.0;

/// The nearest whole number, of numbers up to some millions. Without a call, so that several are computed at a time.
#[inline]
pub fn nearest(x: f32) -> f32 {
    (x + ROUNDS) - ROUNDS
}

/// The sine, to some 1e-6 within a hundred turns. Without a branch or a call, so that several are computed at a time: the
/// library's own takes some three times as long, which is most of a plan.
#[inline]
pub(crate) fn sine(x: f32) -> f32 {
    let half_turns = nearest(x * FRAC_1_PI);
    // Pi in two parts: the first has so few digits that its multiples are exact.
    let rest = (x - half_turns * 3.140_625) - half_turns * 9.676_536e-4;
    let odd = (half_turns - 2.0 * nearest(half_turns * 0.5)).abs();
    let square = rest * rest;
    // Taylor's series; within a quarter turn the next term is below 1e-7.
    let series = [-1.0 / 39_916_800.0, 1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    (1.0 - 2.0 * odd) * rest * series.into_iter().fold(0.0, |sum, factor| sum * square + factor)
}

/// The cosine, as exact as the [`sine`].
#[inline]
pub(crate) fn cosine(x: f32) -> f32 {
    sine(x + FRAC_PI_2)
}

/// The natural logarithm of a positive number, to some 1e-7 of it or of 1. Without a branch or a call.
#[inline]
pub(crate) fn logarithm(x: f32) -> f32 {
    // x = mantissa * 2^exponent, the mantissa within a factor sqrt(2) of 1.
    let bits = x.to_bits();
    let exponent = (bits.wrapping_sub(SQRT_HALF) as i32) >> 23;
    let mantissa = f32::from_bits(bits.wrapping_sub((exponent << 23) as u32));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let square = s * s;
    // ln m = 2 artanh s; the next term is below 1e-9.
    let series = [2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0];
    exponent as f32 * LN_2 + s * series.into_iter().fold(0.0, |sum, factor| sum * square + factor)
}

/// The bits of sqrt(1/2).
const SQRT_HALF: u32 = 0x3f35_04f3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_those_of_the_library() {
        for i in -60_000..60_000 {
            let x = i as f32 * 0.01;
            // What is left of a large angle has its rounding: 6e-8 of 600.
            let tolerance = 4e-7 + 1e-7 * f64::from(x).abs();
            for (found, expected) in [(sine(x), f64::from(x).sin()), (cosine(x), f64::from(x).cos())] {
                let error = (f64::from(found) - expected).abs();
                assert!(error < tolerance, "of {x}: {found} instead of {expected}");
            }
        }
        assert!(sine(f32::NAN).is_nan() && sine(f32::INFINITY).is_nan());
    }
    #[test]
    fn logarithms_are_those_of_the_library() {
        for exponent in -100..100 {
            for mantissa in 0..200 {
                let x = (1.0 + mantissa as f32 / 200.0) * 2f32.powi(exponent);
                let (found, expected) = (f64::from(logarithm(x)), f64::from(x).ln());
                assert!((found - expected).abs() < 2e-7 * expected.abs().max(1.0), "of {x}: {found}, {expected}");
            }
        }
    }
}

//! What the exponentials here have in common.

/// Added to a number below 2^22 and taken away again, it leaves the nearest whole one, which then stands in the last bits.
const WHOLE: f32 = 12_582_912.0;
/// `ln 2` in two parts, the first of so few bits that its products with whole numbers are exact.
const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];

/// `[2^n, r]` with `e^x = 2^n e^r` and `|r| <= ln 2 / 2`, for x from -87 to 88.
#[inline(always)]
pub fn reduced(x: f32) -> [f32; 2] {
    let shifted = x * std::f32::consts::LOG2_E + WHOLE;
    let n = shifted - WHOLE;
    let r = x - n * LN_2[0] - n * LN_2[1];
    [f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits())), r]
}

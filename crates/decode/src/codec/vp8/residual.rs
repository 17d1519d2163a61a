//! Coefficients of a macroblock (RFC 6386, section 13) and their inverse transforms (section 14).

use super::bools::Bools;
use super::header::Steps;
use super::numbers::TokenProbabilities;

/// Places of the coefficients in the order in which they are coded.
const ZIGZAG: [usize; 16] = [0, 1, 4, 8, 5, 2, 3, 6, 9, 12, 13, 10, 7, 11, 14, 15];
/// Band of each place in that order.
const BANDS: [usize; 16] = [0, 1, 2, 3, 6, 4, 5, 6, 6, 6, 6, 6, 6, 6, 6, 7];
/// Least value of the six categories of large coefficients, and the probabilities of their further bits.
const CATEGORIES: [(i32, &[u8]); 6] = [
    (5, &[159]),
    (7, &[165, 145]),
    (11, &[173, 148, 140]),
    (19, &[176, 155, 140, 135]),
    (35, &[180, 157, 141, 134, 130]),
    (67, &[254, 254, 243, 230, 196, 177, 153, 140, 133, 130, 129]),
];
/// Blocks of a macroblock: 16 of luma, 4 of each chroma.
pub(super) const BLOCKS: usize = 24;

/// Whether blocks at an edge of a macroblock have coefficients: four of luma, two of each chroma, the second transform's.
pub(super) type EdgeCoefficients = [bool; 9];

/// Differences to the prediction, block by block in row order.
pub(super) struct Residual {
    pub blocks: [[i32; 16]; BLOCKS],
    pub is_empty: bool,
}

impl Residual {
    pub(super) const EMPTY: Residual = Residual { blocks: [[0; 16]; BLOCKS], is_empty: true };

    /// Reads the coefficients of a macroblock.
    pub(super) fn read(
        bools: &mut Bools,
        probabilities: &TokenProbabilities,
        steps: &Steps,
        has_second: bool,
        (above, left): (&mut EdgeCoefficients, &mut EdgeCoefficients),
    ) -> Self {
        let mut residual = Residual::EMPTY;
        let mut second = [0; 16];
        if has_second {
            let context = usize::from(above[8]) + usize::from(left[8]);
            let has = block(bools, &probabilities[1], context, 0, steps.second, &mut second);
            (above[8], left[8]) = (has, has);
            residual.is_empty &= !has;
            second = walsh(&second);
        }
        let (plane, first) = if has_second { (0, 1) } else { (3, 0) };
        for (number, out) in residual.blocks.iter_mut().enumerate() {
            // Edges of luma, then of both chroma planes.
            let (x, y, plane, first, steps) = match number {
                0..16 => (number % 4, number / 4, plane, first, steps.luma),
                _ => {
                    let (chroma, block) = ((number - 16) / 4, number % 4);
                    (4 + 2 * chroma + block % 2, 4 + 2 * chroma + block / 2, 2, 0, steps.chroma)
                }
            };
            let context = usize::from(above[x]) + usize::from(left[y]);
            let mut coefficients = [0; 16];
            let has = block(bools, &probabilities[plane], context, first, steps, &mut coefficients);
            (above[x], left[y]) = (has, has);
            residual.is_empty &= !has;
            if has_second && number < 16 {
                coefficients[0] = second[number];
            }
            *out = cosine(&coefficients);
        }
        residual
    }
}

/// Reads a block's coefficients; whether it has any, zeros before an end included.
fn block(
    bools: &mut Bools,
    probabilities: &[[[u8; 11]; 3]; 8],
    context: usize,
    first: usize,
    steps: [i32; 2],
    coefficients: &mut [i32; 16],
) -> bool {
    let (mut context, mut place, mut may_end) = (context, first, true);
    while place < 16 {
        let nodes = &probabilities[BANDS[place]][context];
        if may_end && !bools.bool(nodes[0]) {
            break;
        }
        if bools.bool(nodes[1]) {
            let size = size(bools, nodes);
            let level = if bools.flag() { -size } else { size };
            coefficients[ZIGZAG[place]] = level * steps[usize::from(place > 0)];
            (context, may_end) = (if size == 1 { 1 } else { 2 }, true);
        } else {
            (context, may_end) = (0, false);
        }
        place += 1;
    }
    place > first
}

/// The size of a coefficient that is not zero.
fn size(bools: &mut Bools, nodes: &[u8; 11]) -> i32 {
    let mut is = |node: usize| bools.bool(nodes[node]);
    let category = match () {
        () if !is(2) => return 1,
        () if !is(3) => match () {
            () if !is(4) => return 2,
            () => return 3 + i32::from(is(5)),
        },
        () if !is(6) => usize::from(is(7)),
        () if !is(8) => 2 + usize::from(is(9)),
        () => 4 + usize::from(is(10)),
    };
    let (least, bits) = CATEGORIES[category];
    least + bits.iter().fold(0, |number, bit| 2 * number + i32::from(bools.bool(*bit)))
}

/// Inverse Walsh-Hadamard transform (14.3).
fn walsh(coefficients: &[i32; 16]) -> [i32; 16] {
    let four = |it: [i32; 4]| {
        let ([a, b], [c, d]) = ([it[0] + it[3], it[1] + it[2]], [it[1] - it[2], it[0] - it[3]]);
        [a + b, c + d, a - b, d - c]
    };
    separable(coefficients, four, |it| (it + 3) >> 3)
}

/// Inverse cosine transform (14.4), with cosines and sines of pi / 8 in 65536ths.
fn cosine(coefficients: &[i32; 16]) -> [i32; 16] {
    if coefficients[1..].iter().all(|it| *it == 0) {
        return [(coefficients[0] + 4) >> 3; 16];
    }
    let by_sine = |it: i32| (it * 35_468) >> 16;
    let by_cosine = |it: i32| it + ((it * 20_091) >> 16);
    let four = |it: [i32; 4]| {
        let (a, b) = (it[0] + it[2], it[0] - it[2]);
        let (c, d) = (by_sine(it[1]) - by_cosine(it[3]), by_cosine(it[1]) + by_sine(it[3]));
        [a + d, b + c, b - c, a - d]
    };
    separable(coefficients, four, |it| (it + 4) >> 3)
}

/// Columns, then rows.
fn separable(it: &[i32; 16], four: impl Fn([i32; 4]) -> [i32; 4], round: impl Fn(i32) -> i32) -> [i32; 16] {
    let mut columns = [0; 16];
    for x in 0..4 {
        for (y, sum) in four([it[x], it[4 + x], it[8 + x], it[12 + x]]).into_iter().enumerate() {
            columns[4 * y + x] = sum;
        }
    }
    let mut rows = [0; 16];
    for (row, out) in columns.chunks_exact(4).zip(rows.chunks_exact_mut(4)) {
        out.copy_from_slice(&four([row[0], row[1], row[2], row[3]]).map(&round));
    }
    rows
}

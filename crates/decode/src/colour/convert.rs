//! Samples to RGB or grey, row by row. A chroma sample colours all pixels that it stands for, as in ffmpeg's default.

use std::array::from_fn;

use image::{GrayImage, RgbImage};

use super::coefficients::Coefficients;
use super::hdr::ToneMap;
use super::{Colour, Transfer};
use crate::picture::{Chroma, SampleRow, Yuv};

/// Fraction bits of a row's terms: their sums stay within 16 bits.
const FRACTION: u32 = 5;

/// Converts pictures of one colour and depth.
pub(crate) struct Converter {
    coefficients: Coefficients,
    depth: u8,
    tone_map: Option<ToneMap>,
}

impl Converter {
    pub(crate) fn new(colour: &Colour, depth: u8) -> Self {
        let is_hdr = colour.transfer != Transfer::Standard;
        let tone_map = is_hdr.then(|| ToneMap::new(colour.transfer));
        Converter { coefficients: Coefficients::of(colour), depth, tone_map }
    }

    /// An RGB picture, not yet turned.
    pub(crate) fn rgb(&self, yuv: &Yuv) -> RgbImage {
        let (width, height) = yuv.size;
        let mut rgb = vec![0; 3 * width * height];
        let mut terms = Terms::new(width);
        for (y, out) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let chroma = match yuv.chroma {
                Chroma::None => None,
                Chroma::Subsampled(across, down) => Some((across, y >> down, y.is_multiple_of(1 << down))),
            };
            let chroma = chroma.map(|(across, row, is_new)| ([yuv.row(1, row), yuv.row(2, row)], across, is_new));
            match (yuv.row(0, y), &self.tone_map) {
                (SampleRow::Bytes(luma), None) => self.bytes(luma, chroma, &mut terms, out),
                (SampleRow::Words(luma), None) if self.depth == 8 => self.words_of_8(luma, chroma, &mut terms, out),
                (luma, _) => self.deep(luma, chroma.map(|it| (it.0, it.1)), out),
            }
        }
        RgbImage::from_raw(width as u32, height as u32, rgb).expect("three bytes for each pixel")
    }

    /// Luma, 0 to 255, not yet turned.
    pub(crate) fn grey(&self, yuv: &Yuv) -> GrayImage {
        let (width, height) = yuv.size;
        let scale = f64::from(1u32 << (self.depth - 8));
        let level = |sample: usize| {
            let level = self.coefficients.luma * (sample as f64 / scale - self.coefficients.black);
            level.round().clamp(0.0, 255.0) as u8
        };
        let levels: Vec<u8> = (0..1 << self.depth).map(level).collect();
        let mut grey = Vec::with_capacity(width * height);
        for y in 0..height {
            match yuv.row(0, y) {
                SampleRow::Bytes(luma) => grey.extend(luma.iter().map(|&sample| levels[usize::from(sample)])),
                SampleRow::Words(luma) => {
                    let most = levels.len() - 1;
                    grey.extend(luma.iter().map(|&sample| levels[usize::from(sample).min(most)]));
                }
            }
        }
        GrayImage::from_raw(width as u32, height as u32, grey).expect("a byte for each pixel")
    }

    fn bytes(&self, luma: &[u8], chroma: Option<([SampleRow; 2], usize, bool)>, terms: &mut Terms, out: &mut [u8]) {
        if let Some(([SampleRow::Bytes(u), SampleRow::Bytes(v)], across, true)) = chroma {
            terms.set_chroma(&self.coefficients, u.iter().map(|&it| it.into()), v.iter().map(|&it| it.into()), across);
        }
        terms.convert(&self.coefficients, luma.iter().map(|&it| it.into()), out);
    }

    /// Words that hold bytes.
    fn words_of_8(
        &self,
        luma: &[u16],
        chroma: Option<([SampleRow; 2], usize, bool)>,
        terms: &mut Terms,
        out: &mut [u8],
    ) {
        if let Some(([SampleRow::Words(u), SampleRow::Words(v)], across, true)) = chroma {
            terms.set_chroma(&self.coefficients, u.iter().map(|&it| it as i16), v.iter().map(|&it| it as i16), across);
        }
        terms.convert(&self.coefficients, luma.iter().map(|&it| it as i16), out);
    }

    /// Samples of more than 8 bits, or of high dynamic range.
    fn deep(&self, luma: SampleRow, chroma: Option<([SampleRow; 2], usize)>, out: &mut [u8]) {
        let scale = 1.0 / f32::from(1u16 << (self.depth - 8));
        let it = &self.coefficients;
        let [black, of_luma, red_v, green_u, green_v, blue_u] =
            [it.black, it.luma, it.red_v, it.green_u, it.green_v, it.blue_u].map(|it| it as f32);
        let sample = |row: SampleRow, at: usize| match row {
            SampleRow::Bytes(row) => f32::from(row[at]),
            SampleRow::Words(row) => f32::from(row[at]) * scale,
        };
        for (x, pixel) in out.chunks_exact_mut(3).enumerate() {
            let level = of_luma * (sample(luma, x) - black);
            let [u, v] = match chroma {
                Some((rows, across)) => rows.map(|row| sample(row, x >> across) - 128.0),
                None => [0.0; 2],
            };
            let levels = [level + red_v * v, level + green_u * u + green_v * v, level + blue_u * u];
            let levels = match &self.tone_map {
                Some(tone_map) => tone_map.map(levels),
                None => levels,
            };
            // A cast of a float saturates.
            pixel.copy_from_slice(&levels.map(|level| (level + 0.5) as u8));
        }
    }
}

/// Working rows for samples of 8 bits, in 32nds of a grey level.
struct Terms {
    /// Parts of red, green and blue that come from chroma: of each chroma sample, and of each pixel.
    samples: [Vec<i16>; 3],
    chroma: [Vec<i16>; 3],
    /// The row's levels, before they are interleaved.
    levels: [Vec<u8>; 3],
}

/// The upper half of a product of 16-bit numbers, of which one is a coefficient.
fn scaled(number: i16, coefficient: i16) -> i16 {
    ((i32::from(number) * i32::from(coefficient)) >> 16) as i16
}

impl Terms {
    fn new(width: usize) -> Self {
        let terms = || from_fn(|_| vec![0; width + 1]);
        Terms { samples: terms(), chroma: terms(), levels: from_fn(|_| vec![0; width]) }
    }

    fn set_chroma(
        &mut self,
        coefficients: &Coefficients,
        u: impl Iterator<Item = i16> + Clone,
        v: impl Iterator<Item = i16> + Clone,
        across: usize,
    ) {
        // Differences are shifted by 8 bits, coefficients by 13: 21 - 16 = 5 are left.
        let fixed = |coefficient: f64| (coefficient * f64::from(1 << 13)).round() as i16;
        let Coefficients { red_v, green_u, green_v, blue_u, .. } = *coefficients;
        let [red_v, green_u, green_v, blue_u] = [red_v, green_u, green_v, blue_u].map(fixed);
        let centred = |sample: i16| (sample - 128) << 8;
        let [red, green, blue] = &mut self.samples;
        // A loop for each channel: the compiler computes several samples at a time.
        for (red, v) in red.iter_mut().zip(v.clone()) {
            *red = scaled(centred(v), red_v);
        }
        for ((green, u), v) in green.iter_mut().zip(u.clone()).zip(v) {
            *green = scaled(centred(u), green_u) + scaled(centred(v), green_v);
        }
        for (blue, u) in blue.iter_mut().zip(u) {
            *blue = scaled(centred(u), blue_u);
        }
        for (row, samples) in self.chroma.iter_mut().zip(&self.samples) {
            if across == 0 {
                row.copy_from_slice(samples);
            } else {
                for (pair, &sample) in row.chunks_exact_mut(2).zip(samples) {
                    pair.copy_from_slice(&[sample, sample]);
                }
            }
        }
    }

    fn convert(
        &mut self,
        coefficients: &Coefficients,
        luma: impl ExactSizeIterator<Item = i16> + Clone,
        out: &mut [u8],
    ) {
        // Luma is shifted by 7 bits, its coefficient by 14.
        let (of_luma, black) = ((coefficients.luma * f64::from(1 << 14)).round() as i16, coefficients.black as i16);
        let half = 1 << (FRACTION - 1);
        for (levels, chroma) in self.levels.iter_mut().zip(&self.chroma) {
            for ((level, luma), chroma) in levels.iter_mut().zip(luma.clone()).zip(chroma) {
                let sum = scaled((luma - black) << 7, of_luma) + chroma + half;
                *level = (sum >> FRACTION).clamp(0, 255) as u8;
            }
        }
        let [red, green, blue] = &self.levels;
        for (((pixel, red), green), blue) in out.chunks_exact_mut(3).zip(red).zip(green).zip(blue) {
            pixel.copy_from_slice(&[*red, *green, *blue]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::Matrix;
    use crate::picture::{PlaneSamples, SamplePlane};

    fn picture(samples: [u8; 3], depth: u8) -> Yuv {
        let shift = depth - 8;
        let planes = match depth {
            8 => PlaneSamples::Bytes(samples.map(|it| SamplePlane { samples: vec![it; 4], stride: 2 })),
            _ => PlaneSamples::Words(
                samples.map(|it| SamplePlane { samples: vec![u16::from(it) << shift; 4], stride: 2 }),
            ),
        };
        Yuv { size: (2, 2), origin: (0, 0), depth, chroma: Chroma::Subsampled(0, 0), planes }
    }

    /// All samples on a grid, for all matrices, ranges and depths, against the standard's formula in double precision. Sums
    /// of fixed-point terms are off by at most 3/32 of a level, so a rounded level is off by 1 where the exact one lies at a
    /// half.
    #[test]
    fn levels_are_those_of_the_standard() {
        let grid = || (0..=255u8).step_by(15);
        for matrix in [Matrix::Bt601, Matrix::Bt709, Matrix::Bt2020, Matrix::Fcc, Matrix::Smpte240] {
            for (full_range, depth) in [(false, 8), (true, 8), (false, 10), (true, 10), (false, 12)] {
                let colour = Colour { matrix, full_range, transfer: Transfer::Standard, is_stated: true };
                let converter = Converter::new(&colour, depth);
                let it = Coefficients::of(&colour);
                for (y, (u, v)) in grid().flat_map(|y| grid().flat_map(move |u| grid().map(move |v| (y, (u, v))))) {
                    let [level, u_difference, v_difference] =
                        [f64::from(y) - it.black, f64::from(u) - 128.0, f64::from(v) - 128.0];
                    let exact = [
                        it.luma * level + it.red_v * v_difference,
                        it.luma * level + it.green_u * u_difference + it.green_v * v_difference,
                        it.luma * level + it.blue_u * u_difference,
                    ];
                    let found = converter.rgb(&picture([y, u, v], depth)).get_pixel(1, 1).0;
                    for (found, exact) in found.into_iter().zip(exact) {
                        let off = (f64::from(found) - exact.clamp(0.0, 255.0)).abs();
                        assert!(off <= 0.5 + 3.0 / 32.0, "{found} for {exact}: {:?} {colour:?}", [y, u, v]);
                    }
                }
            }
        }
    }

    /// White, black and red of the standards' own examples.
    #[test]
    fn known_colours_come_out() {
        let limited =
            Colour { matrix: Matrix::Bt601, full_range: false, transfer: Transfer::Standard, is_stated: true };
        let rgb = |samples, depth| Converter::new(&limited, depth).rgb(&picture(samples, depth)).get_pixel(0, 0).0;
        for depth in [8, 10] {
            assert_eq!(rgb([235, 128, 128], depth), [255; 3]);
            assert_eq!(rgb([16, 128, 128], depth), [0; 3]);
            assert_eq!(rgb([81, 90, 240], depth), [254, 0, 0]);
        }
        let grey = |samples, depth| Converter::new(&limited, depth).grey(&picture(samples, depth)).get_pixel(0, 0).0;
        assert_eq!([grey([235, 0, 0], 8), grey([16, 0, 0], 10), grey([126, 9, 9], 10)], [[255], [0], [128]]);
    }
}

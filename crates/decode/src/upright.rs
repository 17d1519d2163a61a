//! Turning stored frames upright.

use image::{GrayImage, ImageBuffer, Pixel, RgbImage};

use crate::error::{CONVERT, DecodeError, Result};

/// Part of a matrix's larger entries below which the others are rounding.
const ROUNDING: f64 = 1e-3;

/// One of the eight ways in which a stored frame is turned and mirrored: first transposed, then flipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Orientation {
    /// Rows become columns.
    pub transposed: bool,
    /// Left becomes right, after the transposition.
    pub flipped_horizontally: bool,
    /// Top becomes bottom, after the transposition.
    pub flipped_vertically: bool,
}

impl Orientation {
    /// Stored upright.
    pub const UPRIGHT: Orientation =
        Orientation { transposed: false, flipped_horizontally: false, flipped_vertically: false };

    /// Whether width and height are exchanged.
    pub fn swaps_sides(self) -> bool {
        self.transposed
    }

    /// Width and height after the turn.
    pub fn size(self, (width, height): (u32, u32)) -> (u32, u32) {
        if self.transposed { (height, width) } else { (width, height) }
    }

    /// The angle by which frames are turned clockwise, degrees, and whether they are mirrored before.
    pub fn degrees(self) -> (u32, bool) {
        let Orientation { transposed, flipped_horizontally, flipped_vertically } = self;
        match (transposed, flipped_horizontally, flipped_vertically) {
            (false, false, false) => (0, false),
            (true, true, false) => (90, false),
            (false, true, true) => (180, false),
            (true, false, true) => (270, false),
            (false, true, false) => (0, true),
            (true, true, true) => (90, true),
            (false, false, true) => (180, true),
            (true, false, false) => (270, true),
        }
    }

    /// The orientation of a track's matrix followed by the movie's, and by how much they stretch a pixel's width more than
    /// its height. A matrix [a b u c d v x y w] maps (x, y) to (a x + c y, b x + d y), with y down.
    ///
    /// # Errors
    /// Angles other than multiples of 90 degrees.
    pub(crate) fn of_matrix(track: [i32; 9], movie: [i32; 9]) -> Result<(Self, f64)> {
        let plane = |matrix: [i32; 9]| {
            let plane = [matrix[0], matrix[1], matrix[3], matrix[4]].map(|entry| f64::from(entry) / 65536.0);
            // Some writers leave it empty.
            if plane == [0.0; 4] { [1.0, 0.0, 0.0, 1.0] } else { plane }
        };
        let ([a, b, c, d], [e, f, g, h]) = (plane(track), plane(movie));
        let [a, b, c, d] = [a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h];
        let negligible = |small: [f64; 2], large: [f64; 2]| {
            small.iter().all(|it| large.iter().all(|other| it.abs() <= ROUNDING * other.abs()))
                && large[0] * large[1] != 0.0
        };
        let stretch = a.hypot(b) / c.hypot(d);
        let stretch = if (stretch - 1.0).abs() <= ROUNDING { 1.0 } else { stretch };
        let (transposed, across, down) = match () {
            () if negligible([b, c], [a, d]) => (false, a, d),
            () if negligible([a, d], [b, c]) => (true, c, b),
            () => {
                let degrees = b.atan2(a).to_degrees();
                let what = format!("a video shown at {degrees:.1} degrees or sheared");
                return Err(DecodeError::Unsupported { what, remedy: CONVERT.into() });
            }
        };
        let turn = Orientation { transposed, flipped_horizontally: across < 0.0, flipped_vertically: down < 0.0 };
        Ok((turn, stretch))
    }

    /// Turns an RGB picture.
    pub(crate) fn turn_rgb(self, picture: RgbImage) -> RgbImage {
        self.turn(picture)
    }

    /// Turns a grey picture.
    pub(crate) fn turn_grey(self, picture: GrayImage) -> GrayImage {
        self.turn(picture)
    }

    fn turn<P: Pixel<Subpixel = u8>>(self, picture: ImageBuffer<P, Vec<u8>>) -> ImageBuffer<P, Vec<u8>> {
        if self == Orientation::UPRIGHT {
            return picture;
        }
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let (columns, rows) = if self.transposed { (height, width) } else { (width, height) };
        let channels = usize::from(P::CHANNEL_COUNT);
        let from = picture.as_raw();
        let mut to = vec![0; from.len()];
        for (y, row) in to.chunks_exact_mut(columns * channels).enumerate() {
            let y = if self.flipped_vertically { rows - 1 - y } else { y };
            for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
                let x = if self.flipped_horizontally { columns - 1 - x } else { x };
                let place = if self.transposed { x * width + y } else { y * width + x } * channels;
                pixel.copy_from_slice(&from[place..place + channels]);
            }
        }
        ImageBuffer::from_raw(columns as u32, rows as u32, to).expect("as many pixels as before")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    const ONE: i32 = 1 << 16;

    fn matrix(a: i32, b: i32, c: i32, d: i32) -> [i32; 9] {
        [a * ONE, b * ONE, 0, c * ONE, d * ONE, 0, 0, 0, 1 << 30]
    }

    /// The picture 1 2 / 3 4 / 5 6, turned by the definition of the matrix: the pixel at (x, y) goes to (a x + c y, b x + d y),
    /// shifted so that the smallest coordinates are 0.
    #[test]
    fn each_matrix_turns_the_pixels_as_it_is_defined() {
        let picture = GrayImage::from_fn(2, 3, |x, y| Luma([(1 + x + 2 * y) as u8]));
        for [a, b, c, d] in [
            [1, 0, 0, 1],
            [-1, 0, 0, 1],
            [1, 0, 0, -1],
            [-1, 0, 0, -1],
            [0, 1, 1, 0],
            [0, 1, -1, 0],
            [0, -1, 1, 0],
            [0, -1, -1, 0],
        ] {
            let (turn, stretch) = Orientation::of_matrix(matrix(a, b, c, d), matrix(1, 0, 0, 1)).unwrap();
            let turned = turn.turn_grey(picture.clone());
            assert_eq!((turned.dimensions(), stretch), (turn.size((2, 3)), 1.0));
            for (x, y, pixel) in picture.enumerate_pixels() {
                let (x, y) = (x as i32, y as i32);
                let least = |s: i32, t: i32| s.min(0) + 2 * t.min(0);
                let place = [a * x + c * y - least(a, c), b * x + d * y - least(b, d)];
                assert_eq!(turned.get_pixel(place[0] as u32, place[1] as u32), pixel, "{:?}", [a, b, c, d]);
            }
        }
    }

    #[test]
    fn matrices_multiply_and_stretch() {
        let quarter = matrix(0, 1, -1, 0);
        let (half, _) = Orientation::of_matrix(quarter, quarter).unwrap();
        assert_eq!(half.degrees(), (180, false));
        assert_eq!(Orientation::of_matrix([0; 9], [0; 9]).unwrap(), (Orientation::UPRIGHT, 1.0));
        let (wide, stretch) = Orientation::of_matrix(matrix(0, 2, -1, 0), matrix(1, 0, 0, 1)).unwrap();
        assert_eq!((wide.degrees(), stretch), ((90, false), 2.0));
        for odd in [matrix(1, 1, -1, 1), matrix(1, 0, 0, 0), matrix(1, 0, 1, 1)] {
            assert!(Orientation::of_matrix(odd, matrix(1, 0, 0, 1)).is_err(), "{odd:?}");
        }
    }
}

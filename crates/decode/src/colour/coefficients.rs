//! Coefficients from luma and colour differences to RGB.

use super::{Colour, Matrix};

/// Coefficients for samples of 8 bits, or scaled to them: `R = luma (Y - black) + red_v (V - 128)`, and so on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coefficients {
    pub black: f64,
    pub luma: f64,
    pub red_v: f64,
    pub green_u: f64,
    pub green_v: f64,
    pub blue_u: f64,
}

impl Matrix {
    /// Weights of red and blue in the luma (ITU-T H.273, table 4).
    fn weights(self) -> (f64, f64) {
        match self {
            Matrix::Bt601 => (0.299, 0.114),
            Matrix::Bt709 => (0.2126, 0.0722),
            Matrix::Bt2020 => (0.2627, 0.0593),
            Matrix::Fcc => (0.30, 0.11),
            Matrix::Smpte240 => (0.212, 0.087),
        }
    }
}

impl Coefficients {
    pub(super) fn of(colour: &Colour) -> Self {
        let (red, blue) = colour.matrix.weights();
        let green = 1.0 - red - blue;
        let (black, luma, chroma) =
            if colour.full_range { (0.0, 1.0, 2.0) } else { (16.0, 255.0 / 219.0, 2.0 * 255.0 / 224.0) };
        Coefficients {
            black,
            luma,
            red_v: chroma * (1.0 - red),
            green_u: -chroma * (1.0 - blue) * blue / green,
            green_v: -chroma * (1.0 - red) * red / green,
            blue_u: chroma * (1.0 - blue),
        }
    }
}

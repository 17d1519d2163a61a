//! Colour of a video: its tags, and the conversion of its samples to RGB.

mod coefficients;
mod convert;
mod hdr;

use crate::error::{DecodeError, Result};

pub(crate) use convert::Converter;

/// Colour tags by the code points of ITU-T H.273; `None` where nothing is stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Tags {
    pub primaries: Option<u8>,
    pub transfer: Option<u8>,
    pub matrix: Option<u8>,
    pub full_range: Option<bool>,
}

impl Tags {
    /// Tags of three code points, of which 0 (reserved, but for the matrix) and 2 state nothing.
    pub(crate) fn of_codes(primaries: u8, transfer: u8, matrix: u8) -> Self {
        let stated = |code: u8| (code != 0 && code != 2).then_some(code);
        let matrix = (matrix != 2).then_some(matrix);
        Tags { primaries: stated(primaries), transfer: stated(transfer), matrix, full_range: None }
    }

    /// These tags, and others where these state nothing.
    pub(crate) fn or(self, others: Tags) -> Tags {
        Tags {
            primaries: self.primaries.or(others.primaries),
            transfer: self.transfer.or(others.transfer),
            matrix: self.matrix.or(others.matrix),
            full_range: self.full_range.or(others.full_range),
        }
    }
}

/// Colour of a video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour {
    /// Weights of red, green and blue in the luma.
    pub matrix: Matrix,
    /// Whether black is 0 and white the largest number, not 16 and 235 (of 8 bits).
    pub full_range: bool,
    /// Transfer function.
    pub transfer: Transfer,
    /// Whether the file states its matrix. Where it does not, BT.601 is assumed, as ffmpeg does.
    pub is_stated: bool,
}

/// Weights of red, green and blue in the luma.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Matrix {
    /// ITU-R BT.601, standard definition.
    Bt601,
    /// ITU-R BT.709, high definition.
    Bt709,
    /// ITU-R BT.2020, ultra-high definition.
    Bt2020,
    /// FCC, 1953.
    Fcc,
    /// SMPTE 240M.
    Smpte240,
}

/// Transfer function from light to samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// Any of standard dynamic range; samples are shown as they are.
    Standard,
    /// Perceptual quantizer, SMPTE ST 2084: up to 10,000 cd/m2.
    Pq,
    /// Hybrid log-gamma, ITU-R BT.2100.
    Hlg,
}

impl Colour {
    /// Colour by the tags. JPEG's samples have the full range unless stated otherwise.
    ///
    /// # Errors
    /// Matrices that are none of luma and colour differences.
    pub(crate) fn of(tags: Tags, is_jpeg: bool) -> Result<Self> {
        let transfer = match tags.transfer {
            Some(16) => Transfer::Pq,
            Some(18) => Transfer::Hlg,
            _ => Transfer::Standard,
        };
        let matrix = match tags.matrix {
            Some(1) => Matrix::Bt709,
            Some(4) => Matrix::Fcc,
            Some(5 | 6) => Matrix::Bt601,
            Some(7) => Matrix::Smpte240,
            Some(9 | 10) => Matrix::Bt2020,
            None if transfer != Transfer::Standard => Matrix::Bt2020,
            None => Matrix::Bt601,
            Some(code) => {
                return Err(DecodeError::unsupported(format!("a video with the colour matrix {code} of H.273")));
            }
        };
        let full_range = tags.full_range.unwrap_or(is_jpeg);
        Ok(Colour { matrix, full_range, transfer, is_stated: tags.matrix.is_some() })
    }
}

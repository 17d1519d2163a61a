//! Decoded frames as their decoder leaves them.

use std::sync::Arc;

use image::RgbImage;

/// A decoded frame before it is turned.
#[derive(Clone)]
pub(crate) enum DecodedPicture {
    Yuv(Yuv),
    Rgb(RgbImage),
}

/// Planes of luma and chroma.
#[derive(Clone)]
pub(crate) struct Yuv {
    /// Size of the visible part, pixels.
    pub size: (usize, usize),
    /// Where the visible part begins in the luma plane.
    pub origin: (usize, usize),
    /// Bits of a sample.
    pub depth: u8,
    pub chroma: Chroma,
    pub planes: PlaneSamples,
}

/// Resolution of the chroma planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Chroma {
    /// No chroma planes.
    None,
    /// Logarithms of the luma samples for each chroma sample, across and down.
    Subsampled(usize, usize),
}

/// Samples, owned or shared with their decoder.
#[derive(Clone)]
pub(crate) enum PlaneSamples {
    Bytes([SamplePlane<u8>; 3]),
    Words([SamplePlane<u16>; 3]),
    Hevc(Arc<rusty_h265::Picture>),
}

/// One plane.
#[derive(Clone)]
pub(crate) struct SamplePlane<T> {
    pub samples: Vec<T>,
    pub stride: usize,
}

/// A row of samples.
#[derive(Debug, Clone, Copy)]
pub(crate) enum SampleRow<'a> {
    Bytes(&'a [u8]),
    Words(&'a [u16]),
}

impl Yuv {
    /// Size of a plane's visible part, samples.
    pub(crate) fn plane_size(&self, plane: usize) -> (usize, usize) {
        match (plane, self.chroma) {
            (0, _) => self.size,
            (_, Chroma::None) => (0, 0),
            (_, Chroma::Subsampled(x, y)) => (self.size.0.div_ceil(1 << x), self.size.1.div_ceil(1 << y)),
        }
    }

    /// The visible part of a plane's row.
    pub(crate) fn row(&self, plane: usize, row: usize) -> SampleRow<'_> {
        let (x, y) = match (plane, self.chroma) {
            (0, _) | (_, Chroma::None) => self.origin,
            (_, Chroma::Subsampled(x, y)) => (self.origin.0 >> x, self.origin.1 >> y),
        };
        let width = self.plane_size(plane).0;
        let range = |stride: usize| (y + row) * stride + x..(y + row) * stride + x + width;
        match &self.planes {
            PlaneSamples::Bytes(planes) => SampleRow::Bytes(&planes[plane].samples[range(planes[plane].stride)]),
            PlaneSamples::Words(planes) => SampleRow::Words(&planes[plane].samples[range(planes[plane].stride)]),
            PlaneSamples::Hevc(picture) => {
                SampleRow::Words(&picture.planes[plane].data[range(picture.planes[plane].stride)])
            }
        }
    }

    /// Appends the visible samples, plane by plane: bytes at 8 bits, else little-endian pairs of bytes.
    pub(crate) fn append_raw(&self, raw: &mut Vec<u8>) {
        for plane in 0..3 {
            for row in 0..self.plane_size(plane).1 {
                match self.row(plane, row) {
                    SampleRow::Bytes(samples) => raw.extend_from_slice(samples),
                    SampleRow::Words(samples) if self.depth == 8 => {
                        raw.extend(samples.iter().map(|&sample| sample as u8))
                    }
                    SampleRow::Words(samples) => raw.extend(samples.iter().flat_map(|sample| sample.to_le_bytes())),
                }
            }
        }
    }
}

impl DecodedPicture {
    /// Size before it is turned, pixels.
    pub(crate) fn size(&self) -> (u32, u32) {
        match self {
            DecodedPicture::Yuv(yuv) => (yuv.size.0 as u32, yuv.size.1 as u32),
            DecodedPicture::Rgb(picture) => picture.dimensions(),
        }
    }

    /// Bytes that it holds, nearly.
    pub(crate) fn bytes(&self) -> usize {
        let (width, height) = self.size();
        width as usize * height as usize * 3
    }
}

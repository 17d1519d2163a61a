//! Motion JPEG: frames of baseline JPEG (ITU-T T.81), 8 bits, grey or luma and chroma.

use super::jpeg_huffman::{Codes, Scan, usual};
use super::jpeg_idct::inverse;
use super::{Decode, StreamFacts, check_same};
use crate::bytes::Bytes;
use crate::error::{DecodeError, Result};
use crate::limits::check_size;
use crate::picture::{Chroma, DecodedPicture, PlaneSamples, SamplePlane, Yuv};

/// Places of the coefficients in the order in which they are coded (figure A.6).
#[rustfmt::skip]
const ZIGZAG: [usize; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21, 28,
    35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
];
/// Value of a first coefficient that stands for the middle of the range.
const MIDDLE: i32 = 1024;

/// A decoder; tables stay from frame to frame.
pub(super) struct Mjpeg {
    /// By number and, in the upper half, class.
    codes: [Option<Codes>; 32],
    quantizers: [Option<[u16; 64]>; 4],
    size: Option<(u32, u32)>,
}

/// A component of a frame.
#[derive(Debug, Clone, Copy)]
struct Component {
    id: u8,
    /// Blocks of a unit, across and down.
    across: usize,
    down: usize,
    quantizer: usize,
    /// Tables of codes, set by the scan.
    dc: usize,
    ac: usize,
}

struct JpegHeader {
    size: (u32, u32),
    components: Vec<Component>,
}

impl Mjpeg {
    pub(super) fn new() -> Self {
        let mut codes = std::array::from_fn(|_| None);
        for (number, table) in usual() {
            codes[usize::from(number)] = Some(table);
        }
        Mjpeg { codes, quantizers: [None; 4], size: None }
    }

    fn picture(&mut self, packet: &[u8]) -> Result<Yuv> {
        let (mut bytes, mut header, mut restart) = (Bytes(packet), None, 0);
        loop {
            let marker = marker(&mut bytes)?;
            if matches!(marker, 0xd8 | 1 | 0xd0..=0xd7) {
                continue;
            }
            let length = usize::from(bytes.u16()?);
            let mut segment = Bytes(bytes.take(length.saturating_sub(2))?);
            match marker {
                0xc0 | 0xc1 => header = Some(self.header(&mut segment)?),
                0xc4 => self.take_codes(&mut segment)?,
                0xdb => self.take_quantizers(&mut segment)?,
                0xdd => restart = usize::from(segment.u16()?),
                0xda => {
                    let mut header =
                        header.ok_or_else(|| DecodeError::corrupt("JPEG: a scan comes before its frame"))?;
                    choose_codes(&mut segment, &mut header.components)?;
                    let (yuv, end) = self.scan(bytes.0, &header, restart)?;
                    // A second picture is the other field.
                    if bytes.0[end..].windows(3).any(|it| it == [0xff, 0xd8, 0xff]) {
                        return Err(DecodeError::unsupported("interlaced Motion JPEG"));
                    }
                    return Ok(yuv);
                }
                0xc2 | 0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => {
                    return Err(DecodeError::unsupported("progressive, lossless or arithmetic-coded JPEG"));
                }
                0xd9 => return Err(DecodeError::corrupt("JPEG: a frame holds no picture")),
                _ => {}
            }
        }
    }

    fn header(&mut self, segment: &mut Bytes) -> Result<JpegHeader> {
        let depth = segment.u8()?;
        let (height, width) = (u32::from(segment.u16()?), u32::from(segment.u16()?));
        check_size(width, height)?;
        check_same(&mut self.size, (width, height))?;
        let count = segment.u8()?;
        if depth != 8 || !matches!(count, 1 | 3) {
            return Err(DecodeError::unsupported(format!("JPEG with {depth} bits and {count} components")));
        }
        let mut components = Vec::new();
        for _ in 0..count {
            let (id, factors, quantizer) = (segment.u8()?, segment.u8()?, segment.u8()?);
            let (across, down) = (usize::from(factors >> 4), usize::from(factors & 15));
            components.push(Component { id, across, down, quantizer: usize::from(quantizer & 3), dc: 0, ac: 0 });
        }
        let factors: Vec<_> = components.iter().map(|it| (it.across, it.down)).collect();
        let fits = |luma: usize, chroma: usize| (1..=4).contains(&chroma) && (luma == chroma || luma == 2 * chroma);
        let is_known = match factors.as_slice() {
            [luma, u, v] => u == v && luma.0 <= 4 && luma.1 <= 4 && fits(luma.0, u.0) && fits(luma.1, u.1),
            grey => grey.len() == 1,
        };
        if !is_known {
            return Err(DecodeError::unsupported(format!("JPEG with sampling factors {factors:?}")));
        }
        if let [grey] = components.as_mut_slice() {
            (grey.across, grey.down) = (1, 1);
        }
        Ok(JpegHeader { size: (width, height), components })
    }

    fn take_codes(&mut self, segment: &mut Bytes) -> Result<()> {
        while !segment.0.is_empty() {
            let number = usize::from(segment.u8()?);
            let mut counts = [0; 16];
            counts.copy_from_slice(segment.take(16)?);
            let values = segment.take(counts.iter().map(|count| usize::from(*count)).sum())?;
            let place =
                self.codes.get_mut(number).ok_or_else(|| DecodeError::corrupt("JPEG: a table has no such number"))?;
            *place = Some(Codes::new(&counts, values)?);
        }
        Ok(())
    }

    fn take_quantizers(&mut self, segment: &mut Bytes) -> Result<()> {
        while !segment.0.is_empty() {
            let number = segment.u8()?;
            let mut table = [0; 64];
            for place in ZIGZAG {
                table[place] = if number >> 4 == 0 { segment.u8()?.into() } else { segment.u16()? };
            }
            self.quantizers[usize::from(number & 3)] = Some(table);
        }
        Ok(())
    }

    /// Decodes a scan of all components; returns the place after it.
    fn scan(&self, bytes: &[u8], header: &JpegHeader, restart: usize) -> Result<(Yuv, usize)> {
        let JpegHeader { size: (width, height), components } = header;
        let (width, height) = (*width as usize, *height as usize);
        let (across, down) = (components[0].across, components[0].down);
        let (columns, rows) = (width.div_ceil(8 * across), height.div_ceil(8 * down));
        // Each block has two bits at least.
        if columns * rows * components.iter().map(|it| it.across * it.down).sum::<usize>() > 4 * bytes.len() + 4 {
            return Err(DecodeError::corrupt("JPEG: the picture ends too early"));
        }
        let mut planes: [SamplePlane<u8>; 3] = std::array::from_fn(|_| SamplePlane { samples: Vec::new(), stride: 0 });
        for (plane, it) in planes.iter_mut().zip(components) {
            let stride = 8 * columns * it.across;
            *plane = SamplePlane { samples: vec![0; stride * 8 * rows * it.down], stride };
        }
        let (mut scan, mut last) = (Scan::new(bytes), [MIDDLE; 3]);
        for unit in 0..columns * rows {
            if restart > 0 && unit > 0 && unit.is_multiple_of(restart) {
                scan.restart()?;
                last = [MIDDLE; 3];
            }
            for ((it, plane), last) in components.iter().zip(&mut planes).zip(&mut last) {
                for block in 0..it.across * it.down {
                    let x = 8 * (unit % columns * it.across + block % it.across);
                    let y = 8 * (unit / columns * it.down + block / it.across);
                    let levels = inverse(&self.block(&mut scan, it, last)?);
                    for (row, levels) in levels.chunks_exact(8).enumerate() {
                        let place = (y + row) * plane.stride + x;
                        plane.samples[place..place + 8].copy_from_slice(levels);
                    }
                }
            }
            scan.check()?;
        }
        let chroma = match components.as_slice() {
            [_, chroma, ..] => Chroma::Subsampled(across / chroma.across - 1, down / chroma.down - 1),
            _ => Chroma::None,
        };
        let yuv = Yuv { size: (width, height), origin: (0, 0), depth: 8, chroma, planes: PlaneSamples::Bytes(planes) };
        Ok((yuv, scan.place()))
    }

    /// Coefficients of a block in row order, multiplied by their quantizers.
    fn block(&self, scan: &mut Scan, it: &Component, last: &mut i32) -> Result<[i16; 64]> {
        let missing = || DecodeError::corrupt("JPEG: a table is missing");
        let table = |number: usize| self.codes[number].as_ref().ok_or_else(missing);
        let quantizer = self.quantizers[it.quantizer].as_ref().ok_or_else(missing)?;
        let (dc, ac) = (table(it.dc)?, table(0x10 + it.ac)?);
        let mut coefficients = [0; 64];
        let bits = scan.value(dc)?;
        if bits > 15 {
            return Err(DecodeError::corrupt("JPEG: a coefficient is damaged"));
        }
        *last = last.wrapping_add(scan.signed(bits).wrapping_mul(quantizer[0].into()));
        coefficients[0] = (*last).clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        let mut place = 1;
        while place < 64 {
            let value = scan.value(ac)?;
            let (zeros, bits) = (usize::from(value >> 4), value & 15);
            match (zeros, bits) {
                (15, 0) => place += 16,
                (_, 0) => break,
                _ => {
                    place += zeros;
                    let level = scan.signed(bits);
                    let at = *ZIGZAG.get(place).ok_or_else(|| DecodeError::corrupt("JPEG: a block is too long"))?;
                    coefficients[at] = level.wrapping_mul(quantizer[at].into()) as i16;
                    place += 1;
                }
            }
        }
        Ok(coefficients)
    }
}

/// The next marker; bytes before it are passed over.
fn marker(bytes: &mut Bytes) -> Result<u8> {
    loop {
        if bytes.u8()? == 0xff {
            let marker = loop {
                match bytes.u8()? {
                    0xff => {}
                    marker => break marker,
                }
            };
            if marker != 0 {
                return Ok(marker);
            }
        }
    }
}

/// Sets the tables that a scan chooses; all components must be in one scan.
fn choose_codes(segment: &mut Bytes, components: &mut [Component]) -> Result<()> {
    if usize::from(segment.u8()?) != components.len() {
        return Err(DecodeError::unsupported("JPEG with several scans"));
    }
    for it in components {
        let (id, tables) = (segment.u8()?, segment.u8()?);
        if id != it.id {
            return Err(DecodeError::corrupt("JPEG: the components of a scan are in another order"));
        }
        (it.dc, it.ac) = (usize::from(tables >> 4), usize::from(tables & 15));
    }
    Ok(())
}

impl Decode for Mjpeg {
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()> {
        ready.push(DecodedPicture::Yuv(self.picture(packet)?));
        Ok(())
    }

    fn finish(&mut self, _: &mut Vec<DecodedPicture>) -> Result<()> {
        Ok(())
    }

    fn facts(&self) -> StreamFacts {
        StreamFacts { depth: 8, ..StreamFacts::default() }
    }
}

//! Usability information that H.264 and HEVC have in common (ITU-T H.264, E.1.1; H.265, E.2.1).

use crate::bits::Bits;
use crate::colour::Tags;
use crate::error::Result;

/// Aspects of a pixel by their code (H.264, table E-1).
const ASPECTS: [(u32, u32); 17] = [
    (0, 0),
    (1, 1),
    (12, 11),
    (10, 11),
    (16, 11),
    (40, 33),
    (24, 11),
    (20, 11),
    (32, 11),
    (80, 33),
    (18, 11),
    (15, 11),
    (64, 33),
    (160, 99),
    (4, 3),
    (3, 2),
    (2, 1),
];
/// Code of an aspect that is written out.
const EXTENDED: u32 = 255;

/// Aspect of a pixel and colour.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Signal {
    pub pixel_aspect: Option<f64>,
    pub colour: Tags,
}

/// Reads the fields up to the place of the chroma samples.
pub(super) fn signal(bits: &mut Bits) -> Result<Signal> {
    let mut signal = Signal::default();
    if bits.bit()? {
        let (width, height) = match bits.bits(8)? {
            EXTENDED => (bits.bits(16)?, bits.bits(16)?),
            code => ASPECTS.get(code as usize).copied().unwrap_or_default(),
        };
        signal.pixel_aspect = (width > 0 && height > 0).then(|| f64::from(width) / f64::from(height));
    }
    // Overscan.
    if bits.bit()? {
        bits.bit()?;
    }
    if bits.bit()? {
        bits.bits(3)?;
        let full_range = bits.bit()?;
        if bits.bit()? {
            let mut code = || bits.bits(8).map(|code| code as u8);
            signal.colour = Tags::of_codes(code()?, code()?, code()?);
        }
        signal.colour.full_range = Some(full_range);
    }
    if bits.bit()? {
        bits.ue()?;
        bits.ue()?;
    }
    Ok(signal)
}

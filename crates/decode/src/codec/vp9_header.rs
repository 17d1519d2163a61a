//! The beginning of a VP9 frame's header (VP9 bitstream specification, 6.2): size, depth and colour, before the decoder makes
//! room for them.

use super::PacketRole;
use crate::bits::Bits;
use crate::colour::Tags;
use crate::error::{DecodeError, Result};
use crate::limits::check_size;

/// Colour space of a frame of RGB.
const RGB: u32 = 7;

/// What a frame's header states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vp9Header {
    pub is_key: bool,
    /// Whether the frame, or one before that it names, is shown.
    pub is_shown: bool,
    /// Size, where it is written out and not that of a reference.
    pub size: Option<(u32, u32)>,
    /// Depth and colour of a key frame.
    pub format: Option<(u8, Tags)>,
}

/// The frames of a packet, which may hold several and an index of their sizes (annex B).
pub(super) fn frames(packet: &[u8]) -> Vec<&[u8]> {
    let Some(&marker) = packet.last() else { return Vec::new() };
    let (count, width) = (usize::from(marker & 7) + 1, usize::from(marker >> 3 & 3) + 1);
    let index = packet.len().checked_sub(2 + count * width).filter(|&at| marker >> 5 == 6 && packet[at] == marker);
    let Some(index) = index else { return vec![packet] };
    let (mut rest, mut frames) = (&packet[..index], Vec::new());
    for size in packet[index + 1..packet.len() - 1].chunks_exact(width) {
        let size = size.iter().rev().fold(0, |size, &byte| size << 8 | usize::from(byte));
        let Some((frame, after)) = rest.split_at_checked(size) else { break };
        frames.push(frame);
        rest = after;
    }
    frames
}

impl Vp9Header {
    pub(super) fn read(frame: &[u8]) -> Result<Self> {
        let mut bits = Bits::plain(&frame[..frame.len().min(64)]);
        if bits.bits(2)? != 2 {
            return Err(DecodeError::corrupt("VP9: a frame has no marker"));
        }
        let profile = u32::from(bits.bit()?) + 2 * u32::from(bits.bit()?);
        if profile == 3 {
            bits.bit()?;
        }
        let mut header = Vp9Header { is_key: false, is_shown: true, size: None, format: None };
        if bits.bit()? {
            return Ok(header);
        }
        header.is_key = !bits.bit()?;
        header.is_shown = bits.bit()?;
        let resilient = bits.bit()?;
        if header.is_key {
            bits.skip(24)?;
            header.format = Some(format(&mut bits, profile)?);
            header.size = Some(size(&mut bits)?);
        } else {
            let intra = !header.is_shown && bits.bit()?;
            if !resilient {
                bits.skip(2)?;
            }
            if intra {
                bits.skip(24)?;
                if profile > 0 {
                    format(&mut bits, profile)?;
                }
                bits.skip(8)?;
                header.size = Some(size(&mut bits)?);
            } else {
                bits.skip(8 + 3 * 4)?;
                let of_reference = bits.bit()? || bits.bit()? || bits.bit()?;
                header.size = if of_reference { None } else { Some(size(&mut bits)?) };
            }
        }
        Ok(header)
    }
}

fn size(bits: &mut Bits) -> Result<(u32, u32)> {
    let (width, height) = (bits.bits(16)? + 1, bits.bits(16)? + 1);
    check_size(width, height)?;
    Ok((width, height))
}

fn format(bits: &mut Bits, profile: u32) -> Result<(u8, Tags)> {
    let depth = match profile {
        0 | 1 => 8,
        _ if bits.bit()? => 12,
        _ => 10,
    };
    let space = bits.bits(3)?;
    if space == RGB {
        return Err(DecodeError::unsupported("VP9 in RGB"));
    }
    // Code points of H.273 by VP9's.
    let matrix = [2, 6, 1, 6, 7, 9, 2][space as usize];
    let mut tags = Tags::of_codes(2, 2, matrix);
    let full_range = bits.bit()?;
    tags.full_range = (space != 0 || full_range).then_some(full_range);
    if matches!(profile, 1 | 3) {
        bits.skip(3)?;
    }
    Ok((depth, tags))
}

/// The role of a packet.
pub(super) fn role(packet: &[u8]) -> PacketRole {
    // A packet that is cut off has no index; those that have one show a frame.
    match Vp9Header::read(packet) {
        Ok(header) if header.is_key => PacketRole::Entry,
        Ok(header) if !header.is_shown && packet.len() < super::ROLE_BYTES as usize && frames(packet).len() == 1 => {
            PacketRole::Hidden
        }
        _ => PacketRole::Picture,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_is_split_by_its_index() {
        // Two frames of 2 and 1 bytes, sizes in one byte each: marker 110 00 001.
        let packet = [7, 8, 9, 0xc1, 2, 1, 0xc1];
        assert_eq!(frames(&packet), [&[7, 8][..], &[9]]);
        assert_eq!(frames(&packet[..6]), [&packet[..6]]);
        assert!(frames(&[0xc1, 200, 1, 0xc1]).is_empty());
        assert!(frames(&[]).is_empty());
    }

    #[test]
    fn absurd_sizes_are_refused_before_they_are_decoded() {
        // Marker 10, profile 00, no repetition, key frame, shown, not resilient; sync code; BT.601; 65536 x 65536.
        let mut key = vec![0b1000_0010, 0x49, 0x83, 0x42, 0b0010_1111];
        key.extend([0xff; 8]);
        assert!(matches!(Vp9Header::read(&key), Err(DecodeError::TooLarge { .. })));
    }
}

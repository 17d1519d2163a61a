//! NAL units in packets: after their lengths (mp4) or after start codes (Annex B).

use std::result::Result;

use crate::error::DecodeError;

/// The NAL units of a packet. One that is longer than the packet ends it with an error.
pub(super) fn units<'a>(
    packet: &'a [u8],
    length_bytes: Option<usize>,
) -> Box<dyn Iterator<Item = Result<&'a [u8], DecodeError>> + 'a> {
    match length_bytes {
        Some(length_bytes) => Box::new(by_length(packet, length_bytes)),
        None => Box::new(by_start_code(packet).map(Ok)),
    }
}

fn by_length(packet: &[u8], length_bytes: usize) -> impl Iterator<Item = Result<&[u8], DecodeError>> {
    let mut rest = packet;
    std::iter::from_fn(move || {
        let (length, after) = rest.split_at_checked(length_bytes)?;
        let length = usize::try_from(crate::bytes::big_endian(length)).ok();
        let unit = length.and_then(|length| after.split_at_checked(length));
        rest = unit.map_or(&[], |unit| unit.1);
        Some(unit.map(|unit| unit.0).ok_or_else(|| DecodeError::corrupt("a NAL unit is longer than its packet")))
    })
    .filter(|unit| !matches!(unit, Ok([])))
}

fn by_start_code(packet: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = after_start_code(packet);
    std::iter::from_fn(move || {
        let unit = rest?;
        let end = unit.windows(3).position(|it| it == [0, 0, 1]).unwrap_or(unit.len());
        rest = after_start_code(&unit[end..]);
        // Zeros before the next start code belong to no unit.
        let used = unit[..end].iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        Some(&unit[..used])
    })
    .filter(|unit| !unit.is_empty())
}

fn after_start_code(bytes: &[u8]) -> Option<&[u8]> {
    let place = bytes.windows(3).position(|it| it == [0, 0, 1])?;
    Some(&bytes[place + 3..])
}

/// The type of the first NAL unit that is wanted, in a packet that may be cut off after its first bytes; an error if the cut
/// comes before it.
pub(super) fn first_kind(
    packet: &[u8],
    length_bytes: Option<usize>,
    kind: impl Fn(&[u8]) -> u8,
    is_wanted: impl Fn(u8) -> bool,
) -> Result<Option<u8>, ()> {
    let Some(bytes) = length_bytes else {
        return Ok(units(packet, None).flatten().map(kind).find(|kind| is_wanted(*kind)));
    };
    let mut at = 0usize;
    while let Some(head) = packet.get(at..).and_then(|rest| rest.get(..bytes + 1)) {
        let kind = kind(&head[bytes..]);
        if is_wanted(kind) {
            return Ok(Some(kind));
        }
        at = at.saturating_add(bytes).saturating_add(crate::bytes::big_endian(&head[..bytes]) as usize);
    }
    if packet.len() as u64 == super::ROLE_BYTES { Err(()) } else { Ok(None) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(packet: &[u8], length_bytes: Option<usize>) -> Vec<Option<Vec<u8>>> {
        units(packet, length_bytes).map(|unit| unit.ok().map(Vec::from)).collect()
    }

    #[test]
    fn units_are_found_by_length_and_by_start_code() {
        let expected = [Some(vec![1, 2]), Some(vec![3])];
        assert_eq!(of(&[0, 2, 1, 2, 0, 0, 0, 1, 3], Some(2)), expected);
        assert_eq!(of(&[0, 0, 0, 1, 1, 2, 0, 0, 0, 1, 3, 0], None), expected);
        assert_eq!(of(&[0, 5, 1, 2], Some(2)), [None]);
        assert_eq!(of(&[1, 2, 3], None), []);
    }
}

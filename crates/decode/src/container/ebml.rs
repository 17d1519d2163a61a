//! Elements of EBML: an id, a size, a payload (RFC 8794).

use crate::bytes::big_endian;
use crate::error::{DecodeError, Result};

/// Id of the header with which a file begins.
pub(super) const HEADER: u32 = 0x1a45_dfa3;

/// An element's id and payload.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element<'a> {
    pub id: u32,
    pub payload: &'a [u8],
}

/// Id, bytes of the header, and size of the payload, which may be unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Head {
    pub id: u32,
    pub length: u64,
    pub size: Option<u64>,
}

/// Most bytes of a head: four of the id, eight of the size.
pub(super) const LONGEST_HEAD: u64 = 12;

/// Reads an element's head.
pub(super) fn head(bytes: &[u8]) -> Result<Head> {
    let (id, id_length) = number(bytes, true).filter(|it| it.1 <= 4).ok_or_else(damaged)?;
    let (size, size_length) = number(&bytes[id_length..], false).ok_or_else(damaged)?;
    // All bits set: the size is unknown.
    let unknown = size == (1 << (7 * size_length)) - 1;
    Ok(Head { id: id as u32, length: (id_length + size_length) as u64, size: (!unknown).then_some(size) })
}

fn damaged() -> DecodeError {
    DecodeError::corrupt("an element of its container is damaged")
}

/// A number of variable length and its bytes; `whole` keeps the bit that marks the length.
pub(super) fn number(bytes: &[u8], whole: bool) -> Option<(u64, usize)> {
    let first = *bytes.first()?;
    let length = first.leading_zeros() as usize + 1;
    let number = big_endian(bytes.get(..length).filter(|_| length <= 8)?);
    Some((if whole { number } else { number & ((1 << (7 * length)) - 1) }, length))
}

/// The elements in a payload; ends at the first that is damaged or too long.
pub(super) fn elements(payload: &[u8]) -> impl Iterator<Item = Element<'_>> {
    let mut rest = payload;
    std::iter::from_fn(move || {
        let Head { id, length, size } = head(rest).ok()?;
        let start = length as usize;
        let end = start.checked_add(usize::try_from(size?).ok()?)?;
        let payload = rest.get(start..end)?;
        rest = &rest[end..];
        Some(Element { id, payload })
    })
}

/// The payload of the first element of this id.
pub(super) fn find(payload: &[u8], id: u32) -> Option<&[u8]> {
    elements(payload).find(|it| it.id == id).map(|it| it.payload)
}

/// An unsigned number in an element.
pub(super) fn unsigned(payload: &[u8], id: u32) -> Option<u64> {
    find(payload, id).filter(|it| it.len() <= 8).map(big_endian)
}

/// A floating-point number in an element.
pub(super) fn float(payload: &[u8], id: u32) -> Option<f64> {
    let bytes = find(payload, id)?;
    match bytes.len() {
        4 => Some(f32::from_bits(big_endian(bytes) as u32).into()),
        8 => Some(f64::from_bits(big_endian(bytes))),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_are_read_as_the_standard_has_them() {
        assert_eq!(head(&[0x1a, 0x45, 0xdf, 0xa3, 0x9f]).unwrap(), Head { id: HEADER, length: 5, size: Some(31) });
        assert_eq!(head(&[0xec, 0x40, 2]).unwrap(), Head { id: 0xec, length: 3, size: Some(2) });
        // Sizes that are unknown, in one and in eight bytes.
        assert_eq!(head(&[0xec, 0xff]).unwrap().size, None);
        assert_eq!(head(&[0xec, 1, 255, 255, 255, 255, 255, 255, 255]).unwrap().size, None);
        for damaged in [&[][..], &[0xec], &[0, 0, 0], &[8, 0, 0, 0, 0, 0x81], &[0xec, 0x40]] {
            assert!(head(damaged).is_err(), "{damaged:?}");
        }
        assert_eq!(elements(&[0xec, 0x82, 1, 2, 0xed, 0x83, 1]).count(), 1);
    }
}

//! The boxes of mp4 and mov: a size, a name of four letters, a payload (ISO/IEC 14496-12, 4.2).

use crate::bytes::{Bytes, big_endian};
use crate::error::{DecodeError, Result};

/// Names with which a file may begin.
pub(super) const TOP_LEVEL: [&[u8; 4]; 10] =
    [b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot", b"styp", b"uuid", b"sidx"];

/// A box within a parent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Box<'a> {
    pub name: [u8; 4],
    pub payload: &'a [u8],
}

/// The boxes in a payload. Ends at the first that claims more than its parent holds.
pub(super) fn boxes(payload: &[u8]) -> impl Iterator<Item = Box<'_>> {
    let mut rest = payload;
    std::iter::from_fn(move || {
        let header = rest.get(..8)?;
        let name = [header[4], header[5], header[6], header[7]];
        let (start, size) = match big_endian(&header[..4]) {
            0 => (8, rest.len() as u64),
            1 => (16, big_endian(rest.get(8..16)?)),
            size => (8, size),
        };
        let payload = rest.get(start..usize::try_from(size).ok()?)?;
        rest = &rest[start + payload.len()..];
        Some(Box { name, payload })
    })
}

/// The payload of the first box of this name.
pub(super) fn find<'a>(payload: &'a [u8], name: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(payload).find(|it| it.name == *name).map(|it| it.payload)
}

/// The same along a path of nested boxes.
pub(super) fn find_path<'a>(payload: &'a [u8], path: &[&[u8; 4]]) -> Option<&'a [u8]> {
    path.iter().try_fold(payload, |payload, name| find(payload, name))
}

/// The payload of a box that must be there.
pub(super) fn need<'a>(payload: &'a [u8], name: &[u8; 4]) -> Result<&'a [u8]> {
    find(payload, name).ok_or_else(|| DecodeError::corrupt(format!("it has no box \"{}\"", name.escape_ascii())))
}

/// Version and flags of a full box, and what follows.
pub(super) fn full(payload: &[u8]) -> Result<(u8, u32, Bytes<'_>)> {
    let mut bytes = Bytes(payload);
    let head = bytes.u32()?;
    Ok(((head >> 24) as u8, head & 0xff_ffff, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_end_with_the_first_that_is_too_long() {
        let bytes = [&b"\0\0\0\x0aabcd12"[..], b"\0\0\0\x01long\0\0\0\0\0\0\0\x11x", b"\0\0\0\x09efgh"].concat();
        let found: Vec<_> = boxes(&bytes).map(|it| (it.name, it.payload)).collect();
        assert_eq!(found, [(*b"abcd", &b"12"[..]), (*b"long", b"x")]);
        // Sizes below the header's own end it, too.
        assert_eq!(boxes(b"\0\0\0\x07abcdefgh").count(), 0);
        assert_eq!(boxes(&[[0xff; 8], [0; 8]].concat()).count(), 0);
        assert_eq!(find(b"\0\0\0\0last!", b"last"), Some(&b"!"[..]));
    }
}

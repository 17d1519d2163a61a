//! Tags of cameras in mp4 and mov: keys and values (Apple's QuickTime File Format, "Metadata").

use super::boxes::{boxes, find};
use crate::bytes::Bytes;
use crate::error::{Result, printable};

/// Most tags kept.
const MOST_TAGS: usize = 64;
/// The tag of Android's cameras for the frame rate of the recording; slow motion is stored at another.
const CAPTURE_RATE: &str = "com.android.capture.fps";
/// Types of a value: text, and numbers, most significant byte first.
const TEXT: u32 = 1;
const SIGNED: u32 = 21;
const UNSIGNED: u32 = 22;
const FLOAT: u32 = 23;
const DOUBLE: u32 = 24;

/// The tags of a movie. Damaged ones are left out: the video does not depend on them.
pub(super) fn read(movie: &[u8]) -> Vec<(String, String)> {
    let metas = [Some(movie), find(movie, b"udta")].into_iter().flatten().filter_map(|parent| find(parent, b"meta"));
    metas.flat_map(|meta| of_meta(meta).unwrap_or_default()).take(MOST_TAGS).collect()
}

/// The capture rate among tags, frames a second.
pub(super) fn capture_rate(tags: &[(String, String)]) -> Option<f64> {
    let (_, value) = tags.iter().find(|(key, _)| key == CAPTURE_RATE)?;
    value.parse().ok().filter(|rate: &f64| rate.is_finite() && *rate > 0.0)
}

fn of_meta(meta: &[u8]) -> Result<Vec<(String, String)>> {
    // QuickTime's box has no version, that of ISO has.
    let is_plain = meta.get(4..8) == Some(b"hdlr");
    let inner = if is_plain { meta } else { meta.get(4..).unwrap_or_default() };
    let (Some(keys), Some(list)) = (find(inner, b"keys"), find(inner, b"ilst")) else { return Ok(Vec::new()) };
    let mut bytes = Bytes(keys);
    bytes.take(8)?;
    let names: Vec<_> = boxes(bytes.0).map(|key| printable(&String::from_utf8_lossy(key.payload))).collect();
    let tag = |item: super::boxes::Box<'_>| {
        let name = names.get((u32::from_be_bytes(item.name) as usize).checked_sub(1)?)?;
        Some((name.clone(), value(find(item.payload, b"data")?).ok()?))
    };
    Ok(boxes(list).filter_map(tag).collect())
}

fn value(data: &[u8]) -> Result<String> {
    let mut bytes = Bytes(data);
    let (kind, _locale) = (bytes.u32()?, bytes.u32()?);
    let number = crate::bytes::big_endian(&bytes.0[..bytes.0.len().min(8)]);
    let unused = 64 - 8 * bytes.0.len().min(8) as u32;
    Ok(match kind {
        TEXT => printable(&String::from_utf8_lossy(bytes.0)),
        SIGNED => ((number.wrapping_shl(unused) as i64) >> unused.min(63)).to_string(),
        UNSIGNED => number.to_string(),
        FLOAT => f32::from_bits(bytes.u32()?).to_string(),
        DOUBLE => f64::from_bits(bytes.u64()?).to_string(),
        _ => format!("{} bytes of type {kind}", bytes.0.len()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxed(name: &[u8], payload: &[u8]) -> Vec<u8> {
        [&(payload.len() as u32 + 8).to_be_bytes()[..], name, payload].concat()
    }

    #[test]
    fn the_capture_rate_of_slow_motion_is_read_in_both_forms_of_the_box() {
        let keys = boxed(b"keys", &[&[0, 0, 0, 0, 0, 0, 0, 1][..], &boxed(b"mdta", CAPTURE_RATE.as_bytes())].concat());
        let data = boxed(b"data", &[&FLOAT.to_be_bytes()[..], &[0; 4], &240f32.to_be_bytes()].concat());
        let list = boxed(b"ilst", &boxed(&[0, 0, 0, 1], &data));
        let plain = [boxed(b"hdlr", &[0; 24]), keys, list].concat();
        for meta in [plain.clone(), [&[0; 4][..], &plain].concat()] {
            let tags = read(&boxed(b"meta", &meta));
            assert_eq!(capture_rate(&tags), Some(240.0), "{tags:?}");
        }
    }

    #[test]
    fn signed_numbers_keep_their_sign() {
        let data = |payload: &[u8]| [&SIGNED.to_be_bytes()[..], &[0; 4], payload].concat();
        assert_eq!(value(&data(&[0xff, 0xfe])).unwrap(), "-2");
        assert_eq!(value(&data(&[])).unwrap(), "0");
    }
}

//! When a picture was taken, by its camera (EXIF 2.3, a TIFF directory within the jpeg or png).

use std::io::{BufReader, Cursor, Read};
use std::path::Path;

use image::{ImageDecoder, ImageReader};

use crate::limits::LARGEST_PACKET;
use crate::open::open_regular;

/// Tags: the directory of EXIF, the time of the exposure, and its parts of a second.
const DIRECTORY: u16 = 0x8769;
const TAKEN: u16 = 0x9003;
const PARTS: u16 = 0x9291;

/// Seconds from some day on at which a picture was taken; none where its camera does not state it.
pub(crate) fn seconds(path: &Path) -> Option<f64> {
    let mut bytes = Vec::new();
    BufReader::new(open_regular(path).ok()?).take(LARGEST_PACKET).read_to_end(&mut bytes).ok()?;
    let mut decoder = ImageReader::new(Cursor::new(&bytes)).with_guessed_format().ok()?.into_decoder().ok()?;
    of(&decoder.exif_metadata().ok()??)
}

fn of(tiff: &[u8]) -> Option<f64> {
    let tiff = Tiff::new(tiff)?;
    let directory = tiff.long(tiff.entry(tiff.number(4, 4)?, DIRECTORY)? + 8)?;
    let taken = tiff.text(tiff.entry(directory, TAKEN)?)?;
    let parts = tiff.entry(directory, PARTS).and_then(|entry| tiff.text(entry));
    let parts = parts.and_then(|digits| format!("0.{}", digits.trim()).parse::<f64>().ok()).unwrap_or(0.0);
    // 2026:11:28 22:56:08
    let numbers: Option<Vec<i64>> = taken.split([':', ' ']).map(|number| number.trim().parse().ok()).collect();
    let [year, month, day, hour, minute, second] = numbers?[..] else { return None };
    let days = days(year, month, day)?;
    // A leap second has the number 60.
    if !((0..24).contains(&hour) && (0..60).contains(&minute) && (0..=60).contains(&second)) {
        return None;
    }
    Some((((days * 24 + hour) * 60 + minute) * 60 + second) as f64 + parts)
}

/// Days from the first of March of the year 0 on (Gregorian).
fn days(year: i64, month: i64, day: i64) -> Option<i64> {
    let known = (0..=9999).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    known.then(|| {
        365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400) + (153 * month + 2) / 5 + day
    })
}

struct Tiff<'a> {
    bytes: &'a [u8],
    is_little: bool,
}

impl<'a> Tiff<'a> {
    fn new(bytes: &'a [u8]) -> Option<Self> {
        let is_little = match bytes.get(..2)? {
            b"II" => true,
            b"MM" => false,
            _ => return None,
        };
        Some(Tiff { bytes, is_little })
    }

    fn number(&self, at: usize, length: usize) -> Option<usize> {
        let bytes = self.bytes.get(at..at.checked_add(length)?)?;
        let add = |number: usize, byte: &u8| number << 8 | usize::from(*byte);
        Some(if self.is_little { bytes.iter().rev().fold(0, add) } else { bytes.iter().fold(0, add) })
    }

    fn long(&self, at: usize) -> Option<usize> {
        self.number(at, 4)
    }

    /// Place of a tag's entry in a directory: tag, kind, count, value.
    fn entry(&self, directory: usize, tag: u16) -> Option<usize> {
        let count = self.number(directory, 2)?;
        (0..count)
            .map(|entry| directory + 2 + 12 * entry)
            .take_while(|at| at + 12 <= self.bytes.len())
            .find(|at| self.number(*at, 2) == Some(usize::from(tag)))
    }

    /// Text of an entry, which lies in it where it is short.
    fn text(&self, entry: usize) -> Option<&'a str> {
        let count = self.long(entry + 4)?;
        let at = if count <= 4 { entry + 8 } else { self.long(entry + 8)? };
        let text = std::str::from_utf8(self.bytes.get(at..at.checked_add(count)?)?).ok()?;
        Some(text.trim_end_matches('\0'))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Least significant byte first: a directory that refers to that of EXIF, and texts after it.
    fn tiff(taken: &str, parts: &str) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        let mut short = [0; 4];
        short[..parts.len()].copy_from_slice(parts.as_bytes());
        [
            &b"II\x2a\0\x08\0\0\0\x01\0"[..],
            &entry(DIRECTORY, 4, 1, 26),
            &[0; 4],
            &[2, 0],
            &entry(TAKEN, 2, taken.len() as u32 + 1, 56),
            &entry(PARTS, 2, parts.len() as u32 + 1, u32::from_le_bytes(short)),
            &[0; 4],
            taken.as_bytes(),
            &[0],
        ]
        .concat()
    }

    #[test]
    fn two_pictures_around_midnight_are_a_fraction_of_a_second_apart() {
        let before = of(&tiff("2024:02:28 23:59:59", "90")).unwrap();
        let after = of(&tiff("2024:02:29 00:00:00", "15")).unwrap();
        assert!((after - before - 0.25).abs() < 1e-6, "{}", after - before);
        assert_eq!(of(&tiff("0000:00:00 00:00:00", "1")), None);
        assert_eq!(of(&tiff("2024:02:29 9223372036854775807:00:00", "1")), None);
        assert_eq!(of(b"II\x2a\0\xff\xff\xff\xff"), None);
    }
}

//! Huffman codes of JPEG and the bits of a scan (ITU-T T.81, annexes C, F and K).

use crate::error::{DecodeError, Result};

/// Longest code, bits.
const LONGEST: usize = 16;

/// A table of codes.
#[derive(Debug, Clone)]
pub(super) struct Codes {
    /// First code of each length, and the place of its value.
    first: [(i32, i32); LONGEST + 1],
    /// The code after the last of each length; -1 for a length without codes.
    end: [i32; LONGEST + 1],
    values: Vec<u8>,
}

impl Codes {
    /// Numbers of codes by length, and their values.
    pub(super) fn new(counts: &[u8; LONGEST], values: &[u8]) -> Result<Self> {
        let (mut code, mut place) = (0i32, 0i32);
        let (mut first, mut end) = ([(0, 0); LONGEST + 1], [-1; LONGEST + 1]);
        for (length, &count) in (1..).zip(counts) {
            first[length] = (code, place);
            code += i32::from(count);
            place += i32::from(count);
            if code > 1 << length || place as usize > values.len() {
                return Err(DecodeError::corrupt("JPEG: a table of codes is damaged"));
            }
            end[length] = code;
            code *= 2;
        }
        Ok(Codes { first, end, values: values[..place as usize].to_vec() })
    }
}

/// The bits of a scan. Beyond its end come zeros, which are counted.
pub(super) struct Scan<'a> {
    bytes: &'a [u8],
    at: usize,
    held: u32,
    count: u32,
    /// Bits read beyond the end.
    missing: u32,
}

impl<'a> Scan<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Scan { bytes, at: 0, held: 0, count: 0, missing: 0 }
    }

    fn bit(&mut self) -> i32 {
        if self.count == 0 {
            let here = &self.bytes[self.at.min(self.bytes.len())..];
            self.held = match here {
                [0xff, 0, ..] => {
                    self.at += 2;
                    0xff
                }
                // A marker.
                [0xff, ..] | [] => {
                    self.missing += 8;
                    0
                }
                [byte, ..] => {
                    self.at += 1;
                    u32::from(*byte)
                }
            };
            self.count = 8;
        }
        self.count -= 1;
        (self.held >> self.count & 1) as i32
    }

    /// A value by its code.
    pub(super) fn value(&mut self, codes: &Codes) -> Result<u8> {
        let mut code = 0;
        for length in 1..=LONGEST {
            code = 2 * code + self.bit();
            let (first, place) = codes.first[length];
            if code < codes.end[length] && code >= first {
                return Ok(codes.values[(place + code - first) as usize]);
            }
        }
        Err(DecodeError::corrupt("JPEG: a code is damaged"))
    }

    /// A signed number of so many bits (F.2.2.1).
    pub(super) fn signed(&mut self, bits: u8) -> i32 {
        let number = (0..bits).fold(0, |number, _| 2 * number + self.bit());
        if bits > 0 && number < 1 << (bits - 1) { number - (1 << bits) + 1 } else { number }
    }

    /// Goes to the byte after the next marker of a restart; an error if another comes first.
    pub(super) fn restart(&mut self) -> Result<()> {
        self.count = 0;
        while let Some(rest) = self.bytes.get(self.at..) {
            match rest {
                [0xff, 0xd0..=0xd7, ..] => {
                    self.at += 2;
                    return Ok(());
                }
                [0xff, 0xff, ..] => self.at += 1,
                [] | [0xff, 1..=255, ..] | [0xff] => break,
                _ => self.at += 1,
            }
        }
        Err(DecodeError::corrupt("JPEG: a part of the picture is missing"))
    }

    /// Refuses a scan of which bits are missing; the last byte may be short of its filling.
    pub(super) fn check(&self) -> Result<()> {
        if self.missing > 8 { Err(DecodeError::corrupt("JPEG: the picture ends too early")) } else { Ok(()) }
    }

    /// Place of the byte after the scan's last.
    pub(super) fn place(&self) -> usize {
        self.at.min(self.bytes.len())
    }
}

/// The usual tables (annex K), which Motion JPEG may leave out: DC, AC of luma, DC, AC of chroma.
pub(super) fn usual() -> [(u8, Codes); 4] {
    let codes = |counts: &[u8; LONGEST], values: &[u8]| Codes::new(counts, values).expect("the tables of the standard");
    let twelve: Vec<u8> = (0..12).collect();
    [
        (0x00, codes(&[0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0], &twelve)),
        (0x10, codes(&[0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d], &AC_LUMA)),
        (0x01, codes(&[0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0], &twelve)),
        (0x11, codes(&[0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77], &AC_CHROMA)),
    ]
}

#[rustfmt::skip]
const AC_LUMA: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71, 0x14, 0x32,
    0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72, 0x82, 0x09, 0x0a, 0x16,
    0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45,
    0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69,
    0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94,
    0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6,
    0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8,
    0xd9, 0xda, 0xe1, 0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8,
    0xf9, 0xfa,
];

#[rustfmt::skip]
const AC_CHROMA: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22, 0x32, 0x81,
    0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1, 0x0a, 0x16, 0x24, 0x34,
    0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3a, 0x43, 0x44,
    0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68,
    0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92,
    0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4,
    0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6,
    0xd7, 0xd8, 0xd9, 0xda, 0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8,
    0xf9, 0xfa,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_signed_numbers_are_those_of_the_standard() {
        // K.3: category 0 is 00, category 1 is 010, category 2 is 011. 010 then the bit 0: the number -1.
        let [(_, dc), ..] = usual();
        let mut scan = Scan::new(&[0b0001_0001, 0b1100_0000]);
        assert_eq!(scan.value(&dc).unwrap(), 0);
        let bits = scan.value(&dc).unwrap();
        assert_eq!((bits, scan.signed(bits)), (1, -1));
        let bits = scan.value(&dc).unwrap();
        assert_eq!((bits, scan.signed(bits)), (2, 2));
        scan.check().unwrap();
        assert!(Codes::new(&[3; 16], &[0; 48]).is_err());
    }

    #[test]
    fn a_marker_ends_the_bits_and_a_restart_goes_on_after_it() {
        let mut scan = Scan::new(&[0xff, 0, 0xff, 0xd3, 0x80]);
        assert_eq!(scan.signed(8), 255);
        assert_eq!(scan.signed(0), 0);
        scan.restart().unwrap();
        assert_eq!(scan.signed(1), 1);
        assert!(scan.restart().is_err());
        scan.signed(15);
        scan.signed(15);
        assert!(scan.check().is_err());
    }
}

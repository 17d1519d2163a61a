//! Reading bits of parameter sets: fixed lengths and Exp-Golomb codes (ITU-T H.264, 9.1; H.265, 9.2).

use crate::error::{DecodeError, Result};

/// A position in the payload of a NAL unit.
pub(crate) struct Bits {
    bytes: Vec<u8>,
    at: usize,
}

impl Bits {
    /// A reader of a NAL unit's payload, from which the emulation prevention bytes are removed.
    pub(crate) fn of_nal(payload: &[u8]) -> Self {
        let mut bytes = Vec::with_capacity(payload.len());
        let mut zeros = 0;
        for &byte in payload {
            if zeros >= 2 && byte == 3 {
                zeros = 0;
                continue;
            }
            zeros = if byte == 0 { zeros + 1 } else { 0 };
            bytes.push(byte);
        }
        Bits { bytes, at: 0 }
    }

    /// A reader of bytes without emulation prevention.
    pub(crate) fn plain(bytes: &[u8]) -> Self {
        Bits { bytes: bytes.to_vec(), at: 0 }
    }

    pub(crate) fn bit(&mut self) -> Result<bool> {
        let byte = self.bytes.get(self.at / 8).ok_or_else(|| DecodeError::corrupt("a parameter set ends too early"))?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Ok(bit == 1)
    }

    /// A number of at most 32 bits.
    pub(crate) fn bits(&mut self, count: u32) -> Result<u32> {
        let mut number: u64 = 0;
        for _ in 0..count {
            number = number << 1 | u64::from(self.bit()?);
        }
        Ok(number as u32)
    }

    pub(crate) fn skip(&mut self, count: usize) -> Result<()> {
        for _ in 0..count {
            self.bit()?;
        }
        Ok(())
    }

    /// Exp-Golomb code of an unsigned number.
    pub(crate) fn ue(&mut self) -> Result<u32> {
        let mut zeros = 0;
        while !self.bit()? {
            zeros += 1;
            if zeros > 31 {
                return Err(DecodeError::corrupt("a parameter set holds a number beyond 32 bits"));
            }
        }
        Ok((1 << zeros) - 1 + self.bits(zeros)?)
    }

    /// Exp-Golomb code of a signed number.
    pub(crate) fn se(&mut self) -> Result<i32> {
        let code = i64::from(self.ue()?);
        Ok(if code % 2 == 1 { (code + 1) / 2 } else { -code / 2 } as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The codes of ITU-T H.264, table 9-2 and 9-3.
    #[test]
    fn exp_golomb_codes_are_those_of_the_standard() {
        // 1 | 010 | 011 | 00100 | 00111 and a stop bit.
        let mut bits = Bits::plain(&[0b1010_0110, 0b0100_0011, 0b1100_0000]);
        assert_eq!([0; 4].map(|_: i32| bits.ue().unwrap()), [0, 1, 2, 3]);
        assert_eq!(bits.se().unwrap(), -3);
        let mut short = Bits::plain(&[0]);
        assert!(short.ue().is_err());
    }

    #[test]
    fn emulation_prevention_is_removed() {
        assert_eq!(Bits::of_nal(&[0, 0, 3, 1, 0, 0, 3, 0, 0, 3]).bytes, [0, 0, 1, 0, 0, 0, 0]);
    }
}

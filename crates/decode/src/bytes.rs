//! Reading numbers from bytes that may end too early.

use std::fs::File;
use std::io::{BufReader, Read, Seek};

use crate::error::{DecodeError, Result};

/// A position in bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bytes<'a>(pub(crate) &'a [u8]);

impl<'a> Bytes<'a> {
    /// The next `count` bytes.
    pub(crate) fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let (taken, rest) =
            self.0.split_at_checked(count).ok_or_else(|| DecodeError::corrupt("a header ends too early"))?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    pub(crate) fn u8(&mut self) -> Result<u8> {
        Ok(self.array::<1>()?[0])
    }

    pub(crate) fn u16(&mut self) -> Result<u16> {
        Ok(u16::from_be_bytes(self.array()?))
    }

    pub(crate) fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_be_bytes(self.array()?))
    }

    pub(crate) fn i32(&mut self) -> Result<i32> {
        Ok(i32::from_be_bytes(self.array()?))
    }

    pub(crate) fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_be_bytes(self.array()?))
    }

    /// Four letters.
    pub(crate) fn name(&mut self) -> Result<[u8; 4]> {
        self.array()
    }

    pub(crate) fn u16_le(&mut self) -> Result<u16> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    pub(crate) fn u32_le(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array()?))
    }
}

/// An unsigned number, most significant byte first.
pub(crate) fn big_endian(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

/// Reads bytes of a file from a place on: so many, or an error.
pub(crate) fn read_at(file: &mut BufReader<File>, offset: u64, length: u64) -> Result<Vec<u8>> {
    // Keeps what is buffered: an index is read in many small steps.
    let here = file.stream_position()?;
    match i64::try_from(i128::from(offset) - i128::from(here)) {
        Ok(step) => file.seek_relative(step)?,
        Err(_) => return Err(DecodeError::corrupt(format!("it refers to the byte {offset}"))),
    }
    let mut bytes = Vec::new();
    // Grows with what is there, not with what is claimed.
    let read = file.take(length).read_to_end(&mut bytes)?;
    if read as u64 != length {
        return Err(DecodeError::corrupt(format!("it ends after {read} of {length} bytes at {offset}")));
    }
    Ok(bytes)
}

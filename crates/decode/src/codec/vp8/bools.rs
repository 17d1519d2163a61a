//! The boolean decoder (RFC 6386, section 7).

/// A position in a partition. Beyond its end come zeros.
#[derive(Debug, Clone)]
pub(super) struct Bools<'a> {
    rest: &'a [u8],
    /// Bits read so far and not yet decided, the highest byte first.
    value: u32,
    /// Between 128 and 255.
    range: u32,
    /// Bits of `value` below its two highest bytes' second that are used up.
    shifted: u32,
}

impl<'a> Bools<'a> {
    pub(super) fn new(partition: &'a [u8]) -> Self {
        let mut bools = Bools { rest: partition, value: 0, range: 255, shifted: 0 };
        bools.value = u32::from(bools.byte()) << 8 | u32::from(bools.byte());
        bools
    }

    fn byte(&mut self) -> u8 {
        match self.rest.split_first() {
            Some((byte, rest)) => {
                self.rest = rest;
                *byte
            }
            None => 0,
        }
    }

    /// A decision whose probability of `false` is so many 256ths.
    pub(super) fn bool(&mut self, probability: u8) -> bool {
        let split = 1 + (((self.range - 1) * u32::from(probability)) >> 8);
        let is_true = self.value >= split << 8;
        if is_true {
            self.range -= split;
            self.value -= split << 8;
        } else {
            self.range = split;
        }
        while self.range < 128 {
            self.value <<= 1;
            self.range <<= 1;
            self.shifted += 1;
            if self.shifted == 8 {
                self.shifted = 0;
                self.value |= u32::from(self.byte());
            }
        }
        is_true
    }

    /// A decision of even odds.
    pub(super) fn flag(&mut self) -> bool {
        self.bool(128)
    }

    /// An unsigned number of so many bits.
    pub(super) fn number(&mut self, bits: u32) -> i32 {
        (0..bits).fold(0, |number, _| number << 1 | i32::from(self.flag()))
    }

    /// A number and its sign, if a flag announces them.
    pub(super) fn optional(&mut self, bits: u32) -> Option<i32> {
        if !self.flag() {
            return None;
        }
        let number = self.number(bits);
        Some(if self.flag() { -number } else { number })
    }

    /// The same, 0 where there is none.
    pub(super) fn delta(&mut self, bits: u32) -> i32 {
        self.optional(bits).unwrap_or(0)
    }
}

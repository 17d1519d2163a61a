//! The sample tables of an mp4: sizes, places, times (ISO/IEC 14496-12, 8.6 and 8.7).

use super::Packet;
use super::boxes::{find, full};
use crate::error::{DecodeError, Result};
use crate::limits::{LARGEST_PACKET, check_frames};

/// The samples of a track.
#[derive(Debug, Default)]
pub(super) struct SampleTable {
    pub packets: Vec<Packet>,
    /// Decoding time of the sample after the last, ticks.
    pub end: i64,
    /// Whether presentation times differ from decoding times by more than a constant.
    pub offsets_differ: bool,
    /// The first sample's offset.
    pub first_offset: Option<i64>,
}

impl SampleTable {
    /// Appends a sample that is decoded at the end so far.
    pub(super) fn push(&mut self, offset: u64, size: u64, duration: u32, shift: i64, sync: bool) -> Result<()> {
        if size > LARGEST_PACKET {
            return Err(DecodeError::too_large(format!("frame {} claims {size} bytes", self.packets.len())));
        }
        check_frames(self.packets.len() + 1)?;
        self.offsets_differ |= *self.first_offset.get_or_insert(shift) != shift;
        let stamp = self.end.saturating_add(shift);
        self.packets.push(Packet { offset, size, stamp, sync });
        self.end = self.end.saturating_add(duration.into());
        Ok(())
    }
}

/// Reads the tables of a track in a file of this length.
pub(super) fn samples(table: &[u8], length: u64) -> Result<SampleTable> {
    let sizes = SampleSizes::read(table, length)?;
    let mut times = Runs::read(table, b"stts")?;
    let mut shifts = Runs::read(table, b"ctts")?;
    let chunks = chunks(table)?;
    let mut per_chunk = PerChunk::read(table)?;
    let sync = sync(table)?;
    let timed = times.total();
    if timed != sizes.count as u64 {
        let sized = sizes.count;
        return Err(DecodeError::corrupt(format!("its tables disagree: sizes of {sized} frames, times of {timed}")));
    }
    let mut samples = SampleTable::default();
    let mut sizes = sizes.iter();
    for (number, &chunk) in chunks.iter().enumerate() {
        let mut at = chunk;
        for size in sizes.by_ref().take(per_chunk.of(number as u64 + 1) as usize) {
            let duration = times.next().unwrap_or(0);
            let shift = shifts.next().map_or(0, |shift| i64::from(shift as i32));
            let is_sync = sync.as_ref().is_none_or(|sync| sync.binary_search(&(samples.packets.len() as u32)).is_ok());
            samples.push(at, size, duration, shift, is_sync)?;
            at = at.saturating_add(size);
        }
    }
    match sizes.count() {
        0 => Ok(samples),
        left => Err(DecodeError::corrupt(format!("its tables disagree: the places of {left} frames are missing"))),
    }
}

/// Sizes of the samples, bytes.
struct SampleSizes<'a> {
    count: usize,
    each: Option<u64>,
    /// Bits of an entry.
    bits: usize,
    entries: &'a [u8],
}

impl<'a> SampleSizes<'a> {
    fn read(table: &'a [u8], length: u64) -> Result<Self> {
        let (payload, compact) = match (find(table, b"stsz"), find(table, b"stz2")) {
            (Some(payload), _) => (payload, false),
            (None, Some(payload)) => (payload, true),
            (None, None) => return Err(DecodeError::corrupt("it has no sizes of its frames")),
        };
        let (_, _, mut bytes) = full(payload)?;
        let first = bytes.u32()?;
        let count = bytes.u32()? as usize;
        let bits = if compact { (first & 0xff) as usize } else { 32 };
        let each = (!compact && first > 0).then_some(u64::from(first));
        let fits = match each {
            Some(size) => count as u64 <= length / size,
            None => [4, 8, 16, 32].contains(&bits) && count <= bytes.0.len() * 8 / bits,
        };
        check_frames(count)?;
        if !fits {
            return Err(DecodeError::corrupt(format!("it claims {count} frames, more than it has room for")));
        }
        Ok(SampleSizes { count, each, bits, entries: bytes.0 })
    }

    fn iter(&self) -> impl Iterator<Item = u64> {
        let entry = |number: usize| match self.bits {
            4 => u64::from(self.entries[number / 2] >> (if number.is_multiple_of(2) { 4 } else { 0 }) & 15),
            bits => crate::bytes::big_endian(&self.entries[number * bits / 8..(number + 1) * bits / 8]),
        };
        (0..self.count).map(move |number| self.each.unwrap_or_else(|| entry(number)))
    }
}

/// A table of runs: so many samples with one value.
struct Runs {
    runs: Vec<(u32, u32)>,
    run: usize,
    used: u32,
}

impl Runs {
    /// An absent table has no runs.
    fn read(table: &[u8], name: &[u8; 4]) -> Result<Self> {
        let runs = match find(table, name) {
            Some(payload) => pairs(payload)?,
            None => Vec::new(),
        };
        Ok(Runs { runs, run: 0, used: 0 })
    }

    fn total(&self) -> u64 {
        self.runs.iter().map(|run| u64::from(run.0)).sum()
    }

    fn next(&mut self) -> Option<u32> {
        while self.used >= self.runs.get(self.run)?.0 {
            self.run += 1;
            self.used = 0;
        }
        self.used += 1;
        Some(self.runs[self.run].1)
    }
}

fn pairs(payload: &[u8]) -> Result<Vec<(u32, u32)>> {
    let (_, _, mut bytes) = full(payload)?;
    let count = bytes.u32()? as usize;
    if count > bytes.0.len() / 8 {
        return Err(DecodeError::corrupt(format!("a table claims {count} entries, more than it has room for")));
    }
    (0..count).map(|_| Ok((bytes.u32()?, bytes.u32()?))).collect()
}

/// Places of the chunks, bytes.
fn chunks(table: &[u8]) -> Result<Vec<u64>> {
    let (payload, width) = match (find(table, b"stco"), find(table, b"co64")) {
        (Some(payload), _) => (payload, 4),
        (None, Some(payload)) => (payload, 8),
        (None, None) => return Err(DecodeError::corrupt("it has no places of its frames")),
    };
    let (_, _, mut bytes) = full(payload)?;
    let count = bytes.u32()? as usize;
    if count > bytes.0.len() / width {
        return Err(DecodeError::corrupt(format!("a table claims {count} entries, more than it has room for")));
    }
    Ok(bytes.0.chunks_exact(width).take(count).map(crate::bytes::big_endian).collect())
}

/// Samples of each chunk: the first chunk of a run, samples in each of its chunks.
struct PerChunk {
    runs: Vec<(u32, u32)>,
    run: usize,
}

impl PerChunk {
    fn read(table: &[u8]) -> Result<Self> {
        let payload = find(table, b"stsc").ok_or_else(|| DecodeError::corrupt("it has no table of chunks"))?;
        let (_, _, mut bytes) = full(payload)?;
        let count = bytes.u32()? as usize;
        if count > bytes.0.len() / 12 {
            return Err(DecodeError::corrupt(format!("a table claims {count} entries, more than it has room for")));
        }
        let mut runs = Vec::with_capacity(count);
        for _ in 0..count {
            let run = (bytes.u32()?, bytes.u32()?);
            let described_by = bytes.u32()?;
            if described_by != 1 {
                return Err(DecodeError::unsupported("an mp4 whose codec changes within the track"));
            }
            runs.push(run);
        }
        Ok(PerChunk { runs, run: 0 })
    }

    /// Chunks are asked for in ascending order, counted from 1.
    fn of(&mut self, chunk: u64) -> u32 {
        while self.runs.get(self.run + 1).is_some_and(|next| u64::from(next.0) <= chunk) {
            self.run += 1;
        }
        self.runs.get(self.run).map_or(0, |run| run.1)
    }
}

/// Numbers of the samples at which decoding can begin, counted from 0; none where it can at all.
fn sync(table: &[u8]) -> Result<Option<Vec<u32>>> {
    let Some(payload) = find(table, b"stss") else { return Ok(None) };
    let (_, _, mut bytes) = full(payload)?;
    let count = bytes.u32()? as usize;
    let entries = bytes.0.chunks_exact(4).take(count);
    let mut numbers: Vec<_> = entries.map(|it| (crate::bytes::big_endian(it) as u32).wrapping_sub(1)).collect();
    numbers.sort_unstable();
    Ok(Some(numbers))
}

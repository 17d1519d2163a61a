//! Fragments of an mp4: samples described beside their data (ISO/IEC 14496-12, 8.8).

use super::boxes::{find, full, need};
use super::mp4::all;
use super::mp4_tables::SampleTable;
use crate::error::{DecodeError, Result};

/// Values of samples that a fragment does not state.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Defaults {
    track: u32,
    duration: u32,
    size: u32,
    flags: u32,
}

impl Defaults {
    pub(super) fn of(movie: &[u8], track: u32) -> Result<Self> {
        let Some(extends) = find(movie, b"mvex") else { return Ok(Defaults { track, ..Defaults::default() }) };
        for entry in all(extends, b"trex") {
            let (_, _, mut bytes) = full(entry.payload)?;
            let id = bytes.u32()?;
            bytes.u32()?;
            if id == track {
                return Ok(Defaults { track, duration: bytes.u32()?, size: bytes.u32()?, flags: bytes.u32()? });
            }
        }
        Ok(Defaults { track, ..Defaults::default() })
    }
}

/// Flag of a sample that depends on others.
const NOT_SYNC: u32 = 0x1_0000;

/// Appends the samples of all fragments, each with its place in a file of this length.
pub(super) fn append(
    samples: &mut SampleTable,
    fragments: &[(u64, Vec<u8>)],
    defaults: &Defaults,
    length: u64,
) -> Result<()> {
    for (place, fragment) in fragments {
        for track in all(fragment, b"traf") {
            let (_, flags, mut bytes) = full(need(track.payload, b"tfhd")?)?;
            if bytes.u32()? != defaults.track {
                continue;
            }
            let has = |flag: u32| flags & flag != 0;
            let mut here = *defaults;
            let base = if has(0x1) { bytes.u64()? } else { *place };
            if has(0x2) {
                bytes.u32()?;
            }
            for (flag, value) in [(0x8, &mut here.duration), (0x10, &mut here.size), (0x20, &mut here.flags)] {
                if has(flag) {
                    *value = bytes.u32()?;
                }
            }
            if let Some(time) = find(track.payload, b"tfdt") {
                let (version, _, mut bytes) = full(time)?;
                let begin = if version == 1 { bytes.u64()? } else { bytes.u32()?.into() };
                samples.end =
                    i64::try_from(begin).map_err(|_| DecodeError::corrupt("a fragment begins beyond all time"))?;
            }
            let mut at = base;
            for run in all(track.payload, b"trun") {
                at = append_run(samples, run.payload, &here, base, at, length)?;
            }
        }
    }
    Ok(())
}

/// Appends one run of samples; returns the place after its last.
fn append_run(
    samples: &mut SampleTable,
    run: &[u8],
    defaults: &Defaults,
    base: u64,
    follows: u64,
    length: u64,
) -> Result<u64> {
    let (version, flags, mut bytes) = full(run)?;
    let has = |flag: u32| flags & flag != 0;
    let count = bytes.u32()? as usize;
    let mut at = if has(0x1) { base.saturating_add_signed(bytes.i32()?.into()) } else { follows };
    let first_flags = if has(0x4) { Some(bytes.u32()?) } else { None };
    let entry = 4 * [0x100, 0x200, 0x400, 0x800].into_iter().filter(|&flag| has(flag)).count();
    let fits = match entry {
        0 => defaults.size > 0 && count as u64 <= length / u64::from(defaults.size),
        entry => count <= bytes.0.len() / entry,
    };
    if !fits {
        return Err(DecodeError::corrupt(format!("a fragment claims {count} frames, more than it has room for")));
    }
    for number in 0..count {
        let duration = if has(0x100) { bytes.u32()? } else { defaults.duration };
        let size = u64::from(if has(0x200) { bytes.u32()? } else { defaults.size });
        let own_flags = if has(0x400) { bytes.u32()? } else { defaults.flags };
        let flags = first_flags.filter(|_| number == 0).unwrap_or(own_flags);
        let shift = match (has(0x800), version) {
            (false, _) => 0,
            (true, 0) => bytes.u32()?.into(),
            (true, _) => bytes.i32()?.into(),
        };
        samples.push(at, size, duration, shift, flags & NOT_SYNC == 0)?;
        at = at.saturating_add(size);
    }
    Ok(at)
}

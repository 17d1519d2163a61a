//! A film in H.264: samples decoded in the container's order, frames given in display order.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use image::{RgbImage, imageops};

use super::Frames;
use super::colour::to_rgb;
use super::container::{Codec, ParameterSets, Sample, Track, Turn};
use super::h264::{Decoded, SampleDecoder, is_entry};

/// Most frames that wait for an earlier one. The standard allows 16.
const MOST_WAITING: usize = 32;

/// Decodes one film from its beginning, or from the last frame before the first wanted one at which decoding can begin.
pub(super) struct Film<'a> {
    track: &'a Track,
    sets: &'a ParameterSets,
    file: BufReader<File>,
    decoder: SampleDecoder,
    /// The next sample to be decoded.
    next: Option<usize>,
    /// Decoded frames that are shown later, by number.
    waiting: BTreeMap<usize, RgbImage>,
}

/// Decodes the first frame: the size of the frames as they are coded, or why the decoder cannot decode this film.
///
/// # Errors
/// Damage.
pub(super) fn try_first(path: &Path, track: &Track) -> Result<std::result::Result<(u32, u32), String>> {
    let Codec::H264(sets) = &track.codec else { bail!("it is not H.264") };
    let mut decoder = match SampleDecoder::new(sets)? {
        Ok(decoder) => decoder,
        Err(why) => return Ok(Err(why)),
    };
    let first = track.samples.first().context("it has no frames")?;
    Ok(match decoder.decode(&read(&mut File::open(path)?, first)?).context("its first frame")? {
        Decoded::Frame(frame) => Ok((u32::try_from(frame.width)?, u32::try_from(frame.height)?)),
        Decoded::Unsupported(what) => Err(format!("it is H.264 with {what}")),
    })
}

impl<'a> Film<'a> {
    /// # Errors
    /// As for [`try_first`].
    pub(super) fn open(path: &Path, track: &'a Track) -> Result<Self> {
        let Codec::H264(sets) = &track.codec else { bail!("it is not H.264") };
        let decoder = SampleDecoder::new(sets)?.map_err(anyhow::Error::msg)?;
        let file = BufReader::new(File::open(path)?);
        Ok(Film { track, sets, file, decoder, next: None, waiting: BTreeMap::new() })
    }

    /// The last sample at which decoding can begin and after which nothing is missing that is shown from `number` on.
    fn entry(&mut self, number: usize) -> Result<usize> {
        let samples = &self.track.samples;
        let wanted =
            samples.iter().position(|sample| sample.number == Some(number)).context("there is no such frame")?;
        // Frames that are shown from the wanted one on may be coded before it.
        let earliest = samples.iter().position(|sample| sample.number >= Some(number)).unwrap_or(wanted);
        for place in (0..=earliest).rev() {
            if is_entry(&read(&mut self.file, &samples[place])?, self.sets.length_bytes) {
                return Ok(place);
            }
        }
        Ok(0)
    }
}

impl Frames for Film<'_> {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        let mut next = match self.next {
            Some(next) => next,
            None => self.entry(number)?,
        };
        self.waiting.retain(|&shown, _| shown >= number);
        while !self.waiting.contains_key(&number) {
            let sample = self.track.samples.get(next).with_context(|| format!("frame {number} is missing"))?;
            let frame = match sample.number {
                Some(shown) => format!("frame {shown} at {:.3} s", sample.time),
                None => "a frame that is not shown".into(),
            };
            let bytes = read(&mut self.file, sample).with_context(|| frame.clone())?;
            match self.decoder.decode(&bytes).with_context(|| frame.clone())? {
                Decoded::Unsupported(what) => {
                    bail!(
                        "{frame}: H.264 with {what} is not decoded here; convert the video to plain H.264 with ffmpeg"
                    )
                }
                Decoded::Frame(yuv) => {
                    if let Some(shown) = sample.number.filter(|shown| *shown >= number) {
                        let picture = upright(to_rgb(&yuv), self.track.turn);
                        ensure!(
                            picture.dimensions() == self.track.size(),
                            "{frame}: the size changes within the video"
                        );
                        self.waiting.insert(shown, picture);
                    }
                }
            }
            ensure!(self.waiting.len() <= MOST_WAITING, "{frame}: the order of the frames is damaged");
            next += 1;
            self.next = Some(next);
        }
        Ok(self.waiting[&number].clone())
    }
}

fn read(file: &mut (impl Read + Seek), sample: &Sample) -> Result<Vec<u8>> {
    // The sample lies within the file, so there is room for it.
    let mut bytes = vec![0; sample.size as usize];
    file.seek(SeekFrom::Start(sample.offset))?;
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn upright(picture: RgbImage, turn: Turn) -> RgbImage {
    match turn {
        Turn::None => picture,
        Turn::Quarter => imageops::rotate90(&picture),
        Turn::Half => imageops::rotate180(&picture),
        Turn::ThreeQuarters => imageops::rotate270(&picture),
    }
}

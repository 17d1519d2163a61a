//! Decoders: coded packets in decoding order to pictures in display order.

#[cfg(feature = "av1")]
mod av1;
mod h264;
mod h264_sps;
mod hevc;
mod hevc_sps;
mod jpeg_huffman;
mod jpeg_idct;
mod mjpeg;
mod nal;
mod vp8;
mod vp9;
mod vp9_header;
mod vui;

use crate::colour::Tags;
use crate::container::Setup;
use crate::error::{DecodeError, Result};
use crate::info::Fields;
use crate::picture::DecodedPicture;

/// A decoder that is fed with the packets of a container.
pub(crate) trait Decode: Send {
    /// Decodes one packet; appends the pictures that are ready, in display order.
    ///
    /// # Errors
    /// Damage, or a tool of the codec that the decoder lacks.
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()>;

    /// Appends the pictures that waited for later ones.
    ///
    /// # Errors
    /// As for [`Decode::push`].
    fn finish(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()>;

    /// Facts that the stream itself states; complete once a picture is ready.
    fn facts(&self) -> StreamFacts;
}

/// Facts that a stream states.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct StreamFacts {
    pub depth: u8,
    pub colour: Tags,
    pub pixel_aspect: Option<f64>,
    pub interlaced: Option<Fields>,
}

/// The codec's name, for people.
pub(crate) fn name(setup: &Setup) -> &str {
    match setup {
        Setup::H264(_) => "H.264",
        Setup::Hevc(_) => "HEVC",
        Setup::Vp8 => "VP8",
        Setup::Vp9 => "VP9",
        Setup::Av1 => "AV1",
        Setup::Mjpeg => "Motion JPEG",
        Setup::Other(name) => name,
    }
}

/// The decoder of a codec.
///
/// # Errors
/// A codec without one; damaged parameter sets.
pub(crate) fn decoder(setup: &Setup) -> Result<Box<dyn Decode>> {
    Ok(match setup {
        Setup::H264(sets) => Box::new(h264::H264::new(sets)?),
        Setup::Hevc(sets) => Box::new(hevc::Hevc::new(sets)?),
        Setup::Vp8 => Box::new(vp8::Vp8::new()),
        Setup::Vp9 => Box::new(vp9::Vp9::new()),
        Setup::Mjpeg => Box::new(mjpeg::Mjpeg::new()),
        #[cfg(feature = "av1")]
        Setup::Av1 => Box::new(av1::Av1::new()?),
        setup => return Err(DecodeError::unsupported(format!("{} video", name(setup)))),
    })
}

/// What a packet is for, as far as its first bytes show without decoding it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PacketRole {
    /// Decoding can begin with it.
    Entry,
    /// It gives a picture.
    Picture,
    /// It gives a picture, but only if decoding began before the last entry.
    Leading,
    /// It gives none.
    Hidden,
}

/// Bytes of a packet that [`role`] looks at, at most.
pub(crate) const ROLE_BYTES: u64 = 4096;

/// The role of a packet that begins with these bytes; `sync` is the container's mark.
pub(crate) fn role(setup: &Setup, packet: &[u8], sync: bool) -> PacketRole {
    match setup {
        Setup::H264(sets) => h264::role(packet, sets.length_bytes),
        Setup::Hevc(sets) => hevc::role(packet, sets.length_bytes),
        Setup::Vp8 => match packet.first() {
            Some(tag) if tag & 0x10 == 0 => PacketRole::Hidden,
            Some(tag) if tag & 1 == 0 => PacketRole::Entry,
            _ => PacketRole::Picture,
        },
        Setup::Vp9 => vp9_header::role(packet),
        Setup::Mjpeg => PacketRole::Entry,
        Setup::Av1 | Setup::Other(_) if sync => PacketRole::Entry,
        Setup::Av1 | Setup::Other(_) => PacketRole::Picture,
    }
}

/// Refuses a picture of another size or depth than those before.
pub(crate) fn check_same<T: PartialEq + std::fmt::Debug + Copy>(known: &mut Option<T>, found: T) -> Result<()> {
    match known {
        Some(known) if *known != found => {
            Err(DecodeError::unsupported(format!("a video whose format changes from {known:?} to {found:?}")))
        }
        _ => {
            *known = Some(found);
            Ok(())
        }
    }
}

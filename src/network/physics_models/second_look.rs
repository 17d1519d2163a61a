//! A second look at frames whose objects look alike. The encoder can tell such objects by nothing but their order along an
//! axis; where they are level on it, it places each half-way between them. With x and y exchanged the same frame has another
//! order, so it is encoded that way, too, and the encoding that draws the frame better is taken. Not in the original.

use tch::Tensor;

use super::{Decoder, Encoder, Encoding};

/// Of two encodings of each frame `[frames, channels, S, S]`, the first one and one with x and y exchanged, the one from
/// which it is drawn better. `given` is what the encoder is given of the frames.
pub(crate) fn better_drawn(
    encoder: &Encoder,
    decoder: &Decoder,
    [frames, given]: [&Tensor; 2],
    first: Encoding,
) -> Encoding {
    let second = exchanged(&encoder.forward(&given.transpose(2, 3).contiguous()));
    let error = |encoding: &Encoding| {
        let [drawn] = decoder.draw([&encoding.positions]);
        (drawn - frames).square().sum_dim_intlist([1i64, 2, 3].as_slice(), false, None)
    };
    let better = error(&second).lt_tensor(&error(&first));
    let chosen = |second: &Tensor, first: &Tensor, shape: &[i64]| second.where_self(&better.reshape(shape), first);
    Encoding {
        masks: chosen(&second.masks, &first.masks, &[-1, 1, 1, 1]),
        masked: chosen(&second.masked, &first.masked, &[1, -1, 1, 1, 1]),
        positions: chosen(&second.positions, &first.positions, &[-1, 1]),
    }
}

/// The encoding with x and y exchanged.
fn exchanged(encoding: &Encoding) -> Encoding {
    let Encoding { masks, masked, positions } = encoding;
    Encoding {
        masks: masks.transpose(2, 3),
        masked: masked.transpose(3, 4),
        positions: positions.reshape([positions.size()[0], -1, 2]).flip([2]).flatten(1, 2),
    }
}

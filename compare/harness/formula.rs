//! The numbers a golden file does not store but describes: weights, input frames, loss weights.
//!
//! Everything is drawn from splitmix64 and worked out in double precision; see `goldens/README.md`.

use tch::Tensor;

const INCREMENT: u64 = 0x9E37_79B9_7F4A_7C15;
/// Half the width of the interval the biases are drawn from.
const BIAS_LIMIT: f64 = 0.1;
/// Amplitude of the noise in the input frames, and of the blobs over it.
const NOISE: f64 = 0.1;
const BLOB: f64 = 0.9;

/// The first `count` numbers of a seed's stream, uniform in \[0, 1).
pub fn uniform(seed: u64, count: usize) -> impl Iterator<Item = f64> {
    (1..=count as u64).map(move |j| {
        let mut z = seed.wrapping_add(j.wrapping_mul(INCREMENT));
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 * 2f64.powi(-53)
    })
}

/// Uniform in \[-1, 1), rounded to float32: the weights of a loss `sum(y * w)`.
pub fn loss_weights(seed: u64, shape: &[i64]) -> Tensor {
    tensor(uniform(seed, count(shape)).map(|u| 2.0 * u - 1.0), shape)
}

/// Kernel (`[kh, kw, in, out]` or `[in, out]`) or bias number `index` of a file with this weight seed, times `factor`.
pub fn weights(weight_seed: u64, index: usize, shape: &[i64], factor: f64) -> Tensor {
    let limit = match shape {
        [receptive @ .., inputs, outputs] => {
            (6.0 / (receptive.iter().product::<i64>() * (inputs + outputs)) as f64).sqrt()
        }
        _ => BIAS_LIMIT,
    };
    let seed = weight_seed.wrapping_mul(1000).wrapping_add(index as u64);
    tensor(uniform(seed, count(shape)).map(|u| (2.0 * u - 1.0) * limit * factor), shape)
}

/// Input clips `[batch, time, side, side, 3]` in \[0, 1\]: noise, and in each colour channel a blob that drifts.
pub fn clips(weight_seed: u64, batch: usize, time: usize, side: usize) -> Tensor {
    const CHANNELS: usize = 3;
    let shape = [batch, time, side, side, CHANNELS].map(|n| n as i64);
    let s = side as f64;
    let spread = 2.0 * (s / 12.0).powi(2);
    let paths: Vec<f64> = uniform(weight_seed.wrapping_add(8), batch * CHANNELS * 4).collect();
    let pixel = |(index, noise): (usize, f64)| {
        let (channel, rest) = (index % CHANNELS, index / CHANNELS);
        let (column, rest) = (rest % side, rest / side);
        let (row, rest) = (rest % side, rest / side);
        let (frame, clip) = (rest % time, rest / time);
        let path = &paths[(clip * CHANNELS + channel) * 4..][..4];
        let centre = |start: f64, speed: f64| s * (0.2 + 0.6 * start) + (speed - 0.5) * frame as f64;
        let (cy, cx) = (centre(path[0], path[2]), centre(path[1], path[3]));
        let squared = (row as f64 - cy).powi(2) + (column as f64 - cx).powi(2);
        (NOISE * noise + BLOB * (-squared / spread).exp()).clamp(0.0, 1.0)
    };
    tensor(uniform(weight_seed.wrapping_add(7), count(&shape)).enumerate().map(pixel), &shape)
}

fn count(shape: &[i64]) -> usize {
    shape.iter().product::<i64>() as usize
}

/// Rounded to float32, as the values were fed to TensorFlow, but held in double precision.
fn tensor(values: impl Iterator<Item = f64>, shape: &[i64]) -> Tensor {
    let values: Vec<f64> = values.map(|value| f64::from(value as f32)).collect();
    Tensor::from_slice(&values).reshape(shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stream_is_splitmix64() {
        // The published first output of splitmix64 for seed 0 is e220a8397b1dcdaf.
        let first = uniform(0, 1).next().unwrap();
        assert_eq!(first, (0xe220_a839_7b1d_cdafu64 >> 11) as f64 * 2f64.powi(-53));
    }

    #[test]
    fn limits_follow_the_shape() {
        let largest = |shape: &[i64]| weights(3, 1, shape, 1.0).abs().max().double_value(&[]);
        assert!((0.099..0.1).contains(&largest(&[2000])));
        let limit = (6.0f64 / (9.0 * 48.0)).sqrt();
        assert!((0.99 * limit..limit).contains(&largest(&[3, 3, 16, 32])));
    }
}

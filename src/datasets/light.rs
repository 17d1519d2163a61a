//! Light that flickers from frame to frame: lamps do it, and cameras that set their exposure by themselves. A background
//! that is learned once cannot follow it. Where the background is bright enough to show it, each frame is divided by its
//! light. Not in the original.

use tch::{Kind, Tensor};

/// Level of the median frame from which on a value shows the light, and the share of values that must.
const BRIGHT: f64 = 0.2;
const BRIGHT_SHARE: f64 = 0.25;
/// Light flickers if it changes so much from one frame to the next, as a standard deviation: more than noise does to a
/// median over so many values.
const FLICKERS: f64 = 0.02;

/// Where frames of a dataset show their light.
#[derive(Debug)]
pub(super) struct Light {
    /// The levels that are compared with, `[values]`, and where they stand in a frame.
    median: Tensor,
    bright: Tensor,
}

impl Light {
    /// None where the median frame `[channels, S, S]` is too dark to show it.
    pub(super) fn shown_by(median: &Tensor) -> Option<Self> {
        let flat = median.flatten(0, 2);
        let bright = flat.gt(BRIGHT).nonzero().squeeze_dim(1);
        let enough = bright.size()[0] as f64 >= BRIGHT_SHARE * flat.size()[0] as f64;
        enough.then(|| Light { median: flat.index_select(0, &bright), bright })
    }

    /// How bright the light is in each of these frames `[frames, channels, S, S]`, 1 in the median frame: `[frames]`.
    pub(super) fn of(&self, frames: &Tensor) -> Tensor {
        let levels = frames.flatten(1, 3).index_select(1, &self.bright);
        (levels / &self.median).median_dim(1, false).0.clamp_min(BRIGHT)
    }

    /// Whether it changes much between these frames and those that follow them.
    pub(super) fn flickers(&self, frames: &Tensor, next: &Tensor) -> bool {
        let change = (self.of(next) / self.of(frames)).log();
        change.square().mean(Kind::Double).double_value(&[]).sqrt() > FLICKERS
    }
}

#[cfg(test)]
mod tests {
    use tch::{Device, Kind, Tensor};

    use super::Light;

    const FLOAT: (Kind, Device) = (Kind::Float, Device::Cpu);

    /// A grey ground on which a dark square moves.
    fn frames(factors: &[f64]) -> Tensor {
        let frame = |(place, factor): (usize, &f64)| {
            let frame = Tensor::full([3, 16, 16], 0.6, FLOAT);
            let _ = frame.narrow(1, 5, 4).narrow(2, place as i64 % 12, 4).fill_(0.1);
            frame * *factor
        };
        Tensor::stack(&factors.iter().enumerate().map(frame).collect::<Vec<_>>(), 0)
    }

    #[test]
    fn what_multiplies_a_frame_is_found_beside_what_moves() {
        let factors = [1.0, 0.8, 1.3, 0.7, 1.2];
        let ground = Tensor::full([3, 16, 16], 0.6, FLOAT);
        let light = Light::shown_by(&ground).unwrap();
        let found = Vec::<f32>::try_from(light.of(&frames(&factors))).unwrap();
        for (found, factor) in found.iter().zip(factors) {
            assert!((f64::from(*found) - factor).abs() < 1e-6, "{found} {factor}");
        }
        assert!(light.flickers(&frames(&factors), &frames(&[0.9, 1.1, 0.8, 1.2, 1.0])));
        assert!(!light.flickers(&frames(&factors), &frames(&factors.map(|factor| 1.01 * factor))));
    }

    #[test]
    fn dark_ground_shows_no_light() {
        let dark = Tensor::full([3, 16, 16], 0.1, FLOAT);
        assert!(Light::shown_by(&dark).is_none());
        let _ = dark.narrow(1, 0, 3).fill_(0.9);
        assert!(Light::shown_by(&dark).is_none());
    }
}

//! High dynamic range to the range of ordinary screens.
//!
//! The rule: samples become light on a screen (PQ: SMPTE ST 2084; HLG: ITU-R BT.2100 on a screen of 1000 cd/m2), relative to
//! the white of paper at 203 cd/m2 (ITU-R BT.2408); BT.2020's primaries become those of BT.709, negative light 0. The
//! brightest channel m is kept up to 1/2 and becomes 1 - (1/2)^2 / m above; the others keep their ratio to it. The result is
//! encoded for a screen with a gamma of 2.4 (ITU-R BT.1886). The map is monotonic: an object brighter than another stays so.

use super::Transfer;

/// Light of white paper, cd/m2.
const WHITE: f64 = 203.0;
/// Peak of the screen of HLG, cd/m2, and the exponent of its system gamma less 1.
const HLG_PEAK: f64 = 1000.0;
const HLG_GAMMA: f64 = 0.2;
/// Brightest channel that is kept, of white.
const KNEE: f32 = 0.5;
/// Entries of the tables: steps finer than those of 12 bits, and than a quarter of a grey level.
const STEPS: usize = 4096;

/// Maps levels of high dynamic range, 0 to 255, to levels of BT.709.
pub(super) struct ToneMap {
    /// Light by sample: of the screen (PQ) or the scene (HLG).
    light: Vec<f32>,
    /// Levels by the square root of light.
    levels: Vec<f32>,
    /// Gain from the scene to the screen, by the square root of the scene's luminance; none of PQ, which has the screen's light.
    gains: Option<Vec<f32>>,
}

impl ToneMap {
    pub(super) fn new(transfer: Transfer) -> Self {
        let is_hlg = transfer == Transfer::Hlg;
        let decode = if is_hlg { hlg_scene } else { |sample| 10_000.0 / WHITE * pq(sample) };
        let part = |step: usize| step as f64 / (STEPS - 1) as f64;
        let light = (0..STEPS).map(|step| decode(part(step)) as f32).collect();
        let levels = (0..STEPS).map(|step| (255.0 * part(step).powf(2.0 / 2.4)) as f32).collect();
        let gain = |step: usize| (HLG_PEAK / WHITE * part(step).powf(2.0 * HLG_GAMMA)) as f32;
        ToneMap { light, levels, gains: is_hlg.then(|| (0..STEPS).map(gain).collect()) }
    }

    pub(super) fn map(&self, levels: [f32; 3]) -> [f32; 3] {
        let last = (STEPS - 1) as f32;
        let [red, green, blue] =
            levels.map(|level| self.light[(level * (last / 255.0) + 0.5).clamp(0.0, last) as usize]);
        let screen = self.gains.as_ref().map_or(1.0, |gains| {
            let luminance = 0.2627 * red + 0.6780 * green + 0.0593 * blue;
            gains[(luminance.sqrt() * last + 0.5).min(last) as usize]
        });
        let [red, green, blue] = [red * screen, green * screen, blue * screen];
        let light = [
            1.6605 * red - 0.5876 * green - 0.0728 * blue,
            -0.1246 * red + 1.1329 * green - 0.0083 * blue,
            -0.0182 * red - 0.1006 * green + 1.1187 * blue,
        ];
        let light = light.map(|channel| channel.max(0.0));
        let most = light[0].max(light[1]).max(light[2]);
        let kept = if most <= KNEE { 1.0 } else { (1.0 - KNEE * KNEE / most) / most };
        light.map(|channel| self.levels[((channel * kept).sqrt() * last + 0.5).min(last) as usize])
    }
}

/// Light of a PQ sample, of 10,000 cd/m2 (SMPTE ST 2084, equation 4.1).
fn pq(sample: f64) -> f64 {
    let (m1, m2) = (2610.0 / 16_384.0, 2523.0 / 4096.0 * 128.0);
    let (c1, c2, c3) = (3424.0 / 4096.0, 2413.0 / 4096.0 * 32.0, 2392.0 / 4096.0 * 32.0);
    let power = sample.powf(1.0 / m2);
    ((power - c1).max(0.0) / (c2 - c3 * power)).powf(1.0 / m1)
}

/// Light of the scene of an HLG sample, 0 to 1 (ITU-R BT.2100, table 5).
fn hlg_scene(sample: f64) -> f64 {
    let (a, b, c) = (0.178_832_77, 0.284_668_92, 0.559_910_73);
    if sample <= 0.5 { sample * sample / 3.0 } else { (((sample - c) / a).exp() + b) / 12.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference values: PQ code 0.58 is 203 cd/m2 and HLG code 0.75 is 203 cd/m2 of white (ITU-R BT.2408, table 1), which
    /// the rule puts at 255 (3/4)^(1/2.4) = 226.2.
    #[test]
    fn white_paper_has_one_level_whatever_the_transfer() {
        assert!((10_000.0 * pq(0.58) - 203.0).abs() < 2.0, "{}", 10_000.0 * pq(0.58));
        for (transfer, code) in [(Transfer::Pq, 0.5807f32), (Transfer::Hlg, 0.75)] {
            let white = ToneMap::new(transfer).map([255.0 * code; 3]);
            assert!(white.iter().all(|level| (level - 226.2).abs() < 1.5), "{transfer:?}: {white:?}");
        }
    }

    #[test]
    fn brighter_stays_brighter_and_black_black() {
        for transfer in [Transfer::Pq, Transfer::Hlg] {
            let map = ToneMap::new(transfer);
            assert_eq!(map.map([0.0; 3]), [0.0; 3]);
            let greys: Vec<f32> = (0..=1023).map(|code| map.map([code as f32 * 255.0 / 1023.0; 3])[1]).collect();
            assert!(greys.is_sorted() && greys[1023] > 240.0 && greys[1023] <= 255.0, "{transfer:?}");
            // Red light stays red.
            let [red, green, blue] = map.map([150.0, 20.0, 20.0]);
            assert!(red > 2.0 * green && red > 2.0 * blue);
        }
    }
}

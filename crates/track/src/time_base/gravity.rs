//! What a measured acceleration of free fall implies for the time base.

/// Acceleration of free fall, m/s^2; 9.78 at the equator, 9.83 at the poles.
const GRAVITY: f64 = 9.81;
/// Relative difference that scale, latitude and drag explain.
const EXPLAINED: f64 = 0.03;
/// Ratios of frame rates that cameras and players mix up.
const RATIOS: [f64; 14] =
    [1.0 / 8.0, 1.0 / 4.0, 1.0 / 2.0, 0.8, 5.0 / 6.0, 1.2, 1.25, 2.0, 2.4, 4.0, 4.8, 8.0, 16.0, 32.0];

/// What an acceleration of free fall implies, measured in m/s^2 with a known scale and these times: `None` where it agrees
/// with 9.81 within three standard deviations or 3 %. Drag makes a fall slower, never faster.
pub fn gravity_line(measured: f64, deviation: f64) -> Option<String> {
    let difference = measured - GRAVITY;
    if measured.is_nan() || measured <= 0.0 || difference.abs() <= (3.0 * deviation).max(EXPLAINED * GRAVITY) {
        return None;
    }
    // Times that are too long by a factor make the acceleration too small by its square.
    let factor = (GRAVITY / measured).sqrt();
    let relative = 1.5 * deviation / measured + 0.5 * EXPLAINED;
    let usual = RATIOS.iter().find(|ratio| (factor / **ratio - 1.0).abs() < relative);
    let speed =
        if factor > 1.0 { format!("slowed down by {factor:.3}") } else { format!("sped up by {:.3}", 1.0 / factor) };
    let remedy = match usual {
        Some(ratio) if *ratio > 1.0 => format!("--slow-motion {ratio} would explain it"),
        Some(ratio) => format!("--slow-motion {ratio:.4} would explain it"),
        None => "or the scale is wrong by the ratio of the two".into(),
    };
    Some(format!(
        "with this scale and these times g = {measured:.2} m/s2, not {GRAVITY}: the video may be {speed}; {remedy}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_slowed_down_eightfold_is_named() {
        let line = gravity_line(GRAVITY / 64.0, 0.002).unwrap();
        assert!(line.contains("slowed down by 8.000") && line.contains("--slow-motion 8 "), "{line}");
        assert!(gravity_line(23.0, 0.2).unwrap().contains("sped up by 1.531"));
        assert_eq!(gravity_line(9.6, 0.05), None);
        assert_eq!(gravity_line(8.0, 1.0), None);
    }
}

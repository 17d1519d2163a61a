//! Synthetic videos with known positions: textured ellipses over a textured background.

use ndarray::{Array3, Array4};
use rayon::prelude::*;

use crate::similarity::Similarity;
use crate::video::Size;

/// Shadow that follows the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shadow {
    /// Centre from the object's `[x, y]`, pixels.
    pub offset: [f64; 2],
    /// Semi-axes, pixels.
    pub axes: [f64; 2],
    /// Light that remains, 0..=1.
    pub light: f64,
}

/// Textured ellipse that moves. `Default` is a disc of 12 pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingEllipse {
    /// Centre in each frame at mid-exposure, pixels.
    pub positions: Vec<[f64; 2]>,
    /// Angle in each frame, radians; 0 where absent.
    pub angles: Vec<f64>,
    /// Semi-axes, pixels.
    pub axes: [f64; 2],
    /// Mean colour, levels.
    pub colour: [f64; 3],
    /// Contrast of the texture, levels.
    pub texture: f64,
    pub shadow: Option<Shadow>,
}

impl Default for MovingEllipse {
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            angles: Vec::new(),
            axes: [12.0, 12.0],
            colour: [190.0, 70.0, 50.0],
            texture: 20.0,
            shadow: None,
        }
    }
}

impl MovingEllipse {
    /// A disc of 12 pixels with its centre at these places.
    pub fn at(positions: Vec<[f64; 2]>) -> Self {
        Self { positions, ..Self::default() }
    }

    /// Steps within the exposure of a frame, relative to its position.
    fn blur(&self, frame: usize, shutter: f64) -> Vec<[f64; 2]> {
        let last = self.positions.len() - 1;
        let (before, after) = (frame.saturating_sub(1), (frame + 1).min(last));
        let frames = (after - before).max(1) as f64;
        let way = [0, 1].map(|a| (self.positions[after][a] - self.positions[before][a]) / frames * shutter);
        let steps = (2.0 * way[0].hypot(way[1])).ceil().clamp(1.0, 40.0) as usize;
        (0..steps).map(|k| way.map(|w| w * ((k as f64 + 0.5) / steps as f64 - 0.5))).collect()
    }
}

/// Scene to render.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticScene {
    pub size: Size,
    /// Drawn in this order, with as many positions each.
    pub movers: Vec<MovingEllipse>,
    /// Mean colour of the background, levels.
    pub background: [f64; 3],
    /// Contrast of the background's texture, levels.
    pub background_texture: f64,
    /// Exposure time over the time between frames.
    pub shutter: f64,
    /// Standard deviation of the pixels' noise, levels.
    pub noise: f64,
    /// Change of brightness from the first to the last frame, as a factor less 1.
    pub drift: f64,
    /// Standard deviation of each frame's brightness, as a factor.
    pub flicker: f64,
    /// Standard deviation of the camera's position in each frame, pixels.
    pub shake: f64,
    /// Place `[x, y]` and angle of the scene in each frame, pixels and radians; zero where absent. Positions are places of
    /// the scene.
    pub camera: Vec<[f64; 3]>,
    pub seed: u64,
}

impl Default for SyntheticScene {
    fn default() -> Self {
        Self {
            size: Size { width: 320, height: 240 },
            movers: Vec::new(),
            background: [120.0, 125.0, 118.0],
            background_texture: 25.0,
            shutter: 0.3,
            noise: 2.0,
            drift: 0.0,
            flicker: 0.0,
            shake: 0.0,
            camera: Vec::new(),
            seed: 1,
        }
    }
}

impl SyntheticScene {
    /// A mover before a background with the standard settings.
    pub fn of(mover: MovingEllipse) -> Self {
        Self { movers: vec![mover], ..Self::default() }
    }

    pub fn frames(&self) -> usize {
        self.movers.iter().map(|mover| mover.positions.len()).max().unwrap_or(0)
    }

    /// Renders all frames, `[frames, height, width, 3]`.
    pub fn render(&self) -> Array4<u8> {
        let Size { width, height } = self.size;
        let renderer = SyntheticRenderer::new(self);
        let mut bytes = vec![0; self.frames() * height * width * 3];
        let images = bytes.par_chunks_mut(height * width * 3).enumerate();
        images.for_each(|(frame, image)| renderer.frame(frame, image));
        Array4::from_shape_vec((self.frames(), height, width, 3), bytes).expect("one byte for each sample")
    }

    fn background(&self, scene: &Similarity) -> Array3<f64> {
        let level = |(y, x, c): (usize, usize, usize)| {
            let at = scene.apply([x as f64, y as f64]);
            self.background[c] + self.background_texture * texture(at, 17.0, self.seed + c as u64 / 2)
        };
        Array3::from_shape_fn((self.size.height, self.size.width, 3), level)
    }

    fn shade(&self, levels: &mut Array3<f64>, at: [f64; 2], camera: &Similarity, shadow: Shadow) {
        let centre = camera.apply([0, 1].map(|a| at[a] + shadow.offset[a]));
        let (height, width, _) = levels.dim();
        for y in span(centre[1], shadow.axes[1] + 8.0, height) {
            for x in span(centre[0], shadow.axes[0] + 8.0, width) {
                let at = [x as f64 - centre[0], y as f64 - centre[1]];
                // A penumbra of about six pixels.
                let share = cover(at, shadow.axes, 6.0);
                (0..3).for_each(|c| levels[[y, x, c]] *= 1.0 - share * (1.0 - shadow.light));
            }
        }
    }

    fn draw(&self, levels: &mut Array3<f64>, (place, frame): (usize, usize), camera: &Similarity) {
        let mover = &self.movers[place];
        let steps = mover.blur(frame, self.shutter);
        let way = steps.iter().map(|s| s[0].hypot(s[1])).fold(0.0, f64::max);
        let reach = mover.axes[0].max(mover.axes[1]) + way + 2.0;
        let centre = camera.apply(mover.positions[frame]);
        let (sin, cos) = (mover.angles.get(frame).copied().unwrap_or(0.0) + camera.angle()).sin_cos();
        let (height, width, _) = levels.dim();
        for y in span(centre[1], reach, height) {
            for x in span(centre[0], reach, width) {
                let (mut share, mut colour) = (0.0, [0.0; 3]);
                for step in &steps {
                    let at = [x as f64 - centre[0] - step[0], y as f64 - centre[1] - step[1]];
                    let own = [cos * at[0] + sin * at[1], cos * at[1] - sin * at[0]];
                    let part = cover(own, mover.axes, 1.0) / steps.len() as f64;
                    if part > 0.0 {
                        let pattern = mover.texture * texture(own, 7.0, self.seed + 99 + 13 * place as u64);
                        share += part;
                        (0..3).for_each(|c| colour[c] += part * (mover.colour[c] + pattern));
                    }
                }
                (0..3).for_each(|c| levels[[y, x, c]] = (1.0 - share) * levels[[y, x, c]] + colour[c]);
            }
        }
    }
}

/// Renders the frames of a scene one by one.
#[derive(Debug)]
pub struct SyntheticRenderer<'a> {
    scene: &'a SyntheticScene,
    /// Of a camera that stands.
    background: Option<Array3<f64>>,
    /// Quantiles of the standard normal distribution in random order: quicker to draw from than a formula.
    normal: Vec<f64>,
}

impl<'a> SyntheticRenderer<'a> {
    pub fn new(scene: &'a SyntheticScene) -> Self {
        let stands = scene.camera.is_empty() && scene.shake == 0.0;
        let background = stands.then(|| scene.background(&Similarity::IDENTITY));
        let mut random = SplitMix64::new(scene.seed);
        SyntheticRenderer { scene, background, normal: (0..1 << 16).map(|_| random.normal()).collect() }
    }

    /// Renders one frame into `image`, `[height, width, 3]`.
    pub fn frame(&self, frame: usize, image: &mut [u8]) {
        let scene = self.scene;
        let mut random = SplitMix64::new(scene.seed ^ (frame as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let [x, y, angle] = scene.camera.get(frame).copied().unwrap_or([0.0; 3]);
        let translation = [x + scene.shake * random.normal(), y + scene.shake * random.normal()];
        let camera = Similarity { a: angle.cos(), b: angle.sin(), u: translation[0], v: translation[1] };
        let time = frame as f64 / (scene.frames().max(2) - 1) as f64;
        let light = (1.0 + scene.drift * time) * (1.0 + scene.flicker * random.normal());
        let mut levels = match &self.background {
            Some(background) => background.clone(),
            None => scene.background(&camera.inverse()),
        };
        for mover in &scene.movers {
            if let Some(shadow) = mover.shadow {
                scene.shade(&mut levels, mover.positions[frame], &camera, shadow);
            }
        }
        (0..scene.movers.len()).for_each(|place| scene.draw(&mut levels, (place, frame), &camera));
        for (to, level) in image.iter_mut().zip(&levels) {
            let noise = self.normal[random.next() as usize & (self.normal.len() - 1)];
            *to = (level * light + scene.noise * noise).round().clamp(0.0, 255.0) as u8;
        }
    }
}

fn span(centre: f64, reach: f64, end: usize) -> std::ops::Range<usize> {
    let first = (centre - reach).floor().max(0.0) as usize;
    let last = (centre + reach).ceil().max(-1.0) + 1.0;
    first.min(end)..(last as usize).min(end)
}

/// Share of a pixel covered by an ellipse around the origin whose edge is `soft` pixels wide.
fn cover(at: [f64; 2], axes: [f64; 2], soft: f64) -> f64 {
    let relative = (at[0] / axes[0]).hypot(at[1] / axes[1]);
    let distance =
        if relative > 1e-9 { (1.0 - relative) * at[0].hypot(at[1]) / relative } else { axes[0].min(axes[1]) };
    (0.5 + distance / soft).clamp(0.0, 1.0)
}

/// Smooth noise around 0 with a standard deviation near 0.5: two octaves of lattice noise, `cell` pixels the coarser.
fn texture(at: [f64; 2], cell: f64, seed: u64) -> f64 {
    let octave = |cell: f64, seed: u64| {
        let place = at.map(|v| v / cell);
        let corner = place.map(f64::floor);
        let part = [place[0] - corner[0], place[1] - corner[1]].map(|t| t * t * (3.0 - 2.0 * t));
        let value = |dx: i64, dy: i64| lattice(corner[0] as i64 + dx, corner[1] as i64 + dy, seed);
        let row = |dy: i64| value(0, dy) * (1.0 - part[0]) + value(1, dy) * part[0];
        row(0) * (1.0 - part[1]) + row(1) * part[1]
    };
    octave(cell, seed) + 0.5 * octave(0.37 * cell, seed + 7)
}

/// Value in -1..1 of a lattice point.
fn lattice(x: i64, y: i64, seed: u64) -> f64 {
    let key = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    2.0 * SplitMix64::new(key ^ seed.wrapping_mul(0x1656_67B1_9E37_79F9)).uniform() - 1.0
}

/// SplitMix64 (Steele, Lea and Flood 2014).
#[derive(Debug)]
struct SplitMix64(u64);

impl SplitMix64 {
    fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal number (Box and Muller).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_centroid_of_a_plain_disc_is_its_position() {
        let scene = SyntheticScene {
            size: Size { width: 120, height: 90 },
            background_texture: 0.0,
            noise: 0.0,
            ..SyntheticScene::of(MovingEllipse { texture: 0.0, ..MovingEllipse::at(vec![[60.3, 41.7]; 2]) })
        };
        let frames = scene.render();
        let (mut total, mut moment) = (0.0, [0.0; 2]);
        for ((frame, y, x, c), &level) in frames.indexed_iter() {
            if frame == 0 && c == 0 {
                let weight = f64::from(level) - 120.0;
                total += weight;
                moment[0] += weight * x as f64;
                moment[1] += weight * y as f64;
            }
        }
        // Rounding of some 80 edge pixels to 1/70 of the contrast.
        assert!((moment[0] / total - 60.3).abs() < 0.02 && (moment[1] / total - 41.7).abs() < 0.02);
        assert!((total / 70.0 - std::f64::consts::PI * 144.0).abs() < 3.0);
    }

    #[test]
    fn noise_has_its_standard_deviation() {
        let mut random = SplitMix64::new(5);
        let values: Vec<f64> = (0..20_000).map(|_| random.normal()).collect();
        let square = values.iter().map(|v| v * v).sum::<f64>() / 20_000.0;
        // Three standard errors of a variance: 3 sqrt(2 / 20000).
        assert!((square - 1.0).abs() < 0.03, "{square}");
    }
}

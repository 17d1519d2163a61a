//! Motions of synthetic videos: each has an equation of the gallery and true values, and lasts as long as its video. The
//! trajectories are integrated here, apart from the library's integrators.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::trajectory::{SampleTimes, integrate};

/// Sides of the pictures, pixels.
pub const WIDTH: usize = 1280;
pub const HEIGHT: usize = 720;

/// Motion of some objects with what is to be found.
pub struct TrueMotion {
    /// Of each object: its position in each frame, pixels.
    pub positions: Vec<Vec<[f64; 2]>>,
    /// True values in pixels and seconds; the first is the one that the video is made for.
    pub truth: Vec<(&'static str, f64)>,
    /// The same where the objects are numbered the other way round; empty where that makes no difference. A measurement numbers them
    /// as it finds them.
    pub renumbered: Vec<f64>,
}

/// A kind of motion.
pub struct MotionKind {
    pub name: &'static str,
    /// A built-in equation, or one of the gallery.
    pub equation: &'static str,
    /// Fewest and most frames of a video.
    pub frames: [usize; 2],
    /// The motion over so many seconds.
    pub motion: fn(&mut ChaCha8Rng, &SampleTimes) -> TrueMotion,
}

pub const KINDS: [MotionKind; 10] = [
    MotionKind { name: "throw", equation: "falling", frames: [15, 150], motion: throw },
    MotionKind { name: "fall with linear drag", equation: "fall_linear_drag", frames: [20, 200], motion: linear_drag },
    MotionKind {
        name: "fall with quadratic drag",
        equation: "fall_quadratic_drag",
        frames: [20, 200],
        motion: quadratic_drag,
    },
    MotionKind { name: "pendulum", equation: "swing", frames: [40, 600], motion: pendulum },
    MotionKind { name: "mass on a spring", equation: "mass_on_a_spring", frames: [40, 600], motion: mass_on_a_spring },
    MotionKind { name: "sliding block", equation: "sliding_block", frames: [15, 150], motion: sliding_block },
    MotionKind { name: "bouncing ball", equation: "bounce_on_a_floor", frames: [40, 400], motion: bounce },
    MotionKind { name: "charge in a field", equation: "charge_in_a_field", frames: [30, 400], motion: charge },
    MotionKind { name: "two balls on a spring", equation: "text_spring", frames: [40, 400], motion: spring },
    MotionKind {
        name: "unequal masses on a spring",
        equation: "unequal_masses",
        frames: [40, 400],
        motion: unequal_masses,
    },
];

/// A start near the left or the right edge, the direction inwards, and the way across.
fn across(random: &mut ChaCha8Rng) -> (f64, f64) {
    let left = random.random_bool(0.5);
    let way = random.random_range(600.0..1050.0);
    if left { (110.0, way) } else { (WIDTH as f64 - 110.0, -way) }
}

/// From one side to the other on a parabola whose vertex is within the picture.
fn throw(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let time = clock.seconds();
    let (x, way) = across(random);
    let height = random.random_range(250.0..500.0);
    // Share of the time before the vertex.
    let rise = random.random_range(0.0..0.6) * time;
    let g = 2.0 * height / rise.max(time - rise).powi(2);
    let top = random.random_range(80.0..HEIGHT as f64 - 80.0 - height);
    let at = |t: f64| [x + way * t / time, top + g * (t - rise).powi(2) / 2.0];
    let positions = (0..clock.frames).map(|frame| at(frame as f64 / clock.rate)).collect();
    TrueMotion { positions: vec![positions], truth: vec![("g", g)], renumbered: Vec::new() }
}

/// A fall through a medium, with a resistance that takes a good part of the speed within the picture.
fn drag(random: &mut ChaCha8Rng, clock: &SampleTimes, quadratic: bool) -> TrueMotion {
    let time = clock.seconds();
    let (x, way) = across(random);
    let fall = random.random_range(350.0..520.0);
    let c = if quadratic { random.random_range(0.5..2.0) / fall } else { random.random_range(1.0..3.0) / time };
    // Times the fall without resistance: what is lost by it.
    let mut g = 2.0 * fall / time.powi(2);
    let mut positions = Vec::new();
    for _ in 0..30 {
        let start = (vec![[x, 100.0]], vec![[0.6 * way / time, 0.0]]);
        let pull = |_: &[[f64; 2]], v: &[[f64; 2]]| {
            let resistance = if quadratic { c * v[0][0].hypot(v[0][1]) } else { c };
            vec![[-resistance * v[0][0], g - resistance * v[0][1]]]
        };
        positions = integrate(clock, start, pull, |_| ());
        let fallen = positions[0][clock.frames - 1][1] - 100.0;
        if (fallen / fall - 1.0).abs() < 1e-3 {
            break;
        }
        g *= fall / fallen;
    }
    TrueMotion { positions, truth: vec![("g", g), ("c", c)], renumbered: Vec::new() }
}

fn linear_drag(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    drag(random, clock, false)
}

fn quadratic_drag(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    drag(random, clock, true)
}

/// Period of a motion that swings: from one swing in the video to one in at least 12 frames.
fn period(random: &mut ChaCha8Rng, clock: &SampleTimes) -> f64 {
    let most = clock.seconds() / 1.2;
    let least = (clock.seconds() / 12.0).max(14.0 / clock.rate);
    if least < most { (random.random_range(least.ln()..most.ln())).exp() } else { most }
}

/// A ball on a string whose pivot may be above the picture.
fn pendulum(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let rate = std::f64::consts::TAU / period(random, clock);
    let string = random.random_range(350.0..900.0);
    let bottom = random.random_range(500.0..640.0);
    let amplitude = (random.random_range(120.0_f64..400.0) / string).min(0.9);
    let damping = random.random_range(0.0..0.5) / clock.seconds();
    let start = (vec![[amplitude, 0.0]], vec![[0.0, 0.0]]);
    let pull = |x: &[[f64; 2]], v: &[[f64; 2]]| vec![[-rate * rate * x[0][0].sin() - damping * v[0][0], 0.0]];
    let angles = integrate(clock, start, pull, |_| ()).remove(0);
    let middle = WIDTH as f64 / 2.0 + random.random_range(-150.0..150.0);
    let place = |angle: &[f64; 2]| [middle + string * angle[0].sin(), bottom - string * (1.0 - angle[0].cos())];
    let positions = vec![angles.iter().map(place).collect()];
    TrueMotion { positions, truth: vec![("l", 9.80665 / (rate * rate)), ("c", damping)], renumbered: Vec::new() }
}

fn mass_on_a_spring(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let k = (std::f64::consts::TAU / period(random, clock)).powi(2);
    let c = random.random_range(0.0..1.0) / clock.seconds();
    let rest = [random.random_range(300.0..900.0), 360.0];
    let amplitude = random.random_range(120.0..260.0);
    let start = (vec![[rest[0], rest[1] + amplitude]], vec![[0.0; 2]]);
    let pull = |x: &[[f64; 2]], v: &[[f64; 2]]| vec![[0, 1].map(|i| -k * (x[0][i] - rest[i]) - c * v[0][i])];
    let positions = integrate(clock, start, pull, |_| ());
    TrueMotion { positions, truth: vec![("k", k), ("c", c)], renumbered: Vec::new() }
}

/// A block that comes to rest just after the video.
fn sliding_block(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let (x, way) = across(random);
    let time = clock.seconds() * random.random_range(1.05..1.6);
    let f = 2.0 * way.abs() / time.powi(2);
    let y = random.random_range(200.0..520.0);
    let slope = random.random_range(-0.1..0.1);
    let path = |t: f64| way.signum() * (f * time * t - f * t * t / 2.0);
    let positions = (0..clock.frames).map(|frame| path(frame as f64 / clock.rate));
    let turned: (f64, f64) = (f64::cos(slope), f64::sin(slope));
    let positions = positions.map(|s| [x + s * turned.0, y + s * turned.1]).collect();
    TrueMotion { positions: vec![positions], truth: vec![("f", f)], renumbered: Vec::new() }
}

fn bounce(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let (x, way) = across(random);
    let floor = random.random_range(560.0..650.0);
    let height = random.random_range(350.0..floor - 100.0);
    let e: f64 = random.random_range(0.6..0.9);
    // So many falls and bounces.
    let bounces = random.random_range(2..5);
    let falls = 1.0 + (1..bounces).map(|bounce| 2.0 * e.powi(bounce)).sum::<f64>() + e.powi(bounces);
    let fall = clock.seconds() / falls;
    let g = 2.0 * height / fall.powi(2);
    let start = (vec![[x, floor - height]], vec![[way / clock.seconds(), 0.0]]);
    let positions = integrate(
        clock,
        start,
        |_, _| vec![[0.0, g]],
        |(at, speed)| {
            if at[0][1] > floor && speed[0][1] > 0.0 {
                // Back to the time of the impact, then up.
                let late = (at[0][1] - floor) / speed[0][1];
                speed[0][1] = -e * (speed[0][1] - g * late) + g * late;
                at[0][1] = floor + late * speed[0][1];
            }
        },
    );
    TrueMotion { positions, truth: vec![("g", g), ("e", e)], renumbered: Vec::new() }
}

/// Circles that drift across.
fn charge(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let b = std::f64::consts::TAU / period(random, clock) * if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let radius = random.random_range(80.0..180.0);
    let drift = [random.random_range(-300.0..300.0), random.random_range(-80.0..80.0)].map(|d| d / clock.seconds());
    let push = [b * drift[1], -b * drift[0]];
    let start = (
        vec![[640.0 - drift[0] * clock.seconds() / 2.0, 360.0 - radius - drift[1] * clock.seconds() / 2.0]],
        vec![[radius * b + drift[0], drift[1]]],
    );
    let pull = |_: &[[f64; 2]], v: &[[f64; 2]]| vec![[push[0] - b * v[0][1], push[1] + b * v[0][0]]];
    let positions = integrate(clock, start, pull, |_| ());
    TrueMotion { positions, truth: vec![("b", b), ("ex", push[0]), ("ey", push[1])], renumbered: Vec::new() }
}

/// Two balls that swing against each other and turn about their centre of mass.
fn joined(random: &mut ChaCha8Rng, clock: &SampleTimes, m: f64) -> (Vec<Vec<[f64; 2]>>, f64, f64) {
    // Of the reduced mass.
    let rate = std::f64::consts::TAU / period(random, clock);
    let k = rate * rate / (1.0 + 1.0 / m);
    let rest = random.random_range(160.0..250.0);
    let stretch = random.random_range(0.25..0.5) * rest;
    let turn = random.random_range(-0.5..0.5) * rate;
    let angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
    let (along, beside) = ([angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]);
    let apart = (rest + stretch) / 2.0;
    // Both speeds add up to no momentum.
    let share = [2.0 * m / (1.0 + m), -2.0 / (1.0 + m)];
    let middle = [640.0, 360.0];
    let start = (
        share.map(|part| [0, 1].map(|i| middle[i] + part * apart * along[i])).to_vec(),
        share.map(|part| [0, 1].map(|i| part * turn * apart * 0.5 * beside[i])).to_vec(),
    );
    let pull = |x: &[[f64; 2]], _: &[[f64; 2]]| {
        let way = [x[0][0] - x[1][0], x[0][1] - x[1][1]];
        let length = way[0].hypot(way[1]);
        let force = way.map(|w| k * (length - rest) * w / length);
        vec![force.map(|f| -f), force.map(|f| f / m)]
    };
    (integrate(clock, start, pull, |_| ()), k, rest / 2.0)
}

fn spring(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let (positions, k, l) = joined(random, clock, 1.0);
    TrueMotion { positions, truth: vec![("k", k), ("l", l)], renumbered: Vec::new() }
}

fn unequal_masses(random: &mut ChaCha8Rng, clock: &SampleTimes) -> TrueMotion {
    let m = random.random_range(1.5..3.0);
    let (positions, k, l) = joined(random, clock, m);
    // Over the other mass.
    let renumbered = vec![k / m, l, 1.0 / m];
    TrueMotion { positions, truth: vec![("k", k), ("l", l), ("m", m)], renumbered }
}

//! How often `paig measure` chooses the true equation, and names the term that was left out: `cargo xtask equation-choice`.

use std::collections::BTreeMap;

use anyhow::Result;
use clap::Args;
use paig::generators::variant::Variant;
use paig::network::cells::Coordinates;
use paig::tasks::Task;
use paig::tasks::equation_file::EquationFile;
use paig::tasks::gallery::GALLERY;
use paig_video::measure::trials::Trial;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::trajectory::{SampleTimes, integrate};

/// Frames of a trial, and how many of them fall on one frame of a task.
const FRAMES: usize = 120;
const FINER: usize = 4;
/// Noise of the positions, pixels of a video that is ten times as large as a frame.
const NOISE: f64 = 0.5;

/// Makes trajectories by every equation of the gallery, and counts which equation explains each best; then leaves terms out.
#[derive(Debug, Args)]
pub struct EquationChoiceArguments {
    /// Trajectories of each equation
    #[arg(default_value_t = 3)]
    seeds: u64,
}

/// Equations that hold what another one says.
const CONTAINED: [(&str, &[&str]); 9] = [
    (
        "falling",
        &["fall_linear_drag", "fall_quadratic_drag", "constant_acceleration", "charge_in_a_field", "bounce_on_a_floor"],
    ),
    ("constant_acceleration", &["charge_in_a_field"]),
    ("free_pendulum", &["damped_pendulum", "swing", "driven_pendulum"]),
    ("damped_pendulum", &["swing", "driven_pendulum"]),
    ("swing", &["damped_pendulum"]),
    ("text_spring", &["spring", "damped_spring", "unequal_masses"]),
    ("text_damped_spring", &["damped_spring"]),
    ("lossy_bounce", &["bounce_on_a_floor"]),
    ("gravity_masses", &["charges", "gravity"]),
];

/// # Errors
/// A gallery whose clips cannot be made.
pub fn run(arguments: &EquationChoiceArguments) -> Result<()> {
    choices(arguments.seeds)?;
    missing_terms()
}

fn choices(seeds: u64) -> Result<()> {
    let (mut right, mut all) = (0, 0);
    println!("{:<24} chosen", "true equation");
    for entry in GALLERY {
        let mut task = Task::from_toml(entry.text)?;
        // Surfaces and strings are fitted by name only.
        let constrained = task.system.cell.table().is_some_and(|table| table.is_constrained());
        if task.system.cell.coordinates != Coordinates::Position || task.scene.is_none() || constrained {
            continue;
        }
        task.system.dt /= FINER as f64;
        let mut chosen = BTreeMap::<String, usize>::new();
        for seed in 0..seeds {
            let variant = Variant::new(&task, seed)?;
            let frames = FRAMES.min(FINER * task.test_frames);
            let clip = variant.world().clip(frames, &mut ChaCha8Rng::seed_from_u64(seed))?;
            let trial = Trial {
                objects: task.system.objects,
                positions: clip.iter().flat_map(|state| state.positions.iter().copied()).collect(),
                side: task.system.side as f64,
                wall_margin: task.system.walls.near,
                interval: 1.0 / 30.0,
                noise: NOISE,
                seed,
            };
            let choice = trial.choice()?;
            let best = choice.equations.first().cloned().unwrap_or_default();
            let contains = |(name, others): &(&str, &[&str])| *name == entry.name && others.contains(&&*best);
            let correct = choice.explained && (best == entry.name || CONTAINED.iter().any(contains));
            right += usize::from(correct);
            all += 1;
            let mark = if correct { "" } else { " (wrong)" };
            *chosen
                .entry(format!("{best}{}{mark}", if choice.explained { "" } else { ", explains too little" }))
                .or_default() += 1;
        }
        let chosen: Vec<String> = chosen.iter().map(|(name, count)| format!("{count} x {name}")).collect();
        println!("{:<24} {}", entry.name, chosen.join(", "));
    }
    println!("right: {right} of {all}\n");
    Ok(())
}

/// A motion by an equation of the gallery, and by the same with a term that is left out of it.
struct HiddenTerm {
    equation: &'static str,
    /// Name of the term; none where nothing is left out.
    term: Option<&'static str>,
    begin: [f64; 4],
    /// Acceleration at a place and a velocity.
    acceleration: fn([f64; 2], [f64; 2]) -> [f64; 2],
    /// What the camera does to a place.
    view: fn([f64; 2]) -> [f64; 2],
}

fn as_it_is(at: [f64; 2]) -> [f64; 2] {
    at
}

/// A pendulum 40 pixels long that hangs in the middle.
fn swing([x, y]: [f64; 2], [vx, vy]: [f64; 2]) -> [f64; 2] {
    let r = [x - 32.0, y - 10.0];
    let pull = (60.0 * r[1] + vx * vx + vy * vy) / (r[0] * r[0] + r[1] * r[1]);
    [-pull * r[0], 60.0 - pull * r[1]]
}

/// A spring about (32, 32).
fn spring([x, y]: [f64; 2]) -> [f64; 2] {
    [-20.0 * (x - 32.0), -20.0 * (y - 32.0)]
}

const LINEAR: Option<&str> = Some("linear friction");
const DRAG: Option<&str> = Some("quadratic friction (drag)");
const DRY: Option<&str> = Some("dry friction");
const CONSTANT: Option<&str> = Some("constant force (or a tilted camera)");
const MAGNUS: Option<&str> = Some("force across the velocity (Magnus)");
const SPRING: Option<&str> = Some("spring");
const LENS: Option<&str> = Some("lens distortion");
const PERSPECTIVE: Option<&str> = Some("perspective: the plane of the motion is seen at an angle");

fn motions() -> Vec<HiddenTerm> {
    let fall =
        |term, begin, acceleration| HiddenTerm { equation: "falling", term, begin, acceleration, view: as_it_is };
    let swings =
        |term, begin, acceleration| HiddenTerm { equation: "free_pendulum", term, begin, acceleration, view: as_it_is };
    let hangs = |term, begin, acceleration| HiddenTerm {
        equation: "mass_on_a_spring",
        term,
        begin,
        acceleration,
        view: as_it_is,
    };
    vec![
        fall(LINEAR, [8.0, 10.0, 20.0, -8.0], |_, [vx, vy]| [-0.3 * vx, 8.0 - 0.3 * vy]),
        fall(DRAG, [8.0, 10.0, 20.0, -8.0], |_, [vx, vy]| [-0.02 * vx.hypot(vy) * vx, 8.0 - 0.02 * vx.hypot(vy) * vy]),
        fall(CONSTANT, [8.0, 20.0, 12.0, -14.0], |_, _| [1.5, 8.0]),
        fall(MAGNUS, [8.0, 30.0, 10.0, -14.0], |_, [vx, vy]| [-0.15 * vy, 8.0 + 0.15 * vx]),
        fall(SPRING, [12.0, 20.0, 8.0, -10.0], |[x, y], _| [-0.3 * (x - 30.0), 8.0 - 0.3 * (y - 30.0)]),
        swings(LINEAR, [52.0, 44.6, 0.0, 0.0], |p, v| [0, 1].map(|i| swing(p, v)[i] - 0.1 * v[i])),
        swings(DRAG, [52.0, 44.6, 0.0, 0.0], |p, v| [0, 1].map(|i| swing(p, v)[i] - 0.006 * v[0].hypot(v[1]) * v[i])),
        swings(DRY, [52.0, 44.6, 0.0, 0.0], |p, v| {
            [0, 1].map(|i| swing(p, v)[i] - 2.0 * (v[0].hypot(v[1]) / 0.5).tanh() * v[i] / v[0].hypot(v[1]).max(1e-9))
        }),
        hangs(DRY, [34.0, 50.0, 0.0, 0.0], |p, v| {
            [0, 1].map(|i| spring(p)[i] - 4.0 * (v[0].hypot(v[1]) / 0.5).tanh() * v[i] / v[0].hypot(v[1]).max(1e-9))
        }),
        hangs(DRAG, [34.0, 50.0, 0.0, 0.0], |p, v| [0, 1].map(|i| spring(p)[i] - 0.01 * v[0].hypot(v[1]) * v[i])),
        HiddenTerm { view: bent, ..swings(LENS, [54.0, 42.8, 0.0, 0.0], swing) },
        HiddenTerm { view: oblique, ..hangs(PERSPECTIVE, [50.0, 44.0, 0.0, 20.0], |p, _| spring(p)) },
        fall(None, [8.0, 10.0, 14.0, -4.0], |_, _| [0.0, 6.0]),
        fall(None, [50.0, 40.0, -10.0, -16.0], |_, _| [0.0, 9.0]),
        fall(None, [20.0, 10.0, 3.0, 2.0], |_, _| [0.0, 5.0]),
        swings(None, [52.0, 44.6, 0.0, 0.0], swing),
        swings(None, [40.0, 49.2, 0.0, 0.0], swing),
        swings(None, [60.0, 38.6, 0.0, 0.0], swing),
        hangs(None, [34.0, 50.0, 0.0, 0.0], |p, v| [0, 1].map(|i| spring(p)[i] - 0.2 * v[i])),
        hangs(None, [50.0, 40.0, 0.0, 30.0], |p, v| [0, 1].map(|i| spring(p)[i] - 0.4 * v[i])),
        hangs(None, [32.0, 20.0, 0.0, 0.0], |p, v| [0, 1].map(|i| spring(p)[i] - 0.1 * v[i])),
        HiddenTerm { equation: "constant_acceleration", ..fall(None, [10.0, 50.0, 20.0, -4.0], |_, _| [-4.0, -1.0]) },
    ]
}

/// A wide lens: 6 % at the corner.
fn bent([x, y]: [f64; 2]) -> [f64; 2] {
    let from_middle = [x - 32.0, y - 32.0];
    let factor = 1.0 - 0.06 * (from_middle[0].powi(2) + from_middle[1].powi(2)) / 2048.0;
    from_middle.map(|d| 32.0 + factor * d)
}

/// The right side nearer than the left.
fn oblique([x, y]: [f64; 2]) -> [f64; 2] {
    let from_middle = [x - 32.0, y - 32.0];
    let factor = 1.0 / (1.0 - 0.15 * from_middle[0] / 45.25);
    from_middle.map(|d| 32.0 + factor * d)
}

fn missing_terms() -> Result<()> {
    let clock = SampleTimes { frames: FRAMES, rate: 30.0 };
    let (mut right, mut all) = (0, 0);
    println!("{:<24} {:<58} named", "equation", "left out");
    for (seed, motion) in (0..).zip(motions()) {
        let [x, y, vx, vy] = motion.begin;
        let pull = |at: &[[f64; 2]], speed: &[[f64; 2]]| vec![(motion.acceleration)(at[0], speed[0])];
        let positions = integrate(&clock, (vec![[x, y]], vec![[vx, vy]]), pull, |_| ()).remove(0);
        let trial = Trial {
            objects: 1,
            positions: positions.into_iter().flat_map(motion.view).collect(),
            side: 64.0,
            wall_margin: 0.0,
            interval: 1.0 / clock.rate,
            noise: NOISE,
            seed,
        };
        let missing = trial.missing(&EquationFile::named(motion.equation)?)?;
        let named = missing.as_ref().map(|missing| &*missing.name);
        right += usize::from(named == motion.term);
        all += 1;
        println!("{:<24} {:<58} {}", motion.equation, motion.term.unwrap_or("nothing"), named.unwrap_or("nothing"));
    }
    println!("right: {right} of {all}");
    Ok(())
}

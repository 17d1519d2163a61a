//! Whether a trained model has found what it looked for, judged on held-out clips without any truth.
//!
//! Two measures of the positions, the encoder's and the masks' centroids, are explained anew by the equation. What was
//! learned must agree with what they say.

use std::collections::BTreeMap;

use anyhow::Result;
use tch::{Kind, Tensor};

use super::config::Config;
use super::identify::Identify;
use super::identify::encoded_positions::EncodedPositions;
use super::identify::explain::{Explanation, explain};
use super::identify::fit::FitStart;
use super::identify::missing::PositionResiduals;
use super::objects::motion::MotionDetector;
use crate::datasets::iterators::Clips;
use crate::evaluation::{self, each_pass};
use crate::network::physics_models::losses::{Loss, LossAccumulator, Losses, MeanLosses};
use crate::network::physics_models::{ForwardPass, PhysicsNet};
use crate::runs::verdict::{Check, Interval, Verdict};

/// Clips on which a model is judged, at most.
const CLIPS: usize = 200;
/// Of the frames, those in which an object's mask must hold something that moves.
const PRESENT: f64 = 0.9;
/// An object's mask must hold this share of an equal part of what moves.
const OWN_SHARE: f64 = 0.1;
/// Of what moves, the share that the masks must hold together.
const COVERED: f64 = 0.6;
/// Of the squared difference from the background where something moves, the share that the drawing must explain.
const DRAWN: f64 = 0.75;
/// Where this share is, the masks may be faint: what is drawn where it is has been seen.
const WELL_DRAWN: f64 = 0.95;
/// Pixels that the objects' masks hold.
const HELD: f64 = 0.5;
/// Of the positions, the share that the equation must explain.
const EXPLAINED: f64 = 0.9;
/// Largest relative width of a parameter's interval where the task says nothing, per cent to each side.
const WIDTH: f64 = 5.0;

/// Judges a model that was trained by `config` on `train` from clips it has not learned from.
///
/// # Errors
/// Clips shorter than L + T_pred, positions that are not finite.
pub fn judge(config: &Config, model: &PhysicsNet, train: &Clips, held_out: &Clips) -> Result<Verdict> {
    let _guard = tch::no_grad_guard();
    let motion = MotionDetector::measure(train, config.seed);
    let seen = EncodedPositions::of(
        model,
        held_out,
        &motion,
        CLIPS,
        config.join.validation_clips.min(evaluation::batch(held_out)),
    );
    let filmed = config.task.video().is_some();
    // Later in a filmed video an object may be where nothing was before; the measurement finds it there by its mask.
    let mut drawn = if filmed { DrawnShare::new(train, &motion) } else { DrawnShare::new(held_out, &motion) };
    let mut losses = LossAccumulator::default();
    each_judged(model, held_out, |chosen, frames, pass| {
        losses.add(&Losses::new(pass, frames, &model.system), chosen.len());
        if !filmed {
            drawn.add(chosen, frames, pass, None);
        }
    })?;
    if filmed {
        // A shadow, a string or a hand moves, too, and is no object.
        each_judged(model, train, |chosen, frames, pass| {
            drawn.add(chosen, frames, pass, Some(model.system.objects as i64));
        })?;
    }
    let (drawn, losses) = (drawn.share(), losses.values());
    let mut checks = vec![objects(&seen, drawn, filmed), drawing(drawn)];
    if model.black_box.is_some() {
        // Nothing was said of the motion that it could be judged by.
        checks.extend(limits(config, &losses));
        return Ok(Verdict::new(checks, BTreeMap::new()));
    }
    let settings = Identify::usual(held_out.time());
    let explanation = explain(&settings, model, &seen, &FitStart::of(model))?;
    checks.extend([names(&explanation), motion_explained(model, &explanation)]);
    // Of a filmed video the measurement compares the whole with its pieces.
    if !filmed {
        checks.extend(
            PositionResiduals::of(&settings, model, &seen, &explanation)?.map(|left| nothing_missing(model, left)),
        );
    }
    let intervals = intervals(model, &explanation);
    checks.extend(parameters(config, model, &intervals));
    if !filmed {
        checks.extend(told_apart(model, &explanation));
    }
    checks.extend(limits(config, &losses));
    Ok(Verdict::new(checks, intervals))
}

fn check(name: &str, passed: bool, measured: String, look_at: &str) -> Check {
    Check { name: name.into(), passed, measured, look_at: look_at.into() }
}

fn objects(seen: &EncodedPositions, drawn: f64, filmed: bool) -> Check {
    let (count, well_drawn) = (seen.owned.len(), drawn >= WELL_DRAWN);
    let absent = |object: usize| seen.present[object] < PRESENT && !well_drawn;
    let missing: Vec<usize> =
        (0..count).filter(|&object| absent(object) || seen.owned[object] < OWN_SHARE / count as f64).collect();
    let covered = seen.covered >= COVERED || well_drawn || filmed;
    let measured = match &missing[..] {
        [] if covered => format!("all are there; their masks hold {:.0} % of what moves", 100.0 * seen.covered),
        [] => format!("the masks hold {:.0} % of what moves (at least {:.0} %)", 100.0 * seen.covered, 100.0 * COVERED),
        missing => format!("object {missing:?} holds too little of what moves: {:.2?}", seen.owned),
    };
    check("objects", missing.is_empty() && covered, measured, "encoder_masks.png")
}

/// The first clips, pass by pass.
fn each_judged(model: &PhysicsNet, clips: &Clips, mut see: impl FnMut(&[i64], &Tensor, &ForwardPass)) -> Result<()> {
    each_pass(model, clips, CLIPS, evaluation::batch(clips), |chosen, frames, pass| {
        see(chosen, frames, &pass);
        Ok(())
    })
}

/// How much of what moves is drawn.
struct DrawnShare<'a> {
    clips: &'a Clips,
    motion: &'a MotionDetector,
    /// Squared differences where something moves, from the drawing and from what stands still.
    left: f64,
    all: f64,
}

impl<'a> DrawnShare<'a> {
    fn new(clips: &'a Clips, motion: &'a MotionDetector) -> Self {
        DrawnShare { clips, motion, left: 0.0, all: 0.0 }
    }

    /// Looks at the encoded frames of a pass; only where the masks of so many `objects` are, if that is given.
    fn add(&mut self, chosen: &[i64], frames: &Tensor, pass: &ForwardPass, objects: Option<i64>) {
        let encoded = pass.reconstructions.size()[1];
        let places = self.clips.places(chosen, encoded as usize);
        let truth = frames.narrow(1, 0, encoded).flatten(0, 1);
        let moving = self.motion.of(self.clips, &places, &truth);
        let mut moves = moving.moves();
        if let Some(objects) = objects {
            let held = pass.encoding.masks.narrow(1, 0, objects).sum_dim_intlist([1i64].as_slice(), true, None);
            moves = moves.logical_and(&held.gt(HELD));
        }
        let sum = |x: Tensor| (x.square() * &moves).sum(Kind::Double).double_value(&[]);
        self.left += sum(pass.reconstructions.flatten(0, 1) - &truth);
        self.all += sum(moving.sharp);
    }

    fn share(&self) -> f64 {
        1.0 - self.left / f64::max(self.all, f64::MIN_POSITIVE)
    }
}

fn drawing(drawn: f64) -> Check {
    let measured = format!("{:.0} % of what moves is drawn (at least {:.0} %)", 100.0 * drawn, 100.0 * DRAWN);
    check("drawing", drawn >= DRAWN, measured, "example0.png, templates.png")
}

fn names(explanation: &Explanation) -> Check {
    let explained = explanation.explained;
    let measured = format!(
        "{:.1} % of the held-out positions follow the equation (at least {:.0} %)",
        100.0 * explained,
        100.0 * EXPLAINED
    );
    check("names", explained >= EXPLAINED, measured, "animation.gif: do two objects swap?")
}

fn motion_explained(model: &PhysicsNet, explanation: &Explanation) -> Check {
    let unit = model.system.cell.coordinates.unit();
    let measured = format!(
        "the equation leaves {:.3} {unit} of the positions, without what all share {:.3} {unit} (at most {:.3}); encoder and masks differ by {:.3} px",
        explanation.fit.usual_residual,
        explanation.own_residual,
        explanation.largest_residual,
        explanation.disagreement
    );
    check("motion", explanation.explains(), measured, "parameters.png; is it the right equation?")
}

fn nothing_missing(model: &PhysicsNet, left: PositionResiduals) -> Check {
    let unit = model.system.cell.coordinates.unit();
    let measured =
        format!("the equation leaves {:.4} {unit} of whole clips and {:.4} of half ones", left.whole, left.half);
    let missing = left.misses_a_force();
    let measured = if missing { measured + ": a force is missing in it" } else { measured };
    check("force", !missing, measured, "the equation; its parameters are wrong, however narrow their intervals are")
}

/// Of each learned parameter, from the least to the largest of what was learned and what held-out clips say.
fn intervals(model: &PhysicsNet, explanation: &Explanation) -> BTreeMap<String, Interval> {
    let learned = model.parameters.iter().enumerate().filter(|(_, parameter)| parameter.learned);
    learned
        .map(|(place, parameter)| {
            let deviation = explanation.fit.deviations[place];
            let unconstrained = explanation
                .estimates
                .iter()
                .map(|unconstrained| unconstrained[place])
                .chain([parameter.unconstrained.double_value(&[])]);
            let (low, high) = unconstrained.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), unconstrained| {
                (low.min(unconstrained), high.max(unconstrained))
            });
            let value = |unconstrained: f64| model.true_value(&parameter.kind, unconstrained);
            let interval = Interval { low: value(low - 2.0 * deviation), high: value(high + 2.0 * deviation) };
            (parameter.kind.name.to_string(), interval)
        })
        .collect()
}

/// A filmed video is measured whole, which has intervals of its own: its clips, of a second or two, need not tell a friction.
fn parameters(config: &Config, model: &PhysicsNet, intervals: &BTreeMap<String, Interval>) -> Vec<Check> {
    let learned = model.parameter_values().into_iter();
    learned
        .map(|(name, value)| {
            let Interval { low, high } = intervals[name];
            let said = config.task.success.parameters.get(name).copied();
            let limit = said.or(config.task.video().is_none().then_some(WIDTH));
            let width = 100.0 * (high - value).max(value - low) / value.abs();
            let judged = limit.map_or_else(|| "not judged".into(), |limit| format!("at most {limit} %"));
            let measured =
                format!("learned {value:.4}; held-out clips say {low:.4} to {high:.4}, {width:.2} % ({judged})");
            check(name, limit.is_none_or(|limit| width <= limit), measured, "parameters.png")
        })
        .collect()
}

/// Whether the motion tells the learned parameters apart; nothing to judge where fewer than two are learned.
fn told_apart(model: &PhysicsNet, explanation: &Explanation) -> Option<Check> {
    let several = model.learned().count() > 1;
    several.then(|| match explanation.unidentifiable(model) {
        Some(unidentifiable) => check("parameters", false, unidentifiable.text(), "model.fixed in the config"),
        None => check("parameters", true, "each shows in the motion".into(), "model.fixed in the config"),
    })
}

/// The task's own limits of the losses, on held-out clips.
fn limits(config: &Config, losses: &MeanLosses) -> Vec<Check> {
    let limits = config.task.success.losses.iter();
    limits
        .filter_map(|(loss, limit)| {
            let clips_end_before = *loss == Loss::Extrap && losses.extrap_loss.is_none();
            // One that is not a number passes no limit.
            let value = losses.of(*loss).unwrap_or(f64::NAN);
            let measured = format!("{value:.3} on held-out clips (at most {limit})");
            (!clips_end_before).then(|| check(loss.symbol(), value <= *limit, measured, "example0.png"))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use tch::{Device, Tensor};

    use super::{EncodedPositions, Interval, PhysicsNet, objects, parameters};
    use crate::network::cells::Actions;
    use crate::training::config::Config;
    use crate::training::layers::Overrides;

    /// Two objects, of which the masks hold so much.
    fn passes(present: f64, owned: [f64; 2], drawn: f64, filmed: bool) -> bool {
        let seen = EncodedPositions {
            encoded: Tensor::new(),
            centroids: Tensor::new(),
            offsets: Vec::new(),
            present: vec![1.0, present],
            owned: owned.into(),
            covered: owned.iter().sum(),
            actions: Actions::none(),
        };
        objects(&seen, drawn, filmed).passed
    }

    #[test]
    fn objects_are_there_where_masks_hold_them() {
        assert!(passes(0.95, [0.45, 0.45], 0.8, false));
        // One is missing in a fifth of the frames; the masks hold half of what moves.
        assert!(!passes(0.8, [0.45, 0.45], 0.8, false));
        assert!(!passes(0.95, [0.25, 0.25], 0.8, false));
    }

    #[test]
    fn a_shadow_in_a_filmed_video_is_no_object() {
        assert!(passes(0.95, [0.25, 0.25], 0.8, true));
        // One is missing in a fifth of the frames, or holds nothing.
        assert!(!passes(0.8, [0.25, 0.25], 0.8, true));
        assert!(!passes(0.95, [0.25, 0.04], 0.8, true));
    }

    #[test]
    fn faint_masks_are_no_alarm_where_all_is_drawn() {
        assert!(passes(0.8, [0.25, 0.25], 0.96, false));
        // But each must have a mask of its own.
        assert!(!passes(0.8, [0.6, 0.04], 0.96, false));
    }

    /// Both sides count, and either of them may be the wider one. The task allows k 1 % and l 0.5 %.
    #[test]
    fn a_parameter_passes_where_its_whole_interval_is_near_it() {
        let task = Overrides { task: Some("spring_color".into()), ..Overrides::default() };
        let config = Config::load(None, &task).unwrap();
        let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 1).unwrap();
        model.learned().zip([4.0, 6.0]).for_each(|(parameter, value)| model.set_value(parameter, value).unwrap());
        for (low, high, passes) in [(3.97, 4.03, true), (3.95, 4.0, false), (4.0, 4.05, false)] {
            let (k, l) = (Interval { low, high }, Interval { low: 5.99, high: 6.01 });
            let intervals = BTreeMap::from([("k".to_string(), k), ("l".to_string(), l)]);
            let checks = parameters(&config, &model, &intervals);
            let passed: Vec<_> = checks.iter().map(|check| (check.name.as_str(), check.passed)).collect();
            assert_eq!(passed, [("k", passes), ("l", true)], "k from {low} to {high}");
        }
    }
}

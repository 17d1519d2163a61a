//! From coarse to fine: where frames are large the objects are found on frames of half the side, a step of which costs a
//! quarter, and the networks go on from there. Not in the original.
//!
//! The U-Net's kernels are the same on frames of either size; the localisation network of a large frame sees it halved
//! anyway; sprites are enlarged. Nothing of it is saved: a run that is stopped before its first checkpoint begins anew.

use std::cell::OnceCell;
use std::rc::Rc;
use std::time::Instant;

use anyhow::Result;

use super::{Discover, DiscoverStart, Discovery, Guide, LrSchedule, UNDRAWN_AT_FIT};
use crate::network::System;
use crate::network::blocks::{side_multiple, uses_deep_unet};
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::RunState;
use crate::training::base::{Session, TrainingOutcome};
use crate::training::objects::motion::MotionDetector;

/// The name under which it stands in a run's logs.
const NAME: &str = "coarse";
/// On whole frames what was found is fitted to them: smaller steps, and the share of them from which they shrink.
const RATE: f64 = 0.5;
const ANNEAL_AT: f64 = 0.3;

impl Discover {
    /// Whether the phase begins with halved frames, as far as that is the system's to say: where a network for them has the
    /// same layers.
    pub(super) fn begins_coarse(&self, system: &System) -> bool {
        let side = system.side;
        self.coarse_steps > 0 && uses_deep_unet(side) && side.is_multiple_of(2 * side_multiple(side))
    }
}

/// Finds the objects of the session's clips on halved frames, and begins its model with them.
pub(super) fn begin(config: &Discover, session: &mut Session) -> Result<TrainingOutcome> {
    let (train, valid) = (session.train.halved(), session.valid.halved());
    let device = session.model.variables.device();
    let model = PhysicsNet::new(&session.model.system.halved(), &session.model.options, device, session.seed)?;
    for (parameter, whole) in model.learned().zip(session.model.learned()) {
        model.set_unconstrained(parameter, whole.unconstrained.double_value(&[]));
    }
    let max_steps = config.coarse_steps.min(config.max_steps);
    let config = Discover { max_steps, ..config.clone() };
    let motion = Rc::new(MotionDetector::measure(&train, session.seed));
    let mut discovery = Discovery::new(&config, &UNDRAWN_AT_FIT, &model, [&train, &valid], motion, session.seed)?;
    discovery.set_start(&model)?;
    let mut progress = RunState::new(&session.state.task);
    progress.seconds = session.elapsed();
    let Session { seed, validation, intervals, stop, observers, begun, .. } = &mut *session;
    let mut coarse = Session {
        model: &model,
        train: &train,
        valid: &valid,
        seed: *seed,
        validation: *validation,
        intervals: *intervals,
        last_phase: false,
        begun: begun.clone(),
        best: None,
        motion: OnceCell::new(),
        state: progress,
        store: None,
        observers: observers.iter_mut().map(|observer| &mut **observer as _).collect(),
        stop: Box::new(&**stop),
        slots: None,
        clock: Instant::now(),
    };
    let outcome = coarse.train_phase(NAME, &mut discovery, config.optimizer, config.clip_gradients)?;
    let steps = coarse.state.steps;
    let fitted_last = discovery.fits_after(&coarse.state.validations);
    drop(coarse);
    if outcome == TrainingOutcome::Interrupted {
        return Ok(outcome);
    }
    // Positions are good before all is drawn: the answer until there is a better one. Where the last validation led to a fit it
    // was the best one, so the networks of that fit are those that are given on.
    let fitted = if fitted_last { None } else { discovery.early_fit(&model)? };
    session.state.steps += steps;
    session.model.begin_as(&model);
    if let Some(fitted) = fitted {
        session.tell_fit(NAME, &fitted)?;
    }
    Ok(TrainingOutcome::Finished)
}

/// The phase as it goes on from there: the background begins anew, the guides only fade, and the rates fall soon.
pub(super) fn after(config: &Discover) -> Discover {
    let start = DiscoverStart {
        sprites: false,
        template_bump: 0.0,
        localiser_scale: 0.0,
        mask_spread: 0.0,
        ..config.start.clone()
    };
    let Guide { full_until, zero_from, .. } = config.guide;
    let guide = Guide { full_until: 0, zero_from: zero_from.saturating_sub(full_until), ..config.guide.clone() };
    let schedule = LrSchedule { anneal_at: ANNEAL_AT, ..config.schedule.clone() };
    let max_steps = config.fine_steps.min(config.max_steps);
    Discover { learning_rate: RATE * config.learning_rate, max_steps, start, guide, schedule, ..config.clone() }
}

//! Who decides, and how plans are searched for.

use clap::ValueEnum;

use paig::network::physics_models::PhysicsNet;

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum Who {
    /// Vision is learned, and what foretells: the physics, or a black box in its place
    Learned,
    /// The true state and the true equation: the upper bound
    TrueState,
    /// Vision is learned, the equation is the true one
    TrueEquation,
    /// A latent model of frames, actions and rewards is learned; its run is one of `planet`
    Latent,
    /// Any action
    Random,
    /// No action
    Zero,
}

impl Who {
    /// As it stands in the results: a black box that was learned stands there by its own name.
    pub(super) fn name(self, model: Option<&PhysicsNet>) -> &'static str {
        match self {
            Who::Learned => {
                let black_box = model.filter(|model| model.black_box.is_some());
                black_box.map_or("learned", |model| model.options.dynamics.name())
            }
            Who::TrueState => "true state",
            Who::TrueEquation => "true equation",
            Who::Latent => "latent",
            Who::Random => "random",
            Who::Zero => "zero",
        }
    }

    /// Whether it sees objects, by a run's encoder.
    pub(super) fn sees(self) -> bool {
        matches!(self, Who::Learned | Who::TrueEquation)
    }

    /// Whether it needs a run.
    pub(super) fn has_run(self) -> bool {
        self.sees() || self == Who::Latent
    }
}

/// How plans are searched for.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum Method {
    CrossEntropy,
    PathIntegral,
}

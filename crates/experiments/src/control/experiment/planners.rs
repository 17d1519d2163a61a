//! Who decides, and how plans are searched for.

use paig::network::physics_models::PhysicsNet;

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlannerKind {
    /// Vision is learned, and the model: the physics, or a black box in its place.
    Learned,
    /// The true state and the true equation: the upper bound.
    TrueState,
    /// Vision is learned, the equation is the true one.
    TrueEquation,
    /// A latent model of frames, actions and rewards is learned; its run is one of `planet`.
    Latent,
    /// Random actions.
    Random,
    /// No action.
    Zero,
}

impl PlannerKind {
    /// Its name in the results; that of a learned black box is the black box's own.
    pub(super) fn name(self, model: Option<&PhysicsNet>) -> &'static str {
        match self {
            PlannerKind::Learned => {
                let black_box = model.filter(|model| model.black_box.is_some());
                black_box.map_or("learned", |model| model.options.dynamics.name())
            }
            PlannerKind::TrueState => "true state",
            PlannerKind::TrueEquation => "true equation",
            PlannerKind::Latent => "latent",
            PlannerKind::Random => "random",
            PlannerKind::Zero => "zero",
        }
    }

    /// Whether it sees objects, by a run's encoder.
    pub(super) fn sees(self) -> bool {
        matches!(self, PlannerKind::Learned | PlannerKind::TrueEquation)
    }

    /// Whether it needs a run.
    pub(super) fn has_run(self) -> bool {
        self.sees() || self == PlannerKind::Latent
    }
}

/// How plans are searched for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchMethod {
    CrossEntropy,
    PathIntegral,
}

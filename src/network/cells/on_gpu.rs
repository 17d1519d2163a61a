//! An equation that is rolled out by one kernel where its states are on a GPU.

use std::sync::{Arc, Mutex, PoisonError};

use tch::{Kind, Tensor};

use super::actions::Actions;
use super::cell::Cell;
use super::kind::CellKind;
use super::plain::PlainCell;
use super::state::{State, Walls};
use super::text::listing;
use paig_kernels::gpu;
use paig_kernels::gpu::roll_out::{Scalars, roll_out};

/// A cell, and what the kernel is told of it.
#[derive(Debug)]
pub struct OnGpu {
    kind: Arc<CellKind>,
    walls: Walls,
    /// Of all parameters, in the equation's order.
    unconstrained: Vec<Tensor>,
    /// Computes what the kernel cannot.
    cell: Box<dyn Cell>,
    /// Those that were asked for. They live as long as the cell: a recording of a GPU's work reads them.
    lists: Mutex<Vec<ScalarListing>>,
}

/// The equation as a list, for so many objects; none if there is no such list.
#[derive(Debug)]
struct ScalarListing {
    objects: usize,
    dt: f64,
    scalars: Option<Arc<Scalars>>,
}

impl OnGpu {
    pub fn new(kind: &Arc<CellKind>, walls: Walls, unconstrained: Vec<Tensor>, cell: Box<dyn Cell>) -> Self {
        OnGpu { kind: kind.clone(), walls, unconstrained, cell, lists: Mutex::default() }
    }

    fn by_kernel(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Option<Vec<State>> {
        let served = gpu::supports(&[&initial.pos, &initial.vel]);
        served.then(|| self.launched(initial, actions, dt, frames)).flatten()
    }

    /// The states of the next frames as the cell gives them, by one launch of a kernel instead of a hundred for each frame;
    /// none where the kernel cannot compute them. The tensors are where kernels can be launched.
    fn launched(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Option<Vec<State>> {
        let held = actions.values().filter(|_| self.kind.actions);
        let mut given = self.unconstrained.iter().chain([&initial.pos, &initial.vel]).chain(held);
        let size = initial.pos.size();
        if frames == 0 || size[0] == 0 || !given.all(|tensor| tensor.kind() == Kind::Float) {
            return None;
        }
        let scalars = self.list(size[1] as usize / self.kind.coordinates.per_object(), dt)?;
        let parameters = match &self.unconstrained[..] {
            [] => Tensor::zeros([0], (Kind::Float, initial.pos.device())),
            unconstrained => Tensor::stack(unconstrained, 0).reshape([-1]),
        };
        let held = held.map(|held| held.expand([size[0], -1], false));
        let states = roll_out(&scalars, &initial.joined(), &parameters, held.as_ref(), frames);
        // One operation takes them apart, so one puts their gradients together.
        let halves = states.flatten(0, 1).unbind(0);
        let state = |halves: &[Tensor]| State { pos: halves[0].shallow_clone(), vel: halves[1].shallow_clone() };
        Some(halves.chunks_exact(2).map(state).collect())
    }

    fn list(&self, objects: usize, dt: f64) -> Option<Arc<Scalars>> {
        let mut lists = self.lists.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lists.iter().find(|list| list.objects == objects && list.dt == dt) {
            return known.scalars.clone();
        }
        let equation = self.kind.equation(objects).ok().flatten();
        // Back in time a clock and a wall that takes speed would need rules of their own.
        let equation = equation.filter(|equation| dt > 0.0 || equation.is_reversible());
        let listing = equation.and_then(|equation| listing(&equation, &self.kind.parameters, self.walls, dt));
        let scalars = listing.map(|listing| Arc::new(Scalars::new(listing)));
        lists.push(ScalarListing { objects, dt, scalars: scalars.clone() });
        scalars
    }
}

impl Cell for OnGpu {
    fn substep(&self, state: &State, action: Option<&Tensor>, h: f64) -> State {
        self.cell.substep(state, action, h)
    }

    fn step(&self, state: &State, action: Option<&Tensor>, dt: f64) -> State {
        let actions = Actions::new(action.map(Tensor::shallow_clone));
        let next = self.by_kernel(state, &actions, dt, 1).and_then(|mut states| states.pop());
        next.unwrap_or_else(|| self.cell.step(state, action, dt))
    }

    fn roll_out(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Vec<State> {
        let states = self.by_kernel(initial, actions, dt, frames);
        states.unwrap_or_else(|| self.cell.roll_out(initial, actions, dt, frames))
    }

    fn plain(&self) -> Option<Box<dyn PlainCell>> {
        self.cell.plain()
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        self.cell.plain_double()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use tch::Device;

    use super::*;
    use crate::network::cells::{
        BOUNCING, Coordinates, DAMPED_SPRING, FALLING, FALLING_BOUNCING, GRAVITY, PENDULUM, SPRING,
    };
    use paig_kernels::gpu::roll_out::ScalarOperation;
    use paig_kernels::gpu::testing::{scattered, test_device};

    const FRAMES: usize = 8;
    const BATCH: i64 = 37;

    fn text(table: &str, objects: usize) -> CellKind {
        CellKind::of_text(&toml::from_str(table).unwrap(), objects).unwrap()
    }

    /// States, and gradients of a weighted sum of them by the initial state and the unconstrained parameters.
    fn results(unconstrained: &[f64], initial: &Tensor, roll: impl Fn(&[Tensor], &State) -> Vec<State>) -> [Tensor; 3] {
        let initial = initial.copy().set_requires_grad(true);
        let unconstrained =
            Tensor::from_slice(unconstrained).to_kind(Kind::Float).to_device(initial.device()).set_requires_grad(true);
        let states = State::sequence(&roll(&unconstrained.unbind(0), &State::from_joined(&initial)));
        let weights = scattered(&states.size(), 1.7).to_device(initial.device());
        // What has no part in the states has a gradient of 0.
        ((&states * weights).sum(Kind::Float) + unconstrained.sum(Kind::Float) * 0.0).backward();
        [states.detach(), initial.grad(), unconstrained.grad()]
    }

    /// States in a frame of 32 pixels that go towards its walls, or angles all round.
    fn initial(kind: &CellKind, objects: usize, device: Device) -> Tensor {
        const PLACES: [f32; 6] = [16.0, 9.0, 22.0, 20.0, 10.0, 20.0];
        let size = [BATCH, (objects * kind.coordinates.per_object()) as i64];
        let (pos, fastest): (Tensor, f64) = match kind.coordinates {
            Coordinates::Position => (scattered(&size, 2.3) * 2.0 + Tensor::from_slice(&PLACES[..2 * objects]), 10.0),
            Coordinates::Angle => (scattered(&size, 2.3) * PI, 1.0),
        };
        Tensor::cat(&[pos, scattered(&size, 1.9) * fastest], 1).to_device(device)
    }

    /// The kernel's results are those of the cell on tensors: states to 2e-5 of the largest, gradients to 2e-4.
    fn check(kind: &CellKind, objects: usize, unconstrained: &[f64], actions: &Actions) {
        let Some(device) = test_device() else { return };
        let (walls, dt) = (Walls::new(32, 2.0), 0.3);
        let actions = actions.to(device, Kind::Float);
        let initial = initial(kind, objects, device);
        let expected = results(unconstrained, &initial, |unconstrained, initial| {
            kind.cell(unconstrained, walls).roll_out(initial, &actions, dt, FRAMES)
        });
        let found = results(unconstrained, &initial, |unconstrained, initial| {
            let unconstrained: Vec<_> = unconstrained.iter().map(Tensor::shallow_clone).collect();
            let cell = kind.cell(&unconstrained, walls);
            OnGpu::new(&Arc::new(kind.clone()), walls, unconstrained, cell)
                .launched(initial, &actions, dt, FRAMES)
                .unwrap()
        });
        let names = ["states", "gradient by the initial state", "gradient by the parameters"];
        for (((found, expected), name), tolerance) in found.iter().zip(&expected).zip(names).zip([2e-5, 2e-4, 2e-4]) {
            if expected.numel() > 0 {
                let largest = expected.abs().max().double_value(&[]).max(1e-6);
                let difference = (found - expected).abs().max().double_value(&[]) / largest;
                assert!(difference < tolerance, "{}: {name} differs by {difference}", kind.name);
            }
        }
    }

    /// For fewer frames than are rolled out.
    fn some_actions() -> Actions {
        Actions::new(Some(Tensor::arange(BATCH * 6, (Kind::Float, Device::Cpu)).sin().reshape([BATCH, 6])))
    }

    #[test]
    fn built_in_equations_are_those_of_their_cells() {
        let none = Actions::none();
        check(&BOUNCING.kind(2), 2, &[], &none);
        check(&SPRING.kind(2), 2, &[1.4, 1.1], &none);
        check(&DAMPED_SPRING.kind(2), 2, &[1.4, 1.1, -1.0], &none);
        check(&GRAVITY, 3, &[4.0, 0.1], &none);
        check(&PENDULUM.kind(1), 1, &[1.0, 0.3], &none);
        check(&PENDULUM.kind(1), 1, &[1.0, 0.3], &some_actions());
        check(&FALLING.kind(2), 2, &[0.4], &none);
        check(&FALLING_BOUNCING.kind(2), 2, &[0.4], &none);
    }

    #[test]
    fn texts_are_those_of_their_cells() {
        let lossy = "acceleration = \"vec(0, g)\"\nwalls = true\nrestitution = \"e\"\nparameters.g = {}\n\
                     parameters.e = { low = 0.0, high = 1.0 }";
        check(&text(lossy, 2), 2, &[1.5, 0.4], &Actions::none());
        let charges = "acceleration = \"others(c * other.c * (p - q) / max(norm(p - q), 1)^3)\"\n\
                       parameters.c = { low = -20.0, high = 20.0, each = true }";
        check(&text(charges, 3), 3, &[0.6, 0.3, 0.8], &Actions::none());
    }

    /// Each method of integration, with a learned floor.
    #[test]
    fn integrators_are_those_of_the_cells() {
        for integrator in ["euler", "verlet", "rk4"] {
            let table = format!(
                "acceleration = \"vec(0, g) - c * norm(v) * v + others(c * (w - v))\"\n\
                 integrator = {integrator:?}\nsubsteps = 3\n\
                 walls.bottom = \"y\"\nwalls.left = -1.0\nrestitution = 0.7\n\
                 parameters.c = {{}}\nparameters.g = {{}}\nparameters.y = {{ low = 4.0, high = 36.0 }}"
            );
            check(&text(&table, 3), 3, &[-4.0, 1.0, 1.2], &Actions::none());
        }
    }

    /// All functions of the language in one acceleration, which tells the time.
    #[test]
    fn functions_and_the_time_are_those_of_the_cells() {
        let table = "acceleration = [\"(push + turn) * k\", \"unit(p1 - p2) * square(k) - perp(v2) * k^1.5\"]\n\
                     integrator = \"rk4\"\nparameters.k = {}\nparameters.b = {}\n\
                     [where]\n\
                     r = \"(p1 - p2) / (10 * k)\"\n\
                     push = \"vec(cos(b * t), -sin(-b * t) * tanh(r.x) + tan(r.y / 6)) - exp(-norm(r)) * r\"\n\
                     turn = \"vec(atan2(r.y, r.x) + abs(-r.x) - sign(-r.y), min(dot(r, r), k) \
                     - max(2, ln(1 + square(r.y))) + min(r.x, 1) * max(r.y, k) + sqrt(cross(r, perp(r)) + 1))\"";
        check(&text(table, 2), 2, &[-0.3, 0.2], &Actions::none());
        check(&text(table, 2), 2, &[-0.3, 0.2], &some_actions());
    }

    /// A spring pulls both bodies alike: their pair is computed once.
    #[test]
    fn what_two_objects_share_is_computed_once() {
        let spring = text(
            "acceleration = \"others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4))\"\n\
             parameters.k = {}\nparameters.l = {}",
            2,
        );
        let equation = spring.equation(2).unwrap().unwrap();
        let listing = listing(&equation, &spring.parameters, Walls::new(32, 2.0), 0.3).unwrap();
        let count = |operation: ScalarOperation| listing.moving.iter().filter(|it| it.operation == operation).count();
        assert_eq!((count(ScalarOperation::Norm), count(ScalarOperation::Over)), (1, 2));
        // The one is pushed where the other is pulled.
        assert_eq!((count(ScalarOperation::PlusProduct), count(ScalarOperation::MinusProduct)), (6, 2));
        assert_eq!((listing.moving.len(), count(ScalarOperation::Negative)), (18, 0));
    }
}

//! An equation that is rolled out by one kernel where its states are on a GPU.

use tch::Tensor;

use super::plain::PlainCell;
use super::text::roll_out_on_gpu;
use super::{Actions, Cell, CellKind, State, Walls};
use paig_kernels::gpu;

/// A cell, and what the kernel is told of it.
#[derive(Debug)]
pub struct OnGpu {
    kind: &'static CellKind,
    walls: Walls,
    /// Of all parameters, in the equation's order.
    raw: Vec<Tensor>,
    /// Computes what the kernel cannot.
    cell: Box<dyn Cell>,
}

impl OnGpu {
    pub fn new(kind: &'static CellKind, walls: Walls, raw: Vec<Tensor>, cell: Box<dyn Cell>) -> Self {
        OnGpu { kind, walls, raw, cell }
    }

    fn by_kernel(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Option<Vec<State>> {
        let served = gpu::supports(&[&initial.pos, &initial.vel]);
        served.then(|| roll_out_on_gpu(self.kind, &self.raw, self.walls, initial, actions, dt, frames)).flatten()
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

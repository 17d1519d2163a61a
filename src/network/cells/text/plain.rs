//! An equation of one object in plain numbers: the operations of its graph on columns of states. For planning.

use super::Equation;
use super::graph::{Given, Graph, Operation};
use super::operation::{Binary, Unary};
use super::restitution::Restitution;
use super::table::Integrator;
use crate::network::cells::Walls;
use crate::network::cells::plain::PlainCell;
use crate::support::fast_math::{cosine, sine};

/// A vector's columns; of a scalar the first.
type Columns = [Vec<f32>; 2];

/// An equation with its parameters, and room for what is computed on the way.
#[derive(Debug)]
pub(super) struct PlainText {
    equation: &'static Equation,
    parameters: Vec<f32>,
    walls: Walls,
    /// Of each node of the graph.
    values: Vec<Columns>,
    /// Columns `[coordinates * batch]` of the integration's stages: position, velocity, acceleration, sums.
    stages: [Vec<f32>; 6],
}

/// Whether the graph is about one object alone.
fn of_one_object(graph: &Graph) -> bool {
    graph.nodes.iter().all(|node| {
        !matches!(
            node.operation,
            Operation::Unary(Unary::ForOthers | Unary::OverOthers, _)
                | Operation::Given(Given::ParametersOfOthers(_) | Given::PositionsOfOthers | Given::VelocitiesOfOthers)
        )
    })
}

impl PlainText {
    /// None for an equation of several objects, or with the time in it.
    pub fn new(equation: &'static Equation, parameters: Vec<f32>, walls: Walls) -> Option<Self> {
        let program = &equation.program;
        let alone = program.objects == 1 && of_one_object(&program.graph) && !program.tells_time();
        let values = program.graph.nodes.iter().map(|_| Columns::default()).collect();
        alone.then(|| PlainText { equation, parameters, walls, values, stages: Default::default() })
    }

    fn coordinates(&self) -> usize {
        self.equation.table.state.per_object()
    }

    /// Makes room for a batch; what does not change with the state is computed here. Nothing happens for a batch as large
    /// as the last one.
    fn make_room(&mut self, batch: usize) {
        let numbers = self.coordinates() * batch;
        if self.stages[0].len() == numbers && self.values.first().is_some_and(|value| value[0].len() == batch) {
            return;
        }
        self.stages.iter_mut().for_each(|stage| stage.resize(numbers, 0.0));
        for (value, node) in self.values.iter_mut().zip(&self.equation.program.graph.nodes) {
            value[0].resize(batch, 0.0);
            value[1].resize(if node.vector { batch } else { 0 }, 0.0);
        }
        self.compute(false, &[], &[], &[]);
    }

    /// Computes the nodes that change with the state, or those that do not.
    fn compute(&mut self, moving: bool, pos: &[f32], vel: &[f32], action: &[f32]) {
        for (place, node) in self.equation.program.graph.nodes.iter().enumerate() {
            if node.moves != moving {
                continue;
            }
            let (before, from_here) = self.values.split_at_mut(place);
            let into = &mut from_here[0];
            match node.operation {
                Operation::Number(bits) => into[0].fill(f64::from_bits(bits) as f32),
                Operation::Given(Given::Parameter(place) | Given::Parameters(place)) => {
                    into[0].fill(self.parameters[place]);
                }
                Operation::Given(Given::Positions | Given::PositionOf(_)) => copy(pos, node.vector, into),
                Operation::Given(Given::Velocities | Given::VelocityOf(_)) => copy(vel, node.vector, into),
                Operation::Given(_) => into[0].copy_from_slice(action),
                Operation::Unary(operation, of) => unary(operation, &before[of], node.vector, into),
                Operation::Binary(operation, a, b) => {
                    let vectors = [a, b].map(|place| self.equation.program.graph.nodes[place].vector);
                    binary(operation, [&before[a], &before[b]], vectors, into);
                }
            }
        }
    }

    /// Writes the accelerations in a state into a stage.
    fn accelerate(&mut self, pos: &[f32], vel: &[f32], action: &[f32], stage: usize) {
        self.compute(true, pos, vel, action);
        let place = self.equation.program.accelerations[0];
        let batch = action.len();
        let vector = self.equation.program.graph.nodes[place].vector;
        for (axis, into) in self.stages[stage].chunks_exact_mut(batch).enumerate() {
            into.copy_from_slice(&self.values[place][if vector { axis } else { 0 }]);
        }
    }

    fn substep(&mut self, pos: &mut [f32], vel: &mut [f32], action: &[f32], h: f32) {
        match self.equation.table.integrator {
            Integrator::Euler => {
                self.accelerate(pos, vel, action, 0);
                add(vel, &self.stages[0], h);
                add(pos, vel, h);
            }
            Integrator::Verlet => {
                self.accelerate(pos, vel, action, 0);
                let first = std::mem::take(&mut self.stages[0]);
                add(pos, vel, h);
                add(pos, &first, 0.5 * h * h);
                let mut full = std::mem::take(&mut self.stages[1]);
                full.copy_from_slice(vel);
                add(&mut full, &first, h);
                self.accelerate(pos, &full, action, 2);
                add(vel, &first, 0.5 * h);
                add(vel, &self.stages[2], 0.5 * h);
                (self.stages[0], self.stages[1]) = (first, full);
            }
            Integrator::Rk4 => self.runge_kutta(pos, vel, action, h),
        }
    }

    fn runge_kutta(&mut self, pos: &mut [f32], vel: &mut [f32], action: &[f32], h: f32) {
        let [mut p, mut v, mut sum_p, mut sum_v] = [1, 2, 3, 4].map(|stage| std::mem::take(&mut self.stages[stage]));
        p.copy_from_slice(pos);
        v.copy_from_slice(vel);
        sum_p.fill(0.0);
        sum_v.fill(0.0);
        for (weight, reach) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            self.accelerate(&p, &v, action, 0);
            add(&mut sum_p, &v, weight);
            add(&mut sum_v, &self.stages[0], weight);
            // The next slope is where this one leads to.
            p.copy_from_slice(pos);
            add(&mut p, &v, reach * h);
            v.copy_from_slice(vel);
            add(&mut v, &self.stages[0], reach * h);
        }
        add(pos, &sum_p, h / 6.0);
        add(vel, &sum_v, h / 6.0);
        (self.stages[1], self.stages[2], self.stages[3], self.stages[4]) = (p, v, sum_p, sum_v);
    }

    /// Turns back what has passed a wall, with what is left of its speed.
    fn turn_back(&self, pos: &mut [f32], vel: &mut [f32]) {
        let left = match self.equation.restitution {
            Restitution::All => 1.0,
            Restitution::Number(number) => number as f32,
            Restitution::Parameter(place) => self.parameters[place],
        };
        let (near, far) = (self.walls.near as f32, self.walls.far as f32);
        for (x, v) in pos.iter_mut().zip(vel) {
            let outside = *x > far || *x < near;
            *v = if outside { -*v * left } else { *v };
            *x = if *x > far { far - (*x - far) * left } else { *x };
            *x = if *x < near { near + (near - *x) * left } else { *x };
        }
    }
}

impl PlainCell for PlainText {
    fn step(&mut self, positions: &mut [f32], velocities: &mut [f32], action: &[f32], dt: f32) {
        self.make_room(action.len());
        let substeps = self.equation.table.substeps;
        for _ in 0..substeps {
            self.substep(positions, velocities, action, dt / substeps as f32);
            if self.equation.table.walls {
                self.turn_back(positions, velocities);
            }
        }
    }
}

/// `to += by * times`.
fn add(to: &mut [f32], by: &[f32], times: f32) {
    to.iter_mut().zip(by).for_each(|(to, by)| *to += times * by);
}

fn copy(state: &[f32], vector: bool, into: &mut Columns) {
    let batch = into[0].len();
    into[0].copy_from_slice(&state[..batch]);
    if vector {
        into[1].copy_from_slice(&state[batch..]);
    }
}

fn unary(operation: Unary, of: &Columns, vector: bool, into: &mut Columns) {
    match operation {
        Unary::Part(axis) => into[0].copy_from_slice(&of[usize::from(axis)]),
        Unary::Norm => map2(&of[0], &of[1], &mut into[0], |x, y| (x * x + y * y).sqrt()),
        Unary::Perp => {
            map(&of[1], &mut into[0], |y| -y);
            into[1].copy_from_slice(&of[0]);
        }
        Unary::Negative => {
            let [first, second] = into;
            map(&of[0], first, |x| -x);
            if vector {
                map(&of[1], second, |x| -x);
            }
        }
        Unary::Sqrt => map(&of[0], &mut into[0], f32::sqrt),
        Unary::Exp => map(&of[0], &mut into[0], f32::exp),
        Unary::Ln => map(&of[0], &mut into[0], f32::ln),
        Unary::Sin => map(&of[0], &mut into[0], sine),
        Unary::Cos => map(&of[0], &mut into[0], cosine),
        Unary::Tan => map(&of[0], &mut into[0], f32::tan),
        Unary::Tanh => map(&of[0], &mut into[0], f32::tanh),
        Unary::Abs => map(&of[0], &mut into[0], f32::abs),
        // Of 0 it is 0, unlike the library's.
        Unary::Sign => map(&of[0], &mut into[0], |x| if x == 0.0 { 0.0 } else { x.signum() }),
        Unary::Square => map(&of[0], &mut into[0], |x| x * x),
        Unary::ForOthers | Unary::OverOthers => unreachable!("of one object there are no others"),
    }
}

fn binary(operation: Binary, [a, b]: [&Columns; 2], vectors: [bool; 2], into: &mut Columns) {
    match operation {
        Binary::Plus => each([a, b], vectors, into, |x, y| x + y),
        Binary::Minus => each([a, b], vectors, into, |x, y| x - y),
        Binary::Times => each([a, b], vectors, into, |x, y| x * y),
        Binary::Over => each([a, b], vectors, into, |x, y| x / y),
        Binary::Power => each([a, b], vectors, into, f32::powf),
        Binary::Atan2 => each([a, b], vectors, into, f32::atan2),
        // As the tensors' a number that is none stays one.
        Binary::Min => each([a, b], vectors, into, |x, y| if x < y || x.is_nan() { x } else { y }),
        Binary::Max => each([a, b], vectors, into, |x, y| if x > y || x.is_nan() { x } else { y }),
        Binary::Dot => {
            map2(&a[0], &b[0], &mut into[0], |x, y| x * y);
            add_products(&mut into[0], &a[1], &b[1], 1.0);
        }
        Binary::Cross => {
            map2(&a[0], &b[1], &mut into[0], |x, y| x * y);
            add_products(&mut into[0], &a[1], &b[0], -1.0);
        }
        Binary::Vec => {
            into[0].copy_from_slice(&a[0]);
            into[1].copy_from_slice(&b[0]);
        }
    }
}

/// Of each coordinate; a scalar goes with both parts of a vector.
fn each([a, b]: [&Columns; 2], vectors: [bool; 2], into: &mut Columns, f: impl Fn(f32, f32) -> f32) {
    let axes = if vectors[0] || vectors[1] { 2 } else { 1 };
    for (axis, into) in into.iter_mut().enumerate().take(axes) {
        let part = |operand: usize| if vectors[operand] { axis } else { 0 };
        map2(&a[part(0)], &b[part(1)], into, &f);
    }
}

fn map(of: &[f32], into: &mut [f32], f: impl Fn(f32) -> f32) {
    into.iter_mut().zip(of).for_each(|(into, x)| *into = f(*x));
}

fn map2(a: &[f32], b: &[f32], into: &mut [f32], f: impl Fn(f32, f32) -> f32) {
    into.iter_mut().zip(a).zip(b).for_each(|((into, x), y)| *into = f(*x, *y));
}

fn add_products(to: &mut [f32], a: &[f32], b: &[f32], sign: f32) {
    to.iter_mut().zip(a).zip(b).for_each(|((to, x), y)| *to += sign * x * y);
}

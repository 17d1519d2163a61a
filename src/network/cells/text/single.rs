//! The same equation in plain numbers, one state at a time, without gradients: for long roll-outs of one system, where a
//! tensor of a few numbers costs a hundred times the arithmetic.

use super::Equation;
use super::graph::{Given, Graph, Operation};
use super::operation::{Binary, Unary};
use super::restitution::Restitution;
use super::table::Integrator;
use crate::network::cells::Walls;

/// How many numbers a node has: objects (or 1), their others (or 1), coordinates.
type Shape = [usize; 3];

/// One operation and where its result lies.
#[derive(Debug)]
struct Step {
    operation: Operation,
    shape: Shape,
    at: usize,
    /// Whether it changes with the state.
    moves: bool,
}

/// An equation with the values of its parameters.
#[derive(Debug)]
pub struct SingleEquation {
    equation: &'static Equation,
    steps: Vec<Step>,
    /// The numbers of all nodes.
    numbers: Vec<f64>,
    parameters: Vec<f64>,
    walls: Walls,
}

impl SingleEquation {
    /// The equation with these values (not the raw numbers) of its parameters.
    pub(super) fn new(equation: &'static Equation, parameters: &[f64], walls: Walls) -> Self {
        let (objects, coordinates) = (equation.program.objects, equation.table.state.per_object());
        let (steps, size) = laid_out(&equation.program.graph, objects, coordinates);
        let (numbers, parameters) = (vec![0.0; size], parameters.to_vec());
        let mut single = SingleEquation { equation, steps, numbers, parameters, walls };
        let nothing = vec![0.0; objects * coordinates];
        single.compute(false, &nothing, &nothing, 0.0);
        single
    }

    /// States of `frames` frames, each positions and then velocities of all objects, the initial one first, at the time
    /// `begin`. Nothing acts from outside.
    pub fn roll_out(&mut self, initial: &[f64], begin: f64, dt: f64, frames: usize) -> Vec<f64> {
        let (substeps, half) = (self.equation.table.substeps, initial.len() / 2);
        let (mut pos, mut vel) = (initial[..half].to_vec(), initial[half..].to_vec());
        let mut states = Vec::with_capacity(frames * initial.len());
        for frame in 0..frames {
            if frame > 0 {
                for substep in 0..substeps {
                    let passed = (frame - 1) as f64 + substep as f64 / substeps as f64;
                    self.advance(&mut pos, &mut vel, begin + passed * dt, dt / substeps as f64);
                }
            }
            states.extend(pos.iter().chain(&vel));
        }
        states
    }

    fn advance(&mut self, pos: &mut [f64], vel: &mut [f64], time: f64, h: f64) {
        match self.equation.table.integrator {
            Integrator::Euler => {
                add(vel, &self.acceleration(pos, vel, time), h);
                add(pos, vel, h);
            }
            Integrator::Verlet => {
                let first = self.acceleration(pos, vel, time);
                let mut full = vel.to_vec();
                add(&mut full, &first, h);
                add(pos, vel, h);
                add(pos, &first, 0.5 * h * h);
                let second = self.acceleration(pos, &full, time + h);
                add(vel, &first, 0.5 * h);
                add(vel, &second, 0.5 * h);
            }
            Integrator::Rk4 => self.runge_kutta(pos, vel, time, h),
        }
        self.turn_back(pos, vel);
    }

    fn runge_kutta(&mut self, pos: &mut [f64], vel: &mut [f64], time: f64, h: f64) {
        let mut slopes: [(Vec<f64>, Vec<f64>); 4] = Default::default();
        for (stage, by) in [0.0, 0.5 * h, 0.5 * h, h].into_iter().enumerate() {
            let (mut at, mut speed) = (pos.to_vec(), vel.to_vec());
            if stage > 0 {
                let (dp, dv) = &slopes[stage - 1];
                add(&mut at, dp, by);
                add(&mut speed, dv, by);
            }
            let acceleration = self.acceleration(&at, &speed, time + by);
            slopes[stage] = (speed, acceleration);
        }
        for ((dp, dv), weight) in slopes.iter().zip([1.0, 2.0, 2.0, 1.0]) {
            add(pos, dp, weight * h / 6.0);
            add(vel, dv, weight * h / 6.0);
        }
    }

    /// The walls turn back what has passed them, each with what is left of its speed.
    fn turn_back(&self, pos: &mut [f64], vel: &mut [f64]) {
        if !self.equation.table.walls {
            return;
        }
        let left = match self.equation.restitution {
            Restitution::All => 1.0,
            Restitution::Number(number) => number,
            Restitution::Parameter(place) => self.parameters[place],
        };
        for (p, v) in pos.iter_mut().zip(vel) {
            for (wall, passed) in [(self.walls.far, *p > self.walls.far), (self.walls.near, *p < self.walls.near)] {
                if passed {
                    *p = wall - (*p - wall) * left;
                    *v *= -left;
                }
            }
        }
    }

    /// Of all objects.
    fn acceleration(&mut self, pos: &[f64], vel: &[f64], time: f64) -> Vec<f64> {
        self.compute(true, pos, vel, time);
        let coordinates = self.equation.table.state.per_object();
        let places = &self.equation.program.accelerations;
        let mut accelerations = Vec::with_capacity(pos.len());
        for object in 0..pos.len() / coordinates {
            // One for all objects, or one of each.
            let Step { shape, at, .. } = &self.steps[if places.len() == 1 { places[0] } else { places[object] }];
            let part = |part| self.numbers[at + place_of(*shape, [object, 0, part])];
            accelerations.extend((0..coordinates).map(part));
        }
        accelerations
    }

    /// Computes the nodes that change with the state, or those that do not.
    fn compute(&mut self, moving: bool, pos: &[f64], vel: &[f64], time: f64) {
        let SingleEquation { equation, steps, numbers, parameters, .. } = self;
        let outside = Outside { coordinates: equation.table.state.per_object(), parameters, pos, vel, time };
        for step in steps.iter().filter(|step| step.moves == moving) {
            let [objects, others, parts] = step.shape;
            let (before, own) = numbers.split_at_mut(step.at);
            let read = |place: usize, at: [usize; 3]| {
                let of = &steps[place];
                before[of.at + place_of(of.shape, at)]
            };
            let mut result = own.iter_mut();
            for object in 0..objects {
                for other in 0..others {
                    for part in 0..parts {
                        let at = [object, other, part];
                        let value = match step.operation {
                            Operation::Number(bits) => f64::from_bits(bits),
                            Operation::Given(given) => outside.given(given, at),
                            Operation::Unary(operation, of) => {
                                let shape = steps[of].shape;
                                unary(operation, shape, at, |at| read(of, at))
                            }
                            Operation::Binary(operation, a, b) => {
                                binary(operation, at, |at| read(a, at), |at| read(b, at))
                            }
                        };
                        *result.next().expect("room for all numbers of a node") = value;
                    }
                }
            }
        }
    }
}

/// What comes from outside of the equation.
struct Outside<'a> {
    coordinates: usize,
    parameters: &'a [f64],
    pos: &'a [f64],
    vel: &'a [f64],
    time: f64,
}

impl Outside<'_> {
    fn given(&self, given: Given, [object, other, part]: [usize; 3]) -> f64 {
        let &Outside { coordinates, pos, vel, .. } = self;
        let named = if other >= object { other + 1 } else { other };
        match given {
            Given::Parameter(place) => self.parameters[place],
            Given::Parameters(first) => self.parameters[first + object],
            Given::ParametersOfOthers(first) => self.parameters[first + named],
            Given::Positions => pos[object * coordinates + part],
            Given::Velocities => vel[object * coordinates + part],
            Given::PositionOf(of) => pos[of * coordinates + part],
            Given::VelocityOf(of) => vel[of * coordinates + part],
            Given::PositionsOfOthers => pos[named * coordinates + part],
            Given::VelocitiesOfOthers => vel[named * coordinates + part],
            Given::Action => 0.0,
            Given::Time => self.time,
        }
    }
}

/// Adds a multiple.
fn add(to: &mut [f64], what: &[f64], times: f64) {
    to.iter_mut().zip(what).for_each(|(to, what)| *to += what * times);
}

/// Where a number lies among those of its node; along an axis on which there is one, it is the same for all.
fn place_of(shape: Shape, at: [usize; 3]) -> usize {
    let place = |axis: usize| if shape[axis] == 1 { 0 } else { at[axis] };
    (place(0) * shape[1] + place(1)) * shape[2] + place(2)
}

fn laid_out(graph: &Graph, objects: usize, coordinates: usize) -> (Vec<Step>, usize) {
    let (mut steps, mut size) = (Vec::<Step>::new(), 0);
    for node in &graph.nodes {
        let shape = match node.operation {
            Operation::Number(_) | Operation::Given(Given::Parameter(_) | Given::Action | Given::Time) => [1, 1, 1],
            Operation::Given(Given::Parameters(_)) => [objects, 1, 1],
            Operation::Given(Given::ParametersOfOthers(_)) => [objects, objects - 1, 1],
            Operation::Given(Given::Positions | Given::Velocities) => [objects, 1, coordinates],
            Operation::Given(Given::PositionOf(_) | Given::VelocityOf(_)) => [1, 1, coordinates],
            Operation::Given(Given::PositionsOfOthers | Given::VelocitiesOfOthers) => {
                [objects, objects - 1, coordinates]
            }
            Operation::Unary(operation, of) => {
                let [own, others, parts] = steps[of].shape;
                match operation {
                    Unary::Part(_) | Unary::Norm => [own, others, 1],
                    Unary::OverOthers => [own, 1, parts],
                    _ => [own, others, parts],
                }
            }
            Operation::Binary(operation, a, b) => {
                let (a, b) = (steps[a].shape, steps[b].shape);
                let [own, others, parts] = [0, 1, 2].map(|axis| a[axis].max(b[axis]));
                match operation {
                    Binary::Dot | Binary::Cross => [own, others, 1],
                    Binary::Vec => [own, others, 2],
                    _ => [own, others, parts],
                }
            }
        };
        steps.push(Step { operation: node.operation, shape, at: size, moves: node.moves });
        size += shape.iter().product::<usize>();
    }
    (steps, size)
}

fn unary(operation: Unary, shape: Shape, at: [usize; 3], read: impl Fn([usize; 3]) -> f64) -> f64 {
    let [object, other, part] = at;
    let coordinate = |part: usize| read([object, other, part]);
    let x = read(at);
    match operation {
        Unary::Negative => -x,
        Unary::Part(axis) => coordinate(usize::from(axis)),
        Unary::Norm => coordinate(0).hypot(coordinate(1)),
        Unary::Perp if part == 0 => -coordinate(1),
        Unary::Perp => coordinate(0),
        Unary::Sqrt => x.sqrt(),
        Unary::Exp => x.exp(),
        Unary::Ln => x.ln(),
        Unary::Sin => x.sin(),
        Unary::Cos => x.cos(),
        Unary::Tan => x.tan(),
        Unary::Tanh => x.tanh(),
        Unary::Abs => x.abs(),
        Unary::Sign if x == 0.0 => 0.0,
        Unary::Sign => x.signum(),
        Unary::Square => x * x,
        Unary::ForOthers => x,
        Unary::OverOthers => (0..shape[1]).map(|other| read([object, other, part])).sum(),
    }
}

fn binary(operation: Binary, at: [usize; 3], a: impl Fn([usize; 3]) -> f64, b: impl Fn([usize; 3]) -> f64) -> f64 {
    let [object, other, part] = at;
    let parts = |of: &dyn Fn([usize; 3]) -> f64| [of([object, other, 0]), of([object, other, 1])];
    match operation {
        Binary::Plus => a(at) + b(at),
        Binary::Minus => a(at) - b(at),
        Binary::Times => a(at) * b(at),
        Binary::Over => a(at) / b(at),
        Binary::Power => a(at).powf(b(at)),
        Binary::Dot => {
            let ([ax, ay], [bx, by]) = (parts(&a), parts(&b));
            ax * bx + ay * by
        }
        Binary::Cross => {
            let ([ax, ay], [bx, by]) = (parts(&a), parts(&b));
            ax * by - ay * bx
        }
        Binary::Vec if part == 0 => a([object, other, 0]),
        Binary::Vec => b([object, other, 0]),
        Binary::Atan2 => a(at).atan2(b(at)),
        Binary::Min => a(at).min(b(at)),
        Binary::Max => a(at).max(b(at)),
    }
}

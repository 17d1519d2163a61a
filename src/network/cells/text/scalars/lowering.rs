//! The operations of an equation's graph, taken apart into single numbers.

use super::super::Equation;
use super::super::graph::{self, Given};
use super::super::operation::{Binary, Unary};
use super::super::table::Integrator;
use super::super::walls::{TextWalls, Value};
use super::numbers::{Numbers, Signed, Source};
use crate::network::cells::Walls;
use paig_kernels::gpu::roll_out::{Barrier, Operation};

/// Longest list: one thread goes through it, so a longer one is left to libtorch.
const MOST_OPERATIONS: usize = 10_000;

/// What a node of the graph is: numbers for objects, their others and coordinates; along an axis of length 1 the same
/// for all.
struct Grid {
    shape: [usize; 3],
    numbers: Vec<Signed>,
}

impl Grid {
    fn of(shape: [usize; 3], mut number: impl FnMut([usize; 3]) -> Signed) -> Self {
        let [objects, others, parts] = shape;
        let mut numbers = Vec::with_capacity(objects * others * parts);
        for object in 0..objects {
            for other in 0..others {
                numbers.extend((0..parts).map(|part| number([object, other, part])));
            }
        }
        Grid { shape, numbers }
    }

    fn one(number: Signed) -> Self {
        Grid { shape: [1; 3], numbers: vec![number] }
    }

    fn at(&self, at: [usize; 3]) -> Signed {
        let place = |axis: usize| if self.shape[axis] == 1 { 0 } else { at[axis] };
        self.numbers[(place(0) * self.shape[1] + place(1)) * self.shape[2] + place(2)]
    }
}

/// The state and the time at which accelerations are computed.
struct Moment<'a> {
    pos: &'a [Signed],
    vel: &'a [Signed],
    time: Signed,
}

/// An equation whose list is being made.
pub struct Lowering<'a> {
    pub equation: &'a Equation,
    /// The values of the equation's parameters.
    pub parameters: Vec<Signed>,
    pub numbers: Numbers,
}

impl Lowering<'_> {
    /// Positions, then velocities, after a substep of `h`; none if that takes too many operations.
    pub fn moved(&mut self, h: f64) -> Option<Vec<Signed>> {
        let coordinates = self.coordinates();
        let state: Vec<_> = (0..2 * coordinates).map(|place| self.numbers.put(Source::State(place))).collect();
        let (pos, vel) = state.split_at(coordinates);
        let [moved_pos, moved_vel] = match self.equation.table.integrator {
            Integrator::Euler => {
                let acceleration = self.accelerations(pos, vel, 0.0)?;
                let faster = self.numbers.along(vel, &acceleration, h);
                [self.numbers.along(pos, &faster, h), faster]
            }
            Integrator::Verlet => {
                let first = self.accelerations(pos, vel, 0.0)?;
                let full = self.numbers.along(vel, &first, h);
                let pos = self.numbers.along(pos, vel, h);
                let pos = self.numbers.along(&pos, &first, 0.5 * h * h);
                let second = self.accelerations(&pos, &full, h)?;
                let both: Vec<_> = first.iter().zip(&second).map(|(a, b)| self.numbers.plus(*a, *b)).collect();
                let vel = self.numbers.along(vel, &both, 0.5 * h);
                [pos, vel]
            }
            Integrator::Rk4 => {
                let mut slopes = vec![[vel.to_vec(), self.accelerations(pos, vel, 0.0)?]];
                for (last, by) in [0.5 * h, 0.5 * h, h].into_iter().enumerate() {
                    let [faster, accelerated] = &slopes[last];
                    let (pos, vel) = (self.numbers.along(pos, faster, by), self.numbers.along(vel, accelerated, by));
                    let acceleration = self.accelerations(&pos, &vel, by)?;
                    slopes.push([vel, acceleration]);
                }
                [(pos, 0), (vel, 1)].map(|(from, half)| {
                    let of = |stage: usize, place: usize| slopes[stage][half][place];
                    let sums = (0..coordinates).map(|place| {
                        let inner = self.numbers.plus(of(1, place), of(2, place));
                        let two = self.numbers.number(2.0);
                        let twice = self.numbers.times(inner, two);
                        let sum = self.numbers.plus(of(0, place), twice);
                        self.numbers.plus(sum, of(3, place))
                    });
                    let sums: Vec<_> = sums.collect();
                    self.numbers.along(from, &sums, h / 6.0)
                })
            }
        };
        Some([moved_pos, moved_vel].concat())
    }

    /// Of all objects.
    pub fn coordinates(&self) -> usize {
        self.equation.program.objects * self.equation.table.state.per_object()
    }

    /// The accelerations in a state, a time `by` after the beginning of the substep.
    fn accelerations(&mut self, pos: &[Signed], vel: &[Signed], by: f64) -> Option<Vec<Signed>> {
        let (held, mut time) = (self.numbers.put(Source::Held), self.numbers.put(Source::Since));
        if by != 0.0 {
            let by = self.numbers.number(by);
            time = self.numbers.plus(time, by);
        }
        let moment = Moment { pos, vel, time: self.numbers.plus(held, time) };
        let equation = self.equation;
        let program = &equation.program;
        let mut grids = Vec::with_capacity(program.graph.nodes.len());
        for node in &program.graph.nodes {
            let grid = match node.operation {
                graph::Operation::Number(bits) => Grid::one(self.numbers.number(f64::from_bits(bits))),
                graph::Operation::Given(given) => self.given(given, &moment),
                graph::Operation::Unary(operation, of) => self.unary(operation, &grids[of]),
                graph::Operation::Binary(operation, a, b) => {
                    let numbers = [a, b].map(|place| program.graph.nodes[place].number());
                    self.binary(operation, [&grids[a], &grids[b]], numbers)
                }
            };
            grids.push(grid);
            if self.numbers.count() > MOST_OPERATIONS {
                return None;
            }
        }
        let parts = self.equation.table.state.per_object();
        let acceleration = |number: usize| {
            let object = number / parts;
            // One for all objects, or one of each.
            let place = if program.accelerations.len() == 1 { 0 } else { object };
            grids[program.accelerations[place]].at([object, 0, number % parts])
        };
        Some((0..self.coordinates()).map(acceleration).collect())
    }

    fn given(&mut self, given: Given, moment: &Moment) -> Grid {
        let (objects, parts) = (self.equation.program.objects, self.equation.table.state.per_object());
        let own = [objects, 1, parts];
        let of_others = |parts: usize| [objects, objects - 1, parts];
        let named = |object: usize, other: usize| if other >= object { other + 1 } else { other };
        match given {
            Given::Parameter(place) => Grid::one(self.parameters[place]),
            Given::Parameters(first) => Grid::of([objects, 1, 1], |[object, ..]| self.parameters[first + object]),
            Given::ParametersOfOthers(first) => {
                Grid::of(of_others(1), |[object, other, _]| self.parameters[first + named(object, other)])
            }
            Given::Positions => Grid::of(own, |[object, _, part]| moment.pos[object * parts + part]),
            Given::Velocities => Grid::of(own, |[object, _, part]| moment.vel[object * parts + part]),
            Given::PositionOf(object) => Grid::of([1, 1, parts], |[_, _, part]| moment.pos[object * parts + part]),
            Given::VelocityOf(object) => Grid::of([1, 1, parts], |[_, _, part]| moment.vel[object * parts + part]),
            Given::PositionsOfOthers => {
                Grid::of(of_others(parts), |[object, other, part]| moment.pos[named(object, other) * parts + part])
            }
            Given::VelocitiesOfOthers => {
                Grid::of(of_others(parts), |[object, other, part]| moment.vel[named(object, other) * parts + part])
            }
            Given::Action => Grid::one(self.numbers.put(Source::Held)),
            Given::Time => Grid::one(moment.time),
        }
    }

    fn unary(&mut self, operation: Unary, of: &Grid) -> Grid {
        let [objects, others, parts] = of.shape;
        match operation {
            Unary::Part(axis) => {
                Grid::of([objects, others, 1], |[object, other, _]| of.at([object, other, usize::from(axis)]))
            }
            Unary::Norm => Grid::of([objects, others, 1], |[object, other, _]| {
                let [x, y] = [0, 1].map(|part| of.at([object, other, part]).place);
                self.numbers.computed(Operation::Norm, [x, y])
            }),
            Unary::Perp => Grid::of(of.shape, |[object, other, part]| match part {
                0 => -of.at([object, other, 1]),
                _ => of.at([object, other, 0]),
            }),
            Unary::ForOthers => Grid { shape: of.shape, numbers: of.numbers.clone() },
            Unary::OverOthers => Grid::of([objects, 1, parts], |[object, _, part]| {
                let first = of.at([object, 0, part]);
                (1..others).fold(first, |sum, other| self.numbers.plus(sum, of.at([object, other, part])))
            }),
            _ => Grid::of(of.shape, |at| self.function(operation, of.at(at))),
        }
    }

    /// A function of one number.
    fn function(&mut self, operation: Unary, x: Signed) -> Signed {
        let mut any = |operation: Operation| {
            let x = self.numbers.with_sign(x);
            self.numbers.computed(operation, [x])
        };
        match operation {
            Unary::Sqrt => any(Operation::Sqrt),
            Unary::Exp => any(Operation::Exp),
            Unary::Ln => any(Operation::Ln),
            Unary::Square => self.numbers.times(x, x),
            // The same of -x.
            Unary::Cos => self.numbers.computed(Operation::Cos, [x.place]),
            Unary::Abs => self.numbers.computed(Operation::Abs, [x.place]),
            // Times -1 of -x.
            Unary::Sin => Signed { negative: x.negative, ..self.numbers.computed(Operation::Sin, [x.place]) },
            Unary::Tan => Signed { negative: x.negative, ..self.numbers.computed(Operation::Tan, [x.place]) },
            Unary::Tanh => Signed { negative: x.negative, ..self.numbers.computed(Operation::Tanh, [x.place]) },
            Unary::Sign => Signed { negative: x.negative, ..self.numbers.computed(Operation::Sign, [x.place]) },
            Unary::Negative => -x,
            Unary::Part(_) | Unary::Norm | Unary::Perp | Unary::ForOthers | Unary::OverOthers => {
                unreachable!("an operation on more than one number")
            }
        }
    }

    /// `numbers` are the operands that stand in the text.
    fn binary(&mut self, operation: Binary, [a, b]: [&Grid; 2], numbers: [Option<f64>; 2]) -> Grid {
        let shape = [0, 1, 2].map(|axis| a.shape[axis].max(b.shape[axis]));
        let [objects, others, _] = shape;
        let both = |[object, other, _]: [usize; 3], part: [usize; 2]| {
            (a.at([object, other, part[0]]), b.at([object, other, part[1]]))
        };
        match operation {
            Binary::Dot => Grid::of([objects, others, 1], |at| {
                let ((ax, bx), (ay, by)) = (both(at, [0, 0]), both(at, [1, 1]));
                let first = self.numbers.times(ax, bx);
                self.numbers.plus_product(first, ay, by)
            }),
            Binary::Cross => Grid::of([objects, others, 1], |at| {
                let ((ax, by), (ay, bx)) = (both(at, [0, 1]), both(at, [1, 0]));
                let first = self.numbers.times(ax, by);
                self.numbers.plus_product(first, -ay, bx)
            }),
            Binary::Vec => Grid::of([objects, others, 2], |at| {
                let (x, y) = both(at, [0, 0]);
                if at[2] == 0 { x } else { y }
            }),
            _ => Grid::of(shape, |at| self.function_of_two(operation, a.at(at), b.at(at), numbers)),
        }
    }

    fn function_of_two(&mut self, operation: Binary, x: Signed, y: Signed, numbers: [Option<f64>; 2]) -> Signed {
        let mut any = |operation: Operation| {
            let operands = [x, y].map(|x| self.numbers.with_sign(x));
            self.numbers.computed(operation, operands)
        };
        match (operation, numbers) {
            (Binary::Plus, _) => self.numbers.plus(x, y),
            (Binary::Minus, _) => self.numbers.plus(x, -y),
            (Binary::Times, _) => self.numbers.times(x, y),
            (Binary::Over, _) => self.numbers.over(x, y),
            (Binary::Power, [_, Some(2.0)]) => self.numbers.times(x, x),
            (Binary::Power, [_, Some(3.0)]) => {
                let square = self.numbers.times(x, x);
                self.numbers.times(square, x)
            }
            (Binary::Power, _) => any(Operation::Power),
            (Binary::Atan2, _) => any(Operation::Atan2),
            (Binary::Min, [None, None]) => any(Operation::Min),
            (Binary::Max, [None, None]) => any(Operation::Max),
            // The kernel takes the number last.
            (Binary::Min | Binary::Max, [Some(_), None]) => self.function_of_two(operation, y, x, [None, numbers[0]]),
            (Binary::Min, _) => any(Operation::AtMost),
            (Binary::Max, _) => any(Operation::AtLeast),
            (Binary::Dot | Binary::Cross | Binary::Vec, _) => unreachable!("an operation on vectors"),
        }
    }

    /// Places of the numbers of walls; `edges` are those of the frame.
    pub(crate) fn barrier(&mut self, standing: &TextWalls, edges: Walls) -> Barrier {
        let mut place = |value: Value| {
            let value = match value {
                Value::Number(number) => self.numbers.number(number),
                Value::Parameter(place) => self.parameters[place],
            };
            self.numbers.with_sign(value)
        };
        let mut both =
            |values: [Option<Value>; 2], none: f64| values.map(|value| place(value.unwrap_or(Value::Number(none))));
        let [near, far] = match standing.stand {
            Some([near, far]) => [both(near, f64::NEG_INFINITY), both(far, f64::INFINITY)],
            None => [both([None; 2], edges.near), both([None; 2], edges.far)],
        };
        let left = place(standing.restitution.unwrap_or(Value::Number(1.0)));
        Barrier { near, far, left }
    }
}

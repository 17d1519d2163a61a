//! The operations of an equation's graph, taken apart into single numbers.

use super::super::equation::Equation;
use super::super::graph::{self, ExternalInput};
use super::super::operation::{Binary, Unary};
use super::super::value::EquationNumber;
use super::super::walls::TextWalls;
use super::numbers::{Numbers, ScalarSource, Signed};
use crate::network::cells::integrator::Integrand;
use crate::network::cells::state::Walls;
use paig_kernels::gpu::roll_out::{BarrierSlots, ScalarOperation};

/// Longest list: one thread goes through it, so a longer one is left to libtorch.
const MOST_OPERATIONS: usize = 10_000;

/// What a node of the graph is: numbers for objects, their others and coordinates; along an axis of length 1 the same
/// for all.
struct NodeScalars {
    shape: [usize; 3],
    numbers: Vec<Signed>,
}

impl NodeScalars {
    fn of(shape: [usize; 3], mut number: impl FnMut([usize; 3]) -> Signed) -> Self {
        let [objects, others, parts] = shape;
        let mut numbers = Vec::with_capacity(objects * others * parts);
        for object in 0..objects {
            for other in 0..others {
                numbers.extend((0..parts).map(|part| number([object, other, part])));
            }
        }
        NodeScalars { shape, numbers }
    }

    fn one(number: Signed) -> Self {
        NodeScalars { shape: [1; 3], numbers: vec![number] }
    }

    fn at(&self, at: [usize; 3]) -> Signed {
        let place = |axis: usize| if self.shape[axis] == 1 { 0 } else { at[axis] };
        self.numbers[(place(0) * self.shape[1] + place(1)) * self.shape[2] + place(2)]
    }
}

/// The state and the time at which accelerations are computed.
struct SubstepState<'a> {
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
        let state: Vec<_> = (0..2 * coordinates).map(|place| self.numbers.put(ScalarSource::State(place))).collect();
        let (pos, vel) = state.split_at(coordinates);
        let moved = self.equation.table.integrator.step(self, [pos.to_vec(), vel.to_vec()], h).concat();
        (self.numbers.count() <= MOST_OPERATIONS).then_some(moved)
    }

    /// Of all objects.
    pub fn coordinates(&self) -> usize {
        self.equation.program.objects * self.equation.table.state.per_object()
    }

    fn given(&mut self, given: ExternalInput, moment: &SubstepState) -> NodeScalars {
        let (objects, parts) = (self.equation.program.objects, self.equation.table.state.per_object());
        let own = [objects, 1, parts];
        let of_others = |parts: usize| [objects, objects - 1, parts];
        let named = |object: usize, other: usize| if other >= object { other + 1 } else { other };
        match given {
            ExternalInput::Parameter(place) => NodeScalars::one(self.parameters[place]),
            ExternalInput::Parameters(first) => {
                NodeScalars::of([objects, 1, 1], |[object, ..]| self.parameters[first + object])
            }
            ExternalInput::ParametersOfOthers(first) => {
                NodeScalars::of(of_others(1), |[object, other, _]| self.parameters[first + named(object, other)])
            }
            ExternalInput::Positions => NodeScalars::of(own, |[object, _, part]| moment.pos[object * parts + part]),
            ExternalInput::Velocities => NodeScalars::of(own, |[object, _, part]| moment.vel[object * parts + part]),
            ExternalInput::PositionOf(object) => {
                NodeScalars::of([1, 1, parts], |[_, _, part]| moment.pos[object * parts + part])
            }
            ExternalInput::VelocityOf(object) => {
                NodeScalars::of([1, 1, parts], |[_, _, part]| moment.vel[object * parts + part])
            }
            ExternalInput::PositionsOfOthers => NodeScalars::of(of_others(parts), |[object, other, part]| {
                moment.pos[named(object, other) * parts + part]
            }),
            ExternalInput::VelocitiesOfOthers => NodeScalars::of(of_others(parts), |[object, other, part]| {
                moment.vel[named(object, other) * parts + part]
            }),
            ExternalInput::Action => NodeScalars::one(self.numbers.put(ScalarSource::Held)),
            ExternalInput::Time => NodeScalars::one(moment.time),
        }
    }

    fn unary(&mut self, operation: Unary, of: &NodeScalars) -> NodeScalars {
        let [objects, others, parts] = of.shape;
        match operation {
            Unary::Part(axis) => {
                NodeScalars::of([objects, others, 1], |[object, other, _]| of.at([object, other, usize::from(axis)]))
            }
            Unary::Norm => NodeScalars::of([objects, others, 1], |[object, other, _]| {
                let [x, y] = [0, 1].map(|part| of.at([object, other, part]).place);
                self.numbers.computed(ScalarOperation::Norm, [x, y])
            }),
            Unary::Perp => NodeScalars::of(of.shape, |[object, other, part]| match part {
                0 => -of.at([object, other, 1]),
                _ => of.at([object, other, 0]),
            }),
            Unary::ForOthers => NodeScalars { shape: of.shape, numbers: of.numbers.clone() },
            Unary::OverOthers => NodeScalars::of([objects, 1, parts], |[object, _, part]| {
                let first = of.at([object, 0, part]);
                (1..others).fold(first, |sum, other| self.numbers.plus(sum, of.at([object, other, part])))
            }),
            _ => NodeScalars::of(of.shape, |at| self.function(operation, of.at(at))),
        }
    }

    /// A function of one number.
    fn function(&mut self, operation: Unary, x: Signed) -> Signed {
        let mut any = |operation: ScalarOperation| {
            let x = self.numbers.with_sign(x);
            self.numbers.computed(operation, [x])
        };
        match operation {
            Unary::Sqrt => any(ScalarOperation::Sqrt),
            Unary::Exp => any(ScalarOperation::Exp),
            Unary::Ln => any(ScalarOperation::Ln),
            Unary::Square => self.numbers.times(x, x),
            // The same of -x.
            Unary::Cos => self.numbers.computed(ScalarOperation::Cos, [x.place]),
            Unary::Abs => self.numbers.computed(ScalarOperation::Abs, [x.place]),
            // Times -1 of -x.
            Unary::Sin => Signed { negative: x.negative, ..self.numbers.computed(ScalarOperation::Sin, [x.place]) },
            Unary::Tan => Signed { negative: x.negative, ..self.numbers.computed(ScalarOperation::Tan, [x.place]) },
            Unary::Tanh => Signed { negative: x.negative, ..self.numbers.computed(ScalarOperation::Tanh, [x.place]) },
            Unary::Sign => Signed { negative: x.negative, ..self.numbers.computed(ScalarOperation::Sign, [x.place]) },
            Unary::Negative => -x,
            Unary::Part(_) | Unary::Norm | Unary::Perp | Unary::ForOthers | Unary::OverOthers => {
                unreachable!("an operation on more than one number")
            }
        }
    }

    /// `numbers` are the operands that stand in the text.
    fn binary(&mut self, operation: Binary, [a, b]: [&NodeScalars; 2], numbers: [Option<f64>; 2]) -> NodeScalars {
        let shape = [0, 1, 2].map(|axis| a.shape[axis].max(b.shape[axis]));
        let [objects, others, _] = shape;
        let both = |[object, other, _]: [usize; 3], part: [usize; 2]| {
            (a.at([object, other, part[0]]), b.at([object, other, part[1]]))
        };
        match operation {
            Binary::Dot => NodeScalars::of([objects, others, 1], |at| {
                let ((ax, bx), (ay, by)) = (both(at, [0, 0]), both(at, [1, 1]));
                let first = self.numbers.times(ax, bx);
                self.numbers.plus_product(first, ay, by)
            }),
            Binary::Cross => NodeScalars::of([objects, others, 1], |at| {
                let ((ax, by), (ay, bx)) = (both(at, [0, 1]), both(at, [1, 0]));
                let first = self.numbers.times(ax, by);
                self.numbers.plus_product(first, -ay, bx)
            }),
            Binary::Vec => NodeScalars::of([objects, others, 2], |at| {
                let (x, y) = both(at, [0, 0]);
                if at[2] == 0 { x } else { y }
            }),
            _ => NodeScalars::of(shape, |at| self.function_of_two(operation, a.at(at), b.at(at), numbers)),
        }
    }

    fn function_of_two(&mut self, operation: Binary, x: Signed, y: Signed, numbers: [Option<f64>; 2]) -> Signed {
        let mut any = |operation: ScalarOperation| {
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
            (Binary::Power, _) => any(ScalarOperation::Power),
            (Binary::Atan2, _) => any(ScalarOperation::Atan2),
            (Binary::Min, [None, None]) => any(ScalarOperation::Min),
            (Binary::Max, [None, None]) => any(ScalarOperation::Max),
            // The kernel takes the number last.
            (Binary::Min | Binary::Max, [Some(_), None]) => self.function_of_two(operation, y, x, [None, numbers[0]]),
            (Binary::Min, _) => any(ScalarOperation::AtMost),
            (Binary::Max, _) => any(ScalarOperation::AtLeast),
            (Binary::Dot | Binary::Cross | Binary::Vec, _) => unreachable!("an operation on vectors"),
        }
    }

    /// Places of the numbers of walls; `edges` are those of the frame.
    pub(crate) fn barrier(&mut self, standing: &TextWalls, edges: Walls) -> BarrierSlots {
        let mut place = |value: EquationNumber| {
            let value = match value {
                EquationNumber::Number(number) => self.numbers.number(number),
                EquationNumber::Parameter(place) => self.parameters[place],
            };
            self.numbers.with_sign(value)
        };
        let mut both = |values: [Option<EquationNumber>; 2], none: f64| {
            values.map(|value| place(value.unwrap_or(EquationNumber::Number(none))))
        };
        let [near, far] = match standing.stand {
            Some([near, far]) => [both(near, f64::NEG_INFINITY), both(far, f64::INFINITY)],
            None => [both([None; 2], edges.near), both([None; 2], edges.far)],
        };
        let left = place(standing.restitution.unwrap_or(EquationNumber::Number(1.0)));
        BarrierSlots { near, far, left }
    }
}

impl Integrand for Lowering<'_> {
    type Values = Vec<Signed>;
    type Scalar = f64;

    /// Of a list that is too long already they are left out.
    fn acceleration(&mut self, pos: &Vec<Signed>, vel: &Vec<Signed>, since: f64) -> Vec<Signed> {
        let (held, mut time) = (self.numbers.put(ScalarSource::Held), self.numbers.put(ScalarSource::Since));
        if since != 0.0 {
            let since = self.numbers.number(since);
            time = self.numbers.plus(time, since);
        }
        let moment = SubstepState { pos, vel, time: self.numbers.plus(held, time) };
        let equation = self.equation;
        let program = &equation.program;
        let mut grids = Vec::with_capacity(program.graph.nodes.len());
        for node in &program.graph.nodes {
            let grid = match node.operation {
                graph::Operation::Number(bits) => NodeScalars::one(self.numbers.number(f64::from_bits(bits))),
                graph::Operation::Given(given) => self.given(given, &moment),
                graph::Operation::Unary(operation, of) => self.unary(operation, &grids[of]),
                graph::Operation::Binary(operation, a, b) => {
                    let numbers = [a, b].map(|place| program.graph.nodes[place].number());
                    self.binary(operation, [&grids[a], &grids[b]], numbers)
                }
            };
            grids.push(grid);
            if self.numbers.count() > MOST_OPERATIONS {
                return pos.clone();
            }
        }
        let parts = self.equation.table.state.per_object();
        let acceleration = |number: usize| {
            let object = number / parts;
            // One for all objects, or one of each.
            let place = if program.accelerations.len() == 1 { 0 } else { object };
            grids[program.accelerations[place]].at([object, 0, number % parts])
        };
        (0..self.coordinates()).map(acceleration).collect()
    }

    fn along(&mut self, from: Vec<Signed>, rate: &Vec<Signed>, h: f64) -> Vec<Signed> {
        self.numbers.along(&from, rate, h)
    }

    fn plus(&mut self, a: Vec<Signed>, b: &Vec<Signed>) -> Vec<Signed> {
        a.iter().zip(b).map(|(a, b)| self.numbers.plus(*a, *b)).collect()
    }

    fn twice(&mut self, values: Vec<Signed>) -> Vec<Signed> {
        let two = self.numbers.number(2.0);
        values.iter().map(|value| self.numbers.times(*value, two)).collect()
    }

    fn copy(&mut self, values: &Vec<Signed>) -> Vec<Signed> {
        values.clone()
    }
}

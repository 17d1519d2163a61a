//! The operations of an equation in plain numbers, without tensors or gradients: on states that stand side by side, of each
//! number a column.

use std::fmt::Debug;

use num_traits::Float;

use super::evaluate::CompiledEquation;
use super::graph::{ExternalInput, Graph, Operation};
use super::operation::{Binary, Unary};
use crate::support::fast_math;

/// The numbers that an equation is computed in.
pub(super) trait Number: Float + Debug {
    fn of(number: f64) -> Self;
    fn sine(self) -> Self;
    fn cosine(self) -> Self;
}

impl Number for f64 {
    fn of(number: f64) -> Self {
        number
    }

    fn sine(self) -> Self {
        self.sin()
    }

    fn cosine(self) -> Self {
        self.cos()
    }
}

/// Those of planning, where most of the time would go into sines.
impl Number for f32 {
    fn of(number: f64) -> Self {
        number as f32
    }

    fn sine(self) -> Self {
        fast_math::sine(self)
    }

    fn cosine(self) -> Self {
        fast_math::cosine(self)
    }
}

/// How many numbers a node has: objects (or 1), their others (or 1), coordinates.
type NodeShape = [usize; 3];

/// One operation, and where its columns begin.
#[derive(Debug, Clone, Copy)]
struct Step {
    operation: Operation,
    shape: NodeShape,
    at: usize,
    /// Whether it changes with the state.
    moves: bool,
}

/// States `[coordinates * objects, batch]`, and what the dataset holds for their frame, `[batch]`: what acts, or its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment<'a, F> {
    pub pos: &'a [F],
    pub vel: &'a [F],
    pub held: &'a [F],
    /// Time since the frame.
    pub since: F,
}

/// An equation with the values of its parameters, and room for what is computed on the way.
#[derive(Debug)]
pub(super) struct Columns<F> {
    steps: Vec<Step>,
    /// One number each for all states, or a column.
    parameters: Vec<Vec<F>>,
    /// Coordinates of an object.
    coordinates: usize,
    batch: usize,
    /// The columns of all nodes.
    numbers: Vec<F>,
}

impl<F: Number> Columns<F> {
    /// Of each parameter one value for all states, or one for each.
    pub(super) fn new(program: &CompiledEquation, coordinates: usize, parameters: Vec<Vec<F>>) -> Self {
        let steps = laid_out(&program.graph, program.objects, coordinates);
        Columns { steps, parameters, coordinates, batch: 0, numbers: Vec::new() }
    }

    /// Makes room for a batch; what does not change with the state is computed here. Nothing happens for a batch as large
    /// as the last one.
    pub(super) fn make_room(&mut self, batch: usize) {
        if self.batch == batch {
            return;
        }
        self.batch = batch;
        let columns = self.steps.last().map_or(0, |last| last.at + last.shape.iter().product::<usize>());
        self.numbers = vec![F::zero(); columns * batch];
        self.compute(false, &Moment { pos: &[], vel: &[], held: &[], since: F::zero() });
    }

    /// Computes what changes with the state.
    pub(super) fn compute_moving(&mut self, at: &Moment<F>) {
        self.compute(true, at);
    }

    /// A number of a node for one object, `[batch]`.
    pub(super) fn column(&self, place: usize, object: usize, coordinate: usize) -> &[F] {
        let first = self.steps[place].column([object, 0, coordinate]) * self.batch;
        &self.numbers[first..first + self.batch]
    }

    fn compute(&mut self, moving: bool, moment: &Moment<F>) {
        let Columns { steps, parameters, coordinates, batch, numbers } = self;
        let batch = *batch;
        for step in steps.iter().filter(|step| step.moves == moving) {
            let [objects, others, parts] = step.shape;
            let (before, from_here) = numbers.split_at_mut(step.at * batch);
            let read = |place: usize, at: [usize; 3]| {
                let first = steps[place].column(at) * batch;
                &before[first..first + batch]
            };
            let mut own = from_here.chunks_exact_mut(batch);
            for (object, other, part) in places(objects, others, parts) {
                let into = own.next().expect("room for all numbers of a node");
                let at = [object, other, part];
                match step.operation {
                    Operation::Number(bits) => into.fill(F::of(f64::from_bits(bits))),
                    Operation::Given(given) => match given.source(*coordinates, at) {
                        InputColumn::Parameter(place) => match parameters[place][..] {
                            [one] => into.fill(one),
                            ref each => into.copy_from_slice(each),
                        },
                        InputColumn::Position(place) => into.copy_from_slice(&moment.pos[place * batch..][..batch]),
                        InputColumn::Velocity(place) => into.copy_from_slice(&moment.vel[place * batch..][..batch]),
                        InputColumn::Held => into.copy_from_slice(moment.held),
                        InputColumn::Time => map(moment.held, into, |time| time + moment.since),
                    },
                    Operation::Unary(operation, of) => {
                        unary(operation, steps[of].shape, at, |at| read(of, at), into);
                    }
                    Operation::Binary(operation, a, b) => {
                        binary(operation, at, |at| read(a, at), |at| read(b, at), into);
                    }
                }
            }
        }
    }
}

impl Step {
    /// The column of a number; along an axis on which there is one, it is the same for all.
    fn column(&self, at: [usize; 3]) -> usize {
        let place = |axis: usize| if self.shape[axis] == 1 { 0 } else { at[axis] };
        self.at + (place(0) * self.shape[1] + place(1)) * self.shape[2] + place(2)
    }
}

/// All objects, their others and coordinates, in the order of the columns.
fn places(objects: usize, others: usize, parts: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..objects)
        .flat_map(move |object| (0..others).flat_map(move |other| (0..parts).map(move |part| (object, other, part))))
}

/// Where a number that comes from outside the equation is found.
enum InputColumn {
    Parameter(usize),
    Position(usize),
    Velocity(usize),
    Held,
    Time,
}

impl ExternalInput {
    fn source(self, coordinates: usize, [object, other, part]: [usize; 3]) -> InputColumn {
        let named = if other >= object { other + 1 } else { other };
        let number = |of: usize| of * coordinates + part;
        match self {
            ExternalInput::Parameter(place) => InputColumn::Parameter(place),
            ExternalInput::Parameters(first) => InputColumn::Parameter(first + object),
            ExternalInput::ParametersOfOthers(first) => InputColumn::Parameter(first + named),
            ExternalInput::Positions => InputColumn::Position(number(object)),
            ExternalInput::Velocities => InputColumn::Velocity(number(object)),
            ExternalInput::PositionOf(of) => InputColumn::Position(number(of)),
            ExternalInput::VelocityOf(of) => InputColumn::Velocity(number(of)),
            ExternalInput::PositionsOfOthers => InputColumn::Position(number(named)),
            ExternalInput::VelocitiesOfOthers => InputColumn::Velocity(number(named)),
            ExternalInput::Action => InputColumn::Held,
            ExternalInput::Time => InputColumn::Time,
        }
    }
}

fn laid_out(graph: &Graph, objects: usize, coordinates: usize) -> Vec<Step> {
    let (mut steps, mut size) = (Vec::<Step>::new(), 0);
    for node in &graph.nodes {
        let shape = match node.operation {
            Operation::Number(_)
            | Operation::Given(ExternalInput::Parameter(_) | ExternalInput::Action | ExternalInput::Time) => [1, 1, 1],
            Operation::Given(ExternalInput::Parameters(_)) => [objects, 1, 1],
            Operation::Given(ExternalInput::ParametersOfOthers(_)) => [objects, objects - 1, 1],
            Operation::Given(ExternalInput::Positions | ExternalInput::Velocities) => [objects, 1, coordinates],
            Operation::Given(ExternalInput::PositionOf(_) | ExternalInput::VelocityOf(_)) => [1, 1, coordinates],
            Operation::Given(ExternalInput::PositionsOfOthers | ExternalInput::VelocitiesOfOthers) => {
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
    steps
}

fn unary<'a, F: Number + 'a>(
    operation: Unary,
    shape: NodeShape,
    at: [usize; 3],
    read: impl Fn([usize; 3]) -> &'a [F],
    into: &mut [F],
) {
    let [object, other, part] = at;
    let coordinate = |part: usize| read([object, other, part]);
    match operation {
        Unary::Part(axis) => into.copy_from_slice(coordinate(usize::from(axis))),
        Unary::Norm => map2(coordinate(0), coordinate(1), into, |x, y| (x * x + y * y).sqrt()),
        Unary::Perp if part == 0 => map(coordinate(1), into, |y| -y),
        Unary::Perp => into.copy_from_slice(coordinate(0)),
        Unary::Negative => map(read(at), into, |x| -x),
        Unary::Sqrt => map(read(at), into, F::sqrt),
        Unary::Exp => map(read(at), into, F::exp),
        Unary::Ln => map(read(at), into, F::ln),
        Unary::Sin => map(read(at), into, F::sine),
        Unary::Cos => map(read(at), into, F::cosine),
        Unary::Tan => map(read(at), into, F::tan),
        Unary::Tanh => map(read(at), into, F::tanh),
        Unary::Abs => map(read(at), into, F::abs),
        // Of 0 it is 0, unlike the library's.
        Unary::Sign => map(read(at), into, |x| if x.is_zero() { x } else { x.signum() }),
        Unary::Square => map(read(at), into, |x| x * x),
        Unary::ForOthers => into.copy_from_slice(read(at)),
        Unary::OverOthers => {
            into.fill(F::zero());
            for other in 0..shape[1] {
                let of_other = read([object, other, part]).iter();
                into.iter_mut().zip(of_other).for_each(|(sum, x)| *sum = *sum + *x);
            }
        }
    }
}

fn binary<'a, F: Number + 'a>(
    operation: Binary,
    at: [usize; 3],
    a: impl Fn([usize; 3]) -> &'a [F],
    b: impl Fn([usize; 3]) -> &'a [F],
    into: &mut [F],
) {
    let [object, other, part] = at;
    let coordinate = |part: usize| [object, other, part];
    match operation {
        Binary::Plus => map2(a(at), b(at), into, |x, y| x + y),
        Binary::Minus => map2(a(at), b(at), into, |x, y| x - y),
        Binary::Times => map2(a(at), b(at), into, |x, y| x * y),
        Binary::Over => map2(a(at), b(at), into, |x, y| x / y),
        Binary::Power => map2(a(at), b(at), into, F::powf),
        Binary::Atan2 => map2(a(at), b(at), into, F::atan2),
        // As the tensors' a number that is none stays one.
        Binary::Min => map2(a(at), b(at), into, |x, y| if x < y || x.is_nan() { x } else { y }),
        Binary::Max => map2(a(at), b(at), into, |x, y| if x > y || x.is_nan() { x } else { y }),
        Binary::Dot => {
            map2(a(coordinate(0)), b(coordinate(0)), into, |x, y| x * y);
            add_products(into, a(coordinate(1)), b(coordinate(1)), F::one());
        }
        Binary::Cross => {
            map2(a(coordinate(0)), b(coordinate(1)), into, |x, y| x * y);
            add_products(into, a(coordinate(1)), b(coordinate(0)), -F::one());
        }
        Binary::Vec if part == 0 => into.copy_from_slice(a(coordinate(0))),
        Binary::Vec => into.copy_from_slice(b(coordinate(0))),
    }
}

fn map<F: Copy>(of: &[F], into: &mut [F], f: impl Fn(F) -> F) {
    into.iter_mut().zip(of).for_each(|(into, x)| *into = f(*x));
}

fn map2<F: Copy>(a: &[F], b: &[F], into: &mut [F], f: impl Fn(F, F) -> F) {
    into.iter_mut().zip(a).zip(b).for_each(|((into, x), y)| *into = f(*x, *y));
}

fn add_products<F: Number>(to: &mut [F], a: &[F], b: &[F], sign: F) {
    to.iter_mut().zip(a).zip(b).for_each(|((to, x), y)| *to = *to + sign * *x * *y);
}

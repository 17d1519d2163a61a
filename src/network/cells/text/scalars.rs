//! An equation as a list of operations on single numbers, for the kernel that rolls it out on a GPU.
//!
//! What an equation computes with vectors, objects and their others is taken apart here. Signs are kept beside the
//! numbers, so what two objects do to each other is computed once: `p - q` of the one is that of the other turned
//! round.

use std::collections::HashMap;
use std::ops::Neg;
use std::sync::{Mutex, PoisonError};

use tch::{Kind, Tensor};

use super::graph::{self, Given};
use super::operation::{Binary, Unary};
use super::table::Integrator;
use super::walls::{TextWalls, Value};
use super::{Equation, kind as kind_of_text, written};
use crate::kernels::gpu::roll_out::{Barrier, HELD, Instruction, Listing, Operation, SINCE, STATE, Scalars, roll_out};
use crate::network::cells::{Actions, Bounds, Build, CellKind, PhysicalParameter, State, Walls};

/// Longest list: one thread goes through it, so a longer one is left to libtorch.
const MOST_OPERATIONS: usize = 10_000;

/// The states of the next frames as a [`Cell`](crate::network::cells::Cell) of this equation gives them, by one launch
/// of a kernel instead of a hundred for each frame; none where the kernel cannot compute them. The tensors are where
/// kernels can be launched.
pub fn roll_out_on_gpu(
    kind: &CellKind,
    raw: &[Tensor],
    walls: Walls,
    initial: &State,
    actions: &Actions,
    dt: f64,
    frames: usize,
) -> Option<Vec<State>> {
    let held = actions.values().filter(|_| kind.actions);
    let mut given = raw.iter().chain([&initial.pos, &initial.vel]).chain(held);
    let size = initial.pos.size();
    if frames == 0 || size[0] == 0 || !given.all(|tensor| tensor.kind() == Kind::Float) {
        return None;
    }
    let scalars = lowered(kind, size[1] as usize / kind.coordinates.per_object(), walls, dt)?;
    let parameters = match raw {
        [] => Tensor::zeros([0], (Kind::Float, initial.pos.device())),
        raw => Tensor::stack(raw, 0).reshape([-1]),
    };
    let held = held.map(|held| held.expand([size[0], -1], false));
    let states = roll_out(scalars, &initial.joined(), &parameters, held.as_ref(), frames);
    // One operation takes them apart, so one puts their gradients together.
    let halves = states.flatten(0, 1).unbind(0);
    let state = |halves: &[Tensor]| State { pos: halves[0].shallow_clone(), vel: halves[1].shallow_clone() };
    Some(halves.chunks_exact(2).map(state).collect())
}

/// An equation that was made a list, for so many objects between these walls; none if there is no such list.
struct Known {
    name: &'static str,
    objects: usize,
    walls: Walls,
    dt: f64,
    scalars: Option<&'static Scalars>,
}

static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());

/// The list of an equation. It stays for good, as the equation does: a recording of a GPU's work reads it.
fn lowered(kind: &CellKind, objects: usize, walls: Walls, dt: f64) -> Option<&'static Scalars> {
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let same =
        |known: &&Known| known.name == kind.name && known.objects == objects && known.walls == walls && known.dt == dt;
    if let Some(known) = known.iter().find(same) {
        return known.scalars;
    }
    // Back in time a clock and a wall that takes speed would need rules of their own.
    let back = |equation: &Equation| {
        equation.tells_time() || equation.walls.as_ref().is_some_and(|walls| walls.restitution.is_some())
    };
    let equation = equation(kind, objects).filter(|equation| dt > 0.0 || !back(equation));
    let listing = equation.and_then(|equation| listing(equation, kind.parameters, walls, dt));
    let scalars = listing.map(|listing| &*Box::leak(Box::new(Scalars::new(listing))));
    known.push(Known { name: kind.name, objects, walls, dt, scalars });
    scalars
}

/// The text of an equation; none of one that a program added.
fn equation(kind: &CellKind, objects: usize) -> Option<&'static Equation> {
    if let Build::Text(equation) = kind.build {
        return Some(equation);
    }
    match kind_of_text(&written(kind)?, objects).ok()?.build {
        Build::Text(equation) => Some(equation),
        Build::Rust(_) => None,
    }
}

/// The list of a substep; `raw` are the parameters in the order in which their raw numbers will be given.
fn listing(equation: &Equation, raw: &[PhysicalParameter], walls: Walls, dt: f64) -> Option<Listing> {
    let mut lowering = Lowering { equation, parameters: Vec::new(), nodes: Vec::new(), places: HashMap::new() };
    for parameter in equation.parameters {
        let value = match raw.iter().position(|raw| raw.name == parameter.name) {
            Some(place) => lowering.bounded(place, parameter.bounds),
            None => lowering.number(parameter.fixed?),
        };
        lowering.parameters.push(value);
    }
    let moved = lowering.moved(dt / equation.table.substeps as f64)?;
    let barrier = equation.walls.as_ref().map(|standing| lowering.barrier(standing, walls));
    Some(lowering.listing(raw.len(), &moved, barrier, dt))
}

/// A single number: where it comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Source {
    /// The bits of a number.
    Number(u32),
    /// The raw number of a parameter.
    Raw(usize),
    Held,
    Since,
    /// Of the positions, then of the velocities.
    State(usize),
    /// From numbers in these places, as many as the operation takes.
    Computed(Operation, [usize; 3]),
}

#[derive(Debug, Clone, Copy)]
struct Node {
    source: Source,
    /// Whether it changes with the state.
    moves: bool,
    /// Whether a gradient goes through it.
    learns: bool,
}

/// A number by its place among all, as it is or times -1.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Signed {
    place: usize,
    negative: bool,
}

impl Neg for Signed {
    type Output = Signed;

    fn neg(self) -> Signed {
        Signed { negative: !self.negative, ..self }
    }
}

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

/// A list that is being made, each number once.
struct Lowering<'a> {
    equation: &'a Equation,
    /// The values of the equation's parameters.
    parameters: Vec<Signed>,
    nodes: Vec<Node>,
    places: HashMap<Source, usize>,
}

impl Lowering<'_> {
    fn put(&mut self, source: Source) -> Signed {
        let Lowering { nodes, places, .. } = self;
        let place = *places.entry(source).or_insert_with(|| {
            let of_any = |what: fn(&Node) -> bool, operation: Operation, operands: [usize; 3]| {
                operands[..operation.operands()].iter().any(|operand| what(&nodes[*operand]))
            };
            let (moves, learns) = match source {
                Source::Number(_) => (false, false),
                Source::Raw(_) => (false, true),
                Source::Held | Source::Since => (true, false),
                Source::State(_) => (true, true),
                Source::Computed(operation, operands) => {
                    (of_any(|node| node.moves, operation, operands), of_any(|node| node.learns, operation, operands))
                }
            };
            nodes.push(Node { source, moves, learns });
            nodes.len() - 1
        });
        Signed { place, negative: false }
    }

    fn number(&mut self, number: f64) -> Signed {
        let size = self.put(Source::Number((number.abs() as f32).to_bits()));
        if number < 0.0 { -size } else { size }
    }

    fn computed<const N: usize>(&mut self, operation: Operation, operands: [usize; N]) -> Signed {
        let mut all = [0; 3];
        all[..N].copy_from_slice(&operands);
        self.put(Source::Computed(operation, all))
    }

    /// The place of the number with its sign.
    fn with_sign(&mut self, x: Signed) -> usize {
        if x.negative { self.computed(Operation::Negative, [x.place]).place } else { x.place }
    }

    fn plus(&mut self, a: Signed, b: Signed) -> Signed {
        let [first, last] = [a.place.min(b.place), a.place.max(b.place)];
        let sign_of_first = if a.place <= b.place { a.negative } else { b.negative };
        let operation = if a.negative == b.negative { Operation::Plus } else { Operation::Minus };
        let sum = self.computed(operation, [first, last]);
        if sign_of_first { -sum } else { sum }
    }

    fn times(&mut self, a: Signed, b: Signed) -> Signed {
        let product = self.computed(Operation::Times, [a.place.min(b.place), a.place.max(b.place)]);
        Signed { negative: a.negative != b.negative, ..product }
    }

    fn over(&mut self, a: Signed, b: Signed) -> Signed {
        let quotient = self.computed(Operation::Over, [a.place, b.place]);
        Signed { negative: a.negative != b.negative, ..quotient }
    }

    /// `a + b c`.
    fn plus_product(&mut self, a: Signed, b: Signed, c: Signed) -> Signed {
        let same = a.negative == (b.negative != c.negative);
        let operation = if same { Operation::PlusProduct } else { Operation::MinusProduct };
        let sum = self.computed(operation, [a.place, b.place.min(c.place), b.place.max(c.place)]);
        Signed { negative: a.negative, ..sum }
    }

    /// The value that the raw number of a parameter stands for.
    fn bounded(&mut self, place: usize, bounds: Bounds) -> Signed {
        let raw = self.put(Source::Raw(place));
        match bounds {
            Bounds::Above(0.0) => self.computed(Operation::Exp, [raw.place]),
            Bounds::Above(low) => {
                let (above, low) = (self.computed(Operation::Exp, [raw.place]), self.number(low));
                self.plus(above, low)
            }
            Bounds::Between(low, high) => {
                let (share, width) = (self.computed(Operation::Sigmoid, [raw.place]), self.number(high - low));
                let (above, low) = (self.times(share, width), self.number(low));
                self.plus(above, low)
            }
        }
    }

    /// Positions, then velocities, after a substep of `h`; none if that takes too many operations.
    fn moved(&mut self, h: f64) -> Option<Vec<Signed>> {
        let coordinates = self.coordinates();
        let state: Vec<_> = (0..2 * coordinates).map(|place| self.put(Source::State(place))).collect();
        let (pos, vel) = state.split_at(coordinates);
        let [moved_pos, moved_vel] = match self.equation.table.integrator {
            Integrator::Euler => {
                let acceleration = self.accelerations(pos, vel, 0.0)?;
                let faster = self.along(vel, &acceleration, h);
                [self.along(pos, &faster, h), faster]
            }
            Integrator::Verlet => {
                let first = self.accelerations(pos, vel, 0.0)?;
                let full = self.along(vel, &first, h);
                let pos = self.along(pos, vel, h);
                let pos = self.along(&pos, &first, 0.5 * h * h);
                let second = self.accelerations(&pos, &full, h)?;
                let both: Vec<_> = first.iter().zip(&second).map(|(a, b)| self.plus(*a, *b)).collect();
                let vel = self.along(vel, &both, 0.5 * h);
                [pos, vel]
            }
            Integrator::Rk4 => {
                let mut slopes = vec![[vel.to_vec(), self.accelerations(pos, vel, 0.0)?]];
                for (last, by) in [0.5 * h, 0.5 * h, h].into_iter().enumerate() {
                    let [faster, accelerated] = &slopes[last];
                    let (pos, vel) = (self.along(pos, faster, by), self.along(vel, accelerated, by));
                    let acceleration = self.accelerations(&pos, &vel, by)?;
                    slopes.push([vel, acceleration]);
                }
                [(pos, 0), (vel, 1)].map(|(from, half)| {
                    let of = |stage: usize, place: usize| slopes[stage][half][place];
                    let sums = (0..coordinates).map(|place| {
                        let inner = self.plus(of(1, place), of(2, place));
                        let two = self.number(2.0);
                        let twice = self.times(inner, two);
                        let sum = self.plus(of(0, place), twice);
                        self.plus(sum, of(3, place))
                    });
                    let sums: Vec<_> = sums.collect();
                    self.along(from, &sums, h / 6.0)
                })
            }
        };
        Some([moved_pos, moved_vel].concat())
    }

    /// Where a rate leads to in a time `h`.
    fn along(&mut self, from: &[Signed], rate: &[Signed], h: f64) -> Vec<Signed> {
        let h = self.number(h);
        from.iter().zip(rate).map(|(from, rate)| self.plus_product(*from, *rate, h)).collect()
    }

    /// Of all objects.
    fn coordinates(&self) -> usize {
        self.equation.program.objects * self.equation.table.state.per_object()
    }

    /// The accelerations in a state, a time `by` after the beginning of the substep.
    fn accelerations(&mut self, pos: &[Signed], vel: &[Signed], by: f64) -> Option<Vec<Signed>> {
        let (held, mut time) = (self.put(Source::Held), self.put(Source::Since));
        if by != 0.0 {
            let by = self.number(by);
            time = self.plus(time, by);
        }
        let moment = Moment { pos, vel, time: self.plus(held, time) };
        let equation = self.equation;
        let program = &equation.program;
        let mut grids = Vec::with_capacity(program.graph.nodes.len());
        for node in &program.graph.nodes {
            let grid = match node.operation {
                graph::Operation::Number(bits) => Grid::one(self.number(f64::from_bits(bits))),
                graph::Operation::Given(given) => self.given(given, &moment),
                graph::Operation::Unary(operation, of) => self.unary(operation, &grids[of]),
                graph::Operation::Binary(operation, a, b) => {
                    let numbers = [a, b].map(|place| program.graph.nodes[place].number());
                    self.binary(operation, [&grids[a], &grids[b]], numbers)
                }
            };
            grids.push(grid);
            if self.nodes.len() > MOST_OPERATIONS {
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
            Given::Action => Grid::one(self.put(Source::Held)),
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
                self.computed(Operation::Norm, [x, y])
            }),
            Unary::Perp => Grid::of(of.shape, |[object, other, part]| match part {
                0 => -of.at([object, other, 1]),
                _ => of.at([object, other, 0]),
            }),
            Unary::ForOthers => Grid { shape: of.shape, numbers: of.numbers.clone() },
            Unary::OverOthers => Grid::of([objects, 1, parts], |[object, _, part]| {
                let first = of.at([object, 0, part]);
                (1..others).fold(first, |sum, other| self.plus(sum, of.at([object, other, part])))
            }),
            _ => Grid::of(of.shape, |at| self.function(operation, of.at(at))),
        }
    }

    /// A function of one number.
    fn function(&mut self, operation: Unary, x: Signed) -> Signed {
        let mut any = |operation: Operation| {
            let x = self.with_sign(x);
            self.computed(operation, [x])
        };
        match operation {
            Unary::Sqrt => any(Operation::Sqrt),
            Unary::Exp => any(Operation::Exp),
            Unary::Ln => any(Operation::Ln),
            Unary::Square => self.times(x, x),
            // The same of -x.
            Unary::Cos => self.computed(Operation::Cos, [x.place]),
            Unary::Abs => self.computed(Operation::Abs, [x.place]),
            // Times -1 of -x.
            Unary::Sin => Signed { negative: x.negative, ..self.computed(Operation::Sin, [x.place]) },
            Unary::Tan => Signed { negative: x.negative, ..self.computed(Operation::Tan, [x.place]) },
            Unary::Tanh => Signed { negative: x.negative, ..self.computed(Operation::Tanh, [x.place]) },
            Unary::Sign => Signed { negative: x.negative, ..self.computed(Operation::Sign, [x.place]) },
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
                let first = self.times(ax, bx);
                self.plus_product(first, ay, by)
            }),
            Binary::Cross => Grid::of([objects, others, 1], |at| {
                let ((ax, by), (ay, bx)) = (both(at, [0, 1]), both(at, [1, 0]));
                let first = self.times(ax, by);
                self.plus_product(first, -ay, bx)
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
            let operands = [x, y].map(|x| self.with_sign(x));
            self.computed(operation, operands)
        };
        match (operation, numbers) {
            (Binary::Plus, _) => self.plus(x, y),
            (Binary::Minus, _) => self.plus(x, -y),
            (Binary::Times, _) => self.times(x, y),
            (Binary::Over, _) => self.over(x, y),
            (Binary::Power, [_, Some(2.0)]) => self.times(x, x),
            (Binary::Power, [_, Some(3.0)]) => {
                let square = self.times(x, x);
                self.times(square, x)
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
    fn barrier(&mut self, standing: &TextWalls, edges: Walls) -> Barrier {
        let mut place = |value: Value| {
            let value = match value {
                Value::Number(number) => self.number(number),
                Value::Parameter(place) => self.parameters[place],
            };
            self.with_sign(value)
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

    /// Gives the numbers slots: those that something depends on. `moved` and `barrier` are places here.
    fn listing(&self, parameters: usize, moved: &[Signed], barrier: Option<Barrier>, dt: f64) -> Listing {
        let walls = barrier.map(|Barrier { near, far, left }| [near[0], near[1], far[0], far[1], left]);
        let mut used = vec![false; self.nodes.len()];
        moved.iter().map(|number| number.place).chain(walls.into_iter().flatten()).for_each(|place| used[place] = true);
        for (place, node) in self.nodes.iter().enumerate().rev() {
            if let (true, Source::Computed(operation, operands)) = (used[place], node.source) {
                operands[..operation.operands()].iter().for_each(|operand| used[*operand] = true);
            }
        }
        let chosen = |which: fn(&Node) -> bool| -> Vec<usize> {
            (0..used.len()).filter(|place| used[*place] && which(&self.nodes[*place])).collect()
        };
        let computed = |node: &Node| matches!(node.source, Source::Computed(..));
        let numbers = chosen(|node| matches!(node.source, Source::Number(_)));
        let [still, moving] = [chosen(|node| !node.moves), chosen(|node| node.moves)]
            .map(|places| places.into_iter().filter(|place| computed(&self.nodes[*place])).collect::<Vec<_>>());
        let mut slots: Vec<usize> = self.nodes.iter().map(|node| self.given_slot(node.source)).collect();
        let first = Listing::first_parameter(self.coordinates()) + parameters;
        numbers.iter().chain(&still).chain(&moving).zip(first..).for_each(|(place, slot)| slots[*place] = slot);
        let instruction = |place: &usize| {
            let Source::Computed(operation, operands) = self.nodes[*place].source else {
                unreachable!("what is given is not computed")
            };
            let learns = [0, 1, 2].map(|i| i < operation.operands() && self.nodes[operands[i]].learns);
            Instruction {
                operation,
                slots: [0, 1, 2].map(|i| if i < operation.operands() { slots[operands[i]] } else { HELD }),
                learns,
            }
        };
        let number = |place: &usize| match self.nodes[*place].source {
            Source::Number(bits) => f32::from_bits(bits),
            _ => unreachable!("a number that stands in the list"),
        };
        Listing {
            coordinates: self.coordinates(),
            parameters,
            numbers: numbers.iter().map(number).collect(),
            still: still.iter().map(instruction).collect(),
            moving: moving.iter().map(instruction).collect(),
            moved: moved.iter().map(|number| slots[number.place]).collect(),
            barrier: barrier.map(|Barrier { near, far, left }| Barrier {
                near: near.map(|place| slots[place]),
                far: far.map(|place| slots[place]),
                left: slots[left],
            }),
            tells_time: self.equation.tells_time(),
            substeps: self.equation.table.substeps,
            dt,
        }
    }

    /// The slot of what comes from outside the list; of the rest any.
    fn given_slot(&self, source: Source) -> usize {
        match source {
            Source::Since => SINCE,
            Source::State(place) => STATE + place,
            Source::Raw(place) => Listing::first_parameter(self.coordinates()) + place,
            Source::Held | Source::Number(_) | Source::Computed(..) => HELD,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use tch::Device;

    use super::*;
    use crate::kernels::gpu::test_device;
    use crate::network::cells::{
        BOUNCING, Coordinates, DAMPED_SPRING, FALLING, FALLING_BOUNCING, GRAVITY, PENDULUM, SPRING,
    };

    const FRAMES: usize = 8;
    const BATCH: i64 = 37;

    fn text(table: &str, objects: usize) -> &'static CellKind {
        kind_of_text(&toml::from_str(table).unwrap(), objects).unwrap()
    }

    /// Numbers between -1 and 1, always the same.
    fn scattered(size: &[i64], step: f64) -> Tensor {
        let count: i64 = size.iter().product();
        (Tensor::arange(count, (Kind::Float, Device::Cpu)) * step).sin().reshape(size)
    }

    /// States, and gradients of a weighted sum of them by the initial state and the raw parameters.
    fn results(raw: &[f64], initial: &Tensor, roll: impl Fn(&[Tensor], &State) -> Vec<State>) -> [Tensor; 3] {
        let initial = initial.copy().set_requires_grad(true);
        let raw = Tensor::from_slice(raw).to_kind(Kind::Float).to_device(initial.device()).set_requires_grad(true);
        let states = State::sequence(&roll(&raw.unbind(0), &State::from_joined(&initial)));
        let weights = scattered(&states.size(), 1.7).to_device(initial.device());
        // What has no part in the states has a gradient of 0.
        ((&states * weights).sum(Kind::Float) + raw.sum(Kind::Float) * 0.0).backward();
        [states.detach(), initial.grad(), raw.grad()]
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
    fn check(kind: &CellKind, objects: usize, raw: &[f64], actions: &Actions) {
        let Some(device) = test_device() else { return };
        let (walls, dt) = (Walls::new(32, 2.0), 0.3);
        let actions = actions.to(device, Kind::Float);
        let initial = initial(kind, objects, device);
        let expected =
            results(raw, &initial, |raw, initial| kind.cell(raw, walls).roll_out(initial, &actions, dt, FRAMES));
        let found = results(raw, &initial, |raw, initial| {
            roll_out_on_gpu(kind, raw, walls, initial, &actions, dt, FRAMES).unwrap()
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
        check(&BOUNCING, 2, &[], &none);
        check(&SPRING, 2, &[1.4, 1.1], &none);
        check(&DAMPED_SPRING, 2, &[1.4, 1.1, -1.0], &none);
        check(&GRAVITY, 3, &[4.0, 0.1], &none);
        check(&PENDULUM, 1, &[1.0, 0.3], &none);
        check(&PENDULUM, 1, &[1.0, 0.3], &some_actions());
        check(&FALLING, 2, &[0.4], &none);
        check(&FALLING_BOUNCING, 2, &[0.4], &none);
    }

    #[test]
    fn texts_are_those_of_their_cells() {
        let lossy = "acceleration = \"vec(0, g)\"\nwalls = true\nrestitution = \"e\"\nparameters.g = {}\n\
                     parameters.e = { low = 0.0, high = 1.0 }";
        check(text(lossy, 2), 2, &[1.5, 0.4], &Actions::none());
        let charges = "acceleration = \"others(c * other.c * (p - q) / max(norm(p - q), 1)^3)\"\n\
                       parameters.c = { low = -20.0, high = 20.0, each = true }";
        check(text(charges, 3), 3, &[0.6, 0.3, 0.8], &Actions::none());
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
            check(text(&table, 3), 3, &[-4.0, 1.0, 1.2], &Actions::none());
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
        check(text(table, 2), 2, &[-0.3, 0.2], &Actions::none());
        check(text(table, 2), 2, &[-0.3, 0.2], &some_actions());
    }

    /// A spring pulls both bodies alike: their pair is computed once.
    #[test]
    fn what_two_objects_share_is_computed_once() {
        let listing = listing(equation(&SPRING, 2).unwrap(), SPRING.parameters, Walls::new(32, 2.0), 0.3).unwrap();
        let count = |operation: Operation| listing.moving.iter().filter(|it| it.operation == operation).count();
        assert_eq!((count(Operation::Norm), count(Operation::Over)), (1, 2));
        // The one is pushed where the other is pulled.
        assert_eq!((count(Operation::PlusProduct), count(Operation::MinusProduct)), (6, 2));
        assert_eq!((listing.moving.len(), count(Operation::Negative)), (18, 0));
    }
}

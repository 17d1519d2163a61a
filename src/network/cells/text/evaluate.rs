//! The accelerations of all objects of a batch at one instant, with gradients.

use tch::{Device, Kind, Tensor};

use super::arithmetic::{self, Operand};
use super::graph::{ExternalInput, Graph, NodePlace, Operation};
use super::operation::Binary;

/// The operations of an equation, ready to be computed.
#[derive(Debug)]
pub(super) struct CompiledEquation {
    pub graph: Graph,
    /// The acceleration of all objects, or that of each.
    pub accelerations: Vec<NodePlace>,
    pub objects: usize,
    /// Whether values have an axis for objects. Without it each is about one object: `[batch, coordinates]`.
    by_object: bool,
}

/// What stays the same during a roll-out.
#[derive(Debug)]
pub(super) struct Constants {
    options: (Kind, Device),
    /// Each object's others, `[objects * others]`.
    others: Tensor,
    /// By node; none of those that change with the state.
    values: Vec<Option<Operand>>,
}

/// A state, positions and velocities `[batch, objects * coordinates]` each.
pub(super) struct Instant<'a> {
    pub pos: &'a Tensor,
    pub vel: &'a Tensor,
    /// What the dataset holds for the frame, `[batch, 1]`: what acts, or its time.
    pub held: Option<&'a Tensor>,
    /// Time since the frame.
    pub since: f64,
}

/// The same with the axes of an equation's values: `[batch, objects, coordinates]` or `[batch, coordinates]`.
struct StateAxes {
    pos: Tensor,
    vel: Tensor,
    coordinates: i64,
}

/// Values of nodes while they are computed.
struct NodeValues<'a> {
    constants: &'a [Option<Operand>],
    moving: Vec<Option<Operand>>,
}

impl NodeValues<'_> {
    fn at(&self, place: NodePlace) -> &Operand {
        let value = self.moving[place].as_ref().or(self.constants.get(place).and_then(Option::as_ref));
        value.expect("operands stand before what they are used in")
    }
}

impl Constants {
    /// The number 0, `[1, 1]`.
    pub(super) fn zero(&self) -> Tensor {
        Tensor::zeros([1, 1], self.options)
    }
}

impl CompiledEquation {
    pub(super) fn new(graph: Graph, accelerations: Vec<NodePlace>, objects: usize) -> Self {
        let of_one = |given| match given {
            ExternalInput::Parameter(_)
            | ExternalInput::Action
            | ExternalInput::Time
            | ExternalInput::PositionOf(_)
            | ExternalInput::VelocityOf(_) => true,
            _ => objects == 1,
        };
        let of_one = |operation| !matches!(operation, Operation::Given(given) if !of_one(given));
        let apart = accelerations.len() == objects && graph.nodes.iter().all(|node| of_one(node.operation));
        CompiledEquation { graph, accelerations, objects, by_object: !apart }
    }

    /// Whether anything acts from outside.
    pub(super) fn acts(&self) -> bool {
        self.names(ExternalInput::Action)
    }

    /// Whether the time is in it.
    pub(super) fn tells_time(&self) -> bool {
        self.names(ExternalInput::Time)
    }

    /// Whether the position or velocity of a given object is in it.
    pub(super) fn names_objects(&self) -> bool {
        let named = |given| matches!(given, ExternalInput::PositionOf(_) | ExternalInput::VelocityOf(_));
        self.graph.nodes.iter().any(|node| matches!(node.operation, Operation::Given(given) if named(given)))
    }

    fn names(&self, given: ExternalInput) -> bool {
        self.graph.nodes.iter().any(|node| node.operation == Operation::Given(given))
    }

    /// What depends on the parameters alone, each of them a scalar.
    pub(super) fn constants(&self, parameters: &[Tensor], options: (Kind, Device)) -> Constants {
        let others = (0..self.objects).flat_map(|own| (0..self.objects).filter(move |other| *other != own));
        let others: Vec<i64> = others.map(|object| object as i64).collect();
        self.with_parameters(parameters, Tensor::from_slice(&others).to_device(options.1), options)
    }

    /// The same with the parameters computed once more.
    pub(super) fn renewed(&self, constants: &Constants, parameters: &[Tensor]) -> Constants {
        self.with_parameters(parameters, constants.others.shallow_clone(), constants.options)
    }

    fn with_parameters(&self, parameters: &[Tensor], others: Tensor, options: (Kind, Device)) -> Constants {
        let mut values = NodeValues { constants: &[], moving: Vec::with_capacity(self.graph.nodes.len()) };
        for node in &self.graph.nodes {
            let value = (!node.moves).then(|| match node.operation {
                Operation::Given(given) => Operand::Tensor(self.parameter(given, parameters, &others)),
                operation => computed(operation, &values, options),
            });
            values.moving.push(value);
        }
        Constants { options, others, values: values.moving }
    }

    /// Accelerations, `[batch, objects * coordinates]`.
    pub(super) fn acceleration(&self, constants: &Constants, at: &Instant) -> Tensor {
        let size = at.pos.size();
        let (batch, objects) = (size[0], self.objects as i64);
        let coordinates = size[1] / objects;
        let axes = |x: &Tensor| match self.by_object {
            true => x.reshape([batch, objects, coordinates]),
            false => x.shallow_clone(),
        };
        let grid = StateAxes { pos: axes(at.pos), vel: axes(at.vel), coordinates };
        let mut values =
            NodeValues { constants: &constants.values, moving: Vec::with_capacity(self.graph.nodes.len()) };
        for node in &self.graph.nodes {
            let value = node.moves.then(|| match node.operation {
                Operation::Given(given) => Operand::Tensor(self.of_state(given, constants, &grid, at)),
                operation => computed(operation, &values, constants.options),
            });
            values.moving.push(value);
        }
        let result = |place: NodePlace| values.at(place).tensor(constants.options);
        match self.accelerations[..] {
            [of_all] if self.by_object => {
                of_shape(result(of_all), &[batch, objects, coordinates]).reshape([batch, objects * coordinates])
            }
            [of_one] => of_shape(result(of_one), &[batch, coordinates]),
            ref of_each => {
                let row = |place: &NodePlace| match self.by_object {
                    true => of_shape(result(*place), &[batch, 1, coordinates]).squeeze_dim(1),
                    false => of_shape(result(*place), &[batch, coordinates]),
                };
                Tensor::cat(&of_each.iter().map(row).collect::<Vec<_>>(), 1)
            }
        }
    }

    fn parameter(&self, given: ExternalInput, parameters: &[Tensor], others: &Tensor) -> Tensor {
        let objects = self.objects as i64;
        let row = |first: usize| Tensor::stack(&parameters[first..first + self.objects], 0);
        match given {
            ExternalInput::Parameter(place) => parameters[place].shallow_clone(),
            ExternalInput::Parameters(first) => row(first).reshape([1, objects, 1]),
            ExternalInput::ParametersOfOthers(first) => {
                row(first).index_select(0, others).reshape([1, objects, objects - 1, 1])
            }
            _ => unreachable!("a state is no parameter"),
        }
    }

    fn of_state(&self, given: ExternalInput, constants: &Constants, grid: &StateAxes, at: &Instant) -> Tensor {
        let of_others = |x: &Tensor| {
            // Of two objects each other's is the row turned round.
            if self.objects == 2 {
                return x.flip([1]).unsqueeze(2);
            }
            let (batch, objects, coordinates) = x.size3().expect("[batch, objects, coordinates]");
            x.index_select(1, &constants.others).reshape([batch, objects, objects - 1, coordinates])
        };
        let held = || match at.held {
            Some(held) if self.by_object => held.unsqueeze(-1),
            Some(held) => held.shallow_clone(),
            None => constants.zero(),
        };
        let of_one = |x: &Tensor, object: usize| match self.by_object {
            true => x.narrow(1, object as i64, 1),
            false => x.narrow(1, object as i64 * grid.coordinates, grid.coordinates),
        };
        match given {
            ExternalInput::Positions => grid.pos.shallow_clone(),
            ExternalInput::Velocities => grid.vel.shallow_clone(),
            ExternalInput::PositionOf(object) => of_one(&grid.pos, object),
            ExternalInput::VelocityOf(object) => of_one(&grid.vel, object),
            ExternalInput::PositionsOfOthers => of_others(&grid.pos),
            ExternalInput::VelocitiesOfOthers => of_others(&grid.vel),
            ExternalInput::Time => held() + at.since,
            _ => held(),
        }
    }
}

/// The same along the axes that it lacks.
fn of_shape(x: Tensor, shape: &[i64]) -> Tensor {
    if x.size() == shape { x } else { x.expand(shape, false) }
}

fn computed(operation: Operation, values: &NodeValues, options: (Kind, Device)) -> Operand {
    match operation {
        Operation::Number(bits) => Operand::Number(f64::from_bits(bits)),
        Operation::Unary(operation, of) => Operand::Tensor(arithmetic::unary(operation, values.at(of), options)),
        // A square: one product backward instead of two.
        Operation::Binary(Binary::Dot, a, b) if a == b => {
            Operand::Tensor(arithmetic::squared_norm(&values.at(a).tensor(options)))
        }
        Operation::Binary(operation, a, b) => {
            Operand::Tensor(arithmetic::binary(operation, values.at(a), values.at(b), options))
        }
        Operation::Given(_) => unreachable!("given values are not computed"),
    }
}

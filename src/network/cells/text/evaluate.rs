//! The accelerations of all objects of a batch at one instant, with gradients.

use tch::{Device, Kind, Tensor};

use super::arithmetic::{self, Value};
use super::graph::{Given, Graph, Operation, Place};

/// The operations of an equation, ready to be computed.
#[derive(Debug)]
pub(super) struct Program {
    pub graph: Graph,
    /// The acceleration of all objects, or that of each.
    pub accelerations: Vec<Place>,
    pub objects: usize,
}

/// What stays the same during a roll-out.
#[derive(Debug)]
pub(super) struct Constants {
    options: (Kind, Device),
    /// Each object's others, `[objects * others]`.
    others: Tensor,
    /// By node; none of those that change with the state.
    values: Vec<Option<Value>>,
}

/// A state, each of `[batch, objects, coordinates]`.
pub(super) struct Instant<'a> {
    pub pos: &'a Tensor,
    pub vel: &'a Tensor,
    /// What the dataset holds for the frame, `[batch, 1, 1]`: what acts, or its time.
    pub held: Option<&'a Tensor>,
    /// Time since the frame.
    pub since: f64,
}

/// Values of nodes while they are computed.
struct Values<'a> {
    constants: &'a [Option<Value>],
    moving: Vec<Option<Value>>,
}

impl Values<'_> {
    fn at(&self, place: Place) -> &Value {
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

impl Program {
    /// Whether anything acts from outside.
    pub(super) fn acts(&self) -> bool {
        self.names(Given::Action)
    }

    /// Whether the time is in it.
    pub(super) fn tells_time(&self) -> bool {
        self.names(Given::Time)
    }

    /// Whether the position or velocity of a given object is in it.
    pub(super) fn names_objects(&self) -> bool {
        let named = |given| matches!(given, Given::PositionOf(_) | Given::VelocityOf(_));
        self.graph.nodes.iter().any(|node| matches!(node.operation, Operation::Given(given) if named(given)))
    }

    fn names(&self, given: Given) -> bool {
        self.graph.nodes.iter().any(|node| node.operation == Operation::Given(given))
    }

    /// What depends on the parameters alone, each of them `[1]`.
    pub(super) fn constants(&self, parameters: &[Tensor], options: (Kind, Device)) -> Constants {
        let others = (0..self.objects).flat_map(|own| (0..self.objects).filter(move |other| *other != own));
        let others: Vec<i64> = others.map(|object| object as i64).collect();
        let others = Tensor::from_slice(&others).to_device(options.1);
        let mut values = Values { constants: &[], moving: Vec::with_capacity(self.graph.nodes.len()) };
        for node in &self.graph.nodes {
            let value = (!node.moves).then(|| match node.operation {
                Operation::Given(given) => Value::Tensor(self.parameter(given, parameters, &others)),
                operation => computed(operation, &values, options),
            });
            values.moving.push(value);
        }
        Constants { options, others, values: values.moving }
    }

    /// Accelerations, of a shape that goes with `[batch, objects, coordinates]`.
    pub(super) fn acceleration(&self, constants: &Constants, at: &Instant) -> Tensor {
        let mut values = Values { constants: &constants.values, moving: Vec::with_capacity(self.graph.nodes.len()) };
        for node in &self.graph.nodes {
            let value = node.moves.then(|| match node.operation {
                Operation::Given(given) => Value::Tensor(self.of_state(given, constants, at)),
                operation => computed(operation, &values, constants.options),
            });
            values.moving.push(value);
        }
        let result = |place: Place| values.at(place).tensor(constants.options);
        match self.accelerations[..] {
            [of_all] => result(of_all),
            ref of_each => {
                let one = at.pos.narrow(1, 0, 1);
                let rows: Vec<_> = of_each.iter().map(|place| result(*place).expand_as(&one)).collect();
                Tensor::cat(&rows, 1)
            }
        }
    }

    fn parameter(&self, given: Given, parameters: &[Tensor], others: &Tensor) -> Tensor {
        let objects = self.objects as i64;
        let row = |first: usize| Tensor::cat(&parameters[first..first + self.objects], 0);
        match given {
            Given::Parameter(place) => parameters[place].shallow_clone(),
            Given::Parameters(first) => row(first).reshape([1, objects, 1]),
            Given::ParametersOfOthers(first) => {
                row(first).index_select(0, others).reshape([1, objects, objects - 1, 1])
            }
            _ => unreachable!("a state is no parameter"),
        }
    }

    fn of_state(&self, given: Given, constants: &Constants, at: &Instant) -> Tensor {
        let of_others = |x: &Tensor| {
            // Of two objects each other's is the row turned round.
            if self.objects == 2 {
                return x.flip([1]).unsqueeze(2);
            }
            let (batch, objects, coordinates) = x.size3().expect("[batch, objects, coordinates]");
            x.index_select(1, &constants.others).reshape([batch, objects, objects - 1, coordinates])
        };
        let held = || at.held.map_or_else(|| Tensor::zeros([1, 1, 1], constants.options), Tensor::shallow_clone);
        match given {
            Given::Positions => at.pos.shallow_clone(),
            Given::Velocities => at.vel.shallow_clone(),
            Given::PositionOf(object) => at.pos.narrow(1, object as i64, 1),
            Given::VelocityOf(object) => at.vel.narrow(1, object as i64, 1),
            Given::PositionsOfOthers => of_others(at.pos),
            Given::VelocitiesOfOthers => of_others(at.vel),
            Given::Time => held() + at.since,
            _ => held(),
        }
    }
}

fn computed(operation: Operation, values: &Values, options: (Kind, Device)) -> Value {
    match operation {
        Operation::Number(bits) => Value::Number(f64::from_bits(bits)),
        Operation::Unary(operation, of) => Value::Tensor(arithmetic::unary(operation, values.at(of), options)),
        Operation::Binary(operation, a, b) => {
            Value::Tensor(arithmetic::binary(operation, values.at(a), values.at(b), options))
        }
        Operation::Given(_) => unreachable!("given values are not computed"),
    }
}

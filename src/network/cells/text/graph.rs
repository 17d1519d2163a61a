//! The operations of an equation, each once: what is written twice (`p - q`, `norm(p - q)`) is computed once.
//!
//! A node's operands stand before it, so one pass from the first node to the last computes everything.

use std::collections::HashMap;

use tch::{Device, Kind};

use super::arithmetic::{self, Operand};
use super::complaint::{Complaint, TextSpan};
use super::operation::{Binary, ExpressionFacts, Unary};
use super::units::Unit;

/// Most nodes of an equation.
const MOST_NODES: usize = 10_000;

/// A node's place among all nodes.
pub(super) type NodePlace = usize;

/// What comes from outside the equation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum ExternalInput {
    /// One parameter, a scalar.
    Parameter(usize),
    /// That of each object, `[1, objects, 1]`; the first of them stands here.
    Parameters(usize),
    /// The same of the other objects, `[1, objects, others, 1]`.
    ParametersOfOthers(usize),
    /// `[batch, objects, coordinates]`.
    Positions,
    Velocities,
    /// Of one object, `[batch, 1, coordinates]`.
    PositionOf(usize),
    VelocityOf(usize),
    /// Of each object's others, `[batch, objects, others, coordinates]`.
    PositionsOfOthers,
    VelocitiesOfOthers,
    /// What acts from outside, `[batch, 1, 1]`.
    Action,
    /// The time, `[batch, 1, 1]`.
    Time,
}

impl ExternalInput {
    fn extent(self) -> Extent {
        match self {
            ExternalInput::Parameter(_) => Extent::Shared,
            ExternalInput::ParametersOfOthers(_)
            | ExternalInput::PositionsOfOthers
            | ExternalInput::VelocitiesOfOthers => Extent::Pairs,
            _ => Extent::Objects,
        }
    }

    fn moves(self) -> bool {
        !matches!(
            self,
            ExternalInput::Parameter(_) | ExternalInput::Parameters(_) | ExternalInput::ParametersOfOthers(_)
        )
    }
}

/// Over what a node has values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Extent {
    /// The same for all objects.
    Shared,
    /// For each object, or for one of them.
    Objects,
    /// For each object and each of its others.
    Pairs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Operation {
    /// The bits of a number.
    Number(u64),
    Given(ExternalInput),
    Unary(Unary, NodePlace),
    Binary(Binary, NodePlace, NodePlace),
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub operation: Operation,
    pub vector: bool,
    pub extent: Extent,
    pub unit: Unit,
    /// Whether it changes with the state; what does not is computed once for a roll-out.
    pub moves: bool,
}

impl Node {
    fn known(&self) -> ExpressionFacts {
        ExpressionFacts { vector: self.vector, unit: self.unit, number: self.number() }
    }

    pub(super) fn number(&self) -> Option<f64> {
        match self.operation {
            Operation::Number(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }
}

/// All operations of an equation.
#[derive(Debug, Default)]
pub(super) struct Graph {
    pub nodes: Vec<Node>,
    places: HashMap<Operation, NodePlace>,
}

impl Graph {
    pub(super) fn number(&mut self, number: f64, at: &TextSpan) -> Result<NodePlace, Complaint> {
        if !number.is_finite() {
            return Err(Complaint::new(at, format!("this is {number}, not a finite number")));
        }
        let operation = Operation::Number(number.to_bits());
        self.put(Node { operation, vector: false, extent: Extent::Shared, unit: Unit::Literal, moves: false }, at)
    }

    pub(super) fn given(
        &mut self,
        given: ExternalInput,
        vector: bool,
        unit: Unit,
        at: &TextSpan,
    ) -> Result<NodePlace, Complaint> {
        let operation = Operation::Given(given);
        self.put(Node { operation, vector, extent: given.extent(), unit, moves: given.moves() }, at)
    }

    /// # Errors
    /// An operand of a rank or unit that does not fit.
    pub(super) fn unary(&mut self, operation: Unary, of: NodePlace, at: &TextSpan) -> Result<NodePlace, Complaint> {
        let node = self.nodes[of];
        let (vector, unit) = operation.check(node.known()).map_err(|what| Complaint::new(at, what))?;
        if let Some(number) = node.number() {
            let value = arithmetic::unary(operation, &Operand::Number(number), (Kind::Double, Device::Cpu));
            return self.number(value.double_value(&[0]), at);
        }
        let extent = match operation {
            Unary::ForOthers => Extent::Pairs,
            Unary::OverOthers => Extent::Objects,
            _ => node.extent,
        };
        self.put(Node { operation: Operation::Unary(operation, of), vector, extent, unit, moves: node.moves }, at)
    }

    /// # Errors
    /// Operands that do not go together.
    pub(super) fn binary(
        &mut self,
        operation: Binary,
        a: NodePlace,
        b: NodePlace,
        at: &TextSpan,
    ) -> Result<NodePlace, Complaint> {
        let known = [a, b].map(|place| self.nodes[place].known());
        let (vector, unit) = operation.check(known[0], known[1]).map_err(|what| Complaint::new(at, what))?;
        if let ([Some(x), Some(y)], false) = (known.map(|known| known.number), vector) {
            let [x, y] = [x, y].map(Operand::Number);
            let value = arithmetic::binary(operation, &x, &y, (Kind::Double, Device::Cpu));
            return self.number(value.double_value(&[0]), at);
        }
        let extent = self.nodes[a].extent.max(self.nodes[b].extent);
        let (a, b) = (self.spread(a, extent, at)?, self.spread(b, extent, at)?);
        let moves = self.nodes[a].moves || self.nodes[b].moves;
        self.put(Node { operation: Operation::Binary(operation, a, b), vector, extent, unit, moves }, at)
    }

    /// What each object has, for each pair where pairs are computed with.
    fn spread(&mut self, place: NodePlace, extent: Extent, at: &TextSpan) -> Result<NodePlace, Complaint> {
        match (self.nodes[place].extent, extent) {
            (Extent::Objects, Extent::Pairs) => self.unary(Unary::ForOthers, place, at),
            _ => Ok(place),
        }
    }

    fn put(&mut self, node: Node, at: &TextSpan) -> Result<NodePlace, Complaint> {
        if let Some(place) = self.places.get(&node.operation) {
            return Ok(*place);
        }
        if self.nodes.len() == MOST_NODES {
            let what = format!("the equation takes more than {MOST_NODES} operations");
            return Err(Complaint::new(at, what));
        }
        self.nodes.push(node);
        self.places.insert(node.operation, self.nodes.len() - 1);
        Ok(self.nodes.len() - 1)
    }
}

//! From the expressions of an equation to its operations: what names and functions mean, and whether all goes together.

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::PI;

use super::complaint::{Complaint, TextSpan};
use super::graph::{Extent, ExternalInput, Graph, NodePlace};
use super::operation::{Binary, FUNCTIONS, Function, Unary};
use super::parameters::{Parameters, of_object};
use super::parse::{Expression, Operator, Term};
use super::units::Unit;
use crate::network::cells::state::Coordinates;

/// The least norm that [`Function::Direction`] divides by: the direction of nothing is 0.
const LEAST_NORM: f64 = 1e-6;
/// How deep expressions may stand in each other, those of definitions counted where they are used: a text must not exhaust
/// the program's stack.
const DEEPEST: usize = 200;

/// What the accelerations of one equation have in common.
pub(super) struct Compiler<'a> {
    pub graph: Graph,
    pub coordinates: Coordinates,
    pub objects: usize,
    pub parameters: &'a Parameters,
    /// By name, with the text.
    pub definitions: &'a BTreeMap<String, (String, Expression)>,
    /// Which parameters a text has named.
    pub used: Vec<bool>,
    /// Definitions that were used, by who is meant by p and q; none while one is being read.
    defined: HashMap<(&'a str, ObjectPair), Option<NodePlace>>,
    depth: usize,
}

/// Whose acceleration is written, and who the other is inside of `others(..)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct ObjectPair {
    own: Own,
    other: Other,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Own {
    /// That of all objects at once.
    Each,
    One(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Other {
    /// Outside of `others(..)`.
    Nobody,
    /// Each of the others, for all objects at once.
    Each,
    One(usize),
}

impl<'a> Compiler<'a> {
    pub(super) fn new(
        coordinates: Coordinates,
        objects: usize,
        parameters: &'a Parameters,
        definitions: &'a BTreeMap<String, (String, Expression)>,
    ) -> Self {
        let used = vec![false; parameters.all.len()];
        let (graph, defined) = (Graph::default(), HashMap::new());
        Compiler { graph, coordinates, objects, parameters, definitions, used, defined, depth: 0 }
    }

    /// A definition that no acceleration has used.
    pub(super) fn unused_definition(&self) -> Option<&'a str> {
        let mut names = self.definitions.keys().map(String::as_str);
        names.find(|name| self.defined.keys().all(|(used, _)| used != name))
    }

    /// The acceleration of all objects, or of one, and where it is found.
    ///
    /// # Errors
    /// An unknown name, operands that do not go together, another rank or unit than an acceleration's.
    pub(super) fn acceleration(&mut self, of: Option<usize>, text: &Expression) -> Result<NodePlace, Complaint> {
        let view = ObjectPair { own: of.map_or(Own::Each, Own::One), other: Other::Nobody };
        let place = self.expression(text, view)?;
        let node = self.graph.nodes[place];
        let (vector, unit) = match self.coordinates {
            Coordinates::Position => (true, Unit::Of([1.0, -2.0])),
            Coordinates::Angle => (false, Unit::Of([0.0, -2.0])),
        };
        if node.vector != vector {
            let [needed, found] = [vector, node.vector].map(|vector| if vector { "a vector" } else { "a scalar" });
            let what = format!("the acceleration must be {needed}, but this is {found}");
            return Err(Complaint::new(&text.at, what));
        }
        if node.unit.plus(unit).is_none() {
            let found = node.unit;
            let what =
                format!("the acceleration must have the unit {unit} (powers of length and time), but has {found}");
            return Err(Complaint::new(&text.at, what));
        }
        Ok(place)
    }

    fn expression(&mut self, expression: &Expression, view: ObjectPair) -> Result<NodePlace, Complaint> {
        let at = &expression.at;
        if self.depth == DEEPEST {
            return Err(Complaint::new(at, format!("more than {DEEPEST} expressions in each other")));
        }
        self.depth += 1;
        let place = match &expression.term {
            Term::Number(number) => self.graph.number(*number, at),
            Term::Name(name) => self.name(name, at, view),
            Term::Part(..) => self.parts(expression, view),
            Term::Negative(of) => {
                let of = self.expression(of, view)?;
                self.graph.unary(Unary::Negative, of, at)
            }
            Term::Binary(..) => self.operations(expression, view),
            Term::Call(name, arguments) => self.call(name, arguments, at, view),
        };
        self.depth -= 1;
        place
    }

    /// A chain of operators from its first operand on: a long sum must not exhaust the stack.
    fn operations(&mut self, expression: &Expression, view: ObjectPair) -> Result<NodePlace, Complaint> {
        let mut chain = Vec::new();
        let mut first = expression;
        while let Term::Binary(operator, a, b) = &first.term {
            chain.push((*operator, b.as_ref()));
            first = a.as_ref();
        }
        let mut place = self.expression(first, view)?;
        for (operator, operand) in chain.into_iter().rev() {
            let b = self.expression(operand, view)?;
            let operation = match operator {
                Operator::Plus => Binary::Plus,
                Operator::Minus => Binary::Minus,
                Operator::Times => Binary::Times,
                Operator::Over => Binary::Over,
                Operator::Raised => Binary::Power,
            };
            place = self.graph.binary(operation, place, b, &operand.at)?;
        }
        Ok(place)
    }

    /// `.x` and `.y`, one after the other, or a parameter of the other object.
    fn parts(&mut self, expression: &Expression, view: ObjectPair) -> Result<NodePlace, Complaint> {
        let mut chain = Vec::new();
        let mut first = expression;
        while let Term::Part(whole, name) = &first.term {
            chain.push((name, &first.at));
            first = whole.as_ref();
        }
        let mut place = match (&first.term, chain.last().copied()) {
            (Term::Name(other), Some((name, at))) if other == "other" => {
                chain.pop();
                self.parameter_of_other(name, at, view)?
            }
            _ => self.expression(first, view)?,
        };
        for (name, at) in chain.into_iter().rev() {
            let axis = match name.as_str() {
                "x" => 0,
                "y" => 1,
                _ => return Err(Complaint::new(at, format!("there is no part {name:?}; a vector has .x and .y"))),
            };
            place = self.graph.unary(Unary::Part(axis), place, at)?;
        }
        Ok(place)
    }

    fn name(&mut self, name: &str, at: &TextSpan, view: ObjectPair) -> Result<NodePlace, Complaint> {
        let turns = self.coordinates == Coordinates::Angle;
        match name {
            "p" => self.state(true, Whose::Own, at, view),
            "v" => self.state(false, Whose::Own, at, view),
            "angle" if turns => self.state(true, Whose::Own, at, view),
            "spin" if turns => self.state(false, Whose::Own, at, view),
            "q" => self.state(true, Whose::Other, at, view),
            "w" => self.state(false, Whose::Other, at, view),
            "u" => self.graph.given(ExternalInput::Action, false, Unit::Any, at),
            "t" => self.graph.given(ExternalInput::Time, false, Unit::Of([0.0, 1.0]), at),
            "pi" => self.graph.number(PI, at),
            "other" => Err(Complaint::new(at, "the other object's parameter is written other.name")),
            _ => match of_object(name) {
                Some((letter, number)) => self.numbered(letter, number, at),
                None => match self.definitions.get_key_value(name) {
                    Some((name, (text, meaning))) => self.definition(name, text, meaning, at, view),
                    None => self.parameter(name, at, view),
                },
            },
        }
    }

    /// What a definition means where it is used.
    fn definition(
        &mut self,
        name: &'a str,
        text: &str,
        meaning: &Expression,
        at: &TextSpan,
        view: ObjectPair,
    ) -> Result<NodePlace, Complaint> {
        match self.defined.get(&(name, view)) {
            Some(Some(place)) => return Ok(*place),
            Some(None) => return Err(Complaint::new(at, format!("{name} is defined by itself"))),
            None => drop(self.defined.insert((name, view), None)),
        }
        let place = self.expression(meaning, view).map_err(|complaint| complaint.within(name, text))?;
        self.defined.insert((name, view), Some(place));
        Ok(place)
    }

    /// A position or a velocity.
    fn state(&mut self, position: bool, whose: Whose, at: &TextSpan, view: ObjectPair) -> Result<NodePlace, Complaint> {
        let given = match (whose, view.own, view.other) {
            (Whose::Own, Own::Each, _) => {
                if position {
                    ExternalInput::Positions
                } else {
                    ExternalInput::Velocities
                }
            }
            (Whose::Own, Own::One(object), _) | (Whose::Other, _, Other::One(object)) => of_one(position, object),
            (Whose::Other, _, Other::Each) => {
                if position {
                    ExternalInput::PositionsOfOthers
                } else {
                    ExternalInput::VelocitiesOfOthers
                }
            }
            (Whose::Other, _, Other::Nobody) => {
                let what =
                    "q and w are the other object's position and velocity: they mean something inside others(..)";
                return Err(Complaint::new(at, what));
            }
        };
        self.given_state(given, position, at)
    }

    fn given_state(&mut self, given: ExternalInput, position: bool, at: &TextSpan) -> Result<NodePlace, Complaint> {
        let plane = self.coordinates == Coordinates::Position;
        let length = if plane { 1.0 } else { 0.0 };
        let unit = Unit::Of([length, if position { 0.0 } else { -1.0 }]);
        self.graph.given(given, plane, unit, at)
    }

    /// `p1`, `v2`.
    fn numbered(&mut self, letter: char, number: &str, at: &TextSpan) -> Result<NodePlace, Complaint> {
        let object = number.parse().ok().filter(|number| (1..=self.objects).contains(number));
        let Some(object) = object else {
            let objects = self.objects;
            return Err(Complaint::new(
                at,
                format!("there is no object {number}; they are {letter}1 to {letter}{objects}"),
            ));
        };
        self.given_state(of_one(letter == 'p', object - 1), letter == 'p', at)
    }

    fn parameter(&mut self, name: &str, at: &TextSpan, view: ObjectPair) -> Result<NodePlace, Complaint> {
        if let Some(first) = self.parameters.each.get(name) {
            return match view.own {
                Own::One(object) => self.one_parameter(first + object, at),
                Own::Each => {
                    self.used[*first..first + self.objects].fill(true);
                    self.graph.given(ExternalInput::Parameters(*first), false, self.parameters.all[*first].unit, at)
                }
            };
        }
        match self.parameters.place(name) {
            Some(place) => self.one_parameter(place, at),
            None => Err(Complaint::new(at, format!("unknown name {name:?}; known are {}", self.known(view)))),
        }
    }

    fn one_parameter(&mut self, place: usize, at: &TextSpan) -> Result<NodePlace, Complaint> {
        self.used[place] = true;
        self.graph.given(ExternalInput::Parameter(place), false, self.parameters.all[place].unit, at)
    }

    /// `other.m`.
    fn parameter_of_other(&mut self, name: &str, at: &TextSpan, view: ObjectPair) -> Result<NodePlace, Complaint> {
        if view.other == Other::Nobody {
            return Err(Complaint::new(at, "there is an other object only inside others(..)"));
        }
        let Some(first) = self.parameters.each.get(name) else {
            let known: Vec<_> = self.parameters.each.keys().map(String::as_str).collect();
            let what = format!("objects have no parameter {name:?} of their own (each = true); they have {known:?}");
            return Err(Complaint::new(at, what));
        };
        match view.other {
            Other::One(object) => self.one_parameter(first + object, at),
            _ => {
                self.used[*first..first + self.objects].fill(true);
                self.graph.given(ExternalInput::ParametersOfOthers(*first), false, self.parameters.all[*first].unit, at)
            }
        }
    }

    /// All names that mean something, for people to read.
    fn known(&self, view: ObjectPair) -> String {
        let mut names = vec!["p", "v"];
        if self.coordinates == Coordinates::Angle {
            names.extend(["angle", "spin"]);
        }
        if view.other != Other::Nobody {
            names.extend(["q", "w"]);
        }
        names.extend(["u", "t", "pi"]);
        names.extend(self.definitions.keys().map(String::as_str));
        names.extend(self.parameters.each.keys().map(String::as_str));
        names.extend(self.parameters.all.iter().map(|declared| declared.name.as_str()));
        names.join(", ")
    }

    fn call(
        &mut self,
        name: &str,
        arguments: &[Expression],
        at: &TextSpan,
        view: ObjectPair,
    ) -> Result<NodePlace, Complaint> {
        let Some(function) = Function::named(name) else {
            let known: Vec<_> = FUNCTIONS.iter().map(|(known, _)| *known).collect();
            let what = format!("unknown function {name:?}; known are {}", known.join(", "));
            return Err(Complaint::new(&(at.start..at.start + name.len()), what));
        };
        let needed = function.arguments();
        if arguments.len() != needed {
            let plural = if needed == 1 { "" } else { "s" };
            let what = format!("{name} takes {needed} argument{plural}, not {}", arguments.len());
            return Err(Complaint::new(at, what));
        }
        if function == Function::Others {
            return self.others(&arguments[0], at, view);
        }
        let places = arguments.iter().map(|argument| self.expression(argument, view)).collect::<Result<Vec<_>, _>>()?;
        match function {
            Function::Unary(operation) => self.graph.unary(operation, places[0], &arguments[0].at),
            Function::Binary(operation) => self.graph.binary(operation, places[0], places[1], at),
            Function::Direction | Function::Others => {
                let size = self.graph.unary(Unary::Norm, places[0], &arguments[0].at)?;
                let least = self.graph.number(LEAST_NORM, at)?;
                let size = self.graph.binary(Binary::Max, size, least, at)?;
                self.graph.binary(Binary::Over, places[0], size, at)
            }
        }
    }

    /// The sum over all other objects.
    fn others(&mut self, term: &Expression, at: &TextSpan, view: ObjectPair) -> Result<NodePlace, Complaint> {
        if view.other != Other::Nobody {
            return Err(Complaint::new(at, "others(..) cannot stand inside others(..)"));
        }
        if self.objects < 2 {
            return Err(Complaint::new(at, "there are no others: the system has one object"));
        }
        match view.own {
            Own::Each => {
                let place = self.expression(term, ObjectPair { other: Other::Each, ..view })?;
                if self.graph.nodes[place].extent == Extent::Pairs {
                    return self.graph.unary(Unary::OverOthers, place, at);
                }
                // The same for each of the others.
                let count = self.graph.number((self.objects - 1) as f64, at)?;
                self.graph.binary(Binary::Times, place, count, at)
            }
            Own::One(own) => {
                let mut sum = None;
                for object in (0..self.objects).filter(|object| *object != own) {
                    let place = self.expression(term, ObjectPair { other: Other::One(object), ..view })?;
                    sum = Some(match sum {
                        Some(sum) => self.graph.binary(Binary::Plus, sum, place, at)?,
                        None => place,
                    });
                }
                sum.ok_or_else(|| Complaint::new(at, "there are no others"))
            }
        }
    }
}

/// Whose position or velocity a name is.
#[derive(Debug, Clone, Copy)]
enum Whose {
    Own,
    Other,
}

fn of_one(position: bool, object: usize) -> ExternalInput {
    if position { ExternalInput::PositionOf(object) } else { ExternalInput::VelocityOf(object) }
}

//! What an equation is: its name, its parameters, and how a cell of it is made.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result};
use tch::Tensor;

use super::cell::Cell;
use super::integrator::Integrator;
use super::parameter::PhysicalParameter;
use super::state::{Coordinates, Walls};
use super::text::{Equation, EquationTable, TextCell};
use crate::support::random::fnv1a;

/// The scope of the parameters, whatever the text.
const TEXT_SCOPE: &str = "text_ode_cell";

/// An equation: what it is called, what it is about, and how a cell of it is made.
#[derive(Debug, Clone)]
pub struct CellKind {
    /// Name in a task file, such as `spring`; of a text a checksum of it.
    pub name: Cow<'static, str>,
    /// Name of the scope that holds the cell's variables; ends in `_cell`.
    pub scope: &'static str,
    /// The number of objects that it is written for; none if any number will do.
    pub objects: Option<usize>,
    pub coordinates: Coordinates,
    /// Whether it depends on where the walls are.
    pub walls: bool,
    /// Whether something acts from outside in every frame, or the equation names the time: the dataset must hold it.
    pub actions: bool,
    /// In the order in which `build` takes them.
    pub parameters: Cow<'static, [PhysicalParameter]>,
    pub build: Build,
    /// An equation of Rust as an [`EquationTable`] in TOML, with which a GPU and measurements compute it; none where the
    /// language has no words for it.
    pub text: Option<&'static str>,
}

/// How a cell of an equation is made.
#[derive(Debug, Clone)]
pub enum Build {
    /// By this function, from the unconstrained parameters (scalars, one for each; see
    /// [`Bounds`](super::Bounds): of a positive one its logarithm) and the walls.
    Rust(fn(&[Tensor], Walls) -> Box<dyn Cell>),
    /// From the text of a task file.
    Text(Arc<Equation>),
    /// From the text that the equation's name stands for.
    Named(Arc<Equation>),
}

/// The same function, or the same text for as many objects.
impl PartialEq for Build {
    fn eq(&self, other: &Build) -> bool {
        match (self, other) {
            (Build::Rust(one), Build::Rust(other)) => std::ptr::fn_addr_eq(*one, *other),
            (Build::Text(one), Build::Text(other)) | (Build::Named(one), Build::Named(other)) => one == other,
            _ => false,
        }
    }
}

/// Equations are equal in all that they say. Of one in Rust clones are equal; two that were filled in apart may hold
/// different copies of one function.
impl PartialEq for CellKind {
    fn eq(&self, other: &CellKind) -> bool {
        let CellKind { name, scope, objects, coordinates, walls, actions, parameters, build, text } = self;
        *name == other.name
            && *scope == other.scope
            && *objects == other.objects
            && *coordinates == other.coordinates
            && *walls == other.walls
            && *actions == other.actions
            && *parameters == other.parameters
            && *build == other.build
            && *text == other.text
    }
}

impl CellKind {
    /// The equation of a table, for so many objects.
    ///
    /// # Errors
    /// As for [`Equation::read`].
    pub fn of_text(table: &EquationTable, objects: usize) -> Result<CellKind> {
        let equation = Equation::read(table, objects).context("equation")?;
        Ok(CellKind {
            name: format!("text-{:016x}", checksum(table, objects)?).into(),
            scope: TEXT_SCOPE,
            objects: Some(objects),
            coordinates: table.state,
            walls: equation.has_walls_at_the_edges(),
            actions: equation.needs_actions(),
            parameters: equation.parameters().to_vec().into(),
            build: Build::Text(Arc::new(equation)),
            text: None,
        })
    }

    /// Whether what the dataset holds for each frame is its time, and nothing acts.
    pub fn tells_time(&self) -> bool {
        matches!(&self.build, Build::Text(equation) if equation.tells_time())
    }

    /// Whether it matters which object is which: the text of a file names a given one, there is one for each, or of a parameter that each
    /// object has some are held at other values than the rest. `held`: each unconstrained parameter that is not learned.
    pub(crate) fn tells_objects_apart(&self, held: &[Option<f64>]) -> bool {
        matches!(&self.build, Build::Text(equation) if equation.tells_objects_apart(held))
    }

    /// Of the parameters that each object has of its own, the first object's places; those of the other objects follow each.
    pub fn of_each(&self) -> &[usize] {
        match &self.build {
            Build::Text(equation) | Build::Named(equation) => equation.of_each(),
            Build::Rust(_) => &[],
        }
    }

    /// Whether something acts that may be chosen.
    pub fn can_be_driven(&self) -> bool {
        self.actions && !self.tells_time()
    }

    /// The cell with these unconstrained parameters (scalars, one for each of `parameters`): of those that are positive, the
    /// logarithms.
    pub fn cell(&self, unconstrained: &[Tensor], walls: Walls) -> Box<dyn Cell> {
        match &self.build {
            Build::Rust(build) => build(unconstrained, walls),
            Build::Text(equation) | Build::Named(equation) => Box::new(TextCell::new(equation, unconstrained, walls)),
        }
    }

    /// The table of its text; none of one that has no text.
    ///
    /// # Panics
    /// An equation of Rust whose `text` is no table: a mistake in the program, never in its input.
    pub fn table(&self) -> Option<EquationTable> {
        match &self.build {
            Build::Text(equation) | Build::Named(equation) => Some(equation.table().clone()),
            Build::Rust(_) => {
                let read = |text| toml::from_str(text).expect("the text of an equation of Rust is a table");
                self.text.map(read)
            }
        }
    }

    /// Its text, read for so many objects; none of one that has no text.
    ///
    /// # Errors
    /// As for [`Equation::read`].
    pub fn equation(&self, objects: usize) -> Result<Option<Arc<Equation>>> {
        match &self.build {
            Build::Text(equation) | Build::Named(equation) => Ok(Some(equation.clone())),
            Build::Rust(_) => {
                self.table().map(|table| Equation::read(&table, objects).context("equation").map(Arc::new)).transpose()
            }
        }
    }

    /// What moves the objects, without what only a fit needs (its method, the bounds and starts of the parameters): the
    /// equation's name where it is no text of a file.
    pub(crate) fn accelerations(&self) -> String {
        let Build::Text(equation) = &self.build else { return self.name.to_string() };
        let table = equation.table().clone();
        let moves = EquationTable { integrator: Integrator::default(), parameters: BTreeMap::new(), ..table };
        toml::to_string(&moves).expect("an equation is plain data")
    }

    /// The same text of a file, integrated by another method; none of an equation of Rust.
    ///
    /// # Errors
    /// None that the equation itself did not have.
    pub(crate) fn integrated_by(&self, integrator: Integrator) -> Result<Option<CellKind>> {
        let Build::Text(equation) = &self.build else { return Ok(None) };
        let table = EquationTable { integrator, ..equation.table().clone() };
        CellKind::of_text(&table, equation.objects()).map(Some)
    }
}

/// The same for the same text in every version of the program.
fn checksum(table: &EquationTable, objects: usize) -> Result<u64> {
    let text = toml::to_string(table)? + &objects.to_string();
    Ok(fnv1a(text.as_bytes()))
}

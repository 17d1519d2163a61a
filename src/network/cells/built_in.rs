//! Equations that come with the program: a text under a name.

use std::sync::Arc;

use super::kind::{Build, CellKind};
use super::state::MOST_OBJECTS;
use super::text::{Equation, EquationTable, PlainForms};

/// A text under a name, read anew for the objects of each system.
#[derive(Debug, Clone, Copy)]
pub struct BuiltIn {
    /// Name in a task file.
    pub name: &'static str,
    /// Name of the scope that holds the cell's variables; ends in `_cell`.
    pub scope: &'static str,
    /// The number of objects that it is written for; none if any number will do.
    pub objects: Option<usize>,
    /// Names of the parameters, in their order in checkpoints and reports.
    pub parameters: &'static [&'static str],
    /// An [`EquationTable`] in TOML.
    pub text: &'static str,
    pub plain: PlainForms,
}

/// A name stands for one equation.
impl PartialEq for BuiltIn {
    fn eq(&self, other: &BuiltIn) -> bool {
        (self.name, self.text) == (other.name, other.text)
    }
}

impl BuiltIn {
    /// The equation for so many objects; for the number it is written for, if there is one.
    ///
    /// # Panics
    /// A text that is no equation: a mistake in the program, never in its input.
    pub fn kind(&self, objects: usize) -> CellKind {
        let table: EquationTable = toml::from_str(self.text).expect("the text of a built-in equation is a table");
        let objects = self.objects.unwrap_or(objects).clamp(1, MOST_OBJECTS);
        let equation = Equation::read_named(&table, objects, self.parameters, self.plain);
        let equation = equation.expect("the text of a built-in equation is one");
        CellKind {
            name: self.name.into(),
            scope: self.scope,
            objects: self.objects,
            coordinates: table.state,
            walls: equation.has_walls_at_the_edges(),
            actions: equation.needs_actions(),
            parameters: equation.parameters().to_vec().into(),
            build: Build::Named(Arc::new(equation)),
            text: None,
        }
    }
}

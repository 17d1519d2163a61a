//! An equation that was read from text, for a number of objects.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail, ensure};

use super::compile::Compiler;
use super::contacts::TextContacts;
use super::evaluate::CompiledEquation;
use super::parameters::{Parameters, check_name};
use super::parse::{Expression, parse};
use super::surfaces::TextConstraints;
use super::table::{Accelerations, EquationTable};
use super::walls::TextWalls;
use crate::network::cells::parameter::PhysicalParameter;
use crate::network::cells::plain::PlainCell;
use crate::network::cells::state::MOST_OBJECTS;
use crate::support::error::Excerpt;

/// Most steps for a frame.
const MOST_SUBSTEPS: usize = 1000;

/// An equation that was read from text, for a number of objects.
#[derive(Debug)]
pub struct Equation {
    pub(super) table: EquationTable,
    pub(super) parameters: Vec<PhysicalParameter>,
    /// Places of the parameters that each object has, the first object's.
    of_each: Vec<usize>,
    pub(super) program: CompiledEquation,
    pub(super) walls: Option<TextWalls>,
    pub(super) contacts: Option<TextContacts>,
    /// Surfaces and strings.
    pub(super) constraints: Option<TextConstraints>,
    /// Whether the parameters are computed in every substep instead of once for a roll-out. Their gradients then round as those
    /// of the original, which does so.
    pub(super) renews_parameters: bool,
    pub(super) plain: PlainForms,
}

/// Makes a cell in plain numbers from the values of an equation's parameters.
type PlainForm<F> = fn(&[f64]) -> Box<dyn PlainCell<F>>;

/// Faster forms of an equation in plain numbers, made from the values of its parameters in their order. Without one a fit or a
/// plan computes the text.
#[derive(Debug, Clone, Copy)]
pub struct PlainForms {
    /// For fits.
    pub fit: Option<PlainForm<f64>>,
    /// For planning.
    pub plan: Option<PlainForm<f32>>,
}

impl PlainForms {
    pub const NONE: PlainForms = PlainForms { fit: None, plan: None };
}

/// The rest of an equation follows from its text and the number of objects.
impl PartialEq for Equation {
    fn eq(&self, other: &Equation) -> bool {
        self.table == other.table && self.objects() == other.objects()
    }
}

impl Equation {
    /// The table it was read from.
    pub fn table(&self) -> &EquationTable {
        &self.table
    }

    /// Whether it names the time.
    pub(crate) fn tells_time(&self) -> bool {
        self.program.tells_time()
    }

    /// Whether it has an acceleration for each object, names a given one, or holds a parameter of theirs at unlike values.
    pub(crate) fn tells_objects_apart(&self, held: &[Option<f64>]) -> bool {
        let objects = self.program.objects;
        let unlike = |first: &usize| (1..objects).any(|object| held[first + object] != held[*first]);
        objects > 1
            && (self.program.accelerations.len() > 1
                || self.program.names_objects()
                || self.contacts.as_ref().is_some_and(|contacts| !contacts.masses.is_empty())
                || self.constraints.as_ref().is_some_and(TextConstraints::tell_objects_apart)
                || self.of_each.iter().any(unlike))
    }

    /// Of the parameters that each object has, the first object's places.
    pub(crate) fn of_each(&self) -> &[usize] {
        &self.of_each
    }

    /// Its parameters, those of a file's text sorted by name; those of each object follow each other.
    pub fn parameters(&self) -> &[PhysicalParameter] {
        &self.parameters
    }

    /// The number of objects that it was read for.
    pub fn objects(&self) -> usize {
        self.program.objects
    }

    /// Whether its walls stand at the frame's edges.
    pub(crate) fn has_walls_at_the_edges(&self) -> bool {
        self.walls.as_ref().is_some_and(TextWalls::are_the_edges)
    }

    /// Whether something acts, or it names the time.
    pub(crate) fn needs_actions(&self) -> bool {
        self.program.acts() || self.program.tells_time()
    }

    /// Whether steps back in time are steps forward of another sign: no clock, no wall or contact that takes speed.
    pub(crate) fn is_reversible(&self) -> bool {
        !self.tells_time()
            && self.walls.as_ref().is_none_or(|walls| walls.restitution.is_none())
            && self.contacts.as_ref().is_none_or(TextContacts::are_reversible)
            && self.constraints.as_ref().is_none_or(TextConstraints::are_reversible)
    }

    /// The equation of a table, for so many objects.
    ///
    /// # Errors
    /// A text that is none of the language, a name that is not known, ranks or units that do not go together (the message
    /// shows the place), a parameter that no text names, a number out of range.
    pub fn read(table: &EquationTable, objects: usize) -> Result<Self> {
        Self::read_in_order(table, objects, &[])
    }

    /// The equation that a name stands for; its parameters are in the `order` of these names.
    ///
    /// # Errors
    /// As for [`Self::read`].
    pub(crate) fn read_named(table: &EquationTable, objects: usize, order: &[&str], plain: PlainForms) -> Result<Self> {
        Ok(Equation { renews_parameters: true, plain, ..Self::read_in_order(table, objects, order)? })
    }

    /// Parameters that are not in the `order` follow those that are, by name.
    fn read_in_order(table: &EquationTable, objects: usize, order: &[&str]) -> Result<Self> {
        ensure!((1..=MOST_OBJECTS).contains(&objects), "objects = {objects}: must be 1 to {MOST_OBJECTS} for a text");
        ensure!(
            (1..=MOST_SUBSTEPS).contains(&table.substeps),
            "substeps = {}: must be 1 to {MOST_SUBSTEPS}",
            table.substeps
        );
        let parameters = Parameters::of(&table.parameters, objects, order)?;
        let definitions = definitions(table, &parameters)?;
        let mut compiler = Compiler::new(table.state, objects, &parameters, &definitions);
        let texts = match &table.acceleration {
            Accelerations::ForAll(text) => vec![(None, text)],
            Accelerations::ForEach(texts) => {
                ensure!(
                    texts.len() == objects,
                    "acceleration: the list has {} texts, but there are {objects} objects; give each its own, or one \
                     text for all",
                    texts.len()
                );
                texts.iter().enumerate().map(|(object, text)| (Some(object), text)).collect()
            }
        };
        let mut accelerations = Vec::new();
        for (object, text) in texts {
            let place = parse(text).and_then(|parsed| compiler.acceleration(object, &parsed));
            let place = place.map_err(|complaint| Excerpt(complaint.shown(text)));
            let whose =
                || object.map_or("acceleration".into(), |object| format!("acceleration of object {}", object + 1));
            accelerations.push(place.with_context(whose)?);
        }
        let walls = TextWalls::of(table, &parameters, &mut compiler.used)?;
        let contacts = TextContacts::of(table, objects, &parameters, &mut compiler.used)?;
        let constraints = TextConstraints::of(table, objects, &parameters, &mut compiler.used)?;
        if let Some(unused) = compiler.used.iter().position(|used| !used) {
            let name = &parameters.all[unused].name;
            bail!("parameters: no acceleration names {name}; use it, or take it out");
        }
        if let Some(unused) = compiler.unused_definition() {
            bail!("where: no acceleration names {unused}; use it, or take it out");
        }
        let program = CompiledEquation::new(compiler.graph, accelerations, objects);
        ensure!(
            !(program.acts() && program.tells_time()),
            "the equation names both u and t, and a dataset holds one number for each frame: what acts, or its time"
        );
        let of_each = parameters.each.values().copied().collect();
        Ok(Equation {
            table: table.clone(),
            parameters: parameters.physical(),
            of_each,
            program,
            walls,
            contacts,
            constraints,
            renews_parameters: false,
            plain: PlainForms::NONE,
        })
    }
}

/// The texts of `where`, each with what it says.
fn definitions(table: &EquationTable, parameters: &Parameters) -> Result<BTreeMap<String, (String, Expression)>> {
    let read = |(name, text): (&String, &String)| {
        let of_name = || format!("where.{name}");
        check_name(name).with_context(of_name)?;
        let taken = parameters.place(name).is_some() || parameters.each.contains_key(name);
        ensure!(!taken, "where.{name}: a parameter is called so, too; rename one");
        let parsed = parse(text).map_err(|complaint| Excerpt(complaint.shown(text)));
        Ok((name.clone(), (text.clone(), parsed.with_context(of_name)?)))
    };
    table.definitions.iter().map(read).collect()
}

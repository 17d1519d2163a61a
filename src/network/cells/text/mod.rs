//! Equations that stand as text in a task file, no Rust needed.
//!
//! `system.equation` is then a table ([`EquationTable`]): the accelerations in a small language, the parameters they name
//! with units and bounds, and how they are integrated. `docs/equations.md` shows the language by examples.
//!
//! A text is parsed (`parse`, by the grammar of `grammar.pest`), each name and function is given its meaning (`compile`),
//! ranks and units are checked (`operation`, `units`), and what is left is a list of operations (`graph`), each once, that
//! are computed on whole batches (`evaluate`, `arithmetic`) at every instant of the integration (`integrate`); or without
//! gradients in plain numbers (`columns`, `plain`).

mod arithmetic;
mod built_in;
mod columns;
mod compile;
mod complaint;
mod evaluate;
mod graph;
mod integrate;
mod operation;
mod parameters;
mod parse;
mod plain;
mod scalars;
mod table;
mod units;
mod walls;

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, anyhow, bail, ensure};
use tch::Tensor;

use self::compile::Compiler;
use self::evaluate::Program;
use self::integrate::TextCell;
use self::parameters::{Parameters, check_name};
use self::parse::{Expression, parse};
use self::walls::TextWalls;
use super::{Build, Cell, CellKind, MOST_OBJECTS, PhysicalParameter, Walls};
use crate::support::random::fnv1a;

pub use built_in::written;
pub use plain::{Ensemble, SingleEquation};
pub(crate) use scalars::roll_out_on_gpu;
pub use table::{Accelerations, EquationTable, Given, Integrator, ParameterTable, Sides, WallTable};

/// Most steps for a frame.
const MOST_SUBSTEPS: usize = 1000;

/// The scope of the parameters, whatever the text.
const SCOPE: &str = "text_ode_cell";

/// An equation that was read from text, for a number of objects.
#[derive(Debug)]
pub struct Equation {
    table: EquationTable,
    parameters: &'static [PhysicalParameter],
    /// Places of the parameters that each object has, the first object's.
    of_each: Vec<usize>,
    program: Program,
    walls: Option<TextWalls>,
}

/// The texts that were read.
static KNOWN: Mutex<Vec<&CellKind>> = Mutex::new(Vec::new());

/// The equation of a table, for so many objects.
///
/// Each stays in memory for good: a system holds its equation as a reference that never ends, as it does a built-in one,
/// and a program reads few of them. The same text is read once.
///
/// # Errors
/// A text that is none of the language, a name that is not known, ranks or units that do not go together (the message
/// shows the place), a parameter that no text names, a number out of range.
pub fn kind(table: &EquationTable, objects: usize) -> Result<&'static CellKind> {
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let same = |kind: &&CellKind| matches!(&kind.build, Build::Text(equation) if equation.table == *table && equation.program.objects == objects);
    if let Some(kind) = known.iter().copied().find(same) {
        return Ok(kind);
    }
    let equation: &'static Equation = Box::leak(Box::new(Equation::read(table, objects).context("equation")?));
    let kind = CellKind {
        name: format!("text-{:016x}", checksum(table, objects)?).leak(),
        scope: SCOPE,
        objects: Some(objects),
        coordinates: table.state,
        walls: equation.walls.as_ref().is_some_and(TextWalls::are_the_edges),
        actions: equation.program.acts() || equation.program.tells_time(),
        parameters: equation.parameters,
        build: Build::Text(equation),
    };
    let kind = Box::leak(Box::new(kind));
    known.push(kind);
    Ok(kind)
}

/// The same for the same text in every version of the program.
fn checksum(table: &EquationTable, objects: usize) -> Result<u64> {
    let text = toml::to_string(table)? + &objects.to_string();
    Ok(fnv1a(text.as_bytes()))
}

/// What moves the objects, without what only a fit needs (its method, the bounds and starts of the parameters): the equation's
/// name where it is no text.
pub(crate) fn accelerations(kind: &CellKind) -> String {
    let Build::Text(equation) = kind.build else { return kind.name.into() };
    let moves =
        EquationTable { integrator: Integrator::default(), parameters: BTreeMap::new(), ..equation.table.clone() };
    toml::to_string(&moves).expect("an equation is plain data")
}

/// The same equation, integrated by another method: none of one that is no text.
///
/// # Errors
/// None that the equation itself did not have.
pub(crate) fn integrated_by(kind: &CellKind, integrator: Integrator) -> Result<Option<&'static CellKind>> {
    let Build::Text(equation) = kind.build else { return Ok(None) };
    self::kind(&EquationTable { integrator, ..equation.table.clone() }, equation.program.objects).map(Some)
}

impl Equation {
    /// The table it was read from.
    pub fn table(&self) -> &EquationTable {
        &self.table
    }

    /// Whether it names the time.
    pub(super) fn tells_time(&self) -> bool {
        self.program.tells_time()
    }

    /// Whether it has an acceleration for each object, names a given one, or holds a parameter of theirs at unlike values.
    pub(super) fn tells_objects_apart(&self, held: &[Option<f64>]) -> bool {
        let objects = self.program.objects;
        let unlike = |first: &usize| (1..objects).any(|object| held[first + object] != held[*first]);
        objects > 1
            && (self.program.accelerations.len() > 1 || self.program.names_objects() || self.of_each.iter().any(unlike))
    }

    /// Of the parameters that each object has, the first object's places.
    pub(super) fn of_each(&self) -> &[usize] {
        &self.of_each
    }

    /// The cell with these raw parameters (scalars, one for each).
    pub(super) fn cell(&'static self, raw: &[Tensor], walls: Walls) -> Box<dyn Cell> {
        Box::new(TextCell { equation: self, raw: raw.iter().map(Tensor::shallow_clone).collect(), walls })
    }

    /// The equation in plain numbers, with these values (not the raw numbers) of its parameters.
    pub fn single(&'static self, parameters: &[f64], walls: Walls) -> SingleEquation {
        SingleEquation::new(self, parameters, walls)
    }

    /// The equation in plain numbers for `size` states, of each parameter one value for all or one for each.
    pub fn ensemble(&'static self, parameters: Vec<Vec<f64>>, walls: Walls, size: usize) -> Ensemble {
        Ensemble::new(self, parameters, walls, size)
    }

    fn read(table: &EquationTable, objects: usize) -> Result<Self> {
        ensure!((1..=MOST_OBJECTS).contains(&objects), "objects = {objects}: must be 1 to {MOST_OBJECTS} for a text");
        ensure!(
            (1..=MOST_SUBSTEPS).contains(&table.substeps),
            "substeps = {}: must be 1 to {MOST_SUBSTEPS}",
            table.substeps
        );
        let parameters = Parameters::of(&table.parameters, objects)?;
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
            let place = place.map_err(|complaint| anyhow!("{}", complaint.shown(text)));
            let whose =
                || object.map_or("acceleration".into(), |object| format!("acceleration of object {}", object + 1));
            accelerations.push(place.with_context(whose)?);
        }
        let walls = TextWalls::of(table, &parameters, &mut compiler.used)?;
        if let Some(unused) = compiler.used.iter().position(|used| !used) {
            let name = &parameters.all[unused].name;
            bail!("parameters: no acceleration names {name}; use it, or take it out");
        }
        if let Some(unused) = compiler.unused_definition() {
            bail!("where: no acceleration names {unused}; use it, or take it out");
        }
        let program = Program { graph: compiler.graph, accelerations, objects };
        ensure!(
            !(program.acts() && program.tells_time()),
            "the equation names both u and t, and a dataset holds one number for each frame: what acts, or its time"
        );
        let of_each = parameters.each.values().copied().collect();
        Ok(Equation { table: table.clone(), parameters: parameters.physical(), of_each, program, walls })
    }
}

/// The texts of `where`, each with what it says.
fn definitions(table: &EquationTable, parameters: &Parameters) -> Result<BTreeMap<String, (String, Expression)>> {
    let read = |(name, text): (&String, &String)| {
        let of_name = || format!("where.{name}");
        check_name(name).with_context(of_name)?;
        let taken = parameters.place(name).is_some() || parameters.each.contains_key(name);
        ensure!(!taken, "where.{name}: a parameter is called so, too; rename one");
        let parsed = parse(text).map_err(|complaint| anyhow!("{}", complaint.shown(text)));
        Ok((name.clone(), (text.clone(), parsed.with_context(of_name)?)))
    };
    table.definitions.iter().map(read).collect()
}

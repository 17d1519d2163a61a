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
mod columns;
mod compile;
mod complaint;
mod contacts;
mod equation;
mod evaluate;
mod graph;
mod integrate;
mod operation;
mod parameters;
mod parse;
mod plain;
mod scalars;
mod surface_table;
mod surfaces;
mod table;
mod table_number;
mod units;
mod value;
mod walls;

pub use equation::{Equation, PlainForms};
pub use plain::{Ensemble, SingleEquation};
pub use surface_table::{StringTable, SurfaceTable};
pub use table::{Accelerations, ContactTable, EquationTable, ParameterTable, Sides, WallTable};
pub use table_number::TableNumber;

pub(super) use integrate::TextCell;
pub(super) use scalars::listing;

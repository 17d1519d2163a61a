//! An equation as it stands in a task file.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

use super::surface_table::{StringTable, SurfaceTable};
use super::table_number::TableNumber;
use crate::network::cells::integrator::{Integrator, SUBSTEPS};
use crate::network::cells::state::Coordinates;
use crate::support::toml_values::exact_if_given;

/// An equation: accelerations as text, the parameters they name, how they are integrated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EquationTable {
    /// What the positions are.
    #[serde(default = "position")]
    pub state: Coordinates,
    pub acceleration: Accelerations,
    /// Names for parts of the accelerations, each with its text.
    #[serde(default, rename = "where", skip_serializing_if = "BTreeMap::is_empty")]
    pub definitions: BTreeMap<String, String>,
    #[serde(default)]
    pub integrator: Integrator,
    /// Steps for one frame.
    #[serde(default = "substeps")]
    pub substeps: usize,
    /// The walls that turn the objects back.
    #[serde(default)]
    pub walls: WallTable,
    /// What is left of the speed towards a wall; 1 if nothing is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<TableNumber>,
    /// Discs that collide; none pass through each other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contacts: Option<Box<ContactTable>>,
    /// Lines and circles that objects bounce off.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<SurfaceTable>,
    /// Strings that can go slack.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub strings: Vec<StringTable>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, ParameterTable>,
}

fn position() -> Coordinates {
    Coordinates::Position
}

fn substeps() -> usize {
    SUBSTEPS
}

/// One text for all objects, or one for each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a text, or a list with a text for each object")]
pub enum Accelerations {
    ForAll(String),
    ForEach(Vec<String>),
}

/// Collisions between the objects, which are taken as smooth discs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactTable {
    /// Distance of two centres when the discs touch, pixels: the sum of the radii.
    pub distance: TableNumber,
    /// Share of the closing speed that is left; 1 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<TableNumber>,
    /// Coulomb's coefficient of friction of the discs, which do not spin; 0 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<TableNumber>,
    /// Mass of each object, in any unit; equal ones if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masses: Option<Vec<TableNumber>>,
}

/// Where walls stand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "true, false, or a table with places in pixels for some of left, right, top and bottom")]
pub enum WallTable {
    /// All four, so far from the frame's edges as the system says; or none.
    AtTheEdges(bool),
    /// Those that are named.
    At(Box<Sides>),
}

impl Default for WallTable {
    fn default() -> Self {
        WallTable::AtTheEdges(false)
    }
}

/// Where an object's centre turns, pixels: from the left for the first two, from the top for the others.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sides {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left: Option<TableNumber>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right: Option<TableNumber>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub top: Option<TableNumber>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bottom: Option<TableNumber>,
}

impl EquationTable {
    /// Multiplies lengths of walls, contacts, surfaces and strings that are given as numbers.
    pub fn scale_lengths(&mut self, factor: f64) {
        let sides = match &mut self.walls {
            WallTable::At(sides) => {
                let Sides { left, right, top, bottom } = &mut **sides;
                [left, right, top, bottom].map(Option::as_mut)
            }
            WallTable::AtTheEdges(_) => [const { None }; 4],
        };
        let distance = self.contacts.as_mut().map(|contacts| &mut contacts.distance);
        let surfaces = self.surfaces.iter_mut().flat_map(SurfaceTable::lengths);
        let strings = self.strings.iter_mut().flat_map(StringTable::lengths);
        for given in sides.into_iter().flatten().chain(distance).chain(surfaces).chain(strings) {
            if let TableNumber::Number(length) = given {
                *length *= factor;
            }
        }
    }

    /// Whether it has surfaces or strings.
    pub fn is_constrained(&self) -> bool {
        !self.surfaces.is_empty() || !self.strings.is_empty()
    }

    /// Whether anything but another object turns the objects back.
    pub fn has_obstacles(&self) -> bool {
        self.walls != WallTable::default() || self.is_constrained()
    }

    /// Checks that walls whose places are numbers stand in or beside a frame, at most one side away: none else is ever met in sight.
    ///
    /// # Errors
    /// A wall that stands elsewhere.
    pub(crate) fn check_walls(&self, side: usize) -> Result<()> {
        let WallTable::At(sides) = &self.walls else { return Ok(()) };
        let Sides { left, right, top, bottom } = &**sides;
        let side = side as f64;
        for (name, wall) in [("left", left), ("right", right), ("top", top), ("bottom", bottom)] {
            if let Some(TableNumber::Number(place)) = wall {
                ensure!(
                    (-side..=2.0 * side).contains(place),
                    "walls.{name} = {place}: expected {} to {}, in or beside the frame of {side} pixels",
                    -side,
                    2.0 * side
                );
            }
        }
        Ok(())
    }
}

/// A parameter of the equation.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table, such as { unit = [1, -2] } or { fixed = 9.81 }")]
pub struct ParameterTable {
    /// Powers of a length and of a time; without it units are not checked where the parameter takes part.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exact_if_given")]
    pub unit: Option<[i32; 2]>,
    /// Name of the unit of its value, such as `m`, where constants of the equation fix it, so that no scale changes the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_name: Option<String>,
    /// Where learning starts, lengths in pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<f64>,
    /// Bounds, not included; 0 below and none above where nothing is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// A value that is given instead of being learned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed: Option<f64>,
    /// Whether each object has its own, by the name and the object's number: k1, k2, ..
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub each: bool,
}

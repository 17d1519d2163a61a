//! What the network is told of a system: the frames it sees, the equation it is given, and nothing else.
//!
//! Files, scenes, true parameters and learning rates are a [task](crate::tasks)'s.

use std::fmt::{self, Formatter};
use std::sync::Arc;

use anyhow::{Result, ensure};
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use tch::Tensor;

use super::blocks::side_multiple;
use super::cells::text::EquationTable;
use super::cells::{Build, Cell, CellKind, Coordinates, Equations, MOST_OBJECTS, Walls};

/// Smallest side of a frame, pixels: the window of the structural similarity is 11 x 11.
const LEAST_SIDE: usize = 12;
/// Largest side, pixels: beyond it a single layer of the encoder takes gigabytes.
const LARGEST_SIDE: usize = 512;

/// One system: its frames, how a clip is cut into input and prediction, and its equation.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    /// Side S of the square frames, pixels.
    pub side: usize,
    /// Colour channels of a frame: 1 or 3.
    pub channels: usize,
    /// N: moving objects.
    pub objects: usize,
    /// L: frames the encoder sees before the roll-out starts.
    pub input_steps: usize,
    /// T_pred: predicted frames that enter the training loss. What follows in a clip is T_ext, scored only.
    pub pred_steps: usize,
    /// Time between two frames, in the unit that the parameters are measured in.
    pub dt: f64,
    /// The differential equation.
    pub cell: Arc<CellKind>,
    /// Where an object's centre turns, in equations that have walls.
    pub walls: Walls,
    /// Whether the networks are given each frame at half its side. Positions are in pixels of the whole frame.
    pub halved: bool,
}

/// How networks that see coordinates take them in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaling {
    /// What a coordinate is multiplied by.
    pub scale: f64,
    /// What is then taken off.
    pub shift: f64,
}

impl Scaling {
    /// Coordinates, scaled.
    pub fn of(self, coordinates: &Tensor) -> Tensor {
        coordinates * self.scale - self.shift
    }
}

impl System {
    /// Positions in pixels are taken in as -1 to 1 across the frame; angles, small numbers, as they are.
    pub fn scaling(&self) -> Scaling {
        match self.cell.coordinates {
            Coordinates::Position => Scaling { scale: 2.0 / self.side as f64, shift: 1.0 },
            Coordinates::Angle => Scaling { scale: 1.0, shift: 0.0 },
        }
    }

    /// The same system, given its frames at half their side.
    pub fn halved(&self) -> Self {
        System { halved: true, ..self.clone() }
    }

    /// Side of the frames that the networks are given.
    pub(crate) fn given_side(&self) -> usize {
        if self.halved { self.side / 2 } else { self.side }
    }

    /// Side of one of their pixels, in pixels of the whole frame.
    pub fn given_pixel(&self) -> f64 {
        self.side as f64 / self.given_side() as f64
    }

    /// Numbers in a position of all objects.
    pub fn coordinates(&self) -> usize {
        self.objects * self.cell.coordinates.per_object()
    }

    /// The equation with these unconstrained parameters, one for each of the cell's: of those that are positive, the
    /// logarithms.
    pub fn build_cell(&self, unconstrained: &[Tensor]) -> Box<dyn Cell> {
        self.cell.cell(unconstrained, self.walls)
    }

    /// # Errors
    /// A side that the U-Net cannot halve, or too small or too large; a number of channels or objects that cannot be; no
    /// frames to see or to predict; a time that is not positive; walls that leave no room.
    pub fn check(&self) -> Result<()> {
        let &System { side, channels, objects, input_steps, pred_steps, dt, ref cell, walls, halved: _ } = self;
        let multiple = side_multiple(side);
        ensure!(
            (LEAST_SIDE..=LARGEST_SIDE).contains(&side) && side.is_multiple_of(multiple),
            "side = {side}: frames must have {LEAST_SIDE} to {LARGEST_SIDE} pixels a side, a multiple of {multiple} (the \
             U-Net halves them); the nearest side is {}",
            nearest_side(side)
        );
        ensure!(channels == 1 || channels == 3, "channels = {channels}: frames have 1 channel (grey) or 3 (colour)");
        ensure!(
            (1..=MOST_OBJECTS).contains(&objects),
            "objects = {objects}: there must be at least one object, and at most {MOST_OBJECTS}"
        );
        if let Some(written_for) = cell.objects {
            ensure!(
                objects == written_for,
                "objects = {objects}: the equation {:?} is written for exactly {written_for}",
                cell.name
            );
        }
        ensure!(input_steps > 0, "input_steps = 0: the encoder must see at least one frame");
        ensure!(pred_steps > 0, "pred_steps = 0: at least one frame must be predicted");
        ensure!(dt.is_finite() && dt > 0.0, "dt = {dt}: the time between two frames must be a positive number");
        ensure!(
            walls.near.is_finite() && walls.near >= 0.0 && walls.near < walls.far,
            "wall_margin = {}: must be at least 0 and less than half of the side {side}",
            walls.near
        );
        Ok(())
    }
}

/// The allowed side that is nearest.
fn nearest_side(side: usize) -> usize {
    let allowed = (LEAST_SIDE..=LARGEST_SIDE).filter(|side| side.is_multiple_of(side_multiple(*side)));
    allowed.min_by_key(|allowed| allowed.abs_diff(side)).expect("there are allowed sides")
}

/// An equation as it stands in a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum EquationEntry {
    /// One of Rust, by its name.
    Name(String),
    Text(EquationTable),
}

impl EquationEntry {
    fn of(kind: &CellKind) -> Self {
        match &kind.build {
            Build::Text(equation) => EquationEntry::Text(equation.table().clone()),
            Build::Named(_) | Build::Rust(_) => EquationEntry::Name(kind.name.to_string()),
        }
    }

    /// The equation, for so many objects; `known` are those that have names.
    ///
    /// # Errors
    /// An unknown name, a text that cannot be an equation.
    pub fn kind(&self, objects: usize, known: &Equations) -> Result<Arc<CellKind>> {
        match self {
            EquationEntry::Name(name) => known.find(name, objects),
            EquationEntry::Text(table) => CellKind::of_text(table, objects).map(Arc::new),
        }
    }
}

/// By hand, so that an error names the key within the table.
impl<'de> Deserialize<'de> for EquationEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrTable;

        impl<'de> Visitor<'de> for NameOrTable {
            type Value = EquationEntry;

            fn expecting(&self, f: &mut Formatter) -> fmt::Result {
                write!(f, "the name of an equation, or a table that holds one")
            }

            fn visit_str<E: de::Error>(self, name: &str) -> Result<EquationEntry, E> {
                Ok(EquationEntry::Name(name.into()))
            }

            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<EquationEntry, A::Error> {
                EquationTable::deserialize(MapAccessDeserializer::new(table)).map(EquationEntry::Text)
            }
        }

        deserializer.deserialize_any(NameOrTable)
    }
}

/// A system as it stands in a file: the equation by its name, or as text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SystemTable {
    pub side: usize,
    pub channels: usize,
    pub objects: usize,
    pub input_steps: usize,
    pub pred_steps: usize,
    pub dt: f64,
    pub equation: EquationEntry,
    /// Distance from a frame's edges at which an object's centre turns, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall_margin: Option<f64>,
}

impl From<&System> for SystemTable {
    fn from(system: &System) -> Self {
        let &System { side, channels, objects, input_steps, pred_steps, dt, ref cell, walls, halved: _ } = system;
        let (equation, wall_margin) = (EquationEntry::of(cell), Some(walls.near));
        SystemTable { side, channels, objects, input_steps, pred_steps, dt, equation, wall_margin }
    }
}

impl SystemTable {
    /// The system; `wall_margin` where the table has none, `known` are the equations that have names.
    ///
    /// # Errors
    /// An unknown equation, a text that is none, or what [`System::check`] refuses.
    pub fn system(&self, wall_margin: f64, known: &Equations) -> Result<System> {
        let &SystemTable { side, channels, objects, input_steps, pred_steps, dt, .. } = self;
        let cell = self.equation.kind(objects, known)?;
        if let EquationEntry::Text(table) = &self.equation {
            table.check_walls(side)?;
        }
        let walls = Walls::new(side, self.wall_margin.unwrap_or(wall_margin));
        let system = System { side, channels, objects, input_steps, pred_steps, dt, cell, walls, halved: false };
        system.check()?;
        Ok(system)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::cells::{BuiltIn, PENDULUM, SPRING};

    #[test]
    fn networks_see_positions_from_edge_to_edge_and_angles_as_they_are() {
        let taken_in = |cell: BuiltIn| {
            let system = System {
                side: 64,
                channels: 1,
                objects: cell.objects.unwrap_or(1),
                input_steps: 4,
                pred_steps: 6,
                dt: 0.3,
                cell: Arc::new(cell.kind(2)),
                walls: Walls::new(64, 0.0),
                halved: false,
            };
            Vec::<f64>::try_from(system.scaling().of(&Tensor::from_slice(&[0.0, 48.0, 64.0]))).unwrap()
        };
        assert_eq!(taken_in(SPRING), [-1.0, 0.5, 1.0]);
        assert_eq!(taken_in(PENDULUM), [0.0, 48.0, 64.0]);
    }
}

//! Unilateral constraints as they stand in a task file: surfaces, and strings that can go slack.

use serde::{Deserialize, Serialize};

use super::table_number::TableNumber;

/// A line or a circle that objects bounce off. One of `line`, `bowl` and `bump` is given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceTable {
    /// A point of a line, x and y, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<[TableNumber; 2]>,
    /// Centre of a circle in which the objects stay, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bowl: Option<[TableNumber; 2]>,
    /// Centre of a circle outside of which the objects stay, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bump: Option<[TableNumber; 2]>,
    /// Direction of a line, radians, clockwise: 0 is a floor, pi / 2 a wall at the left.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<TableNumber>,
    /// Distance of an object's centre from the line or the circle's centre at contact, pixels; of a line 0 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<TableNumber>,
    /// Share of the normal speed that is left; 1 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<TableNumber>,
    /// Coulomb's coefficient of friction; 0 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<TableNumber>,
    /// The only object that meets it, from 1 on; all do if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<usize>,
}

/// A string without mass that is taut at its length and slack below. One of `at` and `between` is given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StringTable {
    /// Where it is fastened, x and y, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<[TableNumber; 2]>,
    /// Two objects that it ties, from 1 on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between: Option<[usize; 2]>,
    /// Pixels.
    pub length: TableNumber,
    /// Share of the radial speed that is thrown back when it becomes taut; 0 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<TableNumber>,
    /// Masses of the objects of `between`, in any unit; equal if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masses: Option<[TableNumber; 2]>,
    /// The only object that hangs at `at`, from 1 on; each has such a string if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<usize>,
}

impl SurfaceTable {
    /// The lengths that are given.
    pub(super) fn lengths(&mut self) -> impl Iterator<Item = &mut TableNumber> {
        [&mut self.line, &mut self.bowl, &mut self.bump].into_iter().flatten().flatten().chain(&mut self.distance)
    }
}

impl StringTable {
    /// The lengths that are given.
    pub(super) fn lengths(&mut self) -> impl Iterator<Item = &mut TableNumber> {
        self.at.iter_mut().flatten().chain(std::iter::once(&mut self.length))
    }
}

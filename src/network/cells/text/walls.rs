//! Which walls turn the objects back, where they stand, and what they leave of a speed.

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use super::parameters::Parameters;
use super::table::{EquationTable, WallTable};
use super::table_number::TableNumber;
use super::units::Unit;
use super::value::EquationNumber;
use crate::network::cells::state::{Coordinates, Walls};

/// The walls of an equation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TextWalls {
    /// Left and top, right and bottom, where the table says; the frame's edges where it does not.
    pub(super) stand: Option<[[Option<EquationNumber>; 2]; 2]>,
    /// What is left of the speed towards a wall; none for all of it.
    pub(super) restitution: Option<EquationNumber>,
}

impl TextWalls {
    /// The walls of a table, if it has any. Parameters that they name are marked as `used`.
    ///
    /// # Errors
    /// Walls for an angle, a restitution without walls or that cannot be one, a parameter that is not there or has another
    /// unit, no wall at all.
    pub(super) fn of(table: &EquationTable, parameters: &Parameters, used: &mut [bool]) -> Result<Option<Self>> {
        let angle = table.state == Coordinates::Angle;
        ensure!(
            !(table.walls != WallTable::default() && angle),
            "walls: there are walls for positions, not for angles"
        );
        let mut value = |given: &TableNumber, key: &str, unit: Unit, what: &str| {
            EquationNumber::read(given, (key, unit, what), parameters, used)
        };
        let stand = match &table.walls {
            WallTable::AtTheEdges(false) => {
                let without = "restitution is what walls leave of a speed; set walls = true, or take it out";
                ensure!(table.restitution.is_none(), without);
                return Ok(None);
            }
            WallTable::AtTheEdges(true) => None,
            WallTable::At(sides) => {
                let mut side = |given: &Option<TableNumber>, key| {
                    let given = given.as_ref();
                    given.map(|given| value(given, key, Unit::Of([1.0, 0.0]), "a place, in pixels")).transpose()
                };
                let near = [side(&sides.left, "walls.left")?, side(&sides.top, "walls.top")?];
                let far = [side(&sides.right, "walls.right")?, side(&sides.bottom, "walls.bottom")?];
                let given = near.iter().chain(&far).flatten();
                ensure!(given.clone().count() > 0, "walls: none of left, right, top and bottom is given");
                let finite =
                    |value: &EquationNumber| !matches!(value, EquationNumber::Number(number) if !number.is_finite());
                ensure!(given.clone().all(finite), "walls: a wall stands at a finite number of pixels");
                for (near, far) in near.iter().zip(&far) {
                    if let (Some(EquationNumber::Number(near)), Some(EquationNumber::Number(far))) = (near, far) {
                        ensure!(near < far, "walls: {near} and {far} leave no room between them");
                    }
                }
                Some([near, far])
            }
        };
        let restitution = match &table.restitution {
            None | Some(TableNumber::Number(1.0)) => None,
            Some(given) => Some(EquationNumber::restitution(given, "restitution", parameters, used)?),
        };
        Ok(Some(TextWalls { stand, restitution }))
    }

    /// Whether they stand at the frame's edges.
    pub(super) fn are_the_edges(&self) -> bool {
        self.stand.is_none()
    }

    /// Near and far walls, of x and of y each; infinitely far where there is none. `edges` are those of the frame.
    pub(super) fn places(&self, edges: Walls, parameters: impl Fn(usize) -> f64) -> [[f64; 2]; 2] {
        let Some([near, far]) = self.stand else { return [[edges.near; 2], [edges.far; 2]] };
        let place = |value: Option<EquationNumber>, none: f64| value.map_or(none, |value| value.among(&parameters));
        [near.map(|value| place(value, f64::NEG_INFINITY)), far.map(|value| place(value, f64::INFINITY))]
    }

    /// The same as tensors `[2]`, differentiable by the parameters.
    pub(super) fn tensors(&self, edges: Walls, parameters: &[Tensor], options: (Kind, tch::Device)) -> [Tensor; 2] {
        let Some([near, far]) = self.stand else { return edges.tensors(options) };
        let place = |value: Option<EquationNumber>, none| {
            value.unwrap_or(EquationNumber::Number(none)).tensor(parameters, options)
        };
        let both = |[x, y]: [Option<EquationNumber>; 2], none| Tensor::stack(&[place(x, none), place(y, none)], 0);
        [both(near, f64::NEG_INFINITY), both(far, f64::INFINITY)]
    }

    /// What is left of a speed.
    pub(super) fn left(&self, parameters: impl Fn(usize) -> f64) -> f64 {
        self.restitution.map_or(1.0, |value| value.among(parameters))
    }

    /// The same as a scalar tensor; none for all of it.
    pub(super) fn left_tensor(&self, parameters: &[Tensor], options: (Kind, tch::Device)) -> Option<Tensor> {
        self.restitution.map(|value| value.tensor(parameters, options))
    }
}

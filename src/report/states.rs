//! Errors of positions and velocities on the test clips, root mean squares.

use std::fmt::Write;

use anyhow::Result;

use super::groups::Group;
use super::markdown::{row, spread, table, text};
use crate::runs::scores::StateErrors;

/// One of a run's errors.
pub(super) type StateError = fn(&StateErrors) -> Option<f64>;

/// The errors that the report shows: key in results.json, head of the column, number.
pub(super) const ERRORS: [(&str, &str, StateError); 4] = [
    ("encoded_position", "encoded position", |errors| Some(errors.encoded)),
    ("predicted_position", "position in T_pred", |errors| Some(errors.predicted)),
    ("extrapolated_position", "position in T_ext", |errors| errors.extrapolated),
    ("initial_velocity", "initial velocity", |errors| Some(errors.initial_velocity)),
];

/// Position of the encoded frames.
pub(super) const ENCODED: StateError = ERRORS[0].2;
/// How many times the true velocity there is estimated.
pub(super) const VELOCITY_SLOPE: StateError = |errors| errors.initial_velocity_slope;
/// Velocity at the last input frame.
pub(super) const INITIAL_VELOCITY: StateError = ERRORS[3].2;

/// The unit of a group's positions; that of its velocities is one of them per time unit.
pub(super) fn unit(group: &Group) -> &'static str {
    group.task.cell.coordinates.unit()
}

/// A row for each group.
pub(super) fn write(page: &mut String, groups: &[Group]) -> Result<()> {
    writeln!(page, "## Errors of positions and velocities\n")?;
    writeln!(
        page,
        "Root mean square over test clips, frames and objects, the model's objects in the order that fits the true \
         ones best. Pixels (angles: radians), velocities per time unit. A dash: the runs' summaries do not hold it.\n"
    )?;
    let rows: Vec<_> = groups
        .iter()
        .map(|group| {
            let mut cells = vec![group.task.key.to_string(), text(&group.label), unit(group).into()];
            cells.extend(ERRORS.map(|(_, _, error)| spread(group.state_error(error))));
            row(&cells)
        })
        .collect();
    let mut head = vec!["task", "recipe", "unit"];
    head.extend(ERRORS.map(|(_, column, _)| column));
    table(page, &head, &rows)
}

//! The paper's comparison: other dynamics, other decoders and end-to-end baselines, trained and scored like the physics.
//!
//! Paper: section 4. The other dynamics and decoders are choices of the model
//! ([`ModelOptions`](paig::network::physics_models::ModelOptions)); the [`end_to_end`] stand
//! here. [`list`] says what is compared, [`results`] gathers what became of it and [`earlier`] what other machines reported,
//! [`page`] shows it.

pub mod earlier;
pub mod end_to_end;
mod figures;
pub mod list;
pub mod page;
pub mod plan;
pub mod results;

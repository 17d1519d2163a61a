//! The paper's comparison: other dynamics, other decoders and whole other models, trained and scored like the physics.
//!
//! Paper: section 4. The other dynamics and decoders are choices of the model
//! ([`ModelOptions`](paig::network::physics_models::ModelOptions)); the [`whole_models`] stand
//! here. [`list`] says what is compared, [`results`] gathers what became of it and [`earlier`] what other machines reported,
//! [`page`] shows it.

pub mod earlier;
mod figures;
pub mod list;
pub mod page;
pub mod plan;
pub mod results;
pub mod whole_models;

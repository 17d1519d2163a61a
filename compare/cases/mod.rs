//! One folder for each submodule of the model. It holds the whole case: what is computed and how close it must come, in
//! words (`README.md`), what is drawn for it (`case.py`), and the port's side (`mod.rs`).

mod black_box;
mod cell_bouncing;
mod cell_gravity;
mod cell_spring;
mod conv_lstm;
mod decoder;
mod encoder;
mod optimizers;
mod resize_bilinear;
mod shallow_unet;
mod stn;
mod unet;
mod variable_from_network;
mod velocity_encoder;
mod whole_model;

use anyhow::Result;
use paig::tasks::Task;

use crate::harness::case::Case;
use crate::harness::part;

/// How a case is told by the name of a golden file; text after the forms below is free (`cell_spring_seed7`).
#[derive(Debug)]
enum CaseEntry {
    /// The name begins with this.
    Submodule(&'static str, fn(&mut Case) -> Result<()>),
    /// The name begins with this and goes on with a task's, whose model the submodule is a part of.
    PartOfModel(&'static str, fn(&mut Case, &Task) -> Result<()>),
    /// The name ends with this, or the file has a `meta`.
    WholeModel(&'static str, fn(&mut Case) -> Result<()>),
}

/// A file belongs to the first entry that its name fits. The files of `optimizers` are whole models.
static CASES: [CaseEntry; 15] = [
    CaseEntry::Submodule("black_box_", black_box::compare),
    CaseEntry::Submodule("conv_lstm", conv_lstm::compare),
    CaseEntry::Submodule("resize_bilinear", resize_bilinear::compare),
    CaseEntry::Submodule("shallow_unet", shallow_unet::compare),
    CaseEntry::Submodule("unet", unet::compare),
    CaseEntry::Submodule("stn", stn::compare),
    CaseEntry::Submodule("cell_bouncing", cell_bouncing::compare),
    CaseEntry::Submodule("cell_spring", cell_spring::compare),
    CaseEntry::Submodule("cell_gravity", cell_gravity::compare),
    CaseEntry::PartOfModel("variable_from_network_", variable_from_network::compare),
    CaseEntry::PartOfModel("init_vel_alt_", velocity_encoder::compare_alternative),
    CaseEntry::PartOfModel("init_vel_", velocity_encoder::compare),
    CaseEntry::PartOfModel("encoder_", encoder::compare),
    CaseEntry::PartOfModel("decoder_", decoder::compare),
    CaseEntry::WholeModel("_train", whole_model::compare),
];

/// Compares a golden file by the case that its name tells; `None` where there is none.
pub fn compare(case: &mut Case) -> Option<Result<()>> {
    CASES.iter().find_map(|entry| entry.compare(case))
}

impl CaseEntry {
    fn compare(&self, case: &mut Case) -> Option<Result<()>> {
        let (golden, stem) = (case.golden, case.golden.stem.as_str());
        match self {
            CaseEntry::Submodule(start, compare) => stem.starts_with(start).then(|| compare(case)),
            CaseEntry::PartOfModel(start, compare) => {
                let task = part::task(stem.strip_prefix(start)?)?;
                Some(compare(case, &task))
            }
            CaseEntry::WholeModel(end, compare) => (stem.ends_with(end) || golden.has("meta")).then(|| compare(case)),
        }
    }
}

//! Trains a model in process on clips that are made in memory, and watches it: no files, no command line.
//!
//! `cargo run --release --example train_in_process` takes some two minutes on a core.

use anyhow::Result;
use paig::datasets::files::Split;
use paig::datasets::iterators::Clips;
use paig::datasets::settings::Counts;
use paig::generators::generate_clips;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::network::physics_models::PhysicsNet;
use paig::tasks;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig::training::observer::{TrainingEvent, TrainingObserver};
use paig::training::trainer::Trainer;
use tch::Device;

/// Prints every validation and what the fit found.
struct Printer;

impl TrainingObserver for Printer {
    fn observe(&mut self, event: &TrainingEvent) -> Result<()> {
        match event {
            TrainingEvent::Recorded { record, .. } if record.score.is_some() => {
                println!("step {:>4}: validation score {:.3}", record.step, record.score.unwrap_or(f64::NAN));
            }
            TrainingEvent::Note(line) => println!("{line}"),
            _ => {}
        }
        Ok(())
    }
}

fn main() -> Result<()> {
    // 500 clips of two balls on a spring.
    let task = tasks::find("spring_color")?;
    let counts = Counts { train: 500, valid: 50, test: 1 };
    let variant = Variant::new(&task, 0)?;
    let (made, _true_states) =
        generate_clips(&variant, &SourceImages::original()?, task.train_frames, counts, &|_| {})?;
    let clips = |split| Clips::new(made.split(split), made.actions(split), Device::Cpu);

    // The fast recipe, shortened. Every key can be set as on the command line.
    let set =
        ["discover.max_steps=250", "discover.guide.full_until=80", "discover.guide.zero_from=160", "join.max_steps=40"];
    let overrides = Overrides { set: set.map(String::from).to_vec(), ..Overrides::default() };
    let config = Config::load_task(task, None, &overrides)?;
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, config.seed)?;

    let (train, valid) = (clips(Split::Train), clips(Split::Valid));
    let mut printer = Printer;
    Trainer::new(&config, &model, &train, &valid)?.observed_by(&mut printer).run()?;
    for (symbol, value) in model.parameter_values() {
        println!("{symbol} = {value:.3}");
    }
    println!("true: k = 4, l = 6");
    Ok(())
}

//! The library: model, equations, data, training.

#[path = "../common/random.rs"]
mod random;

mod alignment;
mod cells;
mod coarse;
mod contacts;
mod driven_model;
mod dynamics;
mod equation_text;
mod extremes;
mod generators;
mod identify;
mod kernel_extremes;
mod layers;
mod names;
mod objects;
mod pendulum_data;
mod recentre;
mod refinement;
mod repository;
mod second_look;
mod ssim;
mod subtract_background;
mod surfaces;
mod viz;

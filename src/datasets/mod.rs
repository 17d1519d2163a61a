//! Datasets: making them, reading them, serving them in batches.

pub mod scene;

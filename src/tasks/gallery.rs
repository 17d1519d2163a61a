//! Equations that come with the program as task files: those of `configs/gallery`.

use anyhow::{Result, bail};

use super::equation_file::EquationFile;
use crate::network::cells::Equations;

/// A file of the gallery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GalleryEntry {
    pub name: &'static str,
    /// A task file.
    pub text: &'static str,
}

macro_rules! entries {
    ($($name:literal),+ $(,)?) => {
        &[$(GalleryEntry { name: $name, text: include_str!(concat!("../../configs/gallery/", $name, ".toml")) }),+]
    };
}

/// All of them, by name.
pub const GALLERY: &[GalleryEntry] = entries![
    "balls_in_a_bowl",
    "bounce_on_a_floor",
    "bounce_on_an_incline",
    "cart_on_a_spring",
    "charge_in_a_field",
    "charges",
    "colliding_pendulums",
    "constant_acceleration",
    "damped_pendulum",
    "double_pendulum",
    "driven_pendulum",
    "fall_linear_drag",
    "fall_quadratic_drag",
    "free_pendulum",
    "gravity_masses",
    "lossy_bounce",
    "mass_on_a_spring",
    "slack_pendulum",
    "sliding_block",
    "spring_chain",
    "swing",
    "text_damped_spring",
    "text_pendulum",
    "text_spring",
    "torricelli",
    "unequal_masses",
];

impl EquationFile {
    /// The equation of this name: built in, or of the gallery.
    ///
    /// # Errors
    /// An unknown name, with the list of those there are.
    pub fn named(name: &str) -> Result<Self> {
        if let Some(entry) = GALLERY.iter().find(|entry| entry.name == name) {
            return EquationFile::from_text(entry.name, entry.text);
        }
        let known = Equations::default();
        if known.find(name, 1).is_err() {
            let gallery: Vec<_> = GALLERY.iter().map(|entry| entry.name).collect();
            bail!(
                "unknown equation {name:?}; the equations are {}, and of the gallery {} (or give a file that ends in .toml)",
                known.names(),
                gallery.join(", ")
            );
        }
        Ok(EquationFile::built_in(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_gallery_is_an_entry_and_can_be_named() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/gallery");
        let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap());
        let mut files: Vec<String> = files.map(|file| file.trim_end_matches(".toml").to_string()).collect();
        files.sort();
        assert_eq!(files, GALLERY.iter().map(|entry| entry.name).collect::<Vec<_>>());
        for name in &files {
            assert_eq!(&EquationFile::named(name).unwrap().name, name);
        }
        let unknown = EquationFile::named("swong").unwrap_err().to_string();
        assert!(unknown.contains("swong") && unknown.contains("falling") && unknown.contains("swing"), "{unknown}");
    }
}

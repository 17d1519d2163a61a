//! Files of the program Tracker: `.trk` (XML) and `.trz` (a zip with one in it). The scale, the axes, the time between two
//! frames are read here; point masses by [`crate::reference_track`].

use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use roxmltree::{Document, Node, ParsingOptions};

use paig::support::storage;

/// Most bytes of the XML.
const MOST_BYTES: u64 = 1 << 26;
/// Part by which the scales of both axes may differ.
const SAME_SCALE: f64 = 0.01;

/// What a Tracker file says of a video.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerFile {
    /// Video pixels to a unit of length; metres, unless the user of Tracker thought of others.
    pub pixels_per_metre: f64,
    /// Origin of the axes, video pixels.
    pub origin: [f64; 2],
    /// Angle of the x axis, degrees, counter-clockwise. The y axis points up.
    pub angle: f64,
    /// Frames a second, if the file tells the time between two.
    pub fps: Option<f64>,
}

impl TrackerFile {
    /// # Errors
    /// No such file, no XML, no axes in it, scales of the two axes that differ, numbers that cannot be.
    pub fn read(path: &Path) -> Result<Self> {
        let read = || Self::parse(&text(path)?);
        read().with_context(|| format!("Tracker file {}", path.display()))
    }

    /// Reads the XML.
    ///
    /// # Errors
    /// As for [`Self::read`].
    pub fn parse(text: &str) -> Result<Self> {
        let document = document(text)?;
        let axes = property(document.root(), "coords").context("it has no coordinate system")?;
        let frames = property(axes, "framedata").context("its coordinate system is empty")?;
        let number = |name: &str| number(frames, name)?.with_context(|| format!("its coordinate system has no {name}"));
        let (x, y) = (number("xscale")?, number("yscale")?);
        ensure!(x > 0.0 && y > 0.0, "its scale is {x} by {y} pixels; expected positive numbers");
        ensure!(
            (x / y - 1.0).abs() <= SAME_SCALE,
            "its scales differ: {x} pixels across, {y} up; pixels must be square"
        );
        let origin = [number("xorigin")?, number("yorigin")?];
        let milliseconds = self::number(document.root(), "delta_t")?;
        if let Some(milliseconds) = milliseconds {
            ensure!(milliseconds > 0.0, "its delta_t is {milliseconds} ms; expected a positive number");
        }
        let fps = milliseconds.map(|milliseconds| 1000.0 / milliseconds);
        Ok(TrackerFile { pixels_per_metre: (x + y) / 2.0, origin, angle: number("angle")?, fps })
    }
}

/// The XML as a tree. Tracker writes a document type into some files; entities are not expanded beyond the parser's limit.
pub(crate) fn document(text: &str) -> Result<Document<'_>> {
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).context("not readable XML")
}

/// The first property of that name below a node.
pub(crate) fn property<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.descendants().find(|it| it.has_tag_name("property") && it.attribute("name") == Some(name))
}

pub(crate) fn number(node: Node, name: &str) -> Result<Option<f64>> {
    let Some(text) = property(node, name).and_then(|node| node.text()) else { return Ok(None) };
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    Ok(Some(number.with_context(|| format!("{name} = {text:?}: not a number"))?))
}

pub(crate) fn text(path: &Path) -> Result<String> {
    let file = storage::open(path)?;
    let mut text = String::new();
    if path.extension().is_some_and(|extension| extension == "trz") {
        let mut archive = zip::ZipArchive::new(file).context("not a readable zip")?;
        let name = archive.file_names().find(|name| name.ends_with(".trk")).map(String::from);
        let Some(name) = name else { bail!("it holds no .trk file") };
        archive.by_name(&name)?.take(MOST_BYTES).read_to_string(&mut text)?;
    } else {
        file.take(MOST_BYTES).read_to_string(&mut text)?;
    }
    Ok(text)
}

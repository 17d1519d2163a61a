//! A folder of pictures, one a frame, numbered in their names. Each is turned as its camera was, if the file states it (EXIF).

use std::cmp::Ordering;
use std::fs;
use std::io::{self, BufReader, Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits, RgbImage};

use crate::error::{DecodeError, Result, printable};
use crate::exif;
use crate::flat::over_black;
use crate::frame::{Frame, Presentation};
use crate::limits::{LARGEST_DESCRIPTION, LARGEST_PACKET, LARGEST_SIDE, check_frames, check_size};
use crate::open::open_regular;
use crate::picture::DecodedPicture;
use crate::stream::Sink;

/// Table of the pictures' times.
pub const TIMES: &str = "times.csv";
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Whether a file of a folder is one of its pictures, by its name. Names that begin with a dot are of other programs.
pub fn is_picture(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let hidden = path.file_name().unwrap_or_default().as_encoded_bytes().starts_with(b".");
    EXTENSIONS.contains(&extension.as_str()) && !hidden
}

/// The pictures of a folder in the order of their numbers, `f2.png` before `f10.png`, and their size.
///
/// # Errors
/// No pictures; two series of names; two pictures of one number; numbers that are missing.
pub(crate) fn list(folder: &Path) -> Result<(Vec<PathBuf>, (u32, u32))> {
    let mut series: Vec<(Name, PathBuf)> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if is_picture(&path) {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            series.push((Name::of(&stem), path));
            check_frames(series.len())?;
        }
    }
    series.sort_by(|a, b| a.0.order(&b.0));
    check_series(&series)?;
    let files: Vec<_> = series.into_iter().map(|it| it.1).collect();
    let first = files.first().ok_or_else(|| DecodeError::no_series("the folder holds no png or jpeg"))?;
    let size = read(first)?.dimensions();
    Ok((files, size))
}

/// Times of the pictures of a folder, seconds since the first: those of its file `times.csv`, else those at which the camera
/// states that it took them (EXIF, with parts of a second). None where neither gives ascending times.
///
/// # Errors
/// A `times.csv` that does not give every picture a time, later than the one before.
pub(crate) fn times(folder: &Path, files: &[PathBuf]) -> Result<Option<Vec<f64>>> {
    let table = folder.join(TIMES);
    if table.exists() {
        let text = io::read_to_string(open_regular(&table)?.take(LARGEST_DESCRIPTION))?;
        let named = |source| DecodeError::InFile { name: TIMES.into(), source: Box::new(source) };
        return listed(&text, files).map(Some).map_err(named);
    }
    let taken: Option<Vec<f64>> = files.iter().map(|path| exif::seconds(path)).collect();
    Ok(taken.filter(|times| times.is_sorted_by(|a, b| a < b)).map(since_first))
}

fn since_first(times: Vec<f64>) -> Vec<f64> {
    let first = times.first().copied().unwrap_or(0.0);
    times.iter().map(|time| time - first).collect()
}

/// Times of a table: a row for each picture, either its time or its name and its time, seconds; a heading is passed over.
fn listed(text: &str, files: &[PathBuf]) -> Result<Vec<f64>> {
    let rows: Vec<Vec<&str>> = text
        .lines()
        .map(|line| line.split([',', ';', '\t']).map(str::trim).collect())
        .filter(|row: &Vec<&str>| row.iter().any(|cell| !cell.is_empty()))
        .collect();
    let time = |row: &[&str]| row.last().and_then(|cell| cell.parse::<f64>().ok()).filter(|time| time.is_finite());
    let rows = if rows.first().is_some_and(|row| time(row).is_none()) { &rows[1..] } else { &rows[..] };
    let by_name = rows.first().is_some_and(|row| row.len() > 1);
    let expected = "a row for each picture with its time, or its name and its time, in seconds";
    let times: Option<Vec<f64>> = if by_name {
        let of = |path: &PathBuf| rows.iter().find(|row| row[0] == name(path)).and_then(|row| time(row));
        files.iter().map(of).collect()
    } else {
        rows.iter().map(|row| time(row)).collect()
    };
    let times = times.filter(|times| times.len() == files.len()).ok_or_else(|| {
        DecodeError::no_series(format!("expected {expected}, {} in all, found {} rows", files.len(), rows.len()))
    })?;
    match times.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(place) => {
            Err(DecodeError::no_series(format!("the time of picture {} is not after the one before", place + 1)))
        }
        None => Ok(since_first(times)),
    }
}

/// A name without its extension: text, its last number, text.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Name {
    before: String,
    number: Option<u64>,
    after: String,
}

impl Name {
    fn of(stem: &str) -> Self {
        let end = stem.rfind(|c: char| c.is_ascii_digit()).map_or(0, |last| last + 1);
        let begin = stem[..end]
            .rfind(|c: char| !c.is_ascii_digit())
            .map_or(0, |last| last + stem[last..].chars().next().map_or(1, char::len_utf8));
        match stem[begin..end].parse() {
            Ok(number) => Name { before: stem[..begin].into(), number: Some(number), after: stem[end..].into() },
            Err(_) => Name { before: stem.into(), number: None, after: String::new() },
        }
    }

    fn order(&self, other: &Self) -> Ordering {
        (&self.before, &self.after, self.number).cmp(&(&other.before, &other.after, other.number))
    }
}

/// Refuses a folder whose pictures are not one series of frames without gaps. A constant step is none.
fn check_series(series: &[(Name, PathBuf)]) -> Result<()> {
    let shown = |path: &Path| printable(&path.file_name().unwrap_or_default().to_string_lossy());
    let mut step = None;
    for pair in series.windows(2) {
        let [(a, first), (b, second)] = pair else { continue };
        let (first, second) = (shown(first), shown(second));
        if (&a.before, &a.after) != (&b.before, &b.after) {
            return Err(DecodeError::no_series(format!(
                "{first} and {second} are not of one series; give each its own folder"
            )));
        }
        let (Some(a), Some(b)) = (a.number, b.number) else {
            return Err(DecodeError::no_series(format!("{first} and {second} have no numbers to order them by")));
        };
        match (b - a, *step.get_or_insert(b - a)) {
            (0, _) => return Err(DecodeError::no_series(format!("{first} and {second} are one frame"))),
            (found, step) if found != step => {
                return Err(DecodeError::no_series(format!(
                    "frames are missing between {first} and {second}, or before"
                )));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Decodes the pictures from a number on.
///
/// # Errors
/// A damaged picture, or one of another size than the first; the message names it.
pub(crate) fn decode(
    files: &[PathBuf],
    size: (u32, u32),
    times: Option<&[f64]>,
    display: &Arc<Presentation>,
    from: usize,
    sink: &Sink,
) -> Result<()> {
    for (number, path) in files.iter().enumerate().skip(from) {
        let picture = read(path)?;
        if picture.dimensions() != size {
            let ((width, height), name) = (picture.dimensions(), name(path));
            let expected = format!("the first picture {} x {}", size.0, size.1);
            return Err(DecodeError::no_series(format!("{name} has {width} x {height} pixels, {expected}")));
        }
        let seconds = times.map(|times| times[number]);
        if !sink.send(Frame {
            number,
            seconds,
            picture: DecodedPicture::Rgb(picture),
            display: display.clone(),
            field: None,
        }) {
            break;
        }
    }
    Ok(())
}

fn name(path: &Path) -> String {
    printable(&path.file_name().unwrap_or_default().to_string_lossy())
}

fn read(path: &Path) -> Result<RgbImage> {
    decode_file(path).map_err(|source| DecodeError::InFile { name: name(path), source: Box::new(source) })
}

fn decode_file(path: &Path) -> Result<RgbImage> {
    let damaged = |why: &str| DecodeError::corrupt(format!("it is not a readable picture: {}", printable(why)));
    let mut bytes = Vec::new();
    BufReader::new(open_regular(path)?).take(LARGEST_PACKET).read_to_end(&mut bytes)?;
    if bytes.starts_with(&[0xff, 0xd8]) && !has_end(&bytes) {
        return Err(damaged("it is cut off"));
    }
    let mut reader = ImageReader::new(Cursor::new(&bytes)).with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(|error| damaged(&error.to_string()))?;
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    // Damage in the notes of the camera turns nothing.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut picture = DynamicImage::from_decoder(decoder).map_err(|error| damaged(&error.to_string()))?;
    picture.apply_orientation(orientation);
    Ok(if picture.color().has_alpha() { over_black(&picture.into_rgba8()) } else { picture.into_rgb8() })
}

/// Whether a jpeg has the mark of its end: after its first scan, as small pictures in its header have their own.
fn has_end(jpeg: &[u8]) -> bool {
    let mut at = 2;
    while let Some([0xff, marker, high, low]) = jpeg.get(at..at + 4) {
        if *marker == 0xda {
            return jpeg[at..].windows(2).any(|it| it == [0xff, 0xd9]);
        }
        at += 2 + usize::from(u16::from_be_bytes([*high, *low]));
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use image::{ImageEncoder, Rgb, Rgba, RgbaImage};

    /// A picture of 16 x 8 pixels, white in its left half, of a camera that was turned.
    #[test]
    fn pictures_of_a_turned_camera_stand_upright_and_half_of_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f0.jpg");
        let stored = RgbImage::from_fn(16, 8, |x, _| Rgb([if x < 8 { 255 } else { 0 }; 3]));
        // TIFF, most significant byte first, one entry: 0x112, a number of two bytes.
        let exif = |orientation: u8| {
            [&b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation, 0, 0, 0, 0, 0, 0]].concat()
        };
        for (orientation, size, [x, y]) in [(1, (16, 8), [4, 4]), (3, (16, 8), [12, 4]), (6, (8, 16), [4, 4])] {
            let mut encoder = JpegEncoder::new(fs::File::create(&path).unwrap());
            encoder.set_exif_metadata(exif(orientation)).unwrap();
            encoder.encode_image(&stored).unwrap();
            let upright = read(&path).unwrap();
            assert_eq!((list(folder.path()).unwrap().1, upright.dimensions()), (size, size));
            let dark = [size.0 - 1 - x, size.1 - 1 - y];
            assert!(upright[(x, y)].0[0] > 200 && upright[dark.into()].0[0] < 50, "{orientation}");
        }
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() - 40]).unwrap();
        assert!(decode_file(&path).unwrap_err().to_string().contains("cut off"));
    }

    #[test]
    fn a_table_gives_times_in_order_or_by_name() {
        let files = ["f0.png", "f1.png", "f2.png"].map(PathBuf::from);
        assert_eq!(listed("seconds\n5\n5.5\n6.25\n", &files).unwrap(), [0.0, 0.5, 1.25]);
        assert_eq!(listed("name, time\nf1.png, 0.1\nf0.png, 0\nf2.png, 0.3", &files).unwrap(), [0.0, 0.1, 0.3]);
        for (text, reason) in [("0\n1\n", "3 in all"), ("0\n1\n1\n", "picture 2"), ("a\nb\nc", "found 2 rows")] {
            let error = listed(text, &files).unwrap_err().to_string();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }

    #[test]
    fn a_folder_is_one_series_without_gaps() {
        let of = |names: &[&str]| {
            let folder = tempfile::tempdir().unwrap();
            for name in names {
                RgbaImage::from_pixel(2, 2, Rgba([9; 4])).save(folder.path().join(name)).ok();
            }
            // A file of other programs.
            fs::write(folder.path().join("._f0.png"), "notes").unwrap();
            list(folder.path()).map(|listed| listed.0.iter().map(|path| name(path)).collect::<Vec<_>>())
        };
        assert_eq!(of(&["f10.png", "f8.png", "f6.png"]).unwrap(), ["f6.png", "f8.png", "f10.png"]);
        assert_eq!(of(&["v2_1.png", "v2_0.png"]).unwrap(), ["v2_0.png", "v2_1.png"]);
        for (names, reason) in [
            (&["f1.png", "f2.png", "f4.png"][..], "missing"),
            (&["f1.png", "f01.png"], "one frame"),
            (&["f1.png", "contact.png"], "one series"),
            (&["a.png", "b.png"], "one series"),
            (&[], "no png"),
        ] {
            let error = of(names).unwrap_err().to_string();
            assert!(error.contains(reason), "{names:?}: {error}");
        }
    }
}

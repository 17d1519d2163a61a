//! Archives of the program Tracker (`.trz`): a zip with a `.trk` and the video, or its pictures, in a folder.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use zip::ZipArchive;

use crate::error::{CONVERT, DecodeError, Result, printable};
use crate::limits::check_frames;
use crate::open::open_regular;

const VIDEOS: [&str; 12] = ["mp4", "mov", "m4v", "avi", "webm", "mkv", "gif", "ts", "mts", "wmv", "mpg", "flv"];
const PICTURES: [&str; 3] = ["png", "jpg", "jpeg"];
/// Most bytes that are extracted.
const MOST_BYTES: u64 = 1 << 33;

/// What was extracted of an archive, in a folder that is removed with it.
#[derive(Debug)]
pub(crate) struct Extracted {
    _folder: TempDir,
    video: PathBuf,
}

impl Extracted {
    /// Whether a file is such an archive, by its name.
    pub(crate) fn is_archive(path: &Path) -> bool {
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("trz"))
    }

    /// Extracts the video of an archive: its largest film, else the pictures of its largest series.
    ///
    /// # Errors
    /// No zip, no video in it, more bytes than the limit.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let mut archive = ZipArchive::new(open_regular(path)?).map_err(damaged)?;
        let mut entries: Vec<ArchiveEntry> = Vec::new();
        for number in 0..archive.len() {
            let file = archive.by_index_raw(number).map_err(damaged)?;
            let Some(inner) = file.enclosed_name().filter(|_| file.is_file()) else { continue };
            let extension = inner.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            let name = inner.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let folder = inner.parent().unwrap_or(Path::new("")).to_path_buf();
            let is_video = VIDEOS.contains(&extension.as_str());
            if is_video || PICTURES.contains(&extension.as_str()) {
                entries.push(ArchiveEntry { number, name, folder, bytes: file.size(), is_video });
                check_frames(entries.len())?;
            }
        }
        let folder = tempfile::tempdir()?;
        let film = entries.iter().filter(|entry| entry.is_video).max_by_key(|entry| entry.bytes);
        let (wanted, video): (Vec<&ArchiveEntry>, PathBuf) = match film {
            Some(film) => (vec![film], folder.path().join(&film.name)),
            None => (pictures(&entries)?, folder.path().to_path_buf()),
        };
        check_bytes(&wanted)?;
        for entry in wanted {
            let mut file = archive.by_index(entry.number).map_err(damaged)?;
            // Not more than the archive states, whatever it holds.
            let mut limited = io::Read::take(&mut file, entry.bytes);
            io::copy(&mut limited, &mut File::create(folder.path().join(&entry.name))?)?;
        }
        fs::metadata(&video)?;
        Ok(Extracted { _folder: folder, video })
    }

    /// The film, or the folder of pictures.
    pub(crate) fn video(&self) -> &Path {
        &self.video
    }
}

/// Refuses to extract more than the limit.
fn check_bytes(wanted: &[&ArchiveEntry]) -> Result<()> {
    // Any sizes may be stated: their sum must not overflow.
    let bytes = wanted.iter().fold(0u64, |sum, entry| sum.saturating_add(entry.bytes));
    if bytes > MOST_BYTES {
        return Err(DecodeError::too_large(format!("its video has {bytes} bytes; at most {MOST_BYTES} are extracted")));
    }
    Ok(())
}

/// A film or picture in an archive.
struct ArchiveEntry {
    number: usize,
    name: String,
    folder: PathBuf,
    bytes: u64,
    is_video: bool,
}

/// The pictures of the series with most of them: in one folder, and alike in their names but for the numbers. Tracker adds
/// small pictures of its window.
fn pictures(entries: &[ArchiveEntry]) -> Result<Vec<&ArchiveEntry>> {
    let mut series: BTreeMap<(&Path, String), Vec<&ArchiveEntry>> = BTreeMap::new();
    for entry in entries {
        let letters = entry.name.chars().filter(|letter| !letter.is_ascii_digit()).collect();
        series.entry((&entry.folder, letters)).or_default().push(entry);
    }
    let largest = series.into_values().filter(|found| found.len() > 1).max_by_key(Vec::len);
    largest.ok_or_else(|| DecodeError::Unsupported {
        what: "a Tracker archive without a video".into(),
        remedy: CONVERT.into(),
    })
}

fn damaged(error: zip::result::ZipError) -> DecodeError {
    match error {
        zip::result::ZipError::Io(error) => DecodeError::Io(error),
        other => DecodeError::corrupt(format!("it is no readable zip: {}", printable(&other.to_string()))),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use image::{Rgb, RgbImage};
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    use crate::VideoFile;

    #[test]
    fn the_pictures_of_a_tracker_archive_are_its_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fall.trz");
        let mut archive = ZipWriter::new(std::fs::File::create(&path).unwrap());
        let mut add = |name: &str, bytes: &[u8]| {
            archive.start_file(name, SimpleFileOptions::default()).unwrap();
            archive.write_all(bytes).unwrap();
        };
        add("fall.trk", b"<object/>");
        let png = |level: u8| {
            let mut bytes = std::io::Cursor::new(Vec::new());
            RgbImage::from_pixel(8, 6, Rgb([level; 3])).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
            bytes.into_inner()
        };
        add("thumbnails/thumb.png", &png(9));
        for number in 0..4 {
            add(&format!("videos/f{number}.png"), &png(40 * number));
        }
        archive.finish().unwrap();
        let video = VideoFile::open(&path).unwrap();
        assert_eq!((video.info().frames, video.info().size, video.path()), (4, (8, 6), path.as_path()));
        let levels: Vec<u8> = video.frames().unwrap().map(|frame| frame.unwrap().rgb()[(3, 3)].0[1]).collect();
        assert_eq!(levels, [0, 40, 80, 120]);
        std::fs::write(&path, b"no zip").unwrap();
        assert!(VideoFile::open(&path).is_err());
    }

    /// The sum of these sizes is 0 in 64 bits.
    #[test]
    fn sizes_that_overflow_are_refused() {
        let entry = |name: &str| super::ArchiveEntry {
            number: 0,
            name: name.into(),
            folder: "videos".into(),
            bytes: 1 << 63,
            is_video: false,
        };
        let entries = [entry("f0.png"), entry("f1.png")];
        let wanted = super::pictures(&entries).unwrap();
        assert_eq!(wanted.len(), 2);
        assert!(matches!(super::check_bytes(&wanted), Err(crate::DecodeError::TooLarge { .. })));
    }

    /// One series of each kind of ending; comparing each with every other would take 10^11 steps.
    #[test]
    fn a_series_is_found_among_many_pictures() {
        let entry = |number: usize| super::ArchiveEntry {
            number,
            name: format!("{}{number}.png", if number.is_multiple_of(3) { "f" } else { "g" }),
            folder: "videos".into(),
            bytes: 1,
            is_video: false,
        };
        let entries: Vec<_> = (0..300_000).map(entry).collect();
        assert_eq!(super::pictures(&entries).unwrap().len(), 200_000);
    }
}

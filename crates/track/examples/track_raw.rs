//! Tracks a file of raw RGB frames and prints one line for each object and frame.
//!
//! `cargo run --release --example track_raw -- video.rgb WIDTH HEIGHT [FIRST END]`, where the file comes from
//! `ffmpeg -i video.mp4 -pix_fmt rgb24 -f rawvideo video.rgb`.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;

use paig_track::{Error, Options, Size, Video, Visitor, track};

/// File of frames without a header.
struct RawFile {
    path: PathBuf,
    size: Size,
    frames: usize,
}

impl Video for RawFile {
    fn size(&self) -> Size {
        self.size
    }

    fn frames(&self) -> usize {
        self.frames
    }

    fn visit(&self, wanted: &dyn Fn(usize) -> bool, visitor: &mut Visitor<'_>) -> Result<(), Error> {
        let read = || -> std::io::Result<File> { File::open(&self.path) };
        let mut file = read().map_err(|error| Error::Source(error.to_string()))?;
        let mut bytes = vec![0; self.size.pixels() * 3];
        for frame in (0..self.frames).filter(|&frame| wanted(frame)) {
            file.seek(SeekFrom::Start((frame * bytes.len()) as u64))
                .and_then(|_| file.read_exact(&mut bytes))
                .map_err(|error| Error::Source(error.to_string()))?;
            visitor(frame, &bytes)?;
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, width, height, range @ ..] = arguments.as_slice() else {
        return Err("expected: FILE WIDTH HEIGHT [FIRST END]".into());
    };
    let size = Size { width: width.parse()?, height: height.parse()? };
    let bytes = std::fs::metadata(path)?.len() as usize;
    let video = RawFile { path: path.into(), size, frames: bytes / (size.pixels() * 3) };
    let mut options = Options::default();
    if let [first, end] = range {
        options.frames = Some(first.parse()?..end.parse()?);
    }
    let tracking = track(&video, &options)?;
    let shake = tracking.translations.iter().flatten().fold(0.0_f64, |most, t| most.max(t.abs()));
    eprintln!("moving share {:.4}, flicker {:.2}, shake {shake:.2}", tracking.moving_share, tracking.flicker);
    println!("object,frame,visibility,method,x,y,xx,xy,yy,centroid_x,centroid_y,misfit,contrast");
    for (index, object) in tracking.tracks.iter().enumerate() {
        eprintln!("{index} {:?} diameter {:.1} bin {} {:?}", object.role, object.diameter, object.bin, object.quality);
        for point in &object.points {
            let method = point.measurement.map_or(String::new(), |m| format!("{:?}", m.method));
            let [x, y] = point.measurement.map_or([f64::NAN; 2], |m| m.position);
            let [[xx, xy], [_, yy]] = point.measurement.map_or([[f64::NAN; 2]; 2], |m| m.covariance);
            let [cx, cy] = point.centroid.unwrap_or([f64::NAN; 2]);
            let (misfit, contrast) = (point.misfit.unwrap_or(f64::NAN), point.contrast.unwrap_or(f64::NAN));
            println!(
                "{index},{},{:?},{method},{x:.4},{y:.4},{xx:.3e},{xy:.3e},{yy:.3e},{cx:.4},{cy:.4},{misfit:.4},{contrast:.3}",
                point.frame, point.visibility
            );
        }
    }
    Ok(())
}

//! Prints the facts of a video and decodes it, optionally to RGB: `cargo run --release --example facts -- VIDEO [rgb]`.

use std::path::Path;
use std::time::Instant;

use paig_decode::{DecodeError, VideoFile};

fn main() -> Result<(), DecodeError> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let Some(path) = arguments.first() else {
        eprintln!("usage: facts VIDEO [rgb]");
        return Ok(());
    };
    let video = VideoFile::open(Path::new(path))?;
    println!("{:#?}", video.info());
    let (begin, mut count, mut sum) = (Instant::now(), 0, 0u64);
    for frame in video.frames()? {
        let frame = frame?;
        if arguments.len() > 1 {
            sum += u64::from(frame.rgb().as_raw()[0]);
        }
        count += 1;
    }
    println!("{count} frames in {:.3} s; first levels add up to {sum}", begin.elapsed().as_secs_f64());
    Ok(())
}

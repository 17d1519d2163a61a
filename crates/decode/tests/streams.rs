//! The streams of tests/data, made by make.sh, against what ffmpeg decoded of them.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{decode, difference, parse};
use paig_decode::{DecodeError, Matrix, Note, Transfer, VideoFile};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

#[test]
fn every_decoder_gives_the_samples_and_times_of_ffmpeg() {
    let mut differing = Vec::new();
    let mut streams = 0;
    for entry in fs::read_dir(data()).unwrap() {
        let list = entry.unwrap().path();
        if list.extension().is_some_and(|it| it == "framemd5") {
            let stream = list.with_extension("");
            let name = stream.file_name().unwrap().to_string_lossy().into_owned();
            if name.starts_with("av1") && !cfg!(feature = "av1") {
                continue;
            }
            let expected = parse(&fs::read_to_string(&list).unwrap());
            let outcome = match decode(&stream) {
                Ok(found) => difference(&found, &expected),
                Err(error) => Some(format!("{error:?}")),
            };
            differing.extend(outcome.map(|how| format!("{name}: {how}")));
            streams += 1;
        }
    }
    assert!(differing.is_empty() && streams > 15, "{streams} streams; {differing:#?}");
}

fn open(name: &str) -> VideoFile {
    VideoFile::open_built_in(&data().join(name)).unwrap()
}

#[test]
fn facts_are_those_that_the_streams_were_made_with() {
    let rotated = open("h264_rotated.mp4");
    let info = rotated.info();
    // The tag turns counterclockwise.
    assert_eq!((info.size, info.orientation.degrees(), info.capture_rate), ((94, 130), (270, false), Some(240.0)));
    let first = rotated.frames().unwrap().next().unwrap().unwrap();
    assert_eq!((first.size(), first.rgb().dimensions(), first.grey().dimensions()), ((94, 130), (94, 130), (94, 130)));
    assert!((open("h264_aspect.mp4").info().pixel_aspect - 16.0 / 15.0).abs() < 1e-9);
    let colour = |name: &str| open(name).info().colour;
    assert_eq!((colour("h264_bt709.mp4").matrix, colour("h264_bt709.mp4").is_stated), (Matrix::Bt709, true));
    assert_eq!((colour("h264_bframes.mp4").matrix, colour("h264_bframes.mp4").is_stated), (Matrix::Bt601, false));
    assert!(colour("h264_full_range.mp4").full_range && colour("mjpeg_420.avi").full_range);
    let hdr = open("hevc_hlg.mkv");
    assert_eq!((hdr.info().depth, hdr.info().colour.transfer), (10, Transfer::Hlg));
    assert_eq!((hdr.info().colour.matrix, &hdr.info().notes), (Matrix::Bt2020, &vec![Note::ToneMapped]));
    assert_eq!(open("h264_bframes.avi").info().notes, [Note::TimesOfDecoding]);
    assert_eq!(open("vp9_10.webm").info().depth, 10);
}

#[test]
fn decoding_from_a_frame_on_gives_the_rest() {
    for name in ["h264_bframes.mp4", "h264_bframes.avi", "hevc.mp4", "vp9.webm", "mjpeg_420.avi"] {
        let video = open(name);
        let all: Vec<_> = video.frames().unwrap().map(|frame| frame.unwrap().samples()).collect();
        for from in [0, 1, all.len() / 2, all.len() - 1] {
            let rest: Vec<_> = video.frames_from(from).unwrap().map(|frame| frame.unwrap()).collect();
            assert_eq!((rest.len(), rest[0].number()), (all.len() - from, from), "{name}");
            assert!(rest.iter().all(|frame| frame.samples() == all[frame.number()]), "{name} from {from}");
        }
        assert_eq!(video.frames_from(all.len()).unwrap().count(), 0, "{name}");
    }
}

#[test]
fn a_file_that_is_cut_off_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut");
    let cut = |name: &str, part: usize| {
        let bytes = fs::read(data().join(name)).unwrap();
        fs::write(&path, &bytes[..bytes.len() * part / 4]).unwrap();
        format!("{:?}", decode(&path).unwrap_err())
    };
    assert!(cut("h264_fragments.mp4", 1).contains("cut off"), "{}", cut("h264_fragments.mp4", 1));
    assert!(cut("h264_bframes.mp4", 3).contains("incomplete"), "{}", cut("h264_bframes.mp4", 3));
    fs::write(&path, b"").unwrap();
    assert!(matches!(VideoFile::open(&path), Err(DecodeError::Corrupt { .. })));
    fs::write(&path, b"#EXTM3U\n#EXTINF:1,\nother.ts\n").unwrap();
    assert!(matches!(VideoFile::open_built_in(&path), Err(DecodeError::Unsupported { .. })));
}

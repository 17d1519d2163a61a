//! What is left to ffmpeg. Needs one with libtheora and libx264: `cargo test --test fallback -- --ignored`.

use std::fs;
use std::path::Path;
use std::process::Command;

use paig_decode::{DecodeError, VideoDecoder, VideoFile};

fn make(options: &str, path: &Path) {
    let source = "-v error -nostdin -y -f lavfi -i testsrc2=size=96x64:rate=25 -frames:v 10";
    let mut command = Command::new("ffmpeg");
    command.args(source.split_whitespace()).args(options.split_whitespace()).arg(path);
    assert!(command.status().expect("ffmpeg").success(), "{command:?}");
}

#[test]
#[ignore = "needs ffmpeg"]
fn codecs_without_a_decoder_are_read_by_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    for (name, options, codec) in [
        ("theora.ogv", "-c:v libtheora -q:v 5", "decoded by ffmpeg"),
        ("part2.avi", "-c:v mpeg4 -q:v 4 -bf 2", "MPEG-4 part 2"),
        ("interlaced.mov", "-c:v libx264 -flags +ildct+ilme -pix_fmt yuv420p", "H.264"),
        ("deep.mkv", "-c:v libx264 -pix_fmt yuv422p10le", "H.264"),
    ] {
        let path = folder.path().join(name);
        make(options, &path);
        assert!(matches!(VideoFile::open_built_in(&path), Err(DecodeError::Unsupported { .. })), "{name}");
        let video = VideoFile::open(&path).unwrap();
        assert_eq!((video.info().decoder, video.info().codec.as_str()), (VideoDecoder::Ffmpeg, codec), "{name}");
        let numbers: Vec<_> = video.frames_from(4).unwrap().map(|frame| frame.unwrap().number()).collect();
        assert_eq!(numbers, [4, 5, 6, 7, 8, 9], "{name}");
        let times = video.times().unwrap();
        assert!((times[9] - 9.0 / 25.0).abs() < 1e-3, "{name}: {times:?}");
    }
}

#[test]
#[ignore = "needs ffmpeg"]
fn a_playlist_opens_no_other_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    make("-c:v libx264 -pix_fmt yuv420p", &at("other.mp4"));
    make("-c:v libx264 -pix_fmt yuv420p", &at("other.ts"));
    let other = at("other.ts").display().to_string();
    let lists = [
        "ffconcat version 1.0\nfile other.mp4\n".to_string(),
        format!("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:0.4,\nfile:{other}\n#EXT-X-ENDLIST\n"),
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:0.4,\nother.ts\n#EXT-X-ENDLIST\n".to_string(),
        format!("v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\na=control:{other}\n"),
    ];
    for (list, name) in lists.iter().flat_map(|list| ["list.avi", "list.mkv"].map(|name| (list, name))) {
        fs::write(at(name), list).unwrap();
        assert!(VideoFile::open(&at(name)).is_err(), "{name}: {list}");
    }
}

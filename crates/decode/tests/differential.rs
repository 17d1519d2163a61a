//! Streams that ffmpeg makes, decoded by it and by this crate. Needs ffmpeg 5.1 with libx264, libx265, libvpx and libaom:
//! `cargo test --release --test differential -- --ignored --nocapture`.

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use common::{decode, difference, parse};
use paig_decode::{DecodeError, Note, VideoFile};

const X264: &str = "-c:v libx264 -crf 28 -threads 1 -pix_fmt yuv420p";
const X265: &str = "-c:v libx265 -crf 28 -pix_fmt yuv420p -x265-params log-level=none:pools=none:frame-threads=1";
/// ffmpeg's exact conversion with the nearest chroma sample; its usual one is up to 2.9 levels off.
const EXACT: &str =
    "-map 0:v:0 -frames:v 1 -sws_flags neighbor+accurate_rnd+full_chroma_int -f rawvideo -pix_fmt rgb24";
/// Most grey levels by which colours may be off: both round, from fractions that differ by less than a tenth.
const MOST_LEVELS: u8 = 1;

/// A change of a file's bytes.
type ByteChange = fn(&mut [u8]);

/// What a change leads to.
#[derive(Clone, Copy, PartialEq)]
enum ExpectedDecoding {
    /// The same as ffmpeg.
    Same,
    /// The same samples, 25 a second; ffmpeg guesses their times from those of decoding.
    Regular,
    /// The same samples; times that are stretched by a factor, which is noted.
    Stretched(f64),
    /// Refused.
    Refused,
}

struct EncodedCase {
    name: String,
    /// Options of the encoder.
    options: String,
    extension: &'static str,
    /// Changes the finished file.
    change: ByteChange,
    expected: ExpectedDecoding,
}

fn case(name: impl Into<String>, options: impl Into<String>, extension: &'static str) -> EncodedCase {
    EncodedCase {
        name: name.into(),
        options: options.into(),
        extension,
        change: |_| {},
        expected: ExpectedDecoding::Same,
    }
}

fn changed(name: &str, options: &str, change: ByteChange, expected: ExpectedDecoding) -> EncodedCase {
    EncodedCase { change, expected, ..case(name, options, "mp4") }
}

fn cases() -> Vec<EncodedCase> {
    let mut cases = Vec::new();
    let matrices = [("", ""), ("bt470bg", "smpte170m"), ("bt709", "bt709"), ("bt2020", "bt2020nc")];
    for (full, frames) in [("tv", 0), ("pc", 3)] {
        for (matrix, space) in matrices {
            let tags = if space.is_empty() { String::new() } else { format!("-colorspace {space}") };
            let scale = if matrix.is_empty() { String::new() } else { format!(":out_color_matrix={matrix}") };
            let colour = format!("-vf scale=out_range={full}{scale} -color_range {full} {tags}");
            cases.push(case(format!("h264 {full} {space}"), format!("{X264} -bf {frames} {colour}"), "mp4"));
            cases.push(case(format!("hevc {full} {space}"), format!("{X265} {colour}"), "mp4"));
            cases.push(case(format!("h264 mkv {full} {space}"), format!("{X264} -bf 2 {colour}"), "mkv"));
        }
    }
    for frames in [0, 1, 3, 6] {
        for pyramid in ["none", "normal"] {
            let options = format!("{X264} -bf {frames} -b-pyramid {pyramid} -g 9 -refs 4");
            for extension in ["mp4", "avi"] {
                cases.push(case(
                    format!("{frames} B frames, pyramid {pyramid}, {extension}"),
                    options.as_str(),
                    extension,
                ));
            }
        }
    }
    for (name, filter) in [
        ("variable rate", "setpts=PTS+mod(N\\,3)*0.3/25/TB"),
        ("dropped frames", "select=not(eq(mod(n\\,5)\\,2))"),
        ("ramp", "settb=1/90000,setpts=if(lt(N\\,8)\\,N/25\\,8/25+(N-8)/100)/TB"),
        ("several frames at one time", "setpts=floor(N/2)*2"),
        ("late start", "setpts=PTS+1.5/TB"),
    ] {
        for (extension, codec) in [("mp4", X264), ("mkv", X264), ("mov", X265)] {
            let options = format!("-vf {filter} -fps_mode passthrough {codec} -bf 2 -video_track_timescale 90000");
            cases.push(case(format!("{name} {extension}"), options, extension));
        }
    }
    for (width, height) in [(98, 66), (128, 64), (34, 130)] {
        cases.push(case(format!("h264 {width}x{height}"), format!("-vf scale={width}:{height} {X264} -bf 2"), "mp4"));
        cases.push(case(format!("hevc {width}x{height}"), format!("-vf scale={width}:{height} {X265}"), "mkv"));
    }
    for aspect in ["16/15", "4/3", "496/495"] {
        cases.push(case(format!("aspect {aspect}"), format!("-vf setsar={aspect} {X264}"), "mp4"));
        cases.push(case(format!("aspect {aspect} mkv"), format!("-vf setsar={aspect} {X264}"), "mkv"));
    }
    for (name, options, extension) in [
        ("fragments", "-bf 2 -g 6 -movflags +frag_keyframe+empty_moov", "mp4"),
        ("fragments with bases", "-bf 2 -g 6 -movflags +frag_keyframe+default_base_moof", "mp4"),
        ("description first", "-bf 2 -movflags +faststart", "mov"),
        ("slices", "-slices 4 -profile:v main", "mp4"),
        ("weighted P frames", "-vf fade=in:0:15 -weightp 2 -bf 0", "mp4"),
        ("open groups", "-bf 3 -g 8 -x264-params open-gop=1", "mp4"),
        ("negative offsets", "-bf 2 -movflags +negative_cts_offsets", "mp4"),
    ] {
        cases.push(case(name, format!("{X264} {options}"), extension));
    }
    for (name, options, extension) in [
        ("10 bits", "-pix_fmt yuv420p10le", "mp4"),
        ("open groups", "-g 8 -bf 3", "mkv"),
        ("hlg", "-pix_fmt yuv420p10le -color_trc arib-std-b67 -colorspace bt2020nc", "mp4"),
        ("with parameters in its frames", "-tag:v hev1", "mp4"),
    ] {
        cases.push(case(format!("hevc {name}"), format!("{X265} {options}"), extension));
    }
    for (name, options, extension) in [
        ("vp9", "-c:v libvpx-vp9 -crf 40 -b:v 0 -lag-in-frames 10 -pix_fmt yuv420p", "mp4"),
        ("vp9 in mkv", "-c:v libvpx-vp9 -crf 40 -b:v 0 -tile-columns 1 -pix_fmt yuv422p -profile:v 1", "mkv"),
        ("av1", "-c:v libaom-av1 -cpu-used 8 -crf 45 -b:v 0 -pix_fmt yuv420p", "mkv"),
        ("mjpeg", "-c:v mjpeg -q:v 5 -pix_fmt yuvj444p", "mov"),
        ("mjpeg in avi", "-c:v mjpeg -q:v 5 -pix_fmt yuvj422p", "avi"),
        ("mjpeg in mp4", "-c:v mjpeg -q:v 5 -pix_fmt yuvj420p", "mp4"),
    ] {
        let is_refused = name == "av1" && !cfg!(feature = "av1");
        let expected = if is_refused { ExpectedDecoding::Refused } else { ExpectedDecoding::Same };
        cases.push(EncodedCase { expected, ..case(name, options, extension) });
    }
    for (name, options) in [("h264", X264), ("hevc", X265)] {
        cases.push(case(format!("{name} transport stream"), format!("{options} -bf 2 -g 8"), "ts"));
        cases.push(case(format!("{name} m2ts"), format!("{options} -bf 2 -mpegts_m2ts_mode 1"), "m2ts"));
    }
    let frames = format!("{X264} -bf 2 -g 8");
    let turns: [(&str, ByteChange); 4] = [
        ("quarter", |file| set_matrix(file, [0, 1, -1, 0])),
        ("half", |file| set_matrix(file, [-1, 0, 0, -1])),
        ("three quarters", |file| set_matrix(file, [0, -1, 1, 0])),
        ("upside down", |file| set_matrix(file, [1, 0, 0, -1])),
    ];
    cases.extend(turns.map(|(name, change)| changed(name, &frames, change, ExpectedDecoding::Same)));
    cases.push(changed("stretched", &frames, |file| set_matrix(file, [2, 0, 0, 1]), ExpectedDecoding::Same));
    cases.push(changed("order without offsets", &frames, clear_offsets, ExpectedDecoding::Regular));
    cases.push(changed(
        "played twice as fast",
        &frames,
        |file| set_rate(file, 2 << 16),
        ExpectedDecoding::Stretched(0.5),
    ));
    cases.push(changed(
        "played half as fast",
        &frames,
        |file| set_rate(file, 1 << 15),
        ExpectedDecoding::Stretched(2.0),
    ));
    cases.push(changed("a still", &frames, |file| set_rate(file, 0), ExpectedDecoding::Refused));
    cases.push(changed("half of the sizes", &frames, halve_sizes, ExpectedDecoding::Refused));
    cases
}

/// Place of the byte after a box's name.
fn after(file: &[u8], name: &[u8; 4]) -> usize {
    file.windows(4).position(|it| it == name).expect("the box") + 4
}

fn set(file: &mut [u8], at: usize, number: i32) {
    file[at..at + 4].copy_from_slice(&number.to_be_bytes());
}

fn set_matrix(file: &mut [u8], [a, b, c, d]: [i32; 4]) {
    let at = after(file, b"tkhd") + 40;
    for (place, entry) in [(0, a), (4, b), (12, c), (16, d)] {
        set(file, at + place, entry << 16);
    }
}

/// All frames are shown when they are decoded, and from the beginning on.
fn clear_offsets(file: &mut [u8]) {
    let at = after(file, b"ctts") + 8;
    let count = usize::from(file[at - 1]);
    (0..count).for_each(|entry| set(file, at + 8 * entry + 4, 0));
    let at = after(file, b"elst");
    set(file, at + 12, 0);
}

fn set_rate(file: &mut [u8], rate: i32) {
    let at = after(file, b"elst");
    set(file, at + 16, rate);
    if rate == 1 << 15 {
        // Shown for twice as long.
        let duration = i32::from_be_bytes(file[at + 8..at + 12].try_into().unwrap());
        set(file, at + 8, 2 * duration);
    }
}

fn halve_sizes(file: &mut [u8]) {
    let at = after(file, b"stsz") + 8;
    let count = i32::from_be_bytes(file[at..at + 4].try_into().unwrap());
    set(file, at, count / 2);
}

fn ffmpeg(arguments: &str, path: &Path, output: &str) -> Vec<u8> {
    let mut command = Command::new("ffmpeg");
    command.args(["-v", "error", "-nostdin", "-y"]).args(arguments.split_whitespace());
    if output.is_empty() {
        command.arg(path);
    } else {
        command.arg("-i").arg(path).args(output.split_whitespace()).arg("-");
    }
    let done = command.stderr(Stdio::piped()).output().expect("ffmpeg");
    assert!(done.status.success(), "{command:?}: {}", String::from_utf8_lossy(&done.stderr));
    done.stdout
}

fn make(case: &EncodedCase, folder: &Path, number: usize) -> PathBuf {
    let path = folder.join(format!("{number}.{}", case.extension));
    let source = "-f lavfi -i testsrc2=size=112x80:rate=25,noise=alls=5:allf=t -frames:v 20";
    ffmpeg(&format!("{source} {}", case.options), &path, "");
    let mut file = fs::read(&path).unwrap();
    (case.change)(&mut file);
    fs::write(&path, file).unwrap();
    path
}

/// Largest difference of the first frame's colours, upright, from ffmpeg's: chroma of the nearest sample in both.
fn colours(path: &Path, video: &VideoFile) -> Result<u8, DecodeError> {
    let ours = video.frames()?.next().expect("a frame")?.rgb();
    let theirs = ffmpeg("", path, EXACT);
    assert_eq!(ours.as_raw().len(), theirs.len());
    Ok(ours.as_raw().iter().zip(&theirs).map(|(ours, theirs)| ours.abs_diff(*theirs)).max().unwrap_or(0))
}

/// How the crate's frames differ from ffmpeg's, where they should not.
fn compare(case: &EncodedCase, path: &Path) -> Option<String> {
    let list = ffmpeg(
        "-noautorotate -flags unaligned -idct simple",
        path,
        "-map 0:v:0 -fps_mode passthrough -enc_time_base -1 -f framemd5",
    );
    let mut expected = parse(&String::from_utf8_lossy(&list));
    let found = match (decode(path), case.expected) {
        (Err(_), ExpectedDecoding::Refused) => return None,
        (Err(error), _) => return Some(format!("{error:?}")),
        (Ok(found), _) => found,
    };
    let video = VideoFile::open_built_in(path).unwrap();
    match case.expected {
        ExpectedDecoding::Refused => return Some("it was read".into()),
        ExpectedDecoding::Stretched(factor) => {
            expected.iter_mut().for_each(|frame| frame.0 *= factor);
            if !video.info().notes.contains(&Note::EditRate(1.0 / factor)) {
                return Some("the rate is not noted".into());
            }
            expected.truncate(found.len());
        }
        ExpectedDecoding::Regular => {
            expected.iter_mut().enumerate().for_each(|(number, frame)| frame.0 = number as f64 / 25.0)
        }
        ExpectedDecoding::Same => {}
    }
    difference(&found, &expected).or_else(|| {
        // ffmpeg does not map tones.
        let is_mapped = video.info().notes.contains(&Note::ToneMapped);
        let most = if is_mapped { 0 } else { colours(path, &video).unwrap() };
        (most > MOST_LEVELS).then(|| format!("colours differ by {most}"))
    })
}

#[test]
#[ignore = "needs ffmpeg"]
fn streams_are_decoded_as_by_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let cases = cases();
    assert!(cases.len() >= 60, "{}", cases.len());
    let mut differing = Vec::new();
    for (number, case) in cases.iter().enumerate() {
        let path = make(case, folder.path(), number);
        let outcome = compare(case, &path);
        println!("{}: {}", case.name, outcome.as_deref().unwrap_or("as expected"));
        differing.extend(outcome.map(|how| format!("{}: {how}", case.name)));
    }
    println!("{} streams, {} differ", cases.len(), differing.len());
    assert!(differing.is_empty(), "{differing:#?}");
}

/// Files named by the environment variable CLIPS, separated by colons.
#[test]
#[ignore = "needs ffmpeg"]
fn clips_are_decoded_as_by_ffmpeg() {
    let clips = std::env::var("CLIPS").unwrap_or_default();
    let mut differing = Vec::new();
    for clip in clips.split(':').filter(|clip| !clip.is_empty()) {
        let path = Path::new(clip);
        let outcome = match VideoFile::open_built_in(path) {
            Ok(video) => {
                let info = video.info();
                println!(
                    "{clip}: {} in {}, {:?}, aspect {}, {} frames from {:.4} s, {:?}, {:?}",
                    info.codec,
                    info.container,
                    info.size,
                    info.pixel_aspect,
                    info.frames,
                    info.start,
                    info.colour,
                    info.notes
                );
                compare(&case(clip, "", ""), path)
            }
            Err(error) => Some(format!("{error:?}")),
        };
        println!("  {}", outcome.as_deref().unwrap_or("the same"));
        differing.extend(outcome.map(|how| format!("{clip}: {how}")));
    }
    assert!(differing.is_empty(), "{differing:#?}");
}

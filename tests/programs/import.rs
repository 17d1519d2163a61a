//! Videos become tasks: frames in their order and at their times, crops, hold-out, and files that are damaged.

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use crate::programs::paig;
use crate::project::project;
use image::codecs::gif::GifEncoder;
use image::{Delay, Frame, Rgb, RgbImage, Rgba, RgbaImage};
use paig::datasets::files::{ClipShape, DatasetFile, Split};
use paig::datasets::film::FilmFile;
use paig::network::cells::Equations;
use paig::network::system::EquationEntry;
use paig::tasks::equation_file::EquationFile;
use paig::tasks::{self, Task};
use paig_video::import::crop::{CropChoice, CropRectangle};
use paig_video::import::request::ImportRequest;
use paig_video::import::sources::SourceVideo;
use paig_video::import::time_base::{FrameSpacing, VideoPart};
use paig_video::import::tracker::TrackerFile;
use paig_video::import::{Imported, import};

/// Standard output and error together.
fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// A video of 25 frames a second; each of the 60 frames shows its number (tests/data/make_numbered_clips.py).
fn numbered() -> PathBuf {
    project("tests/data/numbered.mp4")
}

/// The number that a frame of [`numbered`] shows: six blocks in its upper half, white for 1, the highest digit first.
fn number(frame: &RgbImage) -> usize {
    (0..6).fold(0, |number, place| 2 * number + usize::from(frame[(7 + 10 * place, 12)].0[1] > 128))
}

fn request(videos: &[&Path], out: &Path) -> ImportRequest {
    let videos = videos.iter().map(|path| path.to_path_buf()).collect();
    ImportRequest { input_steps: 3, pred_steps: 3, ..ImportRequest::of(videos, out.into()) }
}

fn imported(request: &ImportRequest) -> Imported {
    import(request, &|_, _| {}).unwrap()
}

/// The message of an import that must fail.
#[track_caller]
fn refused(request: &ImportRequest) -> String {
    let message = format!("{:#}", import(request, &|_, _| {}).unwrap_err());
    assert!(!request.out.join("task.toml").exists(), "a refused import left a task");
    message
}

#[track_caller]
fn assert_says(said: &str, words: &[&str]) {
    for word in words {
        assert!(said.contains(word), "{word:?} is not in: {said}");
    }
}

/// Frame `number` of a made video: a bright ball that moves to the right over a grey ground of 120 x 80 pixels, two pixels
/// a frame from (20, 50) on.
fn ball(number: usize) -> RgbImage {
    let x = 20.0 + 2.0 * number as f64;
    RgbImage::from_fn(120, 80, |px, py| {
        let distance = (f64::from(px) + 0.5 - x).hypot(f64::from(py) + 0.5 - 50.0);
        if distance < 4.0 { Rgb([250, 200, 40]) } else { Rgb([60, 60, 60]) }
    })
}

/// A folder with pictures `f0.png`, `f1.png`, ... `f10.png`.
fn pictures(folder: &Path, frames: impl IntoIterator<Item = RgbImage>) -> PathBuf {
    let folder = folder.join("pictures");
    fs::create_dir_all(&folder).unwrap();
    for (number, frame) in frames.into_iter().enumerate() {
        frame.save(folder.join(format!("f{number}.png"))).unwrap();
    }
    folder
}

fn gif(path: &Path, frames: &[(RgbImage, u64)]) {
    let mut encoder = GifEncoder::new(File::create(path).unwrap());
    for (frame, milliseconds) in frames {
        let (width, height) = frame.dimensions();
        let rgba = RgbaImage::from_fn(width, height, |x, y| {
            let [r, g, b] = frame[(x, y)].0;
            Rgba([r, g, b, 255])
        });
        let delay = Delay::from_saturating_duration(Duration::from_millis(*milliseconds));
        encoder.encode_frame(Frame::from_parts(rgba, 0, 0, delay)).unwrap();
    }
}

#[test]
fn frames_of_an_mp4_come_in_display_order_with_their_times() {
    let video = SourceVideo::open(&numbered()).unwrap();
    assert_eq!((video.width, video.height, video.frames), (64, 48, 60));
    let times = video.times.clone().unwrap();
    assert!(times.iter().enumerate().all(|(place, time)| (time - place as f64 / 25.0).abs() < 1e-9), "{times:?}");
    let mut frames = video.decode().unwrap();
    let shown: Vec<_> = (0..60).map(|place| number(&frames.frame(place).unwrap())).collect();
    assert_eq!(shown, (0..60).collect::<Vec<_>>());
    // From the middle on, beginning between two frames at which a decoder may begin.
    let mut frames = video.decode().unwrap();
    assert_eq!([21, 21, 25, 39].map(|place| number(&frames.frame(place).unwrap())), [21, 21, 25, 39]);
    // The square of grey level 160 is on its way back: it begins at 4 + 33.
    let frame = frames.frame(39).unwrap();
    let grey = |x: u32| frame[(x, 36)].0.iter().all(|level| level.abs_diff(160) < 12);
    assert!(grey(39) && grey(47) && !grey(35) && !grey(51), "{:?}", frame[(43, 36)]);
}

/// Cut to frames 20 to 39 without being encoded anew: those from the key frame 16 on are in the file and hidden.
#[test]
fn what_an_edit_list_hides_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = fs::read(numbered()).unwrap();
    // Duration and beginning stand 12 bytes behind the name of the list's box. The first is in milliseconds; the film's clock
    // has 512 ticks to a frame and is 1024 behind, for frames that are decoded before they are shown.
    let edit = bytes.windows(4).position(|name| name == b"elst").unwrap() + 12;
    bytes[edit..edit + 8].copy_from_slice(&[800, 1024 + 20 * 512].map(u32::to_be_bytes).concat());
    let path = folder.path().join("cut.mp4");
    fs::write(&path, &bytes).unwrap();
    let video = SourceVideo::open(&path).unwrap();
    let times = video.times.clone().unwrap();
    assert_eq!((video.frames, times.len()), (20, 20));
    assert!(times.iter().enumerate().all(|(place, time)| (time - place as f64 / 25.0).abs() < 1e-9), "{times:?}");
    let mut frames = video.decode().unwrap();
    let shown: Vec<_> = (0..20).map(|place| number(&frames.frame(place).unwrap())).collect();
    assert_eq!(shown, (20..40).collect::<Vec<_>>());
    assert_eq!(number(&video.decode().unwrap().frame(15).unwrap()), 35);
    bytes[edit + 4..edit + 8].copy_from_slice(&(1_u32 << 20).to_be_bytes());
    fs::write(&path, &bytes).unwrap();
    assert_says(
        &format!("{:#}", SourceVideo::open(&path).unwrap_err()),
        &["cut.mp4", "none of its 60 frames is shown"],
    );
}

#[test]
fn rotated_films_stand_upright() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(numbered()).unwrap();
    // The matrix stands 40 bytes behind the name of the track header's box (version 0).
    let matrix = bytes.windows(4).position(|name| name == b"tkhd").unwrap() + 4 + 40;
    let plain = SourceVideo::open(&numbered()).unwrap().decode().unwrap().frame(9).unwrap();
    let one = 1_i32 << 16;
    for (degrees, [a, b, c, d]) in [(90, [0, one, -one, 0]), (180, [-one, 0, 0, -one]), (270, [0, -one, one, 0])] {
        let mut turned = bytes.clone();
        for (place, number) in [(0, a), (4, b), (12, c), (16, d)] {
            turned[matrix + place..matrix + place + 4].copy_from_slice(&i32::to_be_bytes(number));
        }
        let path = folder.path().join(format!("turned{degrees}.mp4"));
        fs::write(&path, turned).unwrap();
        let video = SourceVideo::open(&path).unwrap();
        assert_eq!((video.width, video.height), if degrees == 180 { (64, 48) } else { (48, 64) });
        let frame = video.decode().unwrap().frame(9).unwrap();
        // Where the pixel next to the top left corner of the coded frame is shown, clockwise.
        let (x, y) = [(47 - 12, 7), (63 - 7, 47 - 12), (12, 63 - 7)][degrees / 90 - 1];
        assert_eq!(frame.dimensions(), (video.width, video.height));
        assert_eq!(frame[(x, y)], plain[(7, 12)], "{degrees} degrees");
    }
}

#[test]
fn pictures_and_gifs_keep_their_order_and_times() {
    let folder = tempfile::tempdir().unwrap();
    let shade = |number: usize| RgbImage::from_pixel(8, 6, Rgb([10 * number as u8; 3]));
    let video = SourceVideo::open(&pictures(folder.path(), (0..12).map(shade))).unwrap();
    assert_eq!((video.frames, &video.times), (12, &None));
    let mut frames = video.decode().unwrap();
    for place in 0..12 {
        assert_eq!(frames.frame(place).unwrap()[(3, 3)], Rgb([10 * place as u8; 3]));
    }
    let path = folder.path().join("clip.gif");
    gif(&path, &(0..12).map(|number| (shade(number), if number == 3 { 200 } else { 100 })).collect::<Vec<_>>());
    let video = SourceVideo::open(&path).unwrap();
    let times = video.times.clone().unwrap();
    for (place, time) in times.iter().enumerate() {
        let expected = 0.1 * place as f64 + if place > 3 { 0.1 } else { 0.0 };
        assert!((time - expected).abs() < 1e-9, "{times:?}");
    }
    let mut frames = video.decode().unwrap();
    for place in [0, 5, 11] {
        // A gif has 256 colours, and these are fewer.
        assert_eq!(frames.frame(place).unwrap()[(3, 3)], Rgb([10 * place as u8; 3]));
    }
}

#[test]
fn arrays_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("video.npz");
    let mut npz = ndarray_npy::NpzWriter::new_compressed(File::create(&path).unwrap());
    let grey = ndarray::Array3::from_shape_fn((5, 4, 6), |(frame, y, x)| (100 * y + 10 * x + frame) as u8);
    npz.add_array("frames", &grey).unwrap();
    npz.finish().unwrap();
    let video = SourceVideo::open(&path).unwrap();
    assert_eq!((video.width, video.height, video.frames), (6, 4, 5));
    assert_eq!(video.decode().unwrap().frame(3).unwrap()[(5, 2)], Rgb([(200 + 50 + 3) as u8; 3]));
    let mut npz = ndarray_npy::NpzWriter::new_compressed(File::create(&path).unwrap());
    npz.add_array("frames", &grey.mapv(f32::from)).unwrap();
    npz.finish().unwrap();
    assert_says(&format!("{:#}", SourceVideo::open(&path).unwrap_err()), &["video.npz", "uint8"]);
}

/// What a task made of a video looks like.
#[test]
fn an_imported_video_is_a_task_that_trains_from_its_own_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("My scene 1");
    let path = numbered();
    let done = imported(&ImportRequest { pixels_per_metre: Some(80.0), y_up: true, ..request(&[&path], &out) });
    let task = tasks::find(out.join("task.toml").to_str().unwrap()).unwrap();
    assert_eq!((task.name.as_str(), task.system.side, task.system.channels), ("my-scene-1", 32, 3));
    assert!(
        (task.system.dt - 0.04).abs() < 1e-6 && done.warnings.iter().any(|it| it.contains("say little")),
        "{done:?}"
    );
    let video = task.video().unwrap();
    assert_eq!((video.size, video.sources[0].frames, video.sources[0].held_out_from), ([64, 48], [0, 60], 45));
    assert_eq!(done.metres_per_pixel, Some(f64::from(done.square.side) / 32.0 / 80.0));
    assert_eq!(video.metres_per_pixel(32), done.metres_per_pixel);
    assert!(out.join("contact-sheet.png").exists());
    let train = DatasetFile::read(&out.join("train.npz"), &ClipShape::training(&task)).unwrap();
    let test = DatasetFile::read(&out.join("test.npz"), &ClipShape::test(&task)).unwrap();
    assert_eq!([train.train.dim().0, train.valid.dim().0, test.test.dim().0], done.clips);
    // The program finds the files without being told where they are.
    let config = paig("train").args(["--print-config", "--task"]).arg(out.join("task.toml")).output().unwrap();
    assert_says(&text(&config), &[&format!("folder = {:?}", out.to_str().unwrap()), "train_file = \"train.npz\""]);
    assert_says(&refused_again(&out), &["holds something already", "--force"]);
    imported(&ImportRequest { force: true, grey: true, ..request(&[&path], &out) });
    assert_eq!(tasks::find(out.join("task.toml").to_str().unwrap()).unwrap().system.channels, 1);
}

fn refused_again(out: &Path) -> String {
    format!("{:#}", import(&request(&[&numbered()], out), &|_, _| {}).unwrap_err())
}

/// The level of its upper half tells a frame; below it something moves.
fn levelled(number: usize) -> RgbImage {
    RgbImage::from_fn(64, 64, |x, y| match y {
        0..32 => Rgb([number as u8; 3]),
        _ if (x as usize + number).is_multiple_of(16) => Rgb([255; 3]),
        _ => Rgb([0; 3]),
    })
}

/// The numbers of the frames in each clip of [`levelled`] ones.
fn numbers(clips: &ndarray::Array5<u8>) -> Vec<Vec<usize>> {
    let of_clip = |clip: ndarray::ArrayView4<u8>| clip.outer_iter().map(|it| usize::from(it[[4, 4, 0]])).collect();
    clips.outer_iter().map(of_clip).collect()
}

#[test]
fn held_out_frames_are_later_than_all_training_frames() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("a"), folder.path().join("b"));
    let (a, b) = (pictures(&first, (0..100).map(levelled)), pictures(&second, (100..216).map(levelled)));
    let out = folder.path().join("out");
    let full = ImportRequest { fps: Some(30.0), crop: CropChoice::Full, ..request(&[&a, &b], &out) };
    let done = imported(&full);
    let task = Task::from_toml(&fs::read_to_string(out.join("task.toml")).unwrap()).unwrap();
    assert!((task.system.dt - 1.0 / 30.0).abs() < 1e-9);
    let train = DatasetFile::read(&out.join("train.npz"), &ClipShape::training(&task)).unwrap();
    let test = DatasetFile::read(&out.join("test.npz"), &ClipShape::test(&task)).unwrap();
    let parts = [numbers(&train.train), numbers(&train.valid), numbers(&test.test)];
    assert_eq!(parts.each_ref().map(Vec::len), done.clips);
    for clip in parts.iter().flatten() {
        let follows = clip.windows(2).all(|pair| pair[1] == pair[0] + 1);
        assert!(follows && (clip[0] < 100) == (clip[clip.len() - 1] < 100), "{clip:?} is no part of one video");
    }
    // Of the first video frames 0 to 74 are trained on, of the second 100 to 186.
    for (video, held_out, test_from) in [(0..100, 75, 87), (100..216, 187, 201)] {
        let of_video = |part: &[Vec<usize>]| -> Vec<usize> {
            part.iter().flatten().copied().filter(|number| video.contains(number)).collect()
        };
        let [train, valid, test] = parts.each_ref().map(|part| of_video(part));
        assert_eq!((train.iter().min(), train.iter().max()), (Some(&video.start), Some(&(held_out - 1))));
        assert!(valid.iter().all(|number| (held_out..test_from).contains(number)), "{valid:?}");
        assert!(test.iter().all(|number| *number >= test_from), "{test:?}");
        assert!(!valid.is_empty() && !test.is_empty());
    }
}

#[test]
fn short_throws_of_one_video_are_held_out_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = pictures(&folder.path().join("film"), (0..80).map(levelled));
    let throws = [(0, 14), (14, 30), (32, 46), (50, 64), (66, 80)];
    let parts = throws.map(|(first, end)| VideoPart::Frames(first, Some(end)));
    let plain = ImportRequest { fps: Some(25.0), ..request(&[&path], &folder.path().join("out")) };
    let done = imported(&ImportRequest { parts: parts.to_vec(), crop: CropChoice::Full, ..plain.clone() });
    let task = tasks::find(done.task_file.to_str().unwrap()).unwrap();
    let train = DatasetFile::read(&folder.path().join("out/train.npz"), &ClipShape::training(&task)).unwrap();
    let test = DatasetFile::read(&folder.path().join("out/test.npz"), &ClipShape::test(&task)).unwrap();
    // Every clip lies within one of its part's throws, and every throw has clips.
    let of_throws = |clips: &ndarray::Array5<u8>, throws: &[(usize, usize)]| {
        let clips = numbers(clips);
        let of = |clip: &[usize], (first, end): (usize, usize)| clip.iter().all(|frame| (first..end).contains(frame));
        clips.iter().all(|clip| throws.iter().any(|throw| of(clip, *throw)))
            && throws.iter().all(|throw| clips.iter().any(|clip| of(clip, *throw)))
    };
    assert!(of_throws(&train.train, &throws[..3]), "{:?}", numbers(&train.train));
    assert!(of_throws(&train.valid, &throws[3..4]), "{:?}", numbers(&train.valid));
    assert!(of_throws(&test.test, &throws[4..]), "{:?}", numbers(&test.test));
    let sources = &task.video().unwrap().sources;
    assert!(sources[..3].iter().all(|source| source.is_learned_from() && !source.is_held_out()), "{sources:?}");
    assert!(sources[3..].iter().all(|source| source.is_held_out() && !source.is_learned_from()), "{sources:?}");
    assert_eq!(task.video().unwrap().source_names()[1].split_once(' ').unwrap().1, "14..30");
    // Neither may parts overlap, nor are three throws enough.
    let out = folder.path().join("refused");
    let overlapping = vec![parts[1], VideoPart::Frames(20, Some(40)), parts[3], parts[4]];
    let again = ImportRequest { out, crop: CropChoice::Full, ..plain };
    assert_says(
        &refused(&ImportRequest { parts: overlapping, ..again.clone() }),
        &["14..30 and 20..", "follow each other"],
    );
    assert_says(
        &refused(&ImportRequest { parts: parts[..3].to_vec(), ..again }),
        &["16 frames are too few", "4 throws"],
    );
}

/// The last of five throws is shorter than a clip: of the four that are left the last two are held out. Where too few are left, the
/// refusal says why.
#[test]
fn a_short_last_throw_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = pictures(&folder.path().join("film"), (0..164).map(levelled));
    let parts =
        [(0, 24), (40, 64), (80, 104), (120, 144), (160, 164)].map(|(first, end)| VideoPart::Frames(first, Some(end)));
    let plain =
        ImportRequest { fps: Some(25.0), crop: CropChoice::Full, ..request(&[&path], &folder.path().join("out")) };
    let done = imported(&ImportRequest { parts: parts.to_vec(), ..plain.clone() });
    assert!(done.warnings[0].contains("frames 160..164 are left out; they give 4"), "{:?}", done.warnings);
    let task = tasks::find(done.task_file.to_str().unwrap()).unwrap();
    let sources = &task.video().unwrap().sources;
    assert_eq!(sources.iter().map(|source| source.is_held_out()).collect::<Vec<_>>(), [false, false, true, true]);
    let fewer = ImportRequest { parts: parts[2..].to_vec(), out: folder.path().join("fewer"), ..plain };
    assert_says(&refused(&fewer), &["160..164 are left out", "24 frames are too few", "4 throws"]);
}

/// A part that is shorter than a clip can be neither learned from nor measured: it is in no file, and that is said.
#[test]
fn a_part_that_is_too_short_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = pictures(&folder.path().join("film"), (0..80).map(levelled));
    let parts = vec![VideoPart::Frames(3, Some(63)), VideoPart::Frames(70, Some(74))];
    // Also a single frame, of a video that has times.
    let one = ImportRequest {
        parts: vec![VideoPart::Frames(0, Some(58)), VideoPart::Frames(58, Some(59))],
        ..request(&[&numbered()], &folder.path().join("one"))
    };
    assert!(imported(&one).warnings[0].contains("frames 58..59 are left out"));
    let plain = request(&[&path], &folder.path().join("out"));
    let done = imported(&ImportRequest { parts: parts.clone(), fps: Some(25.0), crop: CropChoice::Full, ..plain });
    assert!(done.warnings[0].contains("frames 70..74 are left out"), "{:?}", done.warnings);
    let task = tasks::find(done.task_file.to_str().unwrap()).unwrap();
    assert_eq!((task.video().unwrap().sources.len(), task.video().unwrap().sources[0].frames), (1, [3, 63]));
    let film = FilmFile::read(&folder.path().join("out/film.npz"), 1, 32, 3).unwrap();
    assert_eq!((film.videos[0].dim().0, film.numbers[0].to_vec()), (60, (3..63).collect()));
    // Nor does its clock count: one frame of the other part is shown longer, all of its own are shown as long.
    let uneven = folder.path().join("uneven.gif");
    let shown = |number: usize| (levelled(number), if number == 30 { 50 } else { 40 });
    gif(&uneven, &(0..80).map(shown).collect::<Vec<_>>());
    let plain = request(&[&uneven], &folder.path().join("uneven"));
    let done = imported(&ImportRequest { parts, crop: CropChoice::Full, ..plain });
    // To the nanosecond, as it is written down.
    assert!((done.interval - (59.0 * 0.04 + 0.01) / 59.0).abs() < 1e-9, "{}", done.interval);
}

#[test]
fn the_proposed_crop_lies_around_the_ball() {
    let folder = tempfile::tempdir().unwrap();
    let noisy = |number: usize| {
        let mut frame = ball(number);
        // Noise as a camera has it: up to 4 levels to either side, the same in every run.
        for (place, pixel) in frame.pixels_mut().enumerate() {
            let noise = (((place * 31 + number * 17) * 2_654_435_761) >> 7) % 9;
            pixel.0.iter_mut().for_each(|level| *level = (*level + noise as u8).saturating_sub(4));
        }
        frame
    };
    let path = pictures(folder.path(), (0..40).map(noisy));
    let small =
        |name: &str| ImportRequest { input_steps: 2, pred_steps: 2, ..request(&[&path], &folder.path().join(name)) };
    let done = imported(&ImportRequest { fps: Some(25.0), ..small("out") });
    // The ball is seen from (16, 46) to (102, 54).
    let square = done.square;
    let (left, right) = (square.x, square.x + i64::from(square.side));
    assert!(left <= 16 && right >= 102 && square.side <= 120 && square.y + i64::from(square.side) >= 54, "{square:?}");
    assert!(done.warnings.iter().all(|warning| !warning.contains('%')), "{done:?}");
    let part = ImportRequest { parts: vec![VideoPart::Frames(0, Some(20))], ..small("part") };
    let fewer = ImportRequest { fps: Some(25.0), input_steps: 1, pred_steps: 1, ..part };
    let square = imported(&fewer).square;
    assert!(square.x <= 16 && square.x + i64::from(square.side) >= 62 && square.side <= 75, "{square:?}");
}

#[test]
fn a_given_rate_replaces_the_times_and_uneven_times_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = numbered();
    let out = |name: &str| folder.path().join(name);
    let slow = ImportRequest { fps: Some(100.0), ..request(&[&path], &out("slow")) };
    let done = imported(&slow);
    assert_eq!((done.takes[0].kept.clock, done.interval), (FrameSpacing::Given, 0.01));
    let steps = ImportRequest {
        step: 2,
        time_unit: "ms".into(),
        input_steps: 1,
        pred_steps: 1,
        ..request(&[&path], &out("ms"))
    };
    assert_eq!(imported(&steps).takes[0].kept.frames.len(), 30);
    let task = Task::from_toml(&fs::read_to_string(out("ms").join("task.toml")).unwrap()).unwrap();
    assert!((task.system.dt - 80.0).abs() < 1e-6);
    // One frame of a gif stands five times as long as the others.
    let uneven = folder.path().join("uneven.gif");
    gif(&uneven, &(0..60).map(|it| (ball(it % 40), if it == 20 { 200 } else { 40 })).collect::<Vec<_>>());
    let done = imported(&request(&[&uneven], &out("uneven")));
    assert_eq!(done.takes[0].kept.clock, FrameSpacing::Resampled { repeated: 4, left_out: 0 });
    assert!(done.warnings.iter().any(|warning| warning.contains("frame rate varies")), "{:?}", done.warnings);
}

/// Two balls that go past each other: each goes 1.5 pixels of a small frame while the encoder sees it, their middle nowhere.
#[test]
fn what_moves_is_followed_ball_by_ball() {
    let folder = tempfile::tempdir().unwrap();
    let two = |frame: usize| {
        RgbImage::from_fn(120, 80, |x, y| {
            let at = |place: f64, height: f64| (f64::from(x) + 0.5 - place).hypot(f64::from(y) + 0.5 - height) < 6.0;
            let shift = 1.9 * frame as f64;
            if at(7.0 + shift, 25.0) || at(113.0 - shift, 55.0) { Rgb([250, 200, 40]) } else { Rgb([60, 60, 60]) }
        })
    };
    let (video, out) = (pictures(folder.path(), (0..56).map(two)), folder.path().join("out"));
    let asked = ImportRequest { fps: Some(25.0), input_steps: 4, ..request(&[&video], &out) };
    let seen = ImportRequest { crop: CropChoice::Full, objects: Some(2), ..asked };
    let made = imported(&seen);
    assert!(!made.warnings.iter().any(|warning| warning.contains("goes only")), "{:?}", made.warnings);
    assert!(!made.warnings.iter().any(|warning| warning.contains("wide as a model")), "{:?}", made.warnings);
    // Lamps that blink where they are are small beside the balls, and say nothing of their way.
    let blinking = |frame: usize| {
        let mut seen = two(frame);
        for (x, y, pixel) in seen.enumerate_pixels_mut() {
            if frame.is_multiple_of(3) && x % 16 < 4 && (4..8).contains(&(y % 24)) {
                *pixel = Rgb([200, 200, 200]);
            }
        }
        seen
    };
    let lamps = pictures(&folder.path().join("lamps"), (0..56).map(blinking));
    let made = imported(&ImportRequest { out: folder.path().join("lamps-out"), videos: vec![lamps], ..seen.clone() });
    assert!(!made.warnings.iter().any(|warning| warning.contains("goes only")), "{:?}", made.warnings);
    // As large, but so slow that a frame of 32 pixels hardly shows it; and a dot.
    let slow = pictures(&folder.path().join("slow"), (0..56).map(|frame| two(frame / 8)));
    let made = imported(&ImportRequest { out: folder.path().join("slow-out"), videos: vec![slow], ..seen.clone() });
    assert!(made.warnings.iter().any(|warning| warning.contains("goes only")), "{:?}", made.warnings);
    let dot = |frame: usize| {
        RgbImage::from_fn(120, 80, |x, y| {
            if x as usize / 4 == 4 + frame / 3 && y / 4 == 10 { Rgb([250, 200, 40]) } else { Rgb([60, 60, 60]) }
        })
    };
    let dots = pictures(&folder.path().join("dots"), (0..56).map(dot));
    let made = imported(&ImportRequest { out: folder.path().join("dots-out"), videos: vec![dots], ..seen });
    assert!(made.warnings.iter().any(|warning| warning.contains("wide as a model")), "{:?}", made.warnings);
}

const TRK: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
    <property name="clipcontrol" type="object">
    <object class="org.opensourcephysics.media.core.StepperClipControl">
        <property name="delta_t" type="double">8.333333333333334</property>
    </object>
    </property>
    <property name="coords" type="object">
    <object class="org.opensourcephysics.media.core.ImageCoordSystem">
        <property name="fixedorigin" type="boolean">true</property>
        <property name="framedata" type="array" class="[Lorg.opensourcephysics.media.core.ImageCoordSystem$FrameData;">
            <property name="[0]" type="object">
            <object class="org.opensourcephysics.media.core.ImageCoordSystem$FrameData">
                <property name="xorigin" type="double">120.5</property>
                <property name="yorigin" type="double">300.0</property>
                <property name="angle" type="double">-2.5</property>
                <property name="xscale" type="double">512.25</property>
                <property name="yscale" type="double">512.25</property>
            </object>
            </property>
        </property>
    </object>
    </property>
</object>
"#;

#[test]
fn tracker_files_give_scale_axes_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let plain = folder.path().join("clip.trk");
    fs::write(&plain, TRK).unwrap();
    let file = TrackerFile::read(&plain).unwrap();
    assert_eq!((file.pixels_per_metre, file.origin, file.angle), (512.25, [120.5, 300.0], -2.5));
    assert!((file.fps.unwrap() - 120.0).abs() < 1e-9);
    let zipped = folder.path().join("clip.trz");
    let mut archive = zip::ZipWriter::new(File::create(&zipped).unwrap());
    archive.start_file("clip.trk", zip::write::SimpleFileOptions::default()).unwrap();
    std::io::Write::write_all(&mut archive, TRK.as_bytes()).unwrap();
    archive.finish().unwrap();
    assert_eq!(TrackerFile::read(&zipped).unwrap(), file);
    for (here, there, word) in [
        ("512.25</property>\n            </object>", "3</property>\n            </object>", "must be square"),
        ("\"xscale\"", "\"scale\"", "no xscale"),
        ("512.25", "much", "not a number"),
        ("8.333333333333334", "0", "delta_t"),
        ("</object>", "", "XML"),
    ] {
        assert_says(&format!("{:#}", TrackerFile::parse(&TRK.replace(here, there)).unwrap_err()), &[word]);
    }
}

#[test]
fn what_cannot_be_imported_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (numbered(), folder.path().join("out"));
    let plain = || request(&[&path], &out);
    let outside = CropChoice::Rectangle(CropRectangle { x: 40, y: 0, width: 30, height: 30 });
    assert_says(&refused(&ImportRequest { crop: outside, ..plain() }), &["40,0,30,30", "64 x 48"]);
    assert_says(
        &refused(&ImportRequest { parts: vec![VideoPart::Frames(30, Some(70))], ..plain() }),
        &["30..70", "it has 60"],
    );
    assert_says(
        &refused(&ImportRequest { parts: vec![VideoPart::Frames(0, Some(20))], ..plain() }),
        &["20 frames are too few"],
    );
    // 2^54 frames of 3072 bytes are 0 bytes where numbers wrap around at 2^64.
    for frames in [1 << 54, usize::MAX] {
        let long = ImportRequest { clip_frames: Some(frames), ..plain() };
        assert_says(&refused(&long), &[&format!("60 frames are too few for clips of {frames}")]);
    }
    assert_says(&refused(&ImportRequest { side: 50, ..plain() }), &["side = 50", "48"]);
    assert_says(
        &refused(&ImportRequest { equation: EquationEntry::Name("fall".into()), ..plain() }),
        &["\"fall\"", "falling"],
    );
    let own = folder.path().join("own.toml");
    let text =
        "[system.equation]\nacceleration = \"-score * p\"\n[system.equation.parameters]\nscore = { unit = [0, -2] }\n";
    fs::write(&own, text).unwrap();
    let equation = EquationFile::read(&own).unwrap().equation;
    assert_says(&refused(&ImportRequest { equation, ..plain() }), &["equation", "score", "another name"]);
    assert_says(&refused(&ImportRequest { name: Some("pendulum".into()), ..plain() }), &["pendulum", "--name"]);
    assert_says(
        &refused(&ImportRequest { name: Some("My Scene".into()), ..plain() }),
        &["--name: task name \"My Scene\": 1 to 64"],
    );
    let foreign = request(&[&path], &folder.path().join("実験"));
    assert_says(&refused(&foreign), &["the folder --out makes no task's name", "--name", "a-z"]);
    assert_says(&refused(&request(&[&folder.path().join("none.mp4")], &out)), &["none.mp4", "no such file"]);
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    assert_says(&refused(&request(&[&empty], &out)), &["no png or jpeg"]);
    let still = pictures(&folder.path().join("still"), (0..60).map(|_| ball(0)));
    assert_says(&refused(&request(&[&still], &out)), &["--fps"]);
    assert_says(&refused(&ImportRequest { fps: Some(25.0), ..request(&[&still], &out) }), &["nothing moves"]);
    let full = ImportRequest { fps: Some(25.0), crop: CropChoice::Full, ..request(&[&still], &out) };
    assert_says(&refused(&full), &["nothing moves"]);
    let sizes = pictures(&folder.path().join("sizes"), (0..60).map(ball).chain([RgbImage::new(60, 40)]));
    assert_says(&refused(&ImportRequest { fps: Some(25.0), ..request(&[&sizes], &out) }), &["f60.png", "60 x 40"]);
    let same =
        ImportRequest { fps: Some(25.0), ..request(&[&still, &folder.path().join("empty/../still/pictures")], &out) };
    assert_says(&refused(&same), &["empty/../still/pictures", "given twice"]);
    let two = ImportRequest { fps: Some(25.0), ..request(&[&path, &still], &out) };
    assert_says(&refused(&two), &["120 x 80", "64 x 48"]);
}

/// What is imported is never written over, whatever `--force` allows.
#[test]
fn videos_are_not_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("exp");
    let path = pictures(&place, (0..60).map(ball));
    let into_itself = ImportRequest { fps: Some(25.0), force: true, ..request(&[&path], &path) };
    assert_says(&refused(&into_itself), &["would be written over", "another --out"]);
    fs::copy(numbered(), place.join("film.npz")).unwrap();
    let over = ImportRequest { force: true, ..request(&[&place.join("film.npz")], &place) };
    assert_says(&refused(&over), &["exp/film.npz would be written over"]);
    // One that may stay there.
    fs::remove_file(place.join("film.npz")).unwrap();
    fs::copy(numbered(), place.join("clip.mp4")).unwrap();
    imported(&ImportRequest { force: true, ..request(&[&place.join("clip.mp4")], &place) });
    assert!(place.join("clip.mp4").exists() && place.join("film.npz").exists());
}

/// The options reach the task file, and the summary says what was used.
#[test]
fn the_program_says_what_it_made() {
    let folder = tempfile::tempdir().unwrap();
    let (tracker, out) = (folder.path().join("clip.trk"), folder.path().join("out"));
    fs::write(&tracker, TRK).unwrap();
    let mut program = paig("import");
    program.arg(numbered()).arg("--out").arg(&out).arg("--tracker").arg(&tracker);
    program.args(["--crop", "0,24,64,24", "--frames", "2..", "--fps", "50", "--input-steps", "2", "--pred-steps", "2"]);
    let output = program.args(["--equation", "spring", "--angle", "5", "--dt-unit", "frames"]).output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    let said = text(&output);
    assert_says(&said, &["numbered.mp4: 60 frames of 64 x 48, 50.000 a second, as given; kept 58", "equation spring"]);
    assert_says(&said, &["crop 64 x 64 from (0, -8)", "scale 0.003904 m", "paig train --task"]);
    let task = tasks::find(out.join("task.toml").to_str().unwrap()).unwrap();
    let video = task.video().unwrap();
    assert_eq!((task.system.objects, task.system.dt, video.frame_seconds), (2, 1.0, 0.02));
    assert_eq!((video.origin, video.angle, video.y_up), (Some([120.5, 300.0]), 5.0, true));
    assert_eq!((video.pixels_per_metre, video.sources[0].frames), (Some(512.25), [2, 60]));
}

/// Runs the program, which must fail, and returns what it said: one line, and no panic.
#[track_caller]
fn said(program: &mut Command) -> String {
    let output = program.output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.starts_with("error: ") && said.trim_end().lines().count() == 1, "{said}");
    said
}

#[test]
fn options_that_cannot_be_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    for (option, value, words) in [
        ("--crop", "1,2,3", ["--crop \"1,2,3\"", "X,Y,WIDTH,HEIGHT"]),
        ("--scale", "1,2", ["--scale \"1,2\"", "5 numbers"]),
        ("--scale", "1,2,1,2,3", ["--scale", "must differ"]),
        ("--origin", "a,b", ["--origin \"a,b\"", "2 numbers"]),
        ("--frames", "7", ["--frames \"7\"", "START..END"]),
        ("--seconds", "9..12", ["numbered.mp4", "the last at 2.360 s"]),
        ("--fps", "0", ["--fps", "positive"]),
        ("--clip-frames", "0", ["--clip-frames", "0"]),
        ("--tracker", "none.trk", ["none.trk", "No such file"]),
    ] {
        let mut program = paig("import");
        let out = folder.path().join("out");
        assert_says(&said(program.arg(numbered()).arg("--out").arg(out).args([option, value])), &words);
    }
}

/// HEVC, as phones record it, is decoded without ffmpeg: the first frames of the film of H.264.
#[test]
fn hevc_is_decoded_as_h264_is() {
    let video = SourceVideo::open(&project("tests/data/numbered_hevc.mp4")).unwrap();
    assert_eq!((video.width, video.height), (64, 48));
    let mut frames = video.decode().unwrap();
    let shown: Vec<_> = (0..video.frames).map(|place| number(&frames.frame(place).unwrap())).collect();
    assert_eq!(shown, (0..video.frames).collect::<Vec<_>>());
}

#[test]
fn a_codec_without_a_decoder_is_named_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = fs::read(numbered()).unwrap();
    let entry = bytes.windows(4).rposition(|name| name == b"avc1").unwrap();
    bytes[entry..entry + 4].copy_from_slice(b"SVQ3");
    for (name, bytes) in [("clip.mp4", &bytes[..]), ("clip.avi", b"no film")] {
        let video = folder.path().join(name);
        fs::write(&video, bytes).unwrap();
        let mut program = paig("import");
        program.arg(video).arg("--out").arg(folder.path().join("out")).env("PATH", "");
        assert_says(&said(&mut program), &[name, "is not decoded here", "install ffmpeg"]);
    }
}

/// What only ffmpeg decodes comes from it: a program of that name lists 60 frames at 20 a second, then gives their pixels; of
/// another file it complains in two lines, of which the last is the reason.
#[test]
fn other_films_are_decoded_by_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let list = (0..60).map(|frame| format!("0, {frame}, {frame}, 1, 28800, 0x0\n")).collect::<String>();
    fs::write(place("list"), format!("#tb 0: 1/20\n#dimensions 0: 120x80\n{list}")).unwrap();
    fs::write(place("pixels"), (0..60).flat_map(|frame| ball(frame).into_raw()).collect::<Vec<_>>()).unwrap();
    fs::create_dir(place("bin")).unwrap();
    let script = format!(
        "#!/bin/sh\ncase \"$*\" in\n*broken*) echo first >&2; echo reason >&2; exit 1;;\n\
         *torn*framecrc*) echo torn off >&2; exec /bin/cat {0}/list;;\n\
         *framecrc*) exec /bin/cat {0}/list;;\n*rawvideo*) echo >>{0}/passes; exec /bin/cat {0}/pixels;;\nesac\n",
        folder.path().display()
    );
    fs::write(place("bin/ffmpeg"), script).unwrap();
    fs::set_permissions(place("bin/ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let program = |film: &str| {
        fs::write(place(film), "no film").unwrap();
        let mut program = paig("import");
        program.arg(place(film)).arg("--out").arg(place("out")).env("PATH", place("bin"));
        program.args(["--input-steps", "2", "--pred-steps", "2", "--clip-frames", "6"]);
        program
    };
    assert_says(&said(&mut program("broken.avi")), &["ffmpeg cannot read it: reason"]);
    let output = program("clip.avi").output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    assert_says(&text(&output), &["clip.avi: 60 frames of 120 x 80, 20.000 a second"]);
    assert!(place("out/train.npz").exists());
    // What it reads over is told.
    let output = program("torn.avi").args(["--force", "--origin", "-20,300"]).output().unwrap();
    assert_says(&text(&output), &["warning: torn.avi: ffmpeg says \"torn off\""]);
    let video = tasks::find(place("out/task.toml").to_str().unwrap()).unwrap().video().unwrap().clone();
    assert_eq!(video.origin, Some([-20.0, 300.0]));
    assert_eq!(video.sources[0].file, place("torn.avi").to_str().unwrap());
    // Of several throws, too, all are decoded in one pass for the crop and in one for the frames.
    fs::remove_file(place("passes")).unwrap();
    let mut throws = program("clip.avi");
    let output = throws.args(["--force", "--frames", "0..14,15..29,30..44,45..60"]).output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    assert_eq!(fs::read_to_string(place("passes")).unwrap(), "\n\n");
}

/// Cut off anywhere, or with bytes changed, a film ends in an error or in frames, and soon.
#[test]
fn damaged_films_are_no_more_than_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = (folder.path().join("damaged.mp4"), fs::read(numbered()).unwrap());
    let decode = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let Ok(video) = SourceVideo::open(&path) else { return 0 };
        let mut frames = video.decode().unwrap();
        (0..video.frames).take_while(|number| frames.frame(*number).is_ok()).count()
    };
    assert_eq!(decode(&bytes), 60);
    for length in (0..bytes.len()).step_by(41) {
        assert_eq!(decode(&bytes[..length]), 0, "cut off at {length}");
    }
    fs::write(&path, &bytes[..bytes.len() - 100]).unwrap();
    assert_says(&format!("{:#}", SourceVideo::open(&path).unwrap_err()), &["cut off", "of its 60 frames"]);
    for place in (0..bytes.len()).step_by(37) {
        for value in [0, 127, 255] {
            let mut damaged = bytes.clone();
            damaged[place] = value;
            decode(&damaged);
        }
    }
    // Boxes without a size: the next one begins where they do, for ever.
    for name in [b"tkhd", b"mdia", b"stbl", b"avc1"] {
        let place = bytes.windows(4).rposition(|it| it == name).unwrap();
        let mut endless = bytes.clone();
        endless[place - 4..place + 4].copy_from_slice(b"\0\0\0\0none");
        assert_eq!(decode(&endless), 0);
    }
    // A box that claims 2^62 bytes, for which room would be made.
    let mut huge = bytes.clone();
    let place = bytes.windows(4).rposition(|it| it == b"avcC").unwrap();
    huge[place - 4..place].copy_from_slice(&[0, 0, 0, 1]);
    huge[place + 4..place + 12].copy_from_slice(&(1u64 << 62).to_be_bytes());
    assert_eq!(decode(&huge), 0);
    // A header that claims a frame of 65535 pixels, and one that claims four thousand million frames of one size.
    let mut wide = bytes.clone();
    let entry = bytes.windows(4).rposition(|name| name == b"avc1").unwrap() + 4;
    wide[entry + 24..entry + 28].copy_from_slice(&[255; 4]);
    fs::write(&path, wide).unwrap();
    assert_says(&format!("{:#}", SourceVideo::open(&path).unwrap_err()), &["65535 x 65535", "8192"]);
    let mut many = bytes.clone();
    let sizes = bytes.windows(4).position(|name| name == b"stsz").unwrap() + 4;
    many[sizes + 4..sizes + 12].copy_from_slice(&[0, 0, 0, 1, 255, 255, 255, 255]);
    fs::write(&path, many).unwrap();
    assert_says(&format!("{:#}", SourceVideo::open(&path).unwrap_err()), &["it has 4294967295 frames", "at most"]);
}

#[test]
fn an_equation_as_text_stands_in_the_new_task() {
    let folder = tempfile::tempdir().unwrap();
    let (video, out) = (pictures(folder.path(), (0..48).map(ball)), folder.path().join("out"));
    let gallery = project("configs/gallery/fall_linear_drag.toml");
    let drag = tasks::find(gallery.to_str().unwrap()).unwrap().system;
    let equation = EquationFile::read(&gallery).unwrap().equation;
    let made = imported(&ImportRequest { fps: Some(10.0), equation, ..request(&[&video], &out) });
    let task = tasks::find(made.task_file.to_str().unwrap()).unwrap();
    assert_eq!(task.system.cell, drag.cell);
    assert_eq!((task.system.dt, task.system.side), (0.1, 32));
}

/// A file for `--equation` need say no more than the equation; what it says wrongly is named.
#[test]
fn an_equation_stands_alone_in_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("own.toml");
    let text = "[system.equation]\nacceleration = \"-k * p\"\n[system.equation.parameters]\nk = { unit = [0, -2] }\n";
    fs::write(&file, text).unwrap();
    let read = EquationFile::read(&file).unwrap();
    assert_eq!(read.objects, None);
    assert_eq!(read.equation.kind(1, &Equations::default()).unwrap().parameters[0].name, "k");
    fs::write(&file, text.replace("acceleration", "acelleration")).unwrap();
    assert_says(&format!("{:#}", EquationFile::read(&file).unwrap_err()), &["own.toml", "acelleration"]);
    fs::write(&file, "[system]\nside = 32\n").unwrap();
    assert_says(&format!("{:#}", EquationFile::read(&file).unwrap_err()), &["own.toml", "equation"]);
}

/// An equation that names the time is told when each frame of a clip was filmed, counted from its take's first frame.
#[test]
fn clips_know_their_time_where_the_equation_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let (video, out) = (pictures(folder.path(), (0..200).map(levelled)), folder.path().join("out"));
    let gallery = project("configs/gallery/driven_pendulum.toml");
    let equation = EquationFile::read(&gallery).unwrap().equation;
    let takes = [(3, 103), (110, 200)];
    let parts = takes.map(|(first, end)| VideoPart::Frames(first, Some(end))).to_vec();
    let asked = request(&[&video], &out);
    let made = imported(&ImportRequest { fps: Some(25.0), step: 2, crop: CropChoice::Full, equation, parts, ..asked });
    let task = tasks::find(made.task_file.to_str().unwrap()).unwrap();
    let train = DatasetFile::read(&out.join("train.npz"), &ClipShape::training(&task)).unwrap();
    let test = DatasetFile::read(&out.join("test.npz"), &ClipShape::test(&task)).unwrap();
    let mut clips = 0;
    for (file, split) in [(&train, Split::Train), (&train, Split::Valid), (&test, Split::Test)] {
        for (clip, times) in numbers(file.split(split)).iter().zip(file.actions(split).unwrap().outer_iter()) {
            let (first, _) = takes.into_iter().find(|(first, end)| (*first..*end).contains(&clip[0])).unwrap();
            let expected: Vec<_> = clip.iter().map(|number| ((number - first) as f64 / 25.0) as f32).collect();
            for (time, expected) in times.iter().zip(&expected) {
                assert!((time - expected).abs() < 1e-5, "{times} of frames {clip:?}");
            }
            clips += 1;
        }
    }
    assert_eq!(clips, made.clips.iter().sum::<usize>());
}

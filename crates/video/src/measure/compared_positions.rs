//! Where the objects are in every frame of a film: by the encoder, and by the centroids of its masks.

use anyhow::Result;
use tch::{Device, Kind, Tensor};

use super::recording::Positions;
use paig::datasets::film::FilmFile;
use paig::datasets::iterators::Clips;
use paig::network::cells::Coordinates;
use paig::network::physics_models::{PhysicsNet, naming};
use paig::training::identify::encoded_positions::EncodedPositions;
use paig::training::objects::motion::MotionDetector;

/// Frames that the network sees at a time.
const FRAMES_AT_ONCE: usize = 200;

/// Both measures of one video.
#[derive(Debug)]
pub struct ComparedPositions {
    /// By the encoder (without what it is always beside the centroids) and by the centroids.
    pub encoded: Positions,
    pub centroids: Positions,
}

/// Looks at a video. `train` tells what stands behind the objects.
///
/// # Errors
/// A video that is shorter than a clip.
pub fn look(model: &PhysicsNet, train: &Clips, film: &FilmFile, video: usize, seed: u64) -> Result<ComparedPositions> {
    let _guard = tch::no_grad_guard();
    let (frames, length) = (film.videos[video].dim().0, train.time());
    let clips = film.clips(video, length, model.variables.device())?;
    let motion = MotionDetector::measure(train, seed);
    let seen = EncodedPositions::of(model, &clips, &motion, clips.len(), (FRAMES_AT_ONCE / length).max(1));
    let whole = |clips: &Tensor| {
        // The last clip shares frames with the one before.
        let flat = clips.flatten(0, 1);
        let shared = flat.size()[0] - frames as i64;
        let before = (clips.size()[0] - 1) * length as i64;
        Tensor::cat(&[flat.narrow(0, 0, before), flat.narrow(0, before + shared, length as i64 - shared)], 0)
            .unsqueeze(0)
    };
    let (encoded, centroids) = (whole(&seen.encoded), whole(&seen.centroids));
    let several = model.system.objects > 1 && model.system.cell.coordinates == Coordinates::Position;
    let (encoded, centroids) = match several.then(|| model.decoder.unlike()).flatten() {
        Some(unlike) => {
            let order = naming::follow(&centroids, &unlike, frames).order;
            (naming::renamed(&encoded, &order), naming::renamed(&centroids, &order))
        }
        None => (encoded, centroids),
    };
    Ok(ComparedPositions { encoded: positions(model, &encoded), centroids: positions(model, &centroids) })
}

/// Of `[1, frames, 2 * objects]`, in the model's unit.
fn positions(model: &PhysicsNet, seen: &Tensor) -> Positions {
    let numbers = |x: Tensor| -> Vec<f64> {
        x.to_device(Device::Cpu).to_kind(Kind::Double).flatten(0, -1).try_into().expect("float64 numbers")
    };
    let coordinates = model.clip_coordinates(seen) * model.length_per_unit();
    Positions::even(numbers(seen * model.pixels_per_unit()), numbers(coordinates))
}

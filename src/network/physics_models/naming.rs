//! Names of objects within a clip, by continuity.
//!
//! The encoder sees one frame at a time: of two objects that look alike it may call one the first in this frame and the
//! second in the next. Within a clip a name follows the path that changes its velocity least. Objects that look
//! different keep the encoder's names: what it would cost to draw one in the other's place is added. Not in the original.

use tch::{Device, Kind, Tensor};

/// Squared pixels of a path's bend that one unit of squared error in the picture outweighs.
const LOOKS: f64 = 4.0;
/// A bend larger than this many pixels (a bounce) counts linearly.
const BOUNCE: f64 = 2.0;
/// Sweeps over a clip, at most.
const SWEEPS: usize = 20;
/// A change of names must save more than this, squared pixels.
const LEAST_GAIN: f64 = 1e-6;

/// Which of the encoder's objects bears each name.
#[derive(Debug)]
pub struct Naming {
    /// `[batch, time, objects]`, int64; in the first frame the encoder's own order.
    pub order: Tensor,
    /// Clips in which names change.
    pub changed: usize,
}

/// Names the objects at positions `[batch, time, 2 * objects]` (pixels). `unlike`: squared error of drawing each object in
/// the place of each other. The names in the first `input` frames do not depend on what comes after.
pub fn follow(positions: &Tensor, unlike: &[Vec<f64>], input: usize) -> Naming {
    let (batch, time) = (positions.size()[0] as usize, positions.size()[1] as usize);
    let objects = unlike.len();
    let flat: Vec<f64> =
        positions.detach().to_device(Device::Cpu).to_kind(Kind::Double).flatten(0, 2).try_into().expect("numbers");
    let mut order = Vec::with_capacity(batch * time * objects);
    let mut changed = 0;
    for clip in flat.chunks(time * objects * 2) {
        let mut names: Vec<Vec<usize>> = vec![(0..objects).collect(); time];
        for (time, from) in [(input.min(time), 1), (time, input)] {
            NamePath { clip, objects, time, unlike }.smooth(&mut names, from);
        }
        changed +=
            usize::from(names.iter().any(|frame| frame.iter().enumerate().any(|(name, object)| name != *object)));
        order.extend(names.into_iter().flatten().map(|object| object as i64));
    }
    let order = Tensor::from_slice(&order).reshape([batch as i64, time as i64, objects as i64]);
    Naming { order: order.to_device(positions.device()), changed }
}

/// Positions `[batch, time, 2 * objects]` in the order of the names.
pub fn renamed(positions: &Tensor, order: &Tensor) -> Tensor {
    let size = positions.size();
    let index = order.unsqueeze(3).expand([-1, -1, -1, 2], false);
    positions.reshape([size[0], size[1], -1, 2]).gather(2, &index, false).flatten(2, 3)
}

struct NamePath<'a> {
    /// `(x, y)` of each object in each frame.
    clip: &'a [f64],
    objects: usize,
    time: usize,
    unlike: &'a [Vec<f64>],
}

impl NamePath<'_> {
    fn at(&self, frame: usize, object: usize) -> [f64; 2] {
        let place = 2 * (frame * self.objects + object);
        [self.clip[place], self.clip[place + 1]]
    }

    /// Lets the paths bend less: changes of two names from a frame on (`from` or later), or in one frame, are taken as long
    /// as one of them pays.
    fn smooth(&self, names: &mut [Vec<usize>], from: usize) {
        for _ in 0..SWEEPS {
            let mut better = false;
            for frame in from.max(1)..self.time {
                for b in 1..self.objects {
                    for a in 0..b {
                        // From this frame on, then in this frame alone.
                        for until in [names.len(), frame + 1] {
                            let before = self.cost(names, a) + self.cost(names, b);
                            names[frame..until].iter_mut().for_each(|names| names.swap(a, b));
                            if self.cost(names, a) + self.cost(names, b) < before - LEAST_GAIN {
                                better = true;
                            } else {
                                names[frame..until].iter_mut().for_each(|names| names.swap(a, b));
                            }
                        }
                    }
                }
            }
            if !better {
                break;
            }
        }
    }

    /// How much a name's path bends, and how unlike the first the objects on it look.
    fn cost(&self, names: &[Vec<usize>], name: usize) -> f64 {
        let place = |frame: usize| self.at(frame, names[frame][name]);
        let bends = (2..self.time).map(|frame| {
            let [before, now, next] = [place(frame - 2), place(frame - 1), place(frame)];
            let bend = (next[0] - 2.0 * now[0] + before[0]).hypot(next[1] - 2.0 * now[1] + before[1]);
            if bend < BOUNCE { bend.powi(2) } else { BOUNCE * (2.0 * bend - BOUNCE) }
        });
        let looks = (0..self.time).map(|frame| LOOKS * self.unlike[name][names[frame][name]]);
        // Of two frames the way between them is all there is.
        let way = if self.time == 2 {
            let [a, b] = [place(0), place(1)];
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        } else {
            0.0
        };
        bends.sum::<f64>() + looks.sum::<f64>() + way
    }
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::support::random::named_generator;

    /// Two objects on straight paths that cross, called by who is higher.
    fn by_height(frames: i64) -> (Tensor, Tensor) {
        let paths: Vec<f64> = (0..frames)
            .flat_map(|t| {
                let t = t as f64;
                [5.0 + 2.0 * t, 8.0 + 1.5 * t, 22.0 - 1.0 * t, 16.0 - 1.0 * t]
            })
            .collect();
        let truth = Tensor::from_slice(&paths).reshape([1, frames, 2, 2]);
        let order = truth.select(3, 1).argsort(2, false);
        let seen = truth.gather(2, &order.unsqueeze(3).expand([-1, -1, -1, 2], false), false);
        (truth.flatten(2, 3), seen.flatten(2, 3))
    }

    #[test]
    fn objects_that_look_alike_keep_their_names_where_their_paths_cross() {
        let (truth, seen) = by_height(8);
        assert!(seen != truth);
        let naming = follow(&seen, &[vec![0.0, 0.0], vec![0.0, 0.0]], 8);
        assert_eq!(naming.changed, 1);
        assert_eq!(renamed(&seen, &naming.order), truth);
    }

    #[test]
    fn objects_that_look_different_keep_the_encoders_names() {
        let (_, seen) = by_height(8);
        let naming = follow(&seen, &[vec![0.0, 50.0], vec![50.0, 0.0]], 8);
        assert_eq!(naming.changed, 0);
        assert_eq!(renamed(&seen, &naming.order), seen);
    }

    /// Of paths without any order nearly every later frame would have something to say on the names before it.
    #[test]
    fn names_in_the_input_do_not_depend_on_what_comes_after() {
        let mut random = named_generator(1, "paths");
        let paths: Vec<f64> = (0..50 * 10 * 6).map(|_| random.random_range(0.0..32.0)).collect();
        let (seen, unlike) = (Tensor::from_slice(&paths).reshape([50, 10, 6]), vec![vec![0.0; 3]; 3]);
        let alone = follow(&seen.narrow(1, 0, 4), &unlike, 4);
        assert!(alone.changed > 25, "names change in {} of 50 clips: the test would show nothing", alone.changed);
        assert_eq!(follow(&seen, &unlike, 4).order.narrow(1, 0, 4), alone.order);
    }
}

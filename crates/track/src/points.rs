//! Points of a track from registrations and regions.

use crate::candidates::PathCandidate;
use crate::detection::Detection;
use crate::quality::jitter;
use crate::registration::Registration;
use crate::start::ExpectedPath;
use crate::statistics::{median, scale_about_zero};
use crate::track::{Method, Point, TrackPoint, Visibility};

/// Least contrast, relative to the template, of a visible object.
const LEAST_CONTRAST: f64 = 0.4;
/// Largest misfit of a visible object.
const MOST_MISFIT: f64 = 0.6;
/// Share of the template inside the frame below which an object is cut off.
const WHOLE: f64 = 0.97;
/// Least share of the template inside the frame that gives a position.
const LEAST_INSIDE: f64 = 0.4;
/// Share of the regions in which the template is seen, below which all positions are centroids.
const RIGID: f64 = 0.4;
/// Fewest differences that give the jitter of centroids.
const LEAST_DIFFERENCES: usize = 5;
/// Least standard deviation of a centroid, pixels.
const LEAST_DEVIATION: f64 = 0.1;

/// Points of all frames, and the median distance of template and centroid, pixels.
pub(crate) fn points(
    detections: &[Detection],
    candidate: &PathCandidate,
    course: &ExpectedPath,
    fits: &[Option<Registration>],
) -> (Vec<Point>, f64) {
    let seen =
        |fit: &Registration| fit.contrast > LEAST_CONTRAST && fit.misfit < MOST_MISFIT && fit.inside > LEAST_INSIDE;
    let frames = course.frames();
    let has_region = |frame: usize| candidate.nodes.iter().any(|node| detections[node.0].frame == frame);
    let good: Vec<([f64; 2], &Registration)> = course
        .positions
        .iter()
        .zip(fits)
        .zip(frames.clone())
        .filter(|(_, frame)| has_region(*frame))
        .filter_map(|((start, fit), _)| fit.as_ref().filter(|fit| seen(fit)).map(|fit| (*start, fit)))
        .collect();
    // Without a common look, as of an object that tumbles or changes its blur, centroids serve in all frames.
    let rigid = good.len() as f64 >= RIGID * candidate.nodes.len() as f64;
    let offset = [0, 1].map(|axis| {
        let mut values: Vec<f64> = good.iter().map(|(start, fit)| fit.position[axis] - start[axis]).collect();
        if rigid { median(&mut values).unwrap_or(0.0) } else { 0.0 }
    });
    let starts: Vec<Option<[f64; 2]>> =
        frames.clone().zip(&course.positions).map(|(frame, start)| has_region(frame).then_some(*start)).collect();
    let jitter = jitter(&starts, LEAST_DIFFERENCES);
    let deviation = [0, 1].map(|axis| {
        let values = good.iter().map(|(start, fit)| fit.position[axis] - start[axis] - offset[axis]);
        let scale = if rigid { scale_about_zero(values) } else { jitter.map(|jitter| jitter[axis]) };
        scale.unwrap_or(0.2 * candidate.diameter).max(LEAST_DEVIATION)
    });
    let mut distances: Vec<f64> = good
        .iter()
        .map(|(start, fit)| (fit.position[0] - start[0] - offset[0]).hypot(fit.position[1] - start[1] - offset[1]))
        .collect();
    let disagreement = median(&mut distances).unwrap_or(f64::NAN);
    let mut ratios: Vec<f64> = good.iter().map(|(_, fit)| fit.correlation).collect();
    let correlation = median(&mut ratios).unwrap_or(1.0).max(1.0);
    let point = |detection: &Detection| {
        let frame = detection.frame;
        let mut point = Point {
            frame,
            visibility: Visibility::Absent,
            measurement: None,
            centroid: None,
            misfit: None,
            contrast: None,
            diameter: None,
        };
        if !frames.contains(&frame) {
            return point;
        }
        let start = course.positions[frame - frames.start];
        let fit = fits[frame - frames.start].as_ref();
        point.centroid = has_region(frame).then_some(start);
        let region = candidate.nodes.iter().find(|node| detections[node.0].frame == frame);
        point.diameter = region.map(|&(index, blob)| detections[index].blobs[blob].0.diameter());
        point.misfit = fit.map(|fit| fit.misfit);
        point.contrast = fit.map(|fit| fit.contrast);
        point.visibility = Visibility::Occluded;
        if let Some(fit) = fit.filter(|fit| rigid && seen(fit)) {
            let covariance = fit.covariance * correlation;
            point.visibility = if fit.inside < WHOLE { Visibility::CutOff } else { Visibility::Visible };
            point.measurement = Some(TrackPoint {
                position: fit.position,
                covariance: [[covariance[(0, 0)], covariance[(0, 1)]], [covariance[(1, 0)], covariance[(1, 1)]]],
                method: Method::Template,
            });
        } else if has_region(frame) && (!rigid || course.typical[frame - frames.start]) {
            point.visibility = Visibility::Visible;
            point.measurement = Some(TrackPoint {
                position: [start[0] + offset[0], start[1] + offset[1]],
                covariance: [[deviation[0].powi(2), 0.0], [0.0, deviation[1].powi(2)]],
                method: Method::Centroid,
            });
        }
        point
    };
    (detections.iter().map(point).collect(), disagreement)
}

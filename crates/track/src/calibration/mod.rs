//! From pixels to metres: a plane seen at an angle, the lens, and whether the scale depends on depth.

mod depth;
mod lens;
mod plane;

pub use depth::depth_line;
pub use lens::Lens;
pub use plane::MotionPlane;

/// Reasons why a calibration is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// The sides of a rectangle are its measure.
    #[error("expected a rectangle with positive sides, found {width} x {height} m")]
    Sides { width: f64, height: f64 },
    /// The corners of a rectangle seen from its front go round a convex quadrilateral.
    #[error("expected four corners in order around the rectangle, found a shape that is not convex")]
    Corners,
    /// Each pixel is to show a place of its own.
    #[error(
        "expected a coefficient of distortion between -1 and 1, found {coefficient:?}, which folds the picture over at \
         {radius:.3} of its half diagonal"
    )]
    Folded { coefficient: f64, radius: f64 },
    /// A plane seen from its edge shows no place in it.
    #[error(
        "expected a rectangle of {width:?} x {height:?} m, found corners of another shape: a pixel would be more than {most} times \
         as long one way as the other; check its width and height"
    )]
    EdgeOn { width: f64, height: f64, most: f64 },
    /// A straight line needs points to show its bend.
    #[error("expected at least {least} points on each line, found {found}")]
    FewPoints { least: usize, found: usize },
    /// Lines through the middle of the picture stay straight in any lens.
    #[error("the lines do not show the distortion: choose long ones near the border of the picture")]
    Unidentifiable,
}

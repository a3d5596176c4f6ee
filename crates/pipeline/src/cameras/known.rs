//! User constraints on a camera. They are evidence like any other, as factors of [`roadplane_calibrate`].

mod camera_file;
mod check;
mod frames;
mod measured;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector2;
use roadplane_base::{Camera, ImageSize, Lens, PictureMotion};
use roadplane_calibrate::{Factor, Length, Survey};
use roadplane_write::{LengthConstraint, WriteError, read_constraints};

pub(crate) use check::{contradiction, in_words as constraint_in_words, not_compared_in_words};
pub(crate) use frames::in_first_picture;
pub use measured::Measured;

use crate::PipelineError;
use camera_file::{CameraOfFile, GivenLens};
use measured::{GUESSED_HEIGHT_SHARE, GUESSED_TILT_SD_DEG};

/// Largest difference in the log ratio of sides between pictures of the same camera in two sizes.
const SAME_RATIO: f64 = 0.01;

/// The user constraints on a camera; by default there are none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraConstraints {
    /// Exact focal length (px), and the size of the pictures for which it holds, if given.
    focal: Option<(f64, Option<ImageSize>)>,
    /// Lens distortion, if given.
    lens: Option<GivenLens>,
    /// Lens through which the ends of lengths are observed.
    seen_through: Lens,
    /// Mapping from pixels of the frames that lengths name to pixels of the camera's first picture.
    world_from_picture: BTreeMap<u64, PictureMotion>,
    /// All other constraints.
    facts: Vec<Fact>,
}

/// The constraints of a command line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ConstraintOptions<'a> {
    /// Focal length, px. Without an sd it is exact.
    pub focal_px: Option<Measured>,
    /// Tilt, °. Without an sd it has 2°.
    pub tilt_deg: Option<Measured>,
    /// Roll, °. Without an sd it has 2°.
    pub roll_deg: Option<Measured>,
    /// Height, m. Without an sd it has 5 %.
    pub height_m: Option<Measured>,
    /// Camera file: `camera.json`, `.krtd`, or OpenCV's `.yml`.
    pub camera: Option<&'a Path>,
    /// File of measured lengths.
    pub lengths: Option<&'a Path>,
    /// OpenCV's k1 and k2 of the lens; they require a focal length.
    pub lens: Option<[f64; 2]>,
}

/// One constraint.
#[derive(Clone, Debug, PartialEq)]
enum Fact {
    /// One camera parameter.
    Number {
        /// Its index: log focal length, tilt, roll, log height.
        which: usize,
        /// Its value, log px, rad or log m.
        value: f64,
        sd: f64,
    },
    /// A camera from a file.
    Camera { file: String, size: Option<ImageSize>, survey: Survey },
    /// A measured length in the picture.
    Length { file: String, length: LengthConstraint },
}

impl CameraConstraints {
    /// Creates the constraint of an exact focal length, px.
    #[must_use]
    pub fn focal(focal_px: Option<f64>) -> Self {
        Self { focal: focal_px.map(|focal_px| (focal_px, None)), ..Self::default() }
    }

    /// Builds the constraints of a command line and reads its files.
    ///
    /// # Errors
    /// [`PipelineError::Usage`] for values out of range and for malformed files, [`PipelineError::Write`] for files
    /// that cannot be read.
    pub fn new(options: &ConstraintOptions<'_>) -> Result<Self, PipelineError> {
        let mut known = Self::default();
        if let Some(path) = options.camera {
            known.add_camera(path)?;
        }
        if let Some(focal) = options.focal_px {
            let value = positive("--focal-px", focal)?.ln();
            match focal.sd {
                None if known.focal.is_some() => {
                    return Err(PipelineError::usage(
                        "the focal length is given twice, by --camera and by --focal-px: leave one out",
                    ));
                }
                None => known.focal = Some((focal.value, None)),
                Some(sd) => known.facts.push(Fact::Number { which: 0, value, sd: sd / focal.value }),
            }
        }
        if let Some(k1_k2) = options.lens {
            if known.lens.is_some() {
                return Err(PipelineError::usage(
                    "the lens is given twice, by --camera and by --lens: leave one out",
                ));
            }
            known.lens = Some(GivenLens::Opencv(k1_k2));
            if known.about_focal_px().is_none() {
                return Err(PipelineError::usage("--lens needs a focal length: give --focal-px, too"));
            }
        }
        for (which, name, angle) in [(1, "--tilt-deg", options.tilt_deg), (2, "--roll-deg", options.roll_deg)]
        {
            let Some(angle) = angle else { continue };
            if angle.value.abs() >= 90.0 {
                return Err(PipelineError::usage(&format!("{name} must lie between -90 and 90")));
            }
            let sd = angle.sd.unwrap_or(GUESSED_TILT_SD_DEG).to_radians();
            known.facts.push(Fact::Number { which, value: angle.value.to_radians(), sd });
        }
        if let Some(height) = options.height_m {
            let value = positive("--height-m", height)?.ln();
            let sd = height.sd.map_or(GUESSED_HEIGHT_SHARE, |sd| sd / height.value);
            known.facts.push(Fact::Number { which: 3, value, sd });
        }
        if let Some(path) = options.lengths {
            let file = name_of(path);
            let lengths = read_constraints(path).map_err(usage)?;
            known.facts.extend(lengths.into_iter().map(|length| Fact::Length { file: file.clone(), length }));
        }
        Ok(known)
    }

    /// Adds the constraints of a camera file.
    fn add_camera(&mut self, path: &Path) -> Result<(), PipelineError> {
        let CameraOfFile { size, principal_point_px, focal_px, lens, survey } =
            camera_file::read(path).map_err(usage)?;
        let middle = size.map(|size| size.centre_px());
        if let (Some(middle), Some(point)) = (middle, principal_point_px)
            && (middle - Vector2::from(point)).norm() > Camera::PRINCIPAL_POINT_SD * (2.0 * middle.x)
        {
            tracing::warn!(
                "{}: its principal point is not the middle of the picture; the middle is used",
                path.display()
            );
        }
        self.focal = focal_px.map(|focal_px| (focal_px, size));
        self.lens = lens;
        self.facts.extend(survey.map(|survey| Fact::Camera { file: name_of(path), size, survey }));
        Ok(())
    }

    /// Returns the exact focal length, px, if given.
    #[must_use]
    pub fn focal_px(&self) -> Option<f64> {
        self.focal.map(|(focal_px, _)| focal_px)
    }

    /// Returns the focal length, px, exact or with an sd, if given.
    fn about_focal_px(&self) -> Option<f64> {
        let number = |fact: &Fact| match fact {
            Fact::Number { which: 0, value, .. } => Some(value.exp()),
            _ => None,
        };
        self.focal_px().or_else(|| self.facts.iter().find_map(number))
    }

    /// Returns the lens, if given, for pictures of this size. Call [`CameraConstraints::for_pictures`] first.
    pub(crate) fn lens(&self, size: ImageSize) -> Option<Lens> {
        match self.lens? {
            GivenLens::Opencv([k1, k2]) => Some(Lens::from_opencv(k1, k2, self.about_focal_px()?, size)),
            GivenLens::Distortion(distortion) => Some(Lens::with_distortion(distortion, size)),
        }
    }

    /// Returns the constraints with this lens, through which the ends of lengths are observed.
    #[must_use]
    pub(crate) fn seen_through(&self, lens: Lens) -> Self {
        Self { seen_through: lens, ..self.clone() }
    }

    /// Returns the indices of the frames that lengths name.
    fn frames(&self) -> impl Iterator<Item = u64> + '_ {
        self.facts.iter().filter_map(Fact::frame)
    }

    /// Returns the constraints with the positions of the frames that lengths name, and the number of lengths that were
    /// left out. A length is left out if its frame has no position.
    pub(crate) fn with_frames(&self, world_from_picture: &BTreeMap<u64, PictureMotion>) -> (Self, usize) {
        let mut known = self.clone();
        known.facts.retain(|fact| fact.frame().is_none_or(|frame| world_from_picture.contains_key(&frame)));
        known.world_from_picture.clone_from(world_from_picture);
        let left_out = self.facts.len() - known.facts.len();
        (known, left_out)
    }

    /// Returns whether there are no constraints except an exact focal length and a lens.
    #[must_use]
    pub fn is_silent(&self) -> bool {
        self.facts.is_empty()
    }

    /// Returns the constraints for pictures of this size. A camera of the same pictures in another size is scaled.
    ///
    /// # Errors
    /// [`PipelineError::Usage`] for a camera of other pictures, or pixels outside of these.
    pub(crate) fn for_pictures(&self, size: ImageSize) -> Result<Self, PipelineError> {
        let mut known = self.clone();
        if let Some((focal_px, Some(of))) = &mut known.focal {
            *focal_px *= scale(*of, size)?;
            *of = size;
        }
        for fact in &mut known.facts {
            match fact {
                Fact::Camera { size: Some(of), survey, .. } => {
                    survey.mean[0] += scale(*of, size)?.ln();
                    *of = size;
                }
                Fact::Length { file, length } => {
                    let inside = |[x, y]: &[f64; 2]| {
                        (-0.5..f64::from(size.width) - 0.5).contains(x)
                            && (-0.5..f64::from(size.height) - 0.5).contains(y)
                    };
                    if !(inside(&length.from_px) && inside(&length.to_px)) {
                        let name = length.name.as_deref().unwrap_or_default();
                        let [width, height] = <[u32; 2]>::from(size);
                        let what = format!(
                            "the length \"{name}\" ends outside the picture of {width} × {height} px: {file}"
                        );
                        return Err(PipelineError::usage(&what));
                    }
                }
                Fact::Camera { .. } | Fact::Number { .. } => {}
            }
        }
        Ok(known)
    }

    /// Returns the factors on a camera position, from 0.
    ///
    /// Focal length and height hold for all positions. Other constraints hold for the first position only.
    pub(crate) fn factors(&self, position: usize, size: ImageSize) -> Vec<Factor> {
        let factor = |fact: &Fact| match fact {
            Fact::Number { which, value, sd } => Factor::Survey(Survey::of_number(*which, *value, *sd)),
            Fact::Camera { survey, .. } => Factor::Survey(*survey),
            Fact::Length { length, .. } => Factor::Length(self.length_factor(length, size)),
        };
        let here = self.facts.iter().filter(|fact| position == 0 || fact.holds_everywhere());
        here.map(factor).collect()
    }

    /// Returns a length as a factor, for pictures of this size.
    fn length_factor(&self, length: &LengthConstraint, size: ImageSize) -> Length {
        let motion = length.frame.and_then(|frame| self.world_from_picture.get(&frame));
        let motion = motion.unwrap_or(&PictureMotion::IDENTITY);
        let growth = motion.jacobian(&length.from_px.into()).determinant().abs().sqrt();
        let on_ray = |end: [f64; 2]| {
            self.seen_through.undistorted(&(motion.apply(&Vector2::from(end)) - size.centre_px()))
        };
        Length {
            ends_px: [length.from_px, length.to_px].map(on_ray),
            end_sd_px: length.pixel_sd * growth,
            length_m: length.length_m,
            log_sd: length.sd_m / length.length_m,
        }
    }

    /// Returns a note for the user about constraints that do not hold after a camera move; `None` if all hold.
    pub(crate) fn silent_later(&self) -> Option<String> {
        self.facts.iter().any(|fact| !fact.holds_everywhere()).then(|| {
            "the camera was moved: the given tilt, roll, lengths and camera file hold for its first position only"
                .to_owned()
        })
    }
}

impl Fact {
    /// Returns whether the constraint also holds after a camera move.
    fn holds_everywhere(&self) -> bool {
        matches!(self, Self::Number { which: 0 | 3, .. })
    }

    /// Returns the index of the frame that the constraint names.
    fn frame(&self) -> Option<u64> {
        if let Self::Length { length, .. } = self { length.frame } else { None }
    }
}

/// Returns the ratio of the size of pictures `size` to `other`; a usage error where the ratios of sides differ.
fn scale(other: ImageSize, size: ImageSize) -> Result<f64, PipelineError> {
    let [by_width, by_height] =
        [f64::from(size.width) / f64::from(other.width), f64::from(size.height) / f64::from(other.height)];
    if (by_width / by_height).ln().abs() > SAME_RATIO {
        return Err(PipelineError::usage(&format!(
            "--camera is for pictures of {} × {} px, but these have {} × {}: their aspect ratios differ",
            other.width, other.height, size.width, size.height
        )));
    }
    Ok((by_width * by_height).sqrt())
}

/// Returns the number; a usage error if it is not above 0.
fn positive(name: &str, number: Measured) -> Result<f64, PipelineError> {
    if number.value > 0.0 {
        return Ok(number.value);
    }
    Err(PipelineError::usage(&format!("{name} must be above 0")))
}

/// Returns the file name of a path.
fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Converts an error of reading a constraint file. A malformed file is a usage error.
fn usage(error: WriteError) -> PipelineError {
    match error {
        WriteError::Malformed { .. } => PipelineError::usage(&error.to_string()),
        other => other.into(),
    }
}

#[cfg(test)]
mod tests;

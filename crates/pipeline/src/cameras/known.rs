//! What the user knows of a camera: evidence like any other, as [`Factor`]s.

mod camera_file;
mod check;
mod measured;

use std::path::Path;

use nalgebra::{Matrix4, Vector2, Vector4};
use roadplane_base::{Factor, ImageSize, Lens};
use roadplane_write::{LengthConstraint, WriteError, read_constraints};

pub(crate) use check::{contradiction, in_words as known_in_words};
pub use measured::Measured;

use crate::PipelineError;
use camera_file::{CameraOfFile, KnownLens};
use measured::{GUESSED_HEIGHT_SHARE, GUESSED_TILT_SD_DEG};

/// A principal point that is farther from the middle, as a share of the picture's width, is worth a word.
const OFF_CENTRE: f64 = 0.02;
/// Pictures of the same camera in another size have the same ratio of sides, to this share.
const SAME_RATIO: f64 = 0.01;

/// What the user knows of a camera. By default nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraConstraints {
    /// Focal length that is taken as it is, and the size of the pictures that it is for where that is told.
    focal: Option<(f64, Option<ImageSize>)>,
    lens: Option<KnownLens>,
    /// What lens the pixels of lengths are seen through.
    seen_through: Lens,
    facts: Vec<Fact>,
}

/// What is said on a command line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ConstraintOptions<'a> {
    /// Focal length, px. Without an sd it is taken as it is.
    pub focal_px: Option<Measured>,
    /// Tilt, °; without an sd to 2°.
    pub tilt_deg: Option<Measured>,
    /// Roll, °; without an sd to 2°.
    pub roll_deg: Option<Measured>,
    /// Height, m; without an sd to 5 %.
    pub height_m: Option<Measured>,
    /// File of a camera: `camera.json`, `.krtd`, OpenCV's `.yml`.
    pub camera: Option<&'a Path>,
    /// File of known lengths.
    pub lengths: Option<&'a Path>,
    /// OpenCV's k1 and k2 of the lens; they need a focal length.
    pub lens: Option<[f64; 2]>,
}

/// One thing that is known.
#[derive(Clone, Debug, PartialEq)]
enum Fact {
    Number(Number),
    Camera {
        file: String,
        /// Of its pictures, where it is told.
        size: Option<ImageSize>,
        mean: Vector4<f64>,
        information: Matrix4<f64>,
        by_cars: bool,
    },
    Length {
        file: String,
        length: LengthConstraint,
    },
}

/// One of (log focal, tilt, roll, log height).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Number {
    which: usize,
    value: f64,
    sd: f64,
}

impl CameraConstraints {
    /// A focal length, px, that is taken as it is.
    #[must_use]
    pub fn focal(focal_px: Option<f64>) -> Self {
        Self { focal: focal_px.map(|focal_px| (focal_px, None)), ..Self::default() }
    }

    /// What a command line says; files are read.
    ///
    /// # Errors
    /// [`PipelineError::Usage`] for what makes no sense and for files that are not of their form, [`PipelineError::Write`] for files
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
                Some(sd) => known.facts.push(Fact::Number(Number { which: 0, value, sd: sd / focal.value })),
            }
        }
        if let Some(k1_k2) = options.lens {
            if known.lens.is_some() {
                return Err(PipelineError::usage(
                    "the lens is given twice, by --camera and by --lens: leave one out",
                ));
            }
            known.lens = Some(KnownLens::Opencv(k1_k2));
            if known.about_focal_px().is_none() {
                return Err(PipelineError::usage(
                    "--lens means something beside a focal length only: give --focal-px, too",
                ));
            }
        }
        for (which, name, angle) in [(1, "--tilt-deg", options.tilt_deg), (2, "--roll-deg", options.roll_deg)]
        {
            let Some(angle) = angle else { continue };
            if angle.value.abs() >= 90.0 {
                return Err(PipelineError::usage(&format!("{name} must lie between -90 and 90")));
            }
            let sd = angle.sd.unwrap_or(GUESSED_TILT_SD_DEG).to_radians();
            known.facts.push(Fact::Number(Number { which, value: angle.value.to_radians(), sd }));
        }
        if let Some(height) = options.height_m {
            let value = positive("--height-m", height)?.ln();
            let sd = height.sd.map_or(GUESSED_HEIGHT_SHARE, |sd| sd / height.value);
            known.facts.push(Fact::Number(Number { which: 3, value, sd }));
        }
        if let Some(path) = options.lengths {
            let file = name_of(path);
            let lengths = read_constraints(path).map_err(usage)?;
            known.facts.extend(lengths.into_iter().map(|length| Fact::Length { file: file.clone(), length }));
        }
        Ok(known)
    }

    fn add_camera(&mut self, path: &Path) -> Result<(), PipelineError> {
        let CameraOfFile { size, principal_point_px, focal_px, lens, numbers, by_cars } =
            camera_file::read(path).map_err(usage)?;
        let middle = size.map(|size| size.centre_px());
        if let (Some(middle), Some(point)) = (middle, principal_point_px)
            && (middle - Vector2::from(point)).norm() > OFF_CENTRE * (2.0 * middle.x)
        {
            tracing::warn!(
                "{}: its principal point is not the middle of the picture, which it is taken for",
                path.display()
            );
        }
        self.focal = focal_px.map(|focal_px| (focal_px, size));
        self.lens = lens;
        if let Some((mean, information)) = numbers {
            self.facts.push(Fact::Camera { file: name_of(path), size, mean, information, by_cars });
        }
        Ok(())
    }

    /// The focal length, px, where it is taken as it is.
    #[must_use]
    pub fn focal_px(&self) -> Option<f64> {
        self.focal.map(|(focal_px, _)| focal_px)
    }

    /// The focal length, px, as it is taken or about.
    fn about_focal_px(&self) -> Option<f64> {
        let number = |fact: &Fact| match fact {
            Fact::Number(Number { which: 0, value, .. }) => Some(value.exp()),
            _ => None,
        };
        self.focal_px().or_else(|| self.facts.iter().find_map(number))
    }

    /// The lens, where it is told, for pictures of this size that [`CameraConstraints::for_pictures`] was asked for.
    pub(crate) fn lens(&self, size: ImageSize) -> Option<Lens> {
        match self.lens? {
            KnownLens::Opencv([k1, k2]) => Some(Lens::from_opencv(k1, k2, self.about_focal_px()?, size)),
            KnownLens::Bend(bend) => Some(Lens::with_bend(bend, size)),
        }
    }

    /// The same with this lens, which the ends of lengths are seen through.
    #[must_use]
    pub(crate) fn seen_through(&self, lens: Lens) -> Self {
        Self { seen_through: lens, ..self.clone() }
    }

    /// Nothing is known but perhaps focal length and lens, exactly.
    #[must_use]
    pub fn is_silent(&self) -> bool {
        self.facts.is_empty()
    }

    /// The same for pictures of this size: a camera of the same pictures larger or smaller is scaled.
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
                Fact::Camera { size: Some(of), mean, .. } => {
                    mean[0] += scale(*of, size)?.ln();
                    *of = size;
                }
                Fact::Length { file, length } => {
                    let inside = |[x, y]: &[f64; 2]| {
                        (-0.5..f64::from(size.width)).contains(x)
                            && (-0.5..f64::from(size.height)).contains(y)
                    };
                    if !(inside(&length.from_px) && inside(&length.to_px)) {
                        let name = length.name.as_deref().unwrap_or_default();
                        let [width, height] = <[u32; 2]>::from(size);
                        let what =
                            format!("{name} ends outside of the picture, {width} × {height} px: {file}");
                        return Err(PipelineError::usage(&what));
                    }
                }
                Fact::Camera { .. } | Fact::Number(_) => {}
            }
        }
        Ok(known)
    }

    /// What it says of a position of the camera, from 0. Focal length and height hold for all; the rest is true of where the camera
    /// looked first.
    pub(crate) fn factors(&self, position: usize, size: ImageSize) -> Vec<Factor> {
        self.facts
            .iter()
            .filter(|fact| position == 0 || fact.holds_everywhere())
            .map(|fact| fact.factor(size, self.seen_through))
            .collect()
    }

    /// What a reader should know where the camera was moved.
    pub(crate) fn silent_later(&self) -> Option<String> {
        self.facts.iter().any(|fact| !fact.holds_everywhere()).then(|| {
            "the camera was moved: tilt, roll, lengths and camera files that were told hold for its first position only"
                .to_owned()
        })
    }
}

impl Fact {
    /// Also where the camera was moved to.
    fn holds_everywhere(&self) -> bool {
        matches!(self, Self::Number(Number { which: 0 | 3, .. }))
    }

    fn factor(&self, size: ImageSize, lens: Lens) -> Factor {
        match self {
            Self::Number(Number { which, value, sd }) => {
                Factor::Number { which: *which, value: *value, sd: *sd }
            }
            Self::Camera { mean, information, by_cars, .. } => {
                Factor::Camera { mean: *mean, information: *information, by_cars: *by_cars }
            }
            Self::Length { length, .. } => Factor::Length {
                ends_px: [length.from_px, length.to_px]
                    .map(|end| lens.straightened(&(Vector2::from(end) - size.centre_px()))),
                end_sd_px: length.pixel_sd,
                length_m: length.length_m,
                log_sd: length.sd_m / length.length_m,
            },
        }
    }
}

/// How much larger pictures of `size` are than those of `other`.
fn scale(other: ImageSize, size: ImageSize) -> Result<f64, PipelineError> {
    let [by_width, by_height] =
        [f64::from(size.width) / f64::from(other.width), f64::from(size.height) / f64::from(other.height)];
    if (by_width / by_height).ln().abs() > SAME_RATIO {
        return Err(PipelineError::usage(&format!(
            "--camera is of pictures of {} × {} px, these have {} × {}: not the same ones scaled",
            other.width, other.height, size.width, size.height
        )));
    }
    Ok((by_width * by_height).sqrt())
}

fn positive(name: &str, number: Measured) -> Result<f64, PipelineError> {
    if number.value > 0.0 {
        return Ok(number.value);
    }
    Err(PipelineError::usage(&format!("{name} must be above 0")))
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// A file that the command line names and that is not of its form is the command line's fault.
fn usage(error: WriteError) -> PipelineError {
    match error {
        WriteError::Malformed { .. } => PipelineError::usage(&error.to_string()),
        other => other.into(),
    }
}

#[cfg(test)]
mod tests;

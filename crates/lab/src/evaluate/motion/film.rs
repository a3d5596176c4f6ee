//! Films a clip as a camera that turns or zooms about its own centre would film it.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use roadplane_base::{Homography, ImageSize, Lens};
use roadplane_decode::{DecodeOptions, open};
use roadplane_pipeline::PipelineError;
use roadplane_view::{VideoSink, warped};

use crate::LabError;

/// Share of the clip's width that a film shows.
const SHARE: f64 = 0.68;
/// Share of the clip's width that a film with far turns shows.
const FAR_SHARE: f64 = 0.32;
/// Least width of a clip that is filmed with far turns, px.
pub(super) const FAR_WIDTH_PX: u32 = 1280;
/// Share of the clip's width that far turns keep as a margin.
const MARGIN: f64 = 0.01;
/// Positions of the tour, and visits to each position.
const TOUR: (usize, usize) = (3, 3);

/// A motion of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Motion {
    /// No motion.
    Rest,
    /// No motion, but all pictures are displaced by half a pixel. Its differences from the film at rest come from other
    /// pixel values alone.
    Aside,
    /// Sway of ± 3 px with a period of 1.5 s, as of a pole in wind.
    #[value(name = "sway_3px")]
    Sway3,
    /// Sway of ± 12 px with a period of 3.7 s, and ± 0.23° of roll.
    #[value(name = "sway_12px")]
    Sway12,
    /// Shake of ± 2 px at 8 Hz.
    #[value(name = "shake_8hz")]
    Shake,
    /// Drift of 3 px/s.
    Drift,
    /// Pan of 8.5 px/s.
    Pan,
    /// Zoom from 1 to 1.25.
    Zoom,
    /// Pan over three fields of view and back.
    FarPan,
    /// Tour of three presets, with three visits to each.
    Tour,
}

impl Motion {
    /// All motions; the first is the camera at rest.
    pub const ALL: [Self; 10] = [
        Self::Rest,
        Self::Aside,
        Self::Sway3,
        Self::Sway12,
        Self::Shake,
        Self::Drift,
        Self::Pan,
        Self::Zoom,
        Self::FarPan,
        Self::Tour,
    ];

    /// Returns the name in tables and file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Aside => "aside",
            Self::Sway3 => "sway_3px",
            Self::Sway12 => "sway_12px",
            Self::Shake => "shake_8hz",
            Self::Drift => "drift",
            Self::Pan => "pan",
            Self::Zoom => "zoom",
            Self::FarPan => "far_pan",
            Self::Tour => "tour",
        }
    }

    /// Whether the camera turns by more than a field of view.
    pub fn is_far(self) -> bool {
        matches!(self, Self::FarPan | Self::Tour)
    }

    fn share(self) -> f64 {
        if self.is_far() { FAR_SHARE } else { SHARE }
    }
}

/// A clip, and the part of it that is filmed.
pub(super) struct Clip {
    path: PathBuf,
    decode: DecodeOptions,
    seconds: f64,
    fps: f64,
    size: ImageSize,
    mirrored: bool,
    /// Distortion of the film's lens at half its width ([`Lens::distortion`]).
    distortion: f64,
}

/// How a frame of a film shows the clip.
pub(super) struct FilmView {
    /// Homography from pixels of the clip to undistorted pixels of the film.
    film_from_clip: Homography,
    clip_from_film: Homography,
    lens: Lens,
    centre: Vector2<f64>,
}

impl FilmView {
    /// Returns the pixel of the film that shows a pixel of the clip.
    pub fn film_from_clip(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        self.lens.distorted(&(self.film_from_clip.apply(pixel) - self.centre)) + self.centre
    }

    /// Returns the pixel of the clip that a pixel of the film shows.
    pub fn clip_from_film(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        self.clip_from_film.apply(&(self.lens.undistorted(&(pixel - self.centre)) + self.centre))
    }
}

impl Clip {
    /// Opens a clip. The film shows `decode`'s part of it for `seconds`.
    pub fn open(
        path: &Path,
        decode: &DecodeOptions,
        seconds: f64,
        mirrored: bool,
        distortion: f64,
    ) -> Result<Self, LabError> {
        let end_s = decode.start_s + seconds;
        let decode =
            DecodeOptions { end_s: Some(decode.end_s.map_or(end_s, |end| end.min(end_s))), ..decode.clone() };
        let input = open(path, &decode).map_err(PipelineError::from)?;
        let (fps, size) = (input.nominal_fps(), input.size());
        Ok(Self { path: path.to_path_buf(), decode, seconds, fps, size, mirrored, distortion })
    }

    /// Returns the name of the clip in tables and file names.
    pub fn name(&self) -> String {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        format!("{stem}{}", if self.mirrored { "_mirrored" } else { "" })
    }

    /// Returns the motions for which the clip is large enough.
    pub fn motions(&self) -> impl Iterator<Item = Motion> + use<> {
        let is_large = self.size.width >= FAR_WIDTH_PX;
        Motion::ALL.into_iter().filter(move |motion| is_large || !motion.is_far())
    }

    /// Returns the size of a film.
    pub fn film_size(&self, motion: Motion) -> ImageSize {
        let even = |side: u32| 2 * (f64::from(side) * motion.share() / SHARE / 2.0).round() as u32;
        ImageSize { width: even(self.size.width), height: even(self.size.height) }
    }

    /// Returns the focal length of a film in units of the clip's focal length, at a time of the film (s).
    pub fn film_focal_ratio(&self, motion: Motion, time_s: f64) -> f64 {
        f64::from(self.film_size(motion).width) / (motion.share() * f64::from(self.size.width))
            * self.turn(motion, time_s, 1.0).1
    }

    /// Returns pan, tilt and roll (rad), and the growth by the zoom. `focal_px` is the clip's focal length.
    fn turn(&self, motion: Motion, time_s: f64, focal_px: f64) -> ([f64; 3], f64) {
        let px = SHARE / focal_px; // angle of a pixel of the film
        let direction = if self.mirrored { -1.0 } else { 1.0 };
        let wave = |period_s: f64| (TAU * time_s / period_s + f64::from(u8::from(self.mirrored))).sin();
        let share = time_s / self.seconds;
        let from_middle_s = time_s - self.seconds / 2.0;
        let angle = |share: f64| (share * f64::from(self.size.width) / focal_px).atan();
        let far = direction * (angle(0.5 - MARGIN) - angle(FAR_SHARE / 2.0));
        let turn = match motion {
            Motion::Rest | Motion::Zoom => [0.0; 3],
            Motion::Aside => [0.5 * px, 0.5 * px, 0.0],
            Motion::Sway3 => [3.0 * px * wave(1.5), 2.0 * px * wave(1.1), 0.0],
            Motion::Sway12 => [12.0 * px * wave(3.7), 5.0 * px * wave(2.3), 0.004 * wave(3.1)],
            Motion::Shake => [2.0 * px * wave(0.125), 1.5 * px * wave(0.14), 0.0],
            Motion::Drift => [direction * 3.0 * px * from_middle_s, 1.5 * px * from_middle_s, 0.0],
            Motion::Pan => [direction * 8.5 * px * from_middle_s, 0.0, 0.0],
            Motion::FarPan => [far * (1.0 - 2.0 * (2.0 * share - 1.0).abs()), 0.0, 0.0],
            Motion::Tour => {
                let (positions, visits) = TOUR;
                let visit = (share * (positions * visits) as f64) as usize;
                [far * ((visit % positions) as f64 - 1.0), 0.0, 0.0]
            }
        };
        let growth = match motion {
            Motion::Zoom if self.mirrored => 1.25 - 0.25 * share,
            Motion::Zoom => 1.0 + 0.25 * share,
            _ => 1.0,
        };
        (turn, growth)
    }

    /// Returns how a frame of a film shows the clip. `focal_px` is the clip's focal length.
    pub fn view(&self, motion: Motion, frame: u64, focal_px: f64) -> FilmView {
        let (film_from_clip, size) = (self.film_from_clip(motion, frame, focal_px), self.film_size(motion));
        FilmView {
            film_from_clip,
            clip_from_film: film_from_clip.inverse(),
            lens: Lens::with_distortion(self.distortion, size),
            centre: size.centre_px(),
        }
    }

    /// Returns the homography K R K⁻¹ from pixels of the clip to undistorted pixels of a film's frame. `focal_px` is the
    /// clip's focal length.
    fn film_from_clip(&self, motion: Motion, frame: u64, focal_px: f64) -> Homography {
        let time_s = frame as f64 / self.fps;
        let ([pan, tilt, roll], _) = self.turn(motion, time_s, focal_px);
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), roll)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), tilt)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), pan);
        let matrix = |focal: f64, size: ImageSize| {
            let [x, y] = [size.width, size.height].map(|side| (f64::from(side) - 1.0) / 2.0);
            Matrix3::new(focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0)
        };
        let clip = matrix(focal_px, self.size).try_inverse();
        let film = matrix(focal_px * self.film_focal_ratio(motion, time_s), self.film_size(motion));
        clip.and_then(|clip| Homography::new(film * rotation.matrix() * clip)).unwrap_or(Homography::IDENTITY)
    }

    /// Writes a film of the clip. A clip that is shorter than the film is repeated.
    pub fn film(&self, motion: Motion, focal_px: f64, out: &Path) -> Result<(), LabError> {
        let open = || open(&self.path, &self.decode).map_err(PipelineError::from);
        let mut input = open()?;
        let size = self.film_size(motion);
        let mut video =
            VideoSink::create(out, size.width, size.height, self.fps).map_err(PipelineError::from)?;
        for number in 0..(self.seconds * self.fps).round() as u64 {
            let mut frame = input.next_frame().map_err(PipelineError::from)?;
            if frame.is_none() {
                input = open()?;
                frame = input.next_frame().map_err(PipelineError::from)?;
            }
            let Some(mut frame) = frame else { break };
            if self.mirrored {
                image::imageops::flip_horizontal_in_place(&mut frame.image);
            }
            let view = self.view(motion, number, focal_px);
            let picture = warped(&frame.image, size, |pixel| view.clip_from_film(pixel))
                .map_err(PipelineError::from)?;
            video.write(&picture).map_err(PipelineError::from)?;
            input.reuse(frame.image);
        }
        Ok(video.finish().map_err(PipelineError::from)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(width: u32, height: u32) -> Clip {
        let decode = DecodeOptions::default();
        let size = ImageSize { width, height };
        Clip {
            path: "a/lot.mp4".into(),
            decode,
            seconds: 12.0,
            fps: 25.0,
            size,
            mirrored: false,
            distortion: 0.0,
        }
    }

    #[test]
    fn a_film_shows_the_middle_of_the_clip() {
        let clip = clip(640, 360);
        let film = clip.film_from_clip(Motion::Rest, 0, 600.0);
        let middle = Vector2::new(319.5, 179.5);
        assert!((film.apply(&middle) - middle).norm() < 1e-9);
        let side = film.apply(&(middle + Vector2::new(0.34 * 640.0, 0.0)));
        assert!((side - Vector2::new(639.5, 179.5)).norm() < 1e-9, "{side}");
        // The pan is in the middle at 6 s, and a second later the picture has moved by 8.5 px.
        let film = clip.film_from_clip(Motion::Pan, 175, 600.0);
        let moved = film.apply(&middle) - middle;
        assert!((moved - Vector2::new(8.5, 0.0)).norm() < 0.01, "{moved}");
        let growth = clip.film_focal_ratio(Motion::Zoom, 12.0) / clip.film_focal_ratio(Motion::Zoom, 0.0);
        assert!((growth - 1.25).abs() < 1e-12);
    }

    #[test]
    fn far_turns_stay_inside_a_large_clip() {
        assert!(clip(640, 360).motions().all(|motion| !motion.is_far()));
        let clip = clip(1920, 1080);
        assert_eq!(clip.motions().count(), Motion::ALL.len());
        for motion in [Motion::FarPan, Motion::Tour] {
            let size = clip.film_size(motion);
            assert_eq!((size.width, size.height), (904, 508));
            for frame in (0..300).step_by(10) {
                let back = clip.film_from_clip(motion, frame, 1600.0).inverse();
                let edges = [0.0, f64::from(size.width) - 1.0].map(|x| back.apply(&Vector2::new(x, 254.0)).x);
                assert!(edges.iter().all(|x| (0.0..1919.0).contains(x)), "{motion:?} {frame}: {edges:?}");
            }
        }
    }
}

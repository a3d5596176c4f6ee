//! Synthetic clips for tests. A camera that can be turned, zoomed and shaken shows a part of a larger scene.

use std::path::Path;

use image::RgbImage;
use nalgebra::Vector2;
use roadplane_base::{CameraMove, FrameStamp, PictureVerdict, WatchRecord};
use roadplane_decode::{DecodeOptions, open};
use roadplane_watch::{View as KeyframeView, Watcher};

/// A pseudo-random generator with a fixed sequence.
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
    }

    pub fn below(&mut self, count: u32) -> u32 {
        self.next() % count
    }
}

/// A grey picture.
#[derive(Clone)]
pub struct Grey {
    pub width: usize,
    pub height: usize,
    pub values: Vec<u8>,
}

/// The camera's view. Let `p` be a point's position from the picture's middle when the camera is at rest, px. In this
/// view, the point appears at `shift + p · e^log_scale`.
#[derive(Clone, Copy, Default)]
pub struct View {
    pub shift: [f64; 2],
    pub log_scale: f64,
}

impl View {
    pub fn shifted(x: f64, y: f64) -> Self {
        Self { shift: [x, y], log_scale: 0.0 }
    }
}

impl Grey {
    /// Creates a picture with random texture of three sizes.
    pub fn textured(width: usize, height: usize, seed: u64) -> Self {
        let mut values = vec![110.0_f32; width * height];
        for (side, height_of) in [(5_usize, 24.0_f32), (14, 30.0), (45, 50.0)] {
            let columns = width / side + 2;
            let mut dice = Dice::new(seed * 31 + side as u64);
            let knots: Vec<f32> = (0..columns * (height / side + 2))
                .map(|_| (dice.below(1000) as f32 / 1000.0 - 0.5) * height_of)
                .collect();
            for y in 0..height {
                let (row, v) = (y / side, (y % side) as f32 / side as f32);
                for x in 0..width {
                    let (column, u) = (x / side, (x % side) as f32 / side as f32);
                    let at = |i: usize, j: usize| knots[(row + j) * columns + column + i];
                    values[y * width + x] += (at(0, 0) * (1.0 - u) + at(1, 0) * u) * (1.0 - v)
                        + (at(0, 1) * (1.0 - u) + at(1, 1) * u) * v;
                }
            }
        }
        Self { width, height, values: values.into_iter().map(|v| v as u8).collect() }
    }

    /// Pastes another picture with its top-left corner at (x, y). The corner may be outside this picture.
    pub fn paste(&mut self, other: &Self, x: i64, y: i64) {
        for (row, line) in other.values.chunks_exact(other.width).enumerate() {
            let Ok(to) = usize::try_from(y + row as i64) else { continue };
            if to >= self.height {
                break;
            }
            let from = (-x).clamp(0, other.width as i64) as usize;
            let until = (self.width as i64 - x).clamp(from as i64, other.width as i64) as usize;
            if from == until {
                continue;
            }
            let at = (to as i64 * self.width as i64 + x + from as i64) as usize;
            self.values[at..at + until - from].copy_from_slice(&line[from..until]);
        }
    }

    /// Returns the middle of this scene as the camera shows it, with bilinear interpolation.
    pub fn seen(&self, (width, height): (usize, usize), view: View) -> Self {
        let scale = (-view.log_scale).exp();
        let source = |at: usize, length: usize, own: usize, shift: f64| {
            let from = own as f64 / 2.0 + (at as f64 + 0.5 - length as f64 / 2.0 - shift) * scale - 0.5;
            let from = from.clamp(0.0, own as f64 - 1.001);
            (from as usize, (from.fract() * 256.0).round() as u32)
        };
        let columns: Vec<_> = (0..width).map(|x| source(x, width, self.width, view.shift[0])).collect();
        let mut values = Vec::with_capacity(width * height);
        for y in 0..height {
            let (row, v) = source(y, height, self.height, view.shift[1]);
            let (upper, lower) = (&self.values[row * self.width..], &self.values[(row + 1) * self.width..]);
            if v == 0 && columns.iter().enumerate().all(|(i, &(x, u))| u == 0 && x == columns[0].0 + i) {
                values.extend_from_slice(&upper[columns[0].0..][..width]);
                continue;
            }
            values.extend(columns.iter().map(|&(x, u)| {
                let mix = |line: &[u8]| u32::from(line[x]) * (256 - u) + u32::from(line[x + 1]) * u;
                ((mix(upper) * (256 - v) + mix(lower) * v + (1 << 15)) >> 16) as u8
            }));
        }
        Self { width, height, values }
    }

    /// Scales the brightness of every pixel.
    pub fn lit(mut self, gain: f64) -> Self {
        self.values.iter_mut().for_each(|v| *v = (f64::from(*v) * gain).round() as u8);
        self
    }

    /// Fills the picture with one grey level.
    pub fn uniform(mut self, grey: u8) -> Self {
        self.values.fill(grey);
        self
    }

    /// Adds random noise with an sd of 2.3 grey levels. Each frame has its own `seed`.
    pub fn noisy(mut self, seed: u64) -> Self {
        let mut dice = Dice::new(seed + 77);
        for value in &mut self.values {
            let four = dice.next();
            let sum: i32 = (0..4).map(|i| ((four >> (8 * i)) & 15) as i32).sum();
            *value = (i32::from(*value) + (sum - 30) / 4).clamp(0, 255) as u8;
        }
        self
    }

    pub fn rgb(&self) -> RgbImage {
        let mut image = RgbImage::new(self.width as u32, self.height as u32);
        for (pixel, value) in image.chunks_exact_mut(3).zip(&self.values) {
            pixel.fill(*value);
        }
        image
    }
}

/// A scene with traffic that gives one picture per frame.
pub trait Scene {
    fn fps(&self) -> f64;
    /// Size of the camera's picture, px.
    fn picture(&self) -> (usize, usize);
    fn at(&self, frame: u64) -> Grey;
}

/// A synthetic scene: a textured ground with lanes of traffic.
pub struct Made {
    ground: Grey,
    /// For each vehicle: its picture, its row, its start column, and its speed in px per frame.
    traffic: Vec<(Grey, i64, f64, f64)>,
}

impl Made {
    pub fn new(seed: u64) -> Self {
        Self::with_traffic(seed, &[(-3.0, 150, 4), (4.0, 220, 4), (6.0, 290, 3)])
    }

    /// Creates a scene with these lanes: speed (px per frame), row, number of vehicles.
    pub fn with_traffic(seed: u64, lanes: &[(f64, i64, u32)]) -> Self {
        let mut ground = Grey::textured(900, 520, seed);
        let mut dice = Dice::new(seed + 5);
        for _ in 0..30 {
            let (width, height) = (dice.below(60) as usize + 20, dice.below(40) as usize + 20);
            let house = Grey { width, height, values: vec![dice.below(180) as u8 + 40; width * height] };
            ground.paste(&house, i64::from(dice.below(900)), i64::from(dice.below(520)));
        }
        let mut traffic = Vec::new();
        for &(speed, row, count) in lanes {
            for i in 0..count {
                let mut car = Grey::textured(110, 48, seed + 100 + u64::from(i) + row as u64);
                let paint = Grey { width: 70, height: 30, values: vec![dice.below(220) as u8 + 20; 70 * 30] };
                car.paste(&paint, 20, 9);
                traffic.push((car, row, f64::from(i * 900 / count), speed));
            }
        }
        Self { ground, traffic }
    }
}

impl Scene for Made {
    fn fps(&self) -> f64 {
        30.0
    }

    fn picture(&self) -> (usize, usize) {
        (640, 360)
    }

    fn at(&self, frame: u64) -> Grey {
        let mut here = self.ground.clone();
        for (car, row, start, speed) in &self.traffic {
            let x = (start + speed * frame as f64).rem_euclid(900.0 + 110.0) - 110.0;
            here.paste(car, x.round() as i64, *row);
        }
        here
    }
}

/// The frames of a clip in the repository, played forwards and backwards in turn.
pub struct Played {
    frames: Vec<Grey>,
    fps: f64,
}

impl Played {
    pub fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name);
        let mut input = open(&path, &DecodeOptions::default()).unwrap();
        let (mut frames, mut last_s) = (Vec::new(), 0.0);
        while let Some(frame) = input.next_frame().unwrap() {
            last_s = frame.stamp.time_s();
            let (width, height) = (frame.image.width() as usize, frame.image.height() as usize);
            let values = frame.image.as_raw().chunks_exact(3).map(|p| p[1]).collect();
            frames.push(Grey { width, height, values });
        }
        let fps = (frames.len() - 1) as f64 / last_s;
        Self { frames, fps }
    }
}

impl Scene for Played {
    fn fps(&self) -> f64 {
        self.fps
    }

    fn picture(&self) -> (usize, usize) {
        (1120, 600)
    }

    fn at(&self, frame: u64) -> Grey {
        let last = self.frames.len() - 1;
        let at = frame as usize % (2 * last);
        self.frames[at.min(2 * last - at)].clone()
    }
}

/// The watcher's results for a clip.
pub struct WatchedClip {
    pub stride: u64,
    pub fps: f64,
    /// For each frame: its stamp, its record, and the shift of its middle against the keyframe in px of the frame.
    pub frames: Vec<(FrameStamp, WatchRecord, [f64; 2])>,
}

impl WatchedClip {
    pub fn moves(&self) -> Vec<CameraMove> {
        self.frames.iter().filter_map(|(_, record, _)| record.moved).collect()
    }

    /// Returns the verdicts between two times, s.
    pub fn between(&self, from_s: f64, to_s: f64) -> Vec<PictureVerdict> {
        let inside = |stamp: &FrameStamp| (from_s..to_s).contains(&stamp.time_s());
        self.frames.iter().filter(|(stamp, ..)| inside(stamp)).map(|(_, record, _)| record.verdict).collect()
    }

    /// Returns the time of the first frame with this verdict, s.
    pub fn first(&self, verdict: PictureVerdict) -> Option<f64> {
        self.frames.iter().find(|(_, record, _)| record.verdict == verdict).map(|(stamp, ..)| stamp.time_s())
    }
}

/// Returns the shift of the picture's middle against its keyframe, px of the frame.
pub fn shift_of(view: Option<&KeyframeView>, image: &RgbImage) -> [f64; 2] {
    let middle = Vector2::new(f64::from(image.width()), f64::from(image.height())) / 2.0;
    view.map_or([0.0; 2], |view| (view.picture_from_keyframe.apply(&middle) - middle).into())
}

/// Runs the watcher on a synthetic clip at several strides at once. `picture` draws the frame with this number at this
/// time, s.
pub fn watched(
    fps: f64,
    seconds: f64,
    strides: &[u64],
    picture: impl Fn(u64, f64) -> Grey,
) -> Vec<WatchedClip> {
    let mut watchers: Vec<(Watcher, WatchedClip)> = strides
        .iter()
        .map(|&stride| (Watcher::new(), WatchedClip { stride, fps, frames: Vec::new() }))
        .collect();
    for frame in 0..(seconds * fps) as u64 {
        if strides.iter().all(|stride| frame % stride > 0) {
            continue;
        }
        let time_s = frame as f64 / fps;
        let stamp = FrameStamp { index: frame, pts_nanos: (time_s * 1e9).round() as i64 };
        let image = picture(frame, time_s).rgb();
        for (watcher, clip) in &mut watchers {
            if frame % clip.stride == 0 {
                let seen = watcher.observe(stamp, &image).unwrap();
                clip.frames.push((stamp, seen.record, shift_of(seen.view.as_ref(), &image)));
            }
        }
    }
    watchers.into_iter().map(|(_, clip)| clip).collect()
}

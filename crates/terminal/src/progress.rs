//! Progress of a run: a bar with frames/s and time left on a terminal, or else a log line every 10 s.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use roadplane_pipeline::Progress;

/// Time between two log lines of progress, if stderr is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// A display of the progress of one input: a bar on a terminal, or else log lines.
pub struct Bar {
    name: String,
    bar: ProgressBar,
    last_line: Mutex<Instant>,
}

impl Bar {
    /// Creates a display that shows the name of the input.
    pub fn new(name: &str) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        let template = "{prefix:.bold} {wide_bar} {pos}/{len} frames  {per_sec}  {eta} left  {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(name.to_owned());
        Self { name: name.to_owned(), bar, last_line: Mutex::new(Instant::now()) }
    }
}

impl Progress for Bar {
    fn expect(&self, frames: Option<u64>) {
        if let Some(frames) = frames {
            self.bar.set_length(frames);
        }
        self.bar.set_position(0);
        self.bar.reset_eta();
    }

    fn frame_done(&self) {
        self.bar.inc(1);
        if !self.bar.is_hidden() {
            return;
        }
        let Ok(mut last) = self.last_line.lock() else { return };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            let (done, rate) = (self.bar.position(), self.bar.per_sec());
            tracing::info!("{}: {}", self.name, line(done, self.bar.length(), rate));
        }
    }

    fn phase(&self, name: &str) {
        self.bar.set_message(name.to_owned());
        tracing::debug!("{}: {name}", self.name);
    }
}

/// Returns the progress as text: frames done, frames/s, and the time left if `all` (number of all frames) is given.
fn line(done: u64, all: Option<u64>, frames_per_s: f64) -> String {
    let Some(all) = all.filter(|_| frames_per_s > 0.0) else {
        return format!("{done} frames, {frames_per_s:.1} frames/s");
    };
    let left_s = (all.saturating_sub(done) as f64 / frames_per_s).round();
    let left = match left_s {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    };
    format!("{done}/{all} frames, {frames_per_s:.1} frames/s, {left} left")
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_shown_if_the_length_is_given() {
        assert_eq!(line(30, Some(90), 6.0), "30/90 frames, 6.0 frames/s, 10 s left");
        assert_eq!(line(0, Some(36_000), 10.0), "0/36000 frames, 10.0 frames/s, 60 min left");
        assert_eq!(line(0, Some(360_000), 10.0), "0/360000 frames, 10.0 frames/s, 10.0 h left");
        assert_eq!(line(7, None, 2.0), "7 frames, 2.0 frames/s");
        assert_eq!(line(0, Some(9), 0.0), "0 frames, 0.0 frames/s");
    }
}

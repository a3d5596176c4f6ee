//! Progress of a run: a bar with frames/s and time left on a terminal, or else a log line every 10 s.

use std::fmt::Write;
use std::sync::{LazyLock, Mutex};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use roadplane_pipeline::Progress;

/// Time between two log lines of progress, if stderr is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// All bars of the process. The log clears them while it writes a line, so that no bar stays between two lines.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// Style of a bar that counts frames up to a known total.
const COUNT_OF: &str = "{prefix:.bold} {wide_bar} {pos}/{len} frames  {rate}  {eta} left  {msg}";
/// Style of a bar that counts frames without a known total.
const COUNT: &str = "{prefix:.bold}  {pos} frames  {rate}  {msg}";
/// Style of a bar in a part of the work without frames.
const PHASE: &str = "{prefix:.bold}  {msg}";

/// A display of the progress of one input: a bar on a terminal, or else log lines.
pub struct Bar {
    name: String,
    bar: ProgressBar,
    last_line: Mutex<Instant>,
}

impl Bar {
    /// Creates a display that shows the name of the input.
    pub fn new(name: &str) -> Self {
        let bar = BARS.add(ProgressBar::no_length());
        set_style(&bar, PHASE);
        bar.set_prefix(name.to_owned());
        Self { name: name.to_owned(), bar, last_line: Mutex::new(Instant::now()) }
    }
}

/// Calls a function that writes to stderr, while no bar is on the terminal.
pub(crate) fn between_bars<T>(write: impl FnOnce() -> T) -> T {
    BARS.suspend(write)
}

fn set_style(bar: &ProgressBar, template: &str) {
    if let Ok(style) = ProgressStyle::with_template(template) {
        let rate = |state: &ProgressState, to: &mut dyn Write| {
            // A bar has no place for an error.
            let _unwritten = write!(to, "{}", rate_in_words(state.per_sec()));
        };
        bar.set_style(style.with_key("rate", rate));
    }
}

impl Progress for Bar {
    fn expect(&self, frames: Option<u64>) {
        match frames {
            Some(frames) => self.bar.set_length(frames),
            None => self.bar.unset_length(),
        }
        self.bar.set_position(0);
        self.bar.reset_eta();
        set_style(&self.bar, if frames.is_some() { COUNT_OF } else { COUNT });
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
        if self.bar.length().is_none_or(|frames| self.bar.position() >= frames) {
            set_style(&self.bar, PHASE);
        }
        self.bar.set_message(name.to_owned());
        tracing::debug!("{}: {name}", self.name);
    }
}

/// Returns a rate as text with three digits, or all digits of a higher rate: `0.25 frames/s`, `15.5 frames/s`, `238 frames/s`.
fn rate_in_words(frames_per_s: f64) -> String {
    match frames_per_s {
        rate if rate < 0.995 => format!("{rate:.2} frames/s"),
        rate if rate < 99.95 => format!("{rate:.1} frames/s"),
        rate => format!("{rate:.0} frames/s"),
    }
}

/// Returns the progress as text: frames done, frames/s, and the time left if `all` (number of all frames) is given.
fn line(done: u64, all: Option<u64>, frames_per_s: f64) -> String {
    let Some(all) = all.filter(|_| frames_per_s > 0.0) else {
        return format!("{done} frames, {}", rate_in_words(frames_per_s));
    };
    let left_s = (all.saturating_sub(done) as f64 / frames_per_s).round();
    let left = match left_s {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    };
    format!("{done}/{all} frames, {}, {left} left", rate_in_words(frames_per_s))
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        BARS.remove(&self.bar);
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
        assert_eq!(line(0, Some(9), 0.0), "0 frames, 0.00 frames/s");
    }

    #[test]
    fn rates_have_three_digits() {
        let rates = [0.0449, 0.25, 0.996, 15.4525, 99.96, 238.4, 1204.0].map(rate_in_words);
        let texts =
            ["0.04", "0.25", "1.0", "15.5", "100", "238", "1204"].map(|rate| format!("{rate} frames/s"));
        assert_eq!(rates, texts);
    }

    #[test]
    fn a_total_is_shown_only_if_it_is_given() {
        let bar = Bar::new("lot");
        assert_eq!(bar.bar.length(), None);
        bar.expect(Some(90));
        assert_eq!(bar.bar.length(), Some(90));
        bar.frame_done();
        bar.expect(None);
        assert_eq!((bar.bar.length(), bar.bar.position()), (None, 0));
    }
}

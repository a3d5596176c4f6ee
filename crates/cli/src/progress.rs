//! A bar with frames/s and time left on a terminal, a log line now and then anywhere else.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use roadplane_pipeline::Progress;

/// Time between log lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Progress of one input.
pub struct Bar {
    name: String,
    bar: ProgressBar,
    last_line: Mutex<Instant>,
}

impl Bar {
    /// A bar named after its input.
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
    }

    fn frame_done(&self) {
        self.bar.inc(1);
        if !self.bar.is_hidden() {
            return;
        }
        let Ok(mut last) = self.last_line.lock() else { return };
        if last.elapsed() >= LINE_EVERY {
            *last = Instant::now();
            let total = self.bar.length().map_or_else(String::new, |n| format!("/{n}"));
            tracing::info!(
                "{}: {}{total} frames, {:.1} frames/s",
                self.name,
                self.bar.position(),
                self.bar.per_sec()
            );
        }
    }

    fn phase(&self, name: &str) {
        self.bar.set_message(name.to_owned());
        tracing::debug!("{}: {name}", self.name);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

//! Converts the stream's times to the times and indices of frames.

/// Number of equal time steps after which a stream counts as steady. In a steady stream, a longer step means lost
/// frames. In an unsteady stream, longer steps are normal.
const STEADY_STEPS: u32 = 8;
/// Largest deviation of a time step from the usual step, as a share of the usual step.
const STEADY_TOLERANCE: f64 = 0.25;
/// Largest number of frames without times that are normal at the end of a stream. The decoder had buffered these
/// frames.
const MAX_BUFFERED: u64 = 16;

/// Makes the times of frames increase, and detects missing frames.
#[derive(Debug)]
pub(crate) struct Clock {
    /// Usual time from frame to frame, ns.
    step_nanos: f64,
    steady_steps: u32,
    /// Whether the last time step was a gap in a steady stream.
    after_gap: bool,
    last_nanos: Option<i64>,
    without_time: u64,
}

/// The time of a frame, and the properties of the time step before it.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Tick {
    pub pts_nanos: i64,
    /// Number of frames missing between the last frame and this one.
    pub skipped: u64,
    /// Whether the time step to this frame was the usual one. If so, a gap just before it was a loss and not a change
    /// of rate.
    pub usual: bool,
    /// Number of frames that this call adds to the count of frames with invented times.
    pub made_up: u64,
}

impl Clock {
    pub(crate) fn new(fps: f64) -> Self {
        Self { step_nanos: 1e9 / fps, steady_steps: 0, after_gap: false, last_nanos: None, without_time: 0 }
    }

    /// Returns the time of the last frame, s.
    pub(crate) fn last_s(&self) -> f64 {
        self.last_nanos.map_or(0.0, |nanos| nanos as f64 * 1e-9)
    }

    /// Begins with a frame of a stream that is known to be steady, ms from the start of the stream.
    pub(crate) fn begin_steady(&mut self, millis: f64) {
        self.tick(millis);
        self.steady_steps = STEADY_STEPS;
    }

    /// Processes the next frame's time as the stream states it, ms from the start of the stream.
    pub(crate) fn tick(&mut self, millis: f64) -> Tick {
        let stated = (millis.is_finite() && millis.abs() < 1e12).then_some((millis * 1e6).round() as i64);
        let Some(last) = self.last_nanos else {
            let pts_nanos = stated.unwrap_or(0);
            self.last_nanos = Some(pts_nanos);
            return Tick { pts_nanos, skipped: 0, usual: true, made_up: 0 };
        };
        // OpenCV returns 0 for a frame without a time.
        let Some(time) = stated.filter(|&time| time > last) else {
            let pts_nanos = last.saturating_add(self.step_nanos.max(1.0) as i64);
            self.last_nanos = Some(pts_nanos);
            self.without_time += 1;
            return Tick { pts_nanos, skipped: 0, usual: true, made_up: self.newly_made_up(false) };
        };
        let made_up = self.newly_made_up(true);
        let step = (time - last) as f64;
        let steps = (step / self.step_nanos).round();
        let usual = (step / self.step_nanos - 1.0).abs() <= STEADY_TOLERANCE;
        let was_steady = self.steady_steps >= STEADY_STEPS;
        let mut skipped = 0;
        if usual {
            self.steady_steps += 1;
            self.after_gap = false;
        } else if was_steady && !self.after_gap && steps >= 2.0 {
            self.after_gap = true;
            skipped = steps as u64 - 1;
        } else {
            // The stream has no steady rate yet, or a new rate. This step becomes the usual step.
            (self.step_nanos, self.steady_steps, self.after_gap) = (step, 0, false);
        }
        self.last_nanos = Some(time);
        Tick { pts_nanos: time, skipped, usual, made_up }
    }

    /// Returns the number of frames to add to the count of frames with invented times. A few frames without a time at
    /// the end of a stream are normal and are not counted.
    fn newly_made_up(&mut self, stated_again: bool) -> u64 {
        match self.without_time {
            run if stated_again => {
                self.without_time = 0;
                if run > MAX_BUFFERED { 0 } else { run }
            }
            run if run == MAX_BUFFERED + 1 => run,
            run if run > MAX_BUFFERED => 1,
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(clock: &mut Clock, millis: &[f64]) -> (Vec<i64>, u64, u64) {
        let ticks: Vec<Tick> = millis.iter().map(|m| clock.tick(*m)).collect();
        let times = ticks.iter().map(|tick| tick.pts_nanos / 1_000_000).collect();
        let sum = |field: fn(&Tick) -> u64| ticks.iter().map(field).sum();
        (times, sum(|tick| tick.skipped), sum(|tick| tick.made_up))
    }

    #[test]
    fn gaps_in_a_steady_stream_are_lost_frames() {
        let mut clock = Clock::new(25.0);
        let steady: Vec<f64> = (0..10).map(|i| i as f64 * 40.0).collect();
        assert_eq!(run(&mut clock, &steady).1, 0);
        assert_eq!(clock.tick(520.0), Tick { pts_nanos: 520_000_000, skipped: 3, usual: false, made_up: 0 });
        assert_eq!(clock.tick(560.0), Tick { pts_nanos: 560_000_000, skipped: 0, usual: true, made_up: 0 });
    }

    #[test]
    fn a_piece_counts_gaps_from_its_first_frame_on() {
        let mut clock = Clock::new(25.0);
        clock.begin_steady(240_000.0);
        assert_eq!(clock.tick(240_160.0).skipped, 3);
    }

    #[test]
    fn a_change_of_rate_is_no_loss() {
        let mut clock = Clock::new(25.0);
        run(&mut clock, &(0..10).map(|i| i as f64 * 40.0).collect::<Vec<_>>());
        assert_eq!(clock.tick(520.0).skipped, 3, "may be a loss");
        assert!(!clock.tick(680.0).usual, "no loss");
        let (_, skipped, _) = run(&mut clock, &(1..20).map(|i| 680.0 + i as f64 * 160.0).collect::<Vec<_>>());
        assert_eq!(skipped, 0);
    }

    #[test]
    fn an_unsteady_stream_has_no_gaps() {
        let mut clock = Clock::new(25.0);
        let (_, skipped, made_up) = run(&mut clock, &[0.0, 40.0, 300.0, 310.0, 800.0, 810.0, 2000.0]);
        assert_eq!((skipped, made_up), (0, 0));
    }

    #[test]
    fn buffered_frames_continue_at_the_usual_step() {
        let mut clock = Clock::new(25.0);
        let (times, _, made_up) = run(&mut clock, &[0.0, 40.0, 80.0, 0.0, 0.0]);
        assert_eq!((times, made_up), (vec![0, 40, 80, 120, 160], 0));
    }

    #[test]
    fn frames_without_times_are_counted() {
        let mut clock = Clock::new(10.0);
        let (times, _, made_up) = run(&mut clock, &[f64::NAN; 30]);
        assert_eq!((times[29], made_up), (2900, 29));
        let (times, _, made_up) = run(&mut Clock::new(25.0), &[0.0, 40.0, -5.0, 120.0, f64::INFINITY, 200.0]);
        assert_eq!((times, made_up), (vec![0, 40, 80, 120, 160, 200], 2));
    }
}

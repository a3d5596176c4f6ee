//! Processor time, as measured by the system.

use rustix::time::{ClockId, Timespec, clock_gettime};

fn seconds(time: Timespec) -> f64 {
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Returns the processor time of the calling thread so far, s.
#[must_use]
pub fn thread_cpu_s() -> f64 {
    seconds(clock_gettime(ClockId::ThreadCPUTime))
}

/// Returns the processor time of all threads of this process so far, including threads that have ended, s.
#[must_use]
pub fn process_cpu_s() -> f64 {
    seconds(clock_gettime(ClockId::ProcessCPUTime))
}

/// Measures the processor time between two calls.
#[derive(Debug)]
pub struct Laps {
    alone: bool,
    last_s: f64,
}

impl Laps {
    /// Starts a measurement. If `alone` is true, all threads of this process count, otherwise only the calling thread.
    #[must_use]
    pub fn start(alone: bool) -> Self {
        let mut laps = Self { alone, last_s: 0.0 };
        laps.next_s();
        laps
    }

    /// Returns the processor time since the previous call, or since the start, s.
    pub fn next_s(&mut self) -> f64 {
        let now_s = if self.alone { process_cpu_s() } else { thread_cpu_s() };
        let lap_s = now_s - self.last_s;
        self.last_s = now_s;
        lap_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_processor_time() {
        let (mut thread, mut process) = (Laps::start(false), Laps::start(true));
        let mut sum = 0u64;
        while thread.last_s <= 0.0 || thread_cpu_s() - thread.last_s < 0.02 {
            sum = std::hint::black_box(sum.wrapping_add(1));
        }
        let (thread_s, process_s) = (thread.next_s(), process.next_s());
        assert!(thread_s >= 0.02 && process_s >= 0.9 * thread_s, "{thread_s} {process_s}");
    }
}

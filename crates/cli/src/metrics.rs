//! Counts of a run in Prometheus' text format. They are written to a file at the end, and served on a loopback address
//! during the run.

use std::fmt::Write as _;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use roadplane_pipeline::{Fault, PipelineError, Progress, RunReport, WriteError};
use roadplane_write::OutFile;
use roadplane_write::RunStatus;

use roadplane_terminal::Bar;

/// Time limit for reading a request and for writing the answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Counts of one run. Clones of this object share the same counts.
#[derive(Clone)]
pub struct Metrics(Arc<Counts>);

struct Counts {
    run_id: String,
    started: Instant,
    inputs: u64,
    running: AtomicU64,
    done: AtomicU64,
    damaged: AtomicU64,
    partly_followed: AtomicU64,
    /// Inputs without a result, by cause: input, configuration or machine.
    failed: [(&'static str, AtomicU64); 3],
    frames: AtomicU64,
    frames_lost: AtomicU64,
    frames_not_followed: AtomicU64,
    tracks: AtomicU64,
}

/// Returns a run id that is unique on one machine: the time in seconds and the process number.
pub fn default_run_id() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    format!("{seconds}-{}", std::process::id())
}

impl Metrics {
    /// Creates the counts of a run with `inputs` inputs. All counts are 0.
    pub fn new(run_id: &str, inputs: usize) -> Self {
        Self(Arc::new(Counts {
            run_id: run_id.to_owned(),
            started: Instant::now(),
            inputs: inputs as u64,
            running: AtomicU64::new(0),
            done: AtomicU64::new(0),
            damaged: AtomicU64::new(0),
            partly_followed: AtomicU64::new(0),
            failed: ["input", "configuration", "machine"].map(|fault| (fault, AtomicU64::new(0))),
            frames: AtomicU64::new(0),
            frames_lost: AtomicU64::new(0),
            frames_not_followed: AtomicU64::new(0),
            tracks: AtomicU64::new(0),
        }))
    }

    /// Counts one more input as running.
    pub fn begin(&self) {
        self.0.running.fetch_add(1, Relaxed);
    }

    /// Counts one input fewer as running, and adds its result to the counts.
    pub fn end(&self, result: &Result<RunReport, PipelineError>) {
        let counts = &self.0;
        counts.running.fetch_sub(1, Relaxed);
        match result {
            Ok(report) => {
                let state = match report.status {
                    RunStatus::InputDamaged => &counts.damaged,
                    RunStatus::PartlyFollowed => &counts.partly_followed,
                    RunStatus::Complete | RunStatus::PointsNotUsed => &counts.done,
                };
                state.fetch_add(1, Relaxed);
                counts.tracks.fetch_add(report.tracks.unwrap_or(0), Relaxed);
                counts.frames_lost.fetch_add(report.frames_lost, Relaxed);
                counts.frames_not_followed.fetch_add(report.frames_not_followed, Relaxed);
            }
            Err(error) => {
                let fault = match error.fault() {
                    Fault::Input => 0,
                    Fault::Usage | Fault::Model => 1,
                    Fault::Locked | Fault::Internal | Fault::Stopped { .. } => 2,
                };
                counts.failed[fault].1.fetch_add(1, Relaxed);
            }
        }
    }

    /// Returns all counts in Prometheus' text format.
    pub fn text(&self) -> String {
        let counts = &self.0;
        let of = |count: &AtomicU64| count.load(Relaxed);
        let escaped = counts.run_id.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
        let mut text = String::new();
        let mut put = |name: &str, kind: &str, help: &str, values: &[(String, f64)]| {
            let _infallible = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
            for (labels, value) in values {
                let _infallible = writeln!(text, "{name}{labels} {value}");
            }
        };
        let version = env!("CARGO_PKG_VERSION");
        let info = format!("{{version=\"{version}\",run_id=\"{escaped}\"}}");
        put("roadplane_run_info", "gauge", "The run.", &[(info, 1.0)]);
        let (running, done, damaged) = (of(&counts.running), of(&counts.done), of(&counts.damaged));
        let failed: u64 = counts.failed.iter().map(|(_, count)| of(count)).sum();
        let partly_followed = of(&counts.partly_followed);
        let waiting = counts.inputs.saturating_sub(running + done + damaged + partly_followed + failed);
        let states = [
            ("waiting", waiting),
            ("running", running),
            ("done", done),
            ("damaged", damaged),
            ("partly_followed", partly_followed),
        ];
        let mut inputs: Vec<(String, f64)> =
            states.iter().map(|(state, n)| (format!("{{state=\"{state}\"}}"), *n as f64)).collect();
        inputs.push(("{state=\"failed\"}".to_owned(), failed as f64));
        put("roadplane_inputs", "gauge", "Inputs of the run by state.", &inputs);
        let faults: Vec<(String, f64)> = counts
            .failed
            .iter()
            .map(|(fault, count)| (format!("{{fault=\"{fault}\"}}"), of(count) as f64))
            .collect();
        put(
            "roadplane_failures_total",
            "counter",
            "Inputs without a result, by cause: input, configuration or machine.",
            &faults,
        );
        let mut total = |name: &str, help: &str, count: &AtomicU64| {
            put(name, "counter", help, &[(String::new(), of(count) as f64)]);
        };
        total("roadplane_frames_total", "Frames that have passed all stages.", &counts.frames);
        total(
            "roadplane_frames_lost_total",
            "Frames of finished inputs that could not be decoded.",
            &counts.frames_lost,
        );
        total(
            "roadplane_frames_not_followed_total",
            "Frames of finished inputs in which vehicles were not followed, because the camera moved.",
            &counts.frames_not_followed,
        );
        total("roadplane_tracks_total", "Tracks of finished inputs.", &counts.tracks);
        let seconds = counts.started.elapsed().as_secs_f64();
        put("roadplane_run_seconds", "gauge", "Time since the run began, s.", &[(String::new(), seconds)]);
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        put(
            "roadplane_time_seconds",
            "gauge",
            "Time at which this text was written, Unix time, s.",
            &[(String::new(), now)],
        );
        text
    }

    /// Writes the counts to a file for Prometheus' textfile collector. The file appears only when it is complete.
    ///
    /// # Errors
    /// Returns [`PipelineError::Write`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PipelineError> {
        let write = || -> Result<(), WriteError> {
            let mut file = OutFile::create(path)?;
            file.write_bytes(self.text().as_bytes())?;
            file.finish()
        };
        Ok(write()?)
    }
}

/// Serves the counts over HTTP until the process ends.
///
/// # Errors
/// Returns [`PipelineError::Usage`] if the address is not a loopback address, or if the program cannot listen on it.
pub fn serve(address: SocketAddr, metrics: &Metrics) -> Result<(), PipelineError> {
    if !address.ip().is_loopback() {
        return Err(PipelineError::usage(&format!(
            "--metrics {address}: the address must be a loopback address"
        )));
    }
    let cannot = |error| PipelineError::usage(&format!("--metrics {address}: {error}"));
    let listener = TcpListener::bind(address).map_err(cannot)?;
    let metrics = metrics.clone();
    let answer_all = move || {
        for stream in listener.incoming().flatten() {
            if let Err(error) = answer(stream, &metrics) {
                tracing::debug!("metrics: {error}");
            }
        }
    };
    std::thread::Builder::new().name("metrics".to_owned()).spawn(answer_all).map_err(cannot)?;
    Ok(())
}

/// Answers one HTTP request. Only `GET /metrics` is supported, and the headers are ignored.
fn answer(mut stream: TcpStream, metrics: &Metrics) -> std::io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = [0; 1024];
    let mut length = 0;
    while length < request.len() && !request[..length].windows(4).any(|end| end == b"\r\n\r\n") {
        let read = stream.read(&mut request[length..])?;
        if read == 0 {
            break;
        }
        length += read;
    }
    let (status, body) = if request.starts_with(b"GET /metrics ") {
        ("200 OK", metrics.text())
    } else {
        ("404 Not Found", "only GET /metrics\n".to_owned())
    };
    let kind = "text/plain; version=0.0.4; charset=utf-8";
    let size = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {size}\r\nConnection: close\r\n\r\n{body}"
    )
}

/// A progress bar that also counts frames.
pub struct Counted<'a> {
    /// The progress bar.
    pub bar: Bar,
    /// The counts.
    pub metrics: &'a Metrics,
}

impl Progress for Counted<'_> {
    fn expect(&self, frames: Option<u64>) {
        self.bar.expect(frames);
    }

    fn frame_done(&self) {
        self.metrics.0.frames.fetch_add(1, Relaxed);
        self.bar.frame_done();
    }

    fn phase(&self, name: &str) {
        self.bar.phase(name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_served_on_loopback_only() {
        let metrics = Metrics::new("night \"1\"", 6);
        metrics.begin();
        metrics.end(&Err(PipelineError::usage("x")));
        metrics.begin();
        let report = RunReport {
            folder: "o".into(),
            tracks: Some(7),
            camera: String::new(),
            status: RunStatus::InputDamaged,
            frames_lost: 3,
            frames_not_followed: 2,
        };
        metrics.end(&Ok(report.clone()));
        metrics.begin();
        metrics.end(&Ok(RunReport { status: RunStatus::PartlyFollowed, frames_lost: 0, ..report }));
        metrics.begin();
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        serve(free, &metrics).unwrap();
        let get = |path: &str| {
            let mut stream = TcpStream::connect(free).unwrap();
            write!(stream, "GET {path} HTTP/1.1\r\nHost: here\r\n\r\n").unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            text
        };
        let text = get("/metrics");
        assert!(text.starts_with("HTTP/1.1 200 OK\r\n"), "{text}");
        for line in [
            "roadplane_run_info{version=\"0.2.0\",run_id=\"night \\\"1\\\"\"} 1",
            "roadplane_inputs{state=\"waiting\"} 2",
            "roadplane_inputs{state=\"running\"} 1",
            "roadplane_inputs{state=\"damaged\"} 1",
            "roadplane_failures_total{fault=\"configuration\"} 1",
            "roadplane_inputs{state=\"partly_followed\"} 1",
            "roadplane_frames_lost_total 3",
            "roadplane_frames_not_followed_total 4",
            "roadplane_tracks_total 14",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} is missing in\n{text}");
        }
        assert!(get("/").starts_with("HTTP/1.1 404"));
        let refused = serve("0.0.0.0:0".parse().unwrap(), &metrics);
        assert!(matches!(refused, Err(PipelineError::Usage { .. })));
    }
}

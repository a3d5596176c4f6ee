//! The frames file of a run in progress. The file grows by one line per frame. If the run is killed, a later run can
//! continue the file.

use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use roadplane_base::{FrameRecord, ImageSize, Registration, SceneCurve};

use crate::jsonl::json_line;
use crate::{JsonLines, WriteError};

/// A summary of the frames that were recovered from the frames file of an earlier run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Number of recovered frames.
    pub frames: u64,
    /// Index of the last recovered frame; `None` if no frame was recovered. A resumed run continues with the next
    /// frame.
    pub last_frame: Option<u64>,
    /// Number of bytes that were removed after the last recovered frame. [`FrameSpool::open`] describes the removed
    /// part.
    pub cut_bytes: u64,
}

/// The frames file in progress. Frames are appended in the order of their index.
///
/// Unlike an [`OutFile`](crate::OutFile), the frames file has its final name from the start. If a run is killed,
/// [`FrameSpool::open`] repairs the file.
#[derive(Debug)]
pub struct FrameSpool {
    writer: BufWriter<File>,
    line: Vec<u8>,
    path: PathBuf,
}

impl FrameSpool {
    /// Opens or creates the frames file, and removes the frames that a resumed run must process again.
    ///
    /// The frames are divided into intervals, and `interval_of` returns the number of a frame's interval. A resumed run
    /// must start at the first frame of an interval.
    ///
    /// The function removes the first damaged or incomplete line and all lines after it. Then it removes the last
    /// interval of the remaining frames.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn open(
        path: &Path,
        interval_of: impl Fn(&FrameRecord) -> u64,
    ) -> Result<(Self, Recovered), WriteError> {
        let fail = |doing| WriteError::io(doing, path);
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(fail("open"))?;
        let length = file.metadata().map_err(fail("read"))?.len();
        let (mut recovered, whole_bytes) = whole_part(&file, interval_of).map_err(fail("read"))?;
        if whole_bytes < length {
            recovered.cut_bytes = length - whole_bytes;
            file.set_len(whole_bytes).map_err(fail("write"))?;
        }
        file.seek(SeekFrom::Start(whole_bytes)).map_err(fail("write"))?;
        let spool = Self {
            writer: BufWriter::with_capacity(1 << 16, file),
            line: Vec::new(),
            path: path.to_path_buf(),
        };
        Ok((spool, recovered))
    }

    /// Appends a frame as one line.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn append(&mut self, record: &FrameRecord) -> Result<(), WriteError> {
        json_line(&mut self.line, record, &self.path)?;
        self.writer.write_all(&self.line).map_err(WriteError::io("write", &self.path))
    }

    /// Writes all frames that were appended so far to disk.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn sync(&mut self) -> Result<(), WriteError> {
        self.writer
            .flush()
            .and_then(|()| self.writer.get_ref().sync_data())
            .map_err(WriteError::io("write", &self.path))
    }
}

/// Counts the complete frames from the start of the file, and their bytes. The frames of the last interval are not
/// counted.
fn whole_part(file: &File, interval_of: impl Fn(&FrameRecord) -> u64) -> std::io::Result<(Recovered, u64)> {
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let mut found = Recovered::default();
    let mut bytes = 0;
    let mut line = Vec::new();
    // The result at the start of the interval that contains the last frame.
    let mut interval = None;
    let mut before = (Recovered::default(), 0);
    loop {
        line.clear();
        let read = reader.read_until(b'\n', &mut line)?;
        let record = line
            .strip_suffix(b"\n")
            .and_then(|line| std::str::from_utf8(line).ok())
            .and_then(|line| FrameRecord::from_json(line).ok())
            .filter(|record| found.last_frame.is_none_or(|last| record.frame > last));
        let Some(record) = record else { return Ok(before) };
        if interval.replace(interval_of(&record)) != Some(interval_of(&record)) {
            before = (found, bytes);
        }
        found.frames += 1;
        found.last_frame = Some(record.frame);
        bytes += read as u64;
    }
}

/// An iterator over the frames of a frames file.
///
/// The iterator skips empty lines. If a line is invalid, the error contains the line number.
#[derive(Debug)]
pub struct FrameReader {
    lines: std::io::Lines<BufReader<File>>,
    number: u64,
    path: PathBuf,
}

impl FrameReader {
    /// Opens a frames file for reading.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn open(path: &Path) -> Result<Self, WriteError> {
        let file = File::open(path).map_err(WriteError::io("read", path))?;
        Ok(Self { lines: BufReader::new(file).lines(), number: 0, path: path.to_path_buf() })
    }
}

/// All that a frames file shows about the lens.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LensTraces {
    /// Size of the first picture; `None` without frames.
    pub image_size_px: Option<ImageSize>,
    /// Long edges of the scene ([`roadplane_base::FrameRecord::scene_curves`]) of the frame with the largest number.
    pub curves: Vec<SceneCurve>,
}

/// Reads all that a frames file shows about the lens. `take` gets the most accurate registration of each frame whose
/// picture is displaced. Other lines than the first and those with such traces are not parsed.
///
/// # Errors
/// [`WriteError::Malformed`], which names the line; [`WriteError::Io`].
pub fn read_lens_traces(path: &Path, mut take: impl FnMut(&Registration)) -> Result<LensTraces, WriteError> {
    #[derive(serde::Deserialize)]
    struct Line {
        image_size_px: Option<ImageSize>,
        scene_curves: Option<Vec<SceneCurve>>,
        watch: Option<Watch>,
    }
    #[derive(serde::Deserialize)]
    struct Watch {
        #[serde(default)]
        motion: Vec<Registration>,
    }
    let file = File::open(path).map_err(WriteError::io("read", path))?;
    let mut traces = LensTraces::default();
    for (number, line) in (1..).zip(BufReader::new(file).lines()) {
        let line = line.map_err(WriteError::io("read", path))?;
        let has_traces = line.contains("\"scene_curves\"") || line.contains("\"bend\"");
        if line.is_empty() || !(has_traces || traces.image_size_px.is_none()) {
            continue;
        }
        let found: Line = serde_json::from_str(&line)
            .map_err(|e| WriteError::malformed(path, format!("line {number}: {e}")))?;
        traces.image_size_px = traces.image_size_px.or(found.image_size_px);
        let curves = found.scene_curves.unwrap_or_default();
        if curves.len() > traces.curves.len() {
            traces.curves = curves;
        }
        let first = found.watch.and_then(|watch| watch.motion.into_iter().next());
        first.iter().filter(|first| first.lens.is_some()).for_each(&mut take);
    }
    traces.curves.retain(SceneCurve::is_sound);
    Ok(traces)
}

impl Iterator for FrameReader {
    type Item = Result<FrameRecord, WriteError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let line = self.lines.next()?;
            self.number += 1;
            match line {
                Ok(line) if line.trim().is_empty() => {}
                Ok(line) => {
                    let named = |e| WriteError::malformed(&self.path, format!("line {}: {e}", self.number));
                    return Some(FrameRecord::from_json(&line).map_err(named));
                }
                Err(error) => return Some(Err(WriteError::io("read", &self.path)(error))),
            }
        }
    }
}

impl JsonLines {
    /// Appends a frame to a frames file that is written in one pass and never resumed. `roadplane stage detect` writes
    /// such a file.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn write_frame(&mut self, record: &FrameRecord) -> Result<(), WriteError> {
        self.write(record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use roadplane_base::ImageSize;
    use roadplane_base::{RegisteredLens, WatchRecord};

    fn record(frame: u64) -> FrameRecord {
        FrameRecord::empty(frame, frame as f64 / 30.0, ImageSize { width: 640, height: 480 })
    }

    #[test]
    fn every_cut_is_recovered_to_the_same_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        // Opens the file and appends the missing frames.
        let fill = || {
            let (mut spool, recovered) = FrameSpool::open(&path, |record| record.frame / 2).unwrap();
            (recovered.frames..5).for_each(|i| spool.append(&record(i)).unwrap());
            spool.sync().unwrap();
            recovered
        };
        fill();
        let whole = std::fs::read(&path).unwrap();
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let recovered = fill();
            // At most an interval of two frames and a partial line are repeated.
            assert!(recovered.cut_bytes * 5 <= 4 * whole.len() as u64, "{recovered:?}");
            assert_eq!(recovered.frames, recovered.last_frame.map_or(0, |last| last + 1));
            assert_eq!(std::fs::read(&path).unwrap(), whole, "cut at {cut}");
        }
        let frames: Vec<u64> = FrameReader::open(&path).unwrap().map(|r| r.unwrap().frame).collect();
        assert_eq!(frames, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn frames_after_damage_are_repeated() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        let line = |i| serde_json::to_string(&record(i)).unwrap();
        for bad in ["\0\0\0", &line(1), "{}"] {
            std::fs::write(&path, format!("{}\n{}\n{bad}\n{}\n", line(0), line(2), line(3))).unwrap();
            let (_, recovered) = FrameSpool::open(&path, |record| record.frame / 2).unwrap();
            assert_eq!(
                (recovered.frames, recovered.last_frame),
                (1, Some(0)),
                "the interval of frame 2 starts again"
            );
            assert!(recovered.cut_bytes > 0);
        }
    }

    #[test]
    fn errors_name_the_line_of_an_invalid_frame() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        let line = |i| serde_json::to_string(&record(i)).unwrap();
        std::fs::write(&path, format!("{}\n\n{{}}\n{}\n", line(0), line(1))).unwrap();
        let read: Vec<_> = FrameReader::open(&path).unwrap().collect();
        assert_eq!(read.iter().flatten().map(|record| record.frame).collect::<Vec<_>>(), [0, 1]);
        let error = read[1].as_ref().unwrap_err().to_string();
        assert!(error.starts_with("line 3") && error.ends_with("frames.jsonl"), "{error}");
    }

    #[test]
    fn traces_of_the_lens_come_from_all_frames() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        let curve = |x: f64, sd_px: f64| SceneCurve::from([x, 5.0, 300.0, 2.5, 600.0, 5.0, sd_px]);
        let with = |curves: &[SceneCurve]| FrameRecord { scene_curves: Some(curves.to_vec()), ..record(0) };
        // The last edge has no positive sd.
        let most = [curve(1.0, 0.5), curve(2.0, 0.5), curve(3.0, 0.0)];
        let lens = RegisteredLens { bend: -0.02, sd: 0.003, change: [0.0; 8] };
        let here = Registration { reference: 0, homography: Some([1.0; 8]), sd_px: 0.1, lens: Some(lens) };
        let watch = WatchRecord {
            motion: vec![here, Registration { reference: 9, ..here }],
            ..WatchRecord::default()
        };
        let displaced = FrameRecord { watch: Some(watch), ..record(2) };
        let frames = [with(&most), record(1), with(&most[..1]), displaced];
        std::fs::write(&path, frames.each_ref().map(|r| serde_json::to_string(r).unwrap()).join("\n"))
            .unwrap();
        let mut registrations = Vec::new();
        let traces = read_lens_traces(&path, |found| registrations.push(*found)).unwrap();
        assert_eq!(traces.image_size_px, Some(record(0).image_size_px));
        assert_eq!((&traces.curves[..], &registrations[..]), (&most[..2], &[here][..]));
        std::fs::write(&path, "{}\n{\"scene_curves\": 3}\n").unwrap();
        let error = read_lens_traces(&path, |_| ()).unwrap_err().to_string();
        assert!(error.starts_with("line 2"), "{error}");
    }

    #[test]
    fn a_full_disk_is_named() {
        // Every write to /dev/full fails.
        let Ok(file) = OpenOptions::new().write(true).open("/dev/full") else { return };
        let path = PathBuf::from("/dev/full");
        let mut spool = FrameSpool { writer: BufWriter::new(file), line: Vec::new(), path };
        spool.append(&record(0)).unwrap();
        assert!(matches!(spool.sync(), Err(WriteError::DiskFull { .. })));
    }
}

//! The frames file of a run in progress: grows a line a frame, survives a kill.

use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader, BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use roadplane_base::{FrameRecord, SceneCurve};

use crate::jsonl::json_line;
use crate::{JsonLines, WriteError};

/// What was found in a spool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Whole frames that were kept.
    pub frames: u64,
    /// Index of the last of them: a resumed run goes on after it.
    pub last_frame: Option<u64>,
    /// Bytes after them that were cut off: half a line, or what follows a damaged one.
    pub cut_bytes: u64,
}

/// Appends frames in rising order of their index. Unlike other files it has its name from the start: it lives in the
/// partial folder, and recovery makes it whole.
#[derive(Debug)]
pub struct FrameSpool {
    writer: BufWriter<File>,
    line: Vec<u8>,
    path: PathBuf,
}

impl FrameSpool {
    /// Opens or makes the file and cuts off what is not whole: half a line, and the last of the stretches that `stretch_of`
    /// numbers, which work on the frames begins anew.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn open(
        path: &Path,
        stretch_of: impl Fn(&FrameRecord) -> u64,
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
        let (mut recovered, whole_bytes) = whole_part(&file, stretch_of).map_err(fail("read"))?;
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

    /// Adds a frame.
    ///
    /// # Errors
    /// [`WriteError::Io`], [`WriteError::DiskFull`].
    pub fn append(&mut self, record: &FrameRecord) -> Result<(), WriteError> {
        json_line(&mut self.line, record, &self.path)?;
        self.writer.write_all(&self.line).map_err(WriteError::io("write", &self.path))
    }

    /// Puts what was added so far on disk.
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

/// Counts whole frames of rising index from the start, and their bytes, without the last stretch.
fn whole_part(file: &File, stretch_of: impl Fn(&FrameRecord) -> u64) -> std::io::Result<(Recovered, u64)> {
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let mut found = Recovered::default();
    let mut bytes = 0;
    let mut line = Vec::new();
    // Where the stretch of the last frame began.
    let mut stretch = None;
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
        if stretch.replace(stretch_of(&record)) != Some(stretch_of(&record)) {
            before = (found, bytes);
        }
        found.frames += 1;
        found.last_frame = Some(record.frame);
        bytes += read as u64;
    }
}

/// Reads a frames file, one frame at a time; errors name the line. Empty lines are passed over.
#[derive(Debug)]
pub struct FrameReader {
    lines: std::io::Lines<BufReader<File>>,
    number: u64,
    path: PathBuf,
}

impl FrameReader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`WriteError::Io`].
    pub fn open(path: &Path) -> Result<Self, WriteError> {
        let file = File::open(path).map_err(WriteError::io("read", path))?;
        Ok(Self { lines: BufReader::new(file).lines(), number: 0, path: path.to_path_buf() })
    }
}

/// Long edges of the place ([`FrameRecord::scene_curves`]), of the frame that tells most of them; other frames are not looked into.
///
/// # Errors
/// [`WriteError::Malformed`] naming the line, [`WriteError::Io`].
pub fn read_scene_curves(path: &Path) -> Result<Vec<SceneCurve>, WriteError> {
    #[derive(serde::Deserialize)]
    struct Told {
        scene_curves: Vec<SceneCurve>,
    }
    let file = File::open(path).map_err(WriteError::io("read", path))?;
    let mut most = Vec::new();
    for (number, line) in (1..).zip(BufReader::new(file).lines()) {
        let line = line.map_err(WriteError::io("read", path))?;
        if !line.contains("\"scene_curves\"") {
            continue;
        }
        let told: Told = serde_json::from_str(&line)
            .map_err(|e| WriteError::malformed(path, format!("line {number}: {e}")))?;
        if told.scene_curves.len() > most.len() {
            most = told.scene_curves;
        }
    }
    most.retain(SceneCurve::is_sound);
    Ok(most)
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
    /// Adds a frame to a frames file that is written in one go (`roadplane detect`, `roadplane keypoints`).
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

    fn record(frame: u64) -> FrameRecord {
        FrameRecord::empty(frame, frame as f64 / 30.0, ImageSize { width: 640, height: 480 })
    }

    #[test]
    fn every_cut_is_recovered_to_the_same_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        // Opens, and does what is missing.
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
            // No more than a stretch of two frames and half a line are done again.
            assert!(recovered.cut_bytes * 5 <= 4 * whole.len() as u64, "{recovered:?}");
            assert_eq!(recovered.frames, recovered.last_frame.map_or(0, |last| last + 1));
            assert_eq!(std::fs::read(&path).unwrap(), whole, "cut at {cut}");
        }
        let frames: Vec<u64> = FrameReader::open(&path).unwrap().map(|r| r.unwrap().frame).collect();
        assert_eq!(frames, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn what_follows_damage_is_redone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        let line = |i| serde_json::to_string(&record(i)).unwrap();
        for bad in ["\0\0\0", &line(1), "{}"] {
            std::fs::write(&path, format!("{}\n{}\n{bad}\n{}\n", line(0), line(2), line(3))).unwrap();
            let (_, recovered) = FrameSpool::open(&path, |record| record.frame / 2).unwrap();
            assert_eq!(
                (recovered.frames, recovered.last_frame),
                (1, Some(0)),
                "the stretch of frame 2 begins anew"
            );
            assert!(recovered.cut_bytes > 0);
        }
    }

    #[test]
    fn frames_that_cannot_be_are_named_by_their_line() {
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
    fn edges_come_from_the_frame_that_tells_most() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.jsonl");
        let curve = |x: f64, sd_px: f64| SceneCurve::from([x, 5.0, 300.0, 2.5, 600.0, 5.0, sd_px]);
        let told = |curves: &[SceneCurve]| FrameRecord { scene_curves: Some(curves.to_vec()), ..record(0) };
        // The last has no sd.
        let most = [curve(1.0, 0.5), curve(2.0, 0.5), curve(3.0, 0.0)];
        let lines = [told(&most), record(1), told(&most[..1])].map(|r| serde_json::to_string(&r).unwrap());
        std::fs::write(&path, lines.join("\n")).unwrap();
        assert_eq!(read_scene_curves(&path).unwrap(), most[..2]);
        std::fs::write(&path, "{}\n{\"scene_curves\": 3}\n").unwrap();
        let error = read_scene_curves(&path).unwrap_err().to_string();
        assert!(error.starts_with("line 2"), "{error}");
    }

    #[test]
    fn a_full_disk_is_named() {
        // /dev/full reads as zeros: nothing whole in it, and every write fails.
        let Ok(file) = OpenOptions::new().write(true).open("/dev/full") else { return };
        let path = PathBuf::from("/dev/full");
        let mut spool = FrameSpool { writer: BufWriter::new(file), line: Vec::new(), path };
        spool.append(&record(0)).unwrap();
        assert!(matches!(spool.sync(), Err(WriteError::DiskFull { .. })));
    }
}

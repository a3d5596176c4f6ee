//! Tests damaged inputs of all kinds, which a mutation library creates. Each read must end in time, with a result or an
//! error.
//!
//! The set of damaged inputs is fixed. The command `ROADPLANE_MUTATE_S=600 cargo test --release -p roadplane --test
//! mutations` tests more of them: it spends that many seconds on each kind.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mutatis::{Candidates, Context, Mutate, Session};
use roadplane_decode::{DecodeOptions, open};
use roadplane_infer::{Session as Net, SessionOptions};
use roadplane_pipeline::{
    Cancel, Config, EvidenceStore, Silent, SolveMethod, SolveOptions, inputs_of, solve_file, stored_cameras,
};
use roadplane_write::read_constraints;
use serde_json::{Value, json};

/// Longest time for reading one input.
const PATIENCE: Duration = Duration::from_secs(120);
/// Largest growth of the process's memory over many inputs, KiB.
const MAY_GROW_KIB: u64 = 100 << 10;
/// Number of frames that are read from a video.
const FRAMES: usize = 12;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// Adds a mutation to the candidates. `change` damages the input.
fn damage(c: &mut Candidates<'_>, mut change: impl FnMut(&mut Context)) -> mutatis::Result<()> {
    c.mutation(|ctx| {
        change(ctx);
        Ok(())
    })
}

/// Returns a random index below `len`, which must be positive.
fn index(ctx: &mut Context, len: usize) -> usize {
    ctx.rng().gen_index(len).unwrap_or(0)
}

/// Returns a random range of indices below `len`, which must be positive.
fn range(ctx: &mut Context, len: usize) -> Range<usize> {
    let at = index(ctx, len);
    let longest = [1, 4, 64, 4096][index(ctx, 4)];
    at..(at + longest).min(len)
}

/// Mutations of bytes: bytes are changed, cut off, zeroed, removed, doubled, or replaced by bytes that are hard to
/// parse.
struct Bytes;

impl Mutate<Vec<u8>> for Bytes {
    fn mutate(&mut self, c: &mut Candidates<'_>, value: &mut Vec<u8>) -> mutatis::Result<()> {
        const ODD: [&[u8]; 7] = [&[0xff; 8], &[0; 8], b"-1", b"1e999", b"NaN", b"\"", b"\xc3\x28"];
        let len = value.len();
        if len == 0 {
            return damage(c, |ctx| value.push(ctx.rng().gen_u8()));
        }
        damage(c, |ctx| value[index(ctx, len)] = ctx.rng().gen_u8())?;
        damage(c, |ctx| value.truncate(index(ctx, len)))?;
        damage(c, |ctx| value[range(ctx, len)].fill(0))?;
        damage(c, |ctx| drop(value.drain(range(ctx, len))))?;
        damage(c, |ctx| {
            let part = value[range(ctx, len)].to_vec();
            let at = index(ctx, len);
            value.splice(at..at, part);
        })?;
        damage(c, |ctx| {
            let odd = ODD[index(ctx, ODD.len())];
            let at = index(ctx, len);
            value.splice(at..(at + odd.len()).min(len), odd.iter().copied());
        })
    }
}

/// Mutations that turn JSON into other valid JSON, with wrong numbers, texts, lists and fields.
struct Json;

impl Mutate<Value> for Json {
    fn mutate(&mut self, c: &mut Candidates<'_>, value: &mut Value) -> mutatis::Result<()> {
        const NUMBERS: [f64; 8] = [0.0, -1.0, 1e-300, 1e300, -1e300, 1e17, 0.5, f64::MAX];
        match value {
            Value::Array(items) if !items.is_empty() => {
                let len = items.len();
                damage(c, |ctx| drop(items.remove(index(ctx, len))))?;
                damage(c, |ctx| items.push(items[index(ctx, len)].clone()))?;
                damage(c, |ctx| items.swap(index(ctx, len), index(ctx, len)))?;
                items.iter_mut().try_for_each(|item| self.mutate(c, item))
            }
            Value::Object(fields) if !fields.is_empty() => {
                damage(c, |ctx| {
                    let name = fields.keys().nth(index(ctx, fields.len())).cloned();
                    name.and_then(|name| fields.shift_remove(&name));
                })?;
                fields.values_mut().try_for_each(|field| self.mutate(c, field))
            }
            leaf => {
                damage(c, |ctx| *leaf = Value::from(NUMBERS[index(ctx, NUMBERS.len())]))?;
                damage(c, |ctx| *leaf = Value::from(f64::from_bits(ctx.rng().gen_u64())))?;
                damage(c, |ctx| {
                    let others = [json!(null), json!("x"), json!(true), json!({}), json!([])];
                    *leaf = others[index(ctx, others.len())].clone();
                })
            }
        }
    }
}

/// Returns the damaged input with this number. If the inputs are JSON, every second round of damaged inputs is still
/// valid JSON, line by line. All other damaged inputs have damaged bytes.
fn damaged(sound: &[Vec<u8>], number: u64, is_json: bool) -> Vec<u8> {
    let mut session = Session::new().seed(number);
    let round = number as usize / sound.len();
    let sound = &sound[number as usize % sound.len()];
    let times = 1 << (round / 2 % 5);
    if is_json && round.is_multiple_of(2) {
        let values = serde_json::Deserializer::from_slice(sound).into_iter::<Value>();
        let mut lines: Vec<Value> = values.map(Result::unwrap).collect();
        for i in 0..times {
            let at = (round / 10 + i) % lines.len();
            session.mutate_with(&mut Json, &mut lines[at]).unwrap();
        }
        return lines.iter().flat_map(|line| format!("{line}\n").into_bytes()).collect();
    }
    let mut bytes = sound.clone();
    for _ in 0..times {
        session.mutate_with(&mut Bytes, &mut bytes).unwrap();
    }
    bytes
}

/// Returns the resident memory of this process, KiB.
fn resident_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// Damages the sound inputs in turn, `count` times or for the requested number of seconds. `read` reads a damaged
/// input, and returns whether the read succeeded.
fn mutate(kind: &str, sound: &[Vec<u8>], count: u64, read: impl Fn(&Path) -> bool) {
    let long_s = std::env::var("ROADPLANE_MUTATE_S").ok().map(|seconds| seconds.parse::<u64>().unwrap());
    let is_json =
        sound.iter().all(|bytes| serde_json::from_slice::<Value>(bytes).is_ok()) || kind.ends_with("jsonl");
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join(kind);
    let begun = Instant::now();
    let (mut tried, mut read_inputs, mut first_kib) = (0, 0, None);
    while long_s.map_or(tried < count, |seconds| begun.elapsed() < Duration::from_secs(seconds)) {
        let bytes = damaged(sound, tried, is_json);
        fs::write(&path, &bytes).unwrap();
        let since = Instant::now();
        let ended = catch_unwind(AssertUnwindSafe(|| read(&path)));
        let (took, kept) = (since.elapsed(), root().join("target").join(format!("spoilt-{tried}-{kind}")));
        if ended.is_err() || took > PATIENCE {
            fs::write(&kept, &bytes).unwrap();
        }
        assert!(ended.is_ok() && took <= PATIENCE, "{}: {ended:?} after {took:?}", kept.display());
        read_inputs += u64::from(ended.unwrap_or_default());
        tried += 1;
        if tried == 200 {
            first_kib = Some(resident_kib());
        }
    }
    let grown_kib = first_kib.map_or(0, |first_kib| resident_kib().saturating_sub(first_kib));
    println!(
        "{kind}: {tried} inputs in {:.0} s, {read_inputs} of them gave a result, {grown_kib} KiB more memory",
        begun.elapsed().as_secs_f64()
    );
    // Other tests may run at the same time and use memory too.
    assert!(long_s.is_none() || grown_kib < MAY_GROW_KIB, "{kind}: {grown_kib} KiB");
}

fn decodes(path: &Path) -> bool {
    let options = DecodeOptions { max_frames: Some(FRAMES as u64), ..DecodeOptions::default() };
    let Ok(mut input) = open(path, &options) else { return false };
    let mut frames = 0;
    while let Ok(Some(_)) = input.next_frame() {
        frames += 1;
        assert!(frames <= FRAMES, "more frames than were asked for");
    }
    frames > 0
}

fn files(paths: &[&str]) -> Vec<Vec<u8>> {
    paths.iter().map(|path| fs::read(root().join(path)).unwrap()).collect()
}

#[test]
fn videos() {
    let sound = files(&["tests/data/lot.mp4", "tests/data/lots/scenes/clip_0000.mp4"]);
    mutate("video.mp4", &sound, 60, decodes);
}

#[test]
fn images() {
    let mut sound = files(&["tests/data/lots/scenes/still_0000.jpg", "docs/book/images/demo.jpg"]);
    let picture = image::load_from_memory(&sound[1]).unwrap().thumbnail(320, 200);
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    sound.push(png.into_inner());
    mutate("image.jpg", &sound, 100, decodes);
}

#[test]
fn frames() {
    let config = Config::default();
    mutate("frames.jsonl", &files(&["tests/data/mutations/frames.jsonl"]), 60, |path| {
        let out = path.with_file_name("poses.jsonl");
        solve_file(
            path,
            &out,
            &SolveOptions { method: SolveMethod::Free, ..SolveOptions::default() },
            &config,
            &Cancel::default(),
            &Silent,
        )
        .is_ok()
    });
}

#[test]
fn configurations() {
    let sound = files(&["configs/default.toml"]);
    mutate("config.toml", &sound, 1000, |path| Config::load(Some(path), &[]).is_ok());
}

#[test]
fn models() {
    let models = root().join("models");
    // The library of the ONNX runtime is found in a folder above the executable.
    let opens = |card: &Path| Net::open(card, &SessionOptions::default()).is_ok();
    assert!(opens(&models.join("activity.card.json")));
    let card = files(&["models/activity.card.json"]);
    mutate("card.json", &card, 100, |path| {
        let net = path.with_file_name("activity.onnx");
        if !net.exists() {
            fs::copy(models.join("activity.onnx"), &net).unwrap();
        }
        opens(path)
    });
    let net = files(&["models/activity.onnx"]);
    mutate("activity.onnx", &net, 100, |path| {
        let card = path.with_file_name("activity.card.json");
        fs::copy(models.join("activity.card.json"), &card).unwrap();
        let is_changed = fs::read(path).unwrap() != net[0];
        let is_open = opens(&card);
        assert!(!(is_changed && is_open), "a changed net was opened");
        is_open
    });
}

#[test]
fn small_files() {
    let config = Config::default();
    let evidence = files(&["tests/data/mutations/evidence.json"]);
    mutate("evidence.json", &evidence, 200, |path| {
        let cameras = path.with_file_name("cameras");
        fs::create_dir_all(cameras.join("gate")).unwrap();
        for name in ["a.0.json", "b.0.json"] {
            fs::copy(path, cameras.join("gate").join(name)).unwrap();
        }
        stored_cameras(&EvidenceStore::new(&cameras), "gate", &config)
            .is_ok_and(|cameras| !cameras.is_empty())
    });
    let lengths =
        [b"x1,y1,x2,y2,length_m,sd_m,pixel_sd,name\n412,688,655,691,5.00,0.03,1,two bays\n".to_vec()];
    mutate("known.csv", &lengths, 1000, |path| read_constraints(path).is_ok());
    let points =
        [b"x_px,y_px,latitude,longitude,height_m\n14, 259, 51.05, 13.9, 0.5\n1,2,51,13,0\n".to_vec()];
    mutate("points.csv", &points, 1000, |path| roadplane_geo::read_points(path).is_ok());
    let piece = files(&["tests/data/mutations/piece.json"]);
    mutate("piece.json", &piece, 1000, |path| inputs_of(&[path.parent().unwrap().to_path_buf()]).is_ok());
}

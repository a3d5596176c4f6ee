//! `roadplane-lab synth`: synthetic data sets without pictures, with measured keypoints and their truth.

mod records;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roadplane_base::{ImageSize, ShapeAtlas};
use roadplane_metrics::truth::{DATASET_SCHEMA, Dataset, read_truth};
use roadplane_pipeline::{Cancel, FolderLock, PipelineError, Progress as _};
use roadplane_synth::{ClipOptions, Item, Layout, Rng, SynthOptions, clip_item, still_item};
use roadplane_write::{JsonLines, OutFile, WriteError, write_json};

use crate::args::synth::SynthArgs;
use roadplane_terminal::{Bar, Outcome};

/// Name of the subfolder that holds the items.
const SCENES: &str = "scenes";

/// A still or clip that is to be made.
struct Planned {
    stem: String,
    clip: bool,
    seed: u64,
    frames: u64,
}

/// Makes all items that do not exist yet. Then writes the list of items (`dataset.json`) and a description
/// (`README.md`).
pub fn synth(args: &SynthArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let atlas = ShapeAtlas::shipped().map_err(PipelineError::from)?;
    let scenes = args.out.join(SCENES);
    let _lock = FolderLock::acquire(&args.out).map_err(PipelineError::from)?;
    std::fs::create_dir_all(&scenes)
        .map_err(|source| PipelineError::Unreadable { source, path: scenes.clone() })?;
    let plan = plan(args);
    let bar = Bar::new("synth");
    bar.expect(Some(plan.iter().map(|item| item.frames).sum()));
    for item in &plan {
        if let Some(signal) = cancel.signal() {
            return Err(PipelineError::Stopped { signal }.into());
        }
        one(args, &atlas, &scenes, item)?;
        (0..item.frames).for_each(|_| bar.frame_done());
    }
    let mut items: Vec<PathBuf> =
        plan.iter().map(|item| Path::new(SCENES).join(format!("{}.truth.json", item.stem))).collect();
    items.sort();
    let dataset = Dataset {
        schema: DATASET_SCHEMA.to_owned(),
        name: "geometry".to_owned(),
        split: "synthetic".to_owned(),
        seed: args.seed,
        items,
    };
    write_json(&args.out.join("dataset.json"), &dataset).map_err(PipelineError::from)?;
    card(args).map_err(PipelineError::from)?;
    tracing::info!("{} stills and {} clips: {}", args.stills, args.clips, args.out.display());
    Ok(Outcome::Done)
}

fn plan(args: &SynthArgs) -> Vec<Planned> {
    let frames = (args.seconds * args.fps).round().max(1.0) as u64;
    let of_kind = |clip: bool, count: u32| {
        (0..count).map(move |number| Planned {
            stem: format!("{}_{number:04}", if clip { "clip" } else { "still" }),
            clip,
            // Each item has its own random stream, so an item does not depend on how many other items are made.
            seed: Rng::new(args.seed).next_u64()
                ^ Rng::new(u64::from(number) * 2 + u64::from(clip)).next_u64(),
            frames: if clip { frames } else { 1 },
        })
    };
    of_kind(false, args.stills).chain(of_kind(true, args.clips)).collect()
}

/// Makes an item unless it exists. The truth file is written last, so an item with a truth file is complete.
fn one(args: &SynthArgs, atlas: &ShapeAtlas, scenes: &Path, planned: &Planned) -> anyhow::Result<()> {
    let conditions = conditions(args, planned);
    let path = scenes.join(format!("{}.truth.json", planned.stem));
    if path.exists() {
        if read_truth(&path)?.conditions == conditions {
            return Ok(());
        }
        let what = format!("{} was made with other options; choose another folder", path.display());
        return Err(PipelineError::usage(&what).into());
    }
    let item = generate(args, atlas, planned);
    write_item(&item, scenes, planned, conditions).map_err(PipelineError::from)?;
    Ok(())
}

fn write_item(
    item: &Item,
    scenes: &Path,
    planned: &Planned,
    conditions: BTreeMap<String, String>,
) -> Result<(), WriteError> {
    let mut frames = JsonLines::create(&scenes.join(format!("{}.frames.jsonl", planned.stem)))?;
    for record in records::frames(item) {
        frames.write(&record)?;
    }
    frames.finish()?;
    let mut truth = JsonLines::create(&scenes.join(format!("{}.truth.json", planned.stem)))?;
    truth.write(&records::truth(item, conditions))?;
    truth.finish()
}

/// Returns the options of an item by name. The truth file stores these options, and a later call compares them with its
/// own.
fn conditions(args: &SynthArgs, planned: &Planned) -> BTreeMap<String, String> {
    let mut words = BTreeMap::from([
        (
            "layout".to_owned(),
            if planned.clip { "aisle".to_owned() } else { layout_name(planned).to_owned() },
        ),
        ("seed".to_owned(), args.seed.to_string()),
        ("cars".to_owned(), args.cars.to_string()),
        ("noise".to_owned(), args.noise.to_string()),
        ("outliers".to_owned(), args.outliers.to_string()),
        ("off_atlas".to_owned(), args.off_atlas.to_string()),
    ]);
    if planned.clip {
        words.insert("seconds".to_owned(), args.seconds.to_string());
        words.insert("fps".to_owned(), args.fps.to_string());
    }
    words
}

/// Returns the layout of a still: rows of a parking lot for even seeds, random positions for odd seeds.
fn layout(planned: &Planned) -> Layout {
    if planned.seed.is_multiple_of(2) { Layout::Rows } else { Layout::Random }
}

fn layout_name(planned: &Planned) -> &'static str {
    if layout(planned) == Layout::Rows { "rows" } else { "random" }
}

/// Makes an item. Cameras are 4–20 m high, tilted 5–40°, rolled up to 3°; the focal length is 0.7–3 picture widths.
fn generate(args: &SynthArgs, atlas: &ShapeAtlas, planned: &Planned) -> Item {
    let cars = usize::from(args.cars);
    let scene = SynthOptions {
        size: ImageSize { width: 1280, height: 720 },
        cars,
        focal_ratio: [0.7, 3.0],
        height_m: [4.0, 20.0],
        tilt: [5.0, 40.0].map(f64::to_radians),
        roll: [-3.0, 3.0].map(f64::to_radians),
        box_px: [30.0, 400.0],
        layout: layout(planned),
        off_atlas: args.off_atlas,
        noise: args.noise,
        outliers: args.outliers,
        ..SynthOptions::default()
    };
    if planned.clip {
        let movers = cars.div_ceil(2);
        let options =
            ClipOptions { scene, seconds: args.seconds, fps: args.fps, movers, parked: cars - movers };
        clip_item(atlas, &options, planned.seed)
    } else {
        still_item(atlas, &scene, planned.seed)
    }
}

fn card(args: &SynthArgs) -> Result<(), WriteError> {
    let text = format!(
        "# Geometry with truth\n\n\
         {} stills and {} clips made by `roadplane-lab synth --stills {} --clips {} --seed {} --cars {} --noise {} \
         --outliers {} --off-atlas {} --seconds {} --fps {}`.\n\n\
         There are no pictures. `scenes/NAME.frames.jsonl` holds measured keypoints as `roadplane stage solve` reads \
         them, and `scenes/NAME.truth.json` (`roadplane.truth/1`) the truth. Cars are drawn from the shape atlas, and \
         its residual on real cars is added. The keypoints that face the camera are visible, and no object hides \
         another. Boxes enclose the keypoints. In clips, four fifths of a keypoint's error variance persist while its \
         car is stationary, and decay over 2 m of travel.\n\nMade by the program alone: CC0.\n",
        args.stills,
        args.clips,
        args.stills,
        args.clips,
        args.seed,
        args.cars,
        args.noise,
        args.outliers,
        args.off_atlas,
        args.seconds,
        args.fps,
    );
    let mut file = OutFile::create(&args.out.join("README.md"))?;
    file.write_bytes(text.as_bytes())?;
    file.finish()
}

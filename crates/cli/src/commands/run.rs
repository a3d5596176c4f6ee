//! `roadplane run`: tracks the vehicles of each input, and writes one folder per input.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crossbeam_channel::bounded;
use roadplane_pipeline::{
    CameraDatabase, Cancel, Config, Existing, Fault, FolderLock, PipelineError, RunOptions, RunReport,
    check_traffic, clips_of, find_models, run_input, run_piece, stem_of,
};

use crate::args::RunArgs;
use crate::metrics::{self, Counted, Metrics};
use crate::sandbox::{self, Needs};
use roadplane_terminal::{Bar, Outcome};

/// Processes all inputs. If an input fails, the command continues with the next input.
pub fn run(args: &RunArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let image_fps = args.image_fps.map(|fps| format!("decode.image_fps={fps:?}"));
    let config = args.config.load_with(image_fps.as_slice())?;
    let constraints = args.known.read_for_database(args.cameras.is_some())?;
    let inputs = clips_of(&args.inputs, args.resume.then_some(args.out.as_path()))?;
    if args.piece.is_some() && inputs.len() > 1 {
        return Err(PipelineError::usage("--piece takes exactly one input").into());
    }
    let run_id = args.run_id.clone().unwrap_or_else(metrics::default_run_id);
    let metrics = Metrics::new(&run_id, inputs.len());
    let run_span = tracing::info_span!(target: "roadplane_ids", "run", run_id);
    let site = super::site::site(&args.site)?;
    check_traffic(&config.traffic)?;
    let models = find_models(config.models.folder.as_deref())?;
    let cameras = match (&args.cameras, &args.camera_id) {
        (Some(folder), Some(id)) => Some(CameraDatabase::open(folder, id, &inputs)?),
        _ => None,
    };
    let _lock = FolderLock::acquire(&args.out).map_err(PipelineError::from)?;
    sandbox::enter(&needs(args, &inputs, &config));
    if let Some(address) = args.metrics {
        metrics::serve(address, &metrics)?;
    }
    let options = RunOptions {
        models,
        constraints,
        cameras,
        site,
        existing: if args.overwrite { Existing::Overwrite } else { Existing::Refuse },
        resume: args.resume,
        video: args.video,
        background: args.background,
        frames: args.frames,
        alone: args.jobs == 1 || inputs.len() == 1,
    };
    let worst = Mutex::new(Worst::default());
    let jobs = usize::from(args.jobs).min(inputs.len());
    let (sender, receiver) = bounded::<&Path>(inputs.len());
    for input in &inputs {
        let _sent = sender.send(input);
    }
    drop(sender);
    let mut unstarted = None;
    std::thread::scope(|scope| {
        for job in 0..jobs {
            let (receiver, worst, options, config) = (receiver.clone(), &worst, &options, &config);
            let (metrics, run_span) = (&metrics, &run_span);
            let work = move || {
                let _run = run_span.enter();
                for input in receiver {
                    if cancel.is_stopped() {
                        break;
                    }
                    let camera = options.cameras.as_ref().and_then(|database| database.camera_of(input));
                    let name = stem_of(input);
                    let _input =
                        tracing::info_span!(target: "roadplane_ids", "input", clip = name, camera).entered();
                    let progress = Counted { bar: Bar::new(&name), metrics };
                    metrics.begin();
                    let result = match args.piece {
                        Some(piece) => run_piece(input, piece, &args.out, options, config, cancel, &progress),
                        None => run_input(input, &args.out, options, config, cancel, &progress),
                    };
                    metrics.end(&result);
                    if let Ok(mut worst) = worst.lock() {
                        worst.note(input, result);
                    }
                }
            };
            let spawned = std::thread::Builder::new().name(format!("job-{job}")).spawn_scoped(scope, work);
            if let Err(error) = spawned {
                tracing::error!("job {job} cannot be started: {error}");
                unstarted = Some(error);
            }
        }
    });
    let worst = worst.into_inner().unwrap_or_default();
    if let Some(file) = &args.metrics_file {
        metrics.write(file)?;
    }
    if let Some(signal) = cancel.signal() {
        return Err(PipelineError::Stopped { signal }.into());
    }
    if let Some(source) = unstarted.filter(|_| !receiver.is_empty()) {
        return Err(PipelineError::Thread { source }.into());
    }
    if let Some(cameras) = &options.cameras {
        for result in &worst.finished {
            cameras.learn(result)?;
        }
    }
    match worst.error {
        Some(error) => Err(error.into()),
        None if worst.is_partial => Ok(Outcome::Damaged),
        None => Ok(Outcome::Done),
    }
}

/// Returns the files and addresses that a run may use.
fn needs(args: &RunArgs, inputs: &[PathBuf], config: &Config) -> Needs {
    let mut needs = Needs::of_nets(config.models.folder.as_deref()).reading(inputs).writing(&args.out);
    needs.serves = args.metrics;
    if let Some(gates) = &config.traffic.gates {
        needs = needs.reading(std::slice::from_ref(gates));
    }
    let needs = args.cameras.iter().fold(needs, |needs, folder| needs.writing(folder));
    args.metrics_file.iter().fold(needs, |needs, file| needs.writing_file(file))
}

/// The worst outcome of all inputs. This outcome determines the exit code.
///
/// The order, from worst to mildest, is: stopped, internal error, refused model, locked folder, usage error, bad input.
#[derive(Default)]
struct Worst {
    is_partial: bool,
    error: Option<PipelineError>,
    finished: Vec<PathBuf>,
}

impl Worst {
    fn note(&mut self, input: &Path, result: Result<RunReport, PipelineError>) {
        match result {
            Ok(report) => {
                let tracks = report.tracks.map_or_else(String::new, |n| format!("{n} tracks, "));
                let camera = &report.camera;
                tracing::info!("{}: {tracks}{camera}: {}", input.display(), report.folder.display());
                self.is_partial |= report.is_partial();
                self.finished.push(report.folder);
            }
            Err(error) => {
                let rank = |fault: Fault| match fault {
                    Fault::Input => 0,
                    Fault::Usage => 1,
                    Fault::Locked => 2,
                    Fault::Model => 3,
                    Fault::Internal => 4,
                    Fault::Stopped { .. } => 5,
                };
                let worse = self.error.as_ref().is_none_or(|worst| rank(worst.fault()) < rank(error.fault()));
                if worse {
                    if let Some(milder) = self.error.replace(error) {
                        tracing::error!("{milder}");
                    }
                } else {
                    tracing::error!("{error}");
                }
            }
        }
    }
}

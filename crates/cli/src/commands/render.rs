//! `roadplane render`: draws a finished run into its video.

use roadplane_pipeline::{Cancel, render_run};

use crate::args::RenderArgs;
use roadplane_terminal::{Bar, Outcome};

/// Draws boxes, wireframes and tracks of a run into a video.
pub fn render(args: &RenderArgs, cancel: &Cancel) -> anyhow::Result<Outcome> {
    let config = args.config.load()?;
    let out = args.out.clone().unwrap_or_else(|| args.run.join("annotated.mp4"));
    let damaged = render_run(&args.input, &args.run, &out, &config, cancel, &Bar::new("render"))?;
    Ok(if damaged { Outcome::Damaged } else { Outcome::Done })
}

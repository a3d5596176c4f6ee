//! The inputs of a command: finds mistakes before the first input is processed, and replaces folders of videos by their
//! videos.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use roadplane_decode::{FolderContent, refuse_address};

use crate::{PipelineError, stem_of};

/// Returns the inputs of a command, each of which is one clip: a video, an image, or a folder of images.
///
/// A folder with videos is replaced by its videos, sorted by name. Images beside them are left out, with a warning.
/// `finished` is the output folder if finished inputs are skipped. Such an input may be absent.
///
/// # Errors
/// Returns a [`PipelineError`] with exit code 2 if an input is an address or does not exist, or if two inputs have the
/// same name of their results. Further missing inputs are in the log.
pub fn clips_of(inputs: &[PathBuf], finished: Option<&Path>) -> Result<Vec<PathBuf>, PipelineError> {
    let mut missing = None;
    for input in inputs {
        refuse_address(input)?;
        let is_finished =
            || finished.is_some_and(|out| out.join(stem_of(input)).join("summary.json").is_file());
        let absent =
            input.metadata().err().filter(|error| error.kind() == ErrorKind::NotFound && !is_finished());
        if let Some(source) = absent {
            let error = PipelineError::Unreadable { source, path: input.clone() };
            if let Some(before) = missing.replace(error) {
                tracing::error!("{before}");
            }
        }
    }
    if let Some(error) = missing {
        return Err(error);
    }
    let mut clips = Vec::new();
    for input in inputs {
        match input.is_dir().then(|| FolderContent::of(input)).transpose()? {
            Some(content) if !content.videos.is_empty() => {
                tell(input, &content);
                clips.extend(content.videos);
            }
            _ => clips.push(input.clone()),
        }
    }
    let stems: Vec<String> = clips.iter().map(|clip| stem_of(clip)).collect();
    for (i, stem) in stems.iter().enumerate() {
        if let Some(first) = stems[..i].iter().position(|other| other == stem) {
            let [first, second] = [&clips[first], &clips[i]].map(|clip| clip.display());
            return Err(PipelineError::usage(&format!(
                "two inputs would both be written to the folder {stem} of the output: {first} and {second}: rename \
                 one, or run them with different --out"
            )));
        }
    }
    Ok(clips)
}

/// Logs the part of a folder that is processed.
fn tell(folder: &Path, content: &FolderContent) {
    let FolderContent { images, videos, ignored } = content;
    let (folder, videos) = (folder.display(), videos.len());
    if images.is_empty() {
        tracing::info!("{folder}: its videos are processed ({videos})");
    } else {
        tracing::warn!(
            "{folder}: only its videos are processed ({videos}). Its images ({}) are left out: put them into a folder of \
             their own",
            images.len()
        );
    }
    if *ignored > 0 {
        tracing::info!("{folder}: {ignored} files are neither image nor video and are ignored");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Fault;

    fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, content) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        }
        folder
    }

    const VIDEO: &[u8] = b"\0\0\0\x20ftypisom\0\0\x02\0";
    const IMAGE: &[u8] = b"\xff\xd8\xff\xe0";

    #[test]
    fn a_folder_with_videos_is_its_videos() {
        let made = folder(&[
            ("night/c10.mp4", VIDEO),
            ("night/c9.mp4", VIDEO),
            ("night/notes.txt", b"no video"),
            ("mixed/a.mp4", VIDEO),
            ("mixed/thumb.jpg", IMAGE),
            ("frames/1.jpg", IMAGE),
            ("empty/notes.txt", b"no video"),
        ]);
        let of = |inputs: &[&str]| {
            let inputs: Vec<PathBuf> = inputs.iter().map(|name| made.path().join(name)).collect();
            let clips = clips_of(&inputs, None).unwrap();
            let name = |clip: PathBuf| clip.strip_prefix(made.path()).unwrap().display().to_string();
            clips.into_iter().map(name).collect::<Vec<_>>()
        };
        assert_eq!(of(&["night", "mixed/a.mp4"]), ["night/c9.mp4", "night/c10.mp4", "mixed/a.mp4"]);
        assert_eq!(of(&["mixed"]), ["mixed/a.mp4"]);
        assert_eq!(of(&["frames", "empty"]), ["frames", "empty"]);
    }

    #[test]
    fn mistakes_are_found_before_the_first_clip() {
        let made = folder(&[("a.mp4", VIDEO), ("b/a.mkv", VIDEO), ("out/gone/summary.json", b"{}")]);
        let path = |name: &str| made.path().join(name);
        let fails = |inputs: &[PathBuf], finished: Option<&Path>| {
            let error = clips_of(inputs, finished).unwrap_err();
            assert_eq!(error.fault(), Fault::Usage, "{error}");
            error.to_string()
        };
        assert!(fails(&[path("a.mp4"), path("gone.mp4")], None).contains("gone.mp4"));
        assert!(fails(&[path("a.mp4"), path("b")], None).contains("two inputs"));
        assert!(fails(&[path("a.mp4"), "rtsp://camera/1".into()], None).contains("streams are not read"));
        // A resumed run may have finished an input that was deleted later.
        let inputs = [path("a.mp4"), path("gone.mp4")];
        assert_eq!(clips_of(&inputs, Some(&path("out"))).unwrap(), inputs);
    }
}

//! Recognises addresses of streams. roadplane reads files, and no network.

use std::path::Path;

use crate::DecodeError;

/// Refuses an input that is the address of a stream or of a file on a server, such as `rtsp://camera/1`.
///
/// # Errors
/// [`DecodeError::Stream`], whose message has the command that records the stream.
pub fn refuse_address(input: &Path) -> Result<(), DecodeError> {
    let text = input.to_string_lossy();
    let Some((scheme, rest)) = text.split_once("://") else { return Ok(()) };
    let is_scheme = scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    if !is_scheme || input.exists() {
        return Ok(());
    }
    // A log must not contain the password of a camera.
    let address = match rest.split_once('@') {
        Some((user, host)) if !user.contains('/') => format!("{scheme}://USER:PASSWORD@{host}"),
        _ => text.clone().into_owned(),
    };
    let transport = if scheme.starts_with("rtsp") { "-rtsp_transport tcp " } else { "" };
    Err(DecodeError::Stream { address, transport })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_refused_with_the_command_that_records_them() {
        let refused = |input: &str| refuse_address(Path::new(input)).map_err(|error| error.to_string());
        let message = refused("rtsp://admin:secret@10.0.0.5:554/live?ch=1").unwrap_err();
        let command =
            "ffmpeg -rtsp_transport tcp -i 'rtsp://USER:PASSWORD@10.0.0.5:554/live?ch=1' -an -c copy";
        assert!(message.contains(command) && !message.contains("secret"), "{message}");
        let message = refused("http://10.0.0.5/a@b.mjpg").unwrap_err();
        assert!(message.contains("ffmpeg -i 'http://10.0.0.5/a@b.mjpg' -an -c copy"), "{message}");
        for path in ["lot.mp4", "C:/lot.mp4", "nights/a://b", "://x", "concat:a.ts|b.ts"] {
            assert_eq!(refused(path), Ok(()), "{path}");
        }
    }

    #[test]
    fn a_file_with_such_a_name_is_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a:/b.mp4");
        std::fs::create_dir(folder.path().join("a:")).unwrap();
        std::fs::write(&file, "").unwrap();
        assert!(refuse_address(&folder.path().join("a://b.mp4")).is_ok());
    }
}

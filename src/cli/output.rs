//! What commands print and write.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use super::{Failure, usage};
use crate::atomic_file;
use crate::camera::Camera;

/// Prints a line on stdout. Ends the program quietly when nobody reads any more (`voxsight info | head`), as other
/// commands do; any other trouble is an error.
pub fn print_line(line: std::fmt::Arguments) -> Result<(), Failure> {
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => std::process::exit(0),
        other => Ok(other?),
    }
}

/// `println!` that returns errors instead of panicking.
macro_rules! print_out {
    ($($text:tt)*) => { $crate::cli::output::print_line(format_args!($($text)*)) };
}
pub(super) use print_out;

/// Prints a value as JSON on stdout.
pub fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    print_out!("{}", serde_json::to_string_pretty(value)?)
}

/// Writes a file so that it appears under its name only when complete; `-` is stdout. Pipes and devices are written to.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if path == Path::new("-") {
        std::io::stdout().write_all(bytes)?;
        return Ok(());
    }
    let write = || -> std::io::Result<()> {
        if atomic_file::is_special(path) {
            return fs::File::options().write(true).open(path)?.write_all(bytes);
        }
        atomic_file::write_whole(path, bytes)
    };
    write().map_err(|error| format!("{}: cannot write: {error}", path.display()).into())
}

/// Writes a value as JSON into a file.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    write_whole(path, text.as_bytes())
}

/// Writes an image as PNG.
pub fn write_png<P>(path: &Path, image: &image::ImageBuffer<P, Vec<P::Subpixel>>) -> Result<(), Failure>
where
    P: image::Pixel + image::PixelWithColorType,
    [P::Subpixel]: image::EncodableLayout,
{
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    write_whole(path, bytes.get_ref())
}

/// Reads a camera file.
pub fn read_camera(path: &Path) -> Result<Camera, Failure> {
    const EXAMPLE: &str =
        r#"{"eye":[x,y,z],"target":[x,y,z],"up":[x,y,z],"fov_y_deg":60,"width":1024,"height":1024}"#;
    let text =
        fs::read_to_string(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
    serde_json::from_str(&text)
        .map_err(|error| format!("{}: {error}; expected a camera such as {EXAMPLE}", path.display()).into())
}

/// Refuses, before any work is done, an output whose folder is missing, or that would replace a file which is not of
/// its kind: a model or a scene named by mistake. `-`, pipes and devices are fine.
pub fn check_output(path: &Path, extensions: &[&str]) -> Result<(), Failure> {
    if path.is_dir() {
        return Err(format!("{}: is a folder; name a file", path.display()).into());
    }
    if path == Path::new("-") || fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        return Ok(());
    }
    let is_one = |found: &OsStr| extensions.iter().any(|extension| found.eq_ignore_ascii_case(extension));
    if !path.extension().is_some_and(is_one) {
        return Err(usage(format!("{}: name this output .{}", path.display(), extensions.join(" or ."))));
    }
    match path.parent() {
        Some(folder) if folder != Path::new("") && !folder.is_dir() => {
            Err(format!("{}: there is no folder {}: make it first", path.display(), folder.display()).into())
        }
        _ => Ok(()),
    }
}

/// Bytes for people: 1.23 MB.
pub fn human_bytes(bytes: u64) -> String {
    let mut value = bytes as f64;
    let mut unit = "B";
    for next in ["kB", "MB", "GB", "TB"] {
        if value < 1000.0 {
            break;
        }
        value /= 1000.0;
        unit = next;
    }
    if unit == "B" { format!("{bytes} B") } else { format!("{value:.2} {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_written_to_and_never_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let text = std::thread::scope(|scope| {
            let reader = scope.spawn(|| fs::read_to_string(&pipe).unwrap());
            write_json(&pipe, &[1]).unwrap();
            reader.join().unwrap()
        });
        assert_eq!(text, "[\n  1\n]\n");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        // A link to the device, so that a mistake removes only the link.
        let null = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write_whole(&null, b"text").unwrap();
        assert!(fs::metadata(&null).unwrap().file_type().is_char_device());
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!(human_bytes(999), "999 B");
        assert_eq!(human_bytes(12_345_678), "12.35 MB");
    }
}

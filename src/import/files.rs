//! Finds the model files below the inputs, and the files that models refer to, and never leaves their
//! folders.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::ImportOptions;
use super::detect::Format;
use super::draft::{Source, too_many_nodes};
use super::error::{ImportError, excerpt};
use crate::report::Findings;

/// A folder or a model file, in depth-first pre-order.
pub(super) struct Entry {
    /// Name of its node.
    pub name: String,
    /// Index of the folder that it is in.
    pub parent: Option<usize>,
    /// Folders above it.
    pub depth: usize,
    /// Name in reports and errors: relative to the input.
    pub shown: String,
    /// `None` for a folder.
    pub file: Option<PathBuf>,
}

/// Everything to import. Folders without a model anywhere below are left out.
pub(super) fn list(
    inputs: &[PathBuf],
    options: &ImportOptions,
    findings: &mut Findings,
) -> Result<Vec<Entry>, ImportError> {
    let mut walk = Walk { options, findings, entries: Vec::new(), seen: 0, root: PathBuf::new() };
    for input in inputs {
        let io_error = |source| ImportError::Io { file: input.display().to_string(), source };
        let kind = fs::metadata(input).map_err(io_error)?.file_type();
        let name = own_name(input);
        if kind.is_dir() {
            walk.root = fs::canonicalize(input).map_err(io_error)?;
            let skipped_before = walk.seen;
            let prefix = if inputs.len() == 1 { String::new() } else { format!("{name}/") };
            if !walk.folder(input, name, &prefix, None, 0)? {
                let skipped = walk.seen - skipped_before;
                return Err(ImportError::NoModelInFolder { folder: input.display().to_string(), skipped });
            }
        } else if kind.is_file() {
            let file = Some(input.clone());
            walk.entries.push(Entry { shown: name.clone(), name, parent: None, depth: 0, file });
        } else {
            return Err(ImportError::NotAFile { file: input.display().to_string() });
        }
    }
    Ok(walk.entries)
}

struct Walk<'a> {
    options: &'a ImportOptions,
    findings: &'a mut Findings,
    entries: Vec<Entry>,
    /// Files and folders met so far.
    seen: u64,
    /// The input folder without symbolic links.
    root: PathBuf,
}

impl Walk<'_> {
    /// Adds a folder and what is below it; false, and nothing added, if there is no model.
    fn folder(
        &mut self,
        path: &Path,
        name: String,
        prefix: &str,
        parent: Option<usize>,
        depth: usize,
    ) -> Result<bool, ImportError> {
        if depth >= self.options.max_depth {
            return Err(ImportError::TooMany {
                file: prefix.to_owned(),
                what: "folders inside each other",
                limit: self.options.max_depth as u64,
                advice: "import a folder further down, or raise max_depth",
            });
        }
        let io_error = |source| ImportError::Io { file: shown_or_dot(prefix), source };
        let mut children = Vec::new();
        for child in fs::read_dir(path).map_err(io_error)? {
            let child = child.map_err(io_error)?;
            children.push((child.file_name(), child.file_type().map_err(io_error)?));
            self.seen += 1;
            if self.seen > self.options.max_nodes as u64 {
                return Err(too_many_nodes(&shown_or_dot(prefix), self.options));
            }
        }
        // The order that a folder is read in differs from disk to disk.
        children.sort_by(|a, b| a.0.cmp(&b.0));
        let this = self.entries.len();
        self.entries.push(Entry { name, parent, depth, shown: shown_or_dot(prefix), file: None });
        for (child_name, mut kind) in children {
            let child_path = path.join(&child_name);
            let child_name = child_name.to_string_lossy().into_owned();
            let shown = format!("{prefix}{child_name}");
            if kind.is_symlink() {
                match self.followed(&child_path) {
                    Ok(followed) => kind = followed,
                    Err(why) => {
                        self.findings.add(why, 1, || shown);
                        continue;
                    }
                }
            }
            if kind.is_dir() {
                self.folder(&child_path, child_name, &format!("{shown}/"), Some(this), depth + 1)?;
            } else if kind.is_file() && Format::from_extension(&child_path).is_some() {
                let (parent, file) = (Some(this), Some(child_path));
                self.entries.push(Entry { name: child_name, parent, depth: depth + 1, shown, file });
            } else {
                self.findings.add(
                    "files that are no models by their extension: read only where a model refers to them",
                    1,
                    || shown,
                );
            }
        }
        let has_models = self.entries.len() > this + 1;
        if !has_models {
            self.entries.truncate(this);
        }
        Ok(has_models)
    }

    /// What a symbolic link inside a folder leads to, if it may be followed.
    fn followed(&self, link: &Path) -> Result<fs::FileType, &'static str> {
        let target = fs::canonicalize(link).map_err(|_| "symbolic links skipped: they lead nowhere")?;
        if !target.starts_with(&self.root) {
            return Err("symbolic links skipped: they leave the input folder");
        }
        let kind =
            fs::metadata(&target).map_err(|_| "symbolic links skipped: they lead nowhere")?.file_type();
        // A link to a folder could lead in a circle; its content is found where it really is.
        if kind.is_dir() {
            Err("symbolic links skipped: they lead to another folder of the input")
        } else {
            Ok(kind)
        }
    }
}

fn shown_or_dot(prefix: &str) -> String {
    match prefix.trim_end_matches('/') {
        "" => ".".to_owned(),
        shown => shown.to_owned(),
    }
}

/// The last component, also of `.` and `..`.
fn own_name(input: &Path) -> String {
    let canonical;
    let name = match input.file_name() {
        Some(name) => Some(name),
        None => {
            canonical = fs::canonicalize(input).unwrap_or_default();
            canonical.file_name()
        }
    };
    name.map_or_else(|| "model".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The path that `uri` (decoded) means, relative to the folder of `source`, or an error if it leads out of
/// there.
pub(super) fn resolve(source: &Source, uri: &str) -> Result<PathBuf, ImportError> {
    relative_path(uri).map_err(|reason| unsafe_path(source, uri, reason))
}

fn unsafe_path(source: &Source, uri: &str, reason: &'static str) -> ImportError {
    let uri = excerpt(uri.as_bytes()).trim_matches('"').to_owned();
    ImportError::UnsafePath { file: source.name.to_owned(), uri, reason }
}

/// Length of a file that a model in `folder` refers to by this relative path, if it could be read as [`read_beside`] does.
#[cfg(feature = "viewer")]
pub(crate) fn length_beside(folder: &Path, relative: &str) -> Option<u64> {
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    let folder = fs::canonicalize(folder).ok()?;
    let target = fs::canonicalize(folder.join(relative)).ok().filter(|target| target.starts_with(&folder))?;
    let meta = fs::File::open(target).and_then(|file| file.metadata()).ok()?;
    meta.is_file().then_some(meta.len())
}

/// Reads a file that `source` refers to by `uri` (decoded), which must be in the same folder or below it.
pub(super) fn read_beside(source: &Source, uri: &str) -> Result<Vec<u8>, ImportError> {
    let relative = resolve(source, uri)?;
    let io_error = |error| ImportError::Io {
        file: format!("{}, beside {}", relative.display(), source.name),
        source: error,
    };
    let folder = match source.path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let folder = fs::canonicalize(folder).map_err(io_error)?;
    let target = fs::canonicalize(folder.join(&relative)).map_err(io_error)?;
    if !target.starts_with(&folder) {
        return Err(unsafe_path(source, uri, "which is a symbolic link that leaves the folder of the model"));
    }
    if !fs::metadata(&target).map_err(io_error)?.is_file() {
        return Err(io_error(io::Error::new(io::ErrorKind::InvalidInput, "it is not a file")));
    }
    fs::read(&target).map_err(io_error)
}

/// A path that stays in the folder it starts from, or why it does not. `\` separates as `/` does: exporters
/// on Windows write it.
fn relative_path(uri: &str) -> Result<PathBuf, &'static str> {
    if uri.is_empty() {
        return Err("which names no file");
    }
    if uri.starts_with(['/', '\\']) {
        return Err("an absolute path");
    }
    let mut components: Vec<&str> = Vec::new();
    for component in uri.split(['/', '\\']) {
        match component {
            "" | "." => {}
            ".." => {
                components.pop().ok_or("which leaves the folder of the model")?;
            }
            // A drive letter (C:) or a scheme (http:, file:).
            _ if components.is_empty() && component.contains(':') => {
                return Err("an absolute path or the address of something that is not a file");
            }
            _ if component.contains('\0') => return Err("which cannot be a file name"),
            _ => components.push(component),
        }
    }
    if components.is_empty() { Err("which names no file") } else { Ok(components.iter().collect()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_stay_in_the_folder_of_the_model() {
        for (uri, path) in [("a.bin", "a.bin"), ("./b/../a b.bin", "a b.bin"), ("t\\x.mtl", "t/x.mtl")] {
            assert_eq!(relative_path(uri), Ok(PathBuf::from(path)));
        }
        for uri in [
            "",
            ".",
            "/etc/passwd",
            "\\\\host\\share",
            "C:\\x.bin",
            "c:x.bin",
            "file:///x.bin",
            "http://x/y.bin",
            "../x.bin",
            "a/../../x.bin",
            "a\\..\\..\\x.bin",
            "..",
            "a\0b",
        ] {
            assert!(relative_path(uri).is_err(), "{uri}");
        }
    }
}

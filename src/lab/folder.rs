//! A folder of files that appears whole or not at all.
//!
//! The files are written into a folder beside the target, which takes the target's place at the end. A target that is
//! there already is replaced only when it holds nothing but an earlier report.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{report, shadows};

/// The file that tells an earlier report.
pub const REPORT_JSON: &str = "report.json";

/// Why a report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// There is something else.
    #[error("{folder}: {what}; name a new or an empty folder, or an earlier report", folder = folder.display())]
    Occupied {
        /// The target.
        folder: PathBuf,
        /// What is there.
        what: String,
    },
    /// Its parent is missing.
    #[error("{folder}: there is no folder {parent}: make it first", folder = folder.display(), parent = parent.display())]
    NoParent {
        /// The target.
        folder: PathBuf,
        /// What is missing.
        parent: PathBuf,
    },
    /// The system said no.
    #[error("{path}: cannot write: {source}", path = path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// What an earlier report says of itself.
#[derive(Deserialize)]
struct Earlier {
    format: String,
    files: Vec<String>,
}

/// Can a report be written here? To be asked before the work begins.
///
/// # Errors
///
/// The parent is missing, or there is something that is no earlier report.
pub fn check_folder(folder: &Path) -> Result<(), FolderError> {
    let parent = parent_of(folder);
    if !parent.is_dir() {
        return Err(FolderError::NoParent { folder: folder.to_owned(), parent: parent.to_owned() });
    }
    let occupied = |what: String| FolderError::Occupied { folder: folder.to_owned(), what };
    if folder.file_name().is_none() {
        return Err(occupied("it has no name of its own".into()));
    }
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => {
            return Err(occupied("there is a file of this name".into()));
        }
        Err(source) => return Err(FolderError::Io { path: folder.to_owned(), source }),
    };
    let names: Vec<OsString> = entries
        .map(|entry| Ok(entry?.file_name()))
        .collect::<io::Result<_>>()
        .map_err(|source| FolderError::Io { path: folder.to_owned(), source })?;
    let earlier = fs::read(folder.join(REPORT_JSON)).ok();
    let earlier: Option<Earlier> = earlier.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let earlier =
        earlier.filter(|earlier| [report::FORMAT, shadows::FORMAT].contains(&earlier.format.as_str()));
    let is_ours = |name: &OsString| {
        earlier.as_ref().is_some_and(|earlier| earlier.files.iter().any(|file| name == file.as_str()))
    };
    match names.iter().find(|name| !is_ours(name)) {
        None => Ok(()),
        Some(name) => Err(occupied(format!("there is {} in it", name.to_string_lossy()))),
    }
}

/// Writes all files and puts them in the folder's place.
///
/// # Errors
///
/// As [`check_folder`]; a file cannot be written. The folder is then as it was before.
pub fn write_folder(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<(), FolderError> {
    check_folder(folder)?;
    let at = |path: &Path| {
        let path = path.to_owned();
        move |source| FolderError::Io { path, source }
    };
    // A link to a folder keeps being one.
    let target = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    let mut prefix = OsString::from(".");
    prefix.push(target.file_name().unwrap_or_default());
    prefix.push(".tmp-");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Like any new folder, less the process's umask.
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    let staging = builder.tempdir_in(parent_of(&target)).map_err(at(folder))?;
    for (name, bytes) in files {
        fs::write(staging.path().join(name), bytes).map_err(at(&folder.join(name)))?;
    }
    // Two renamings: a reader may find no folder for a moment, but never half a report.
    let old = builder.tempdir_in(parent_of(&target)).map_err(at(folder))?;
    let kept = old.path().join("old");
    let is_replaced = target.exists();
    if is_replaced {
        fs::rename(&target, &kept).map_err(at(folder))?;
    }
    if let Err(source) = fs::rename(staging.path(), &target) {
        if is_replaced {
            fs::rename(&kept, &target).map_err(at(&kept))?;
        }
        return Err(FolderError::Io { path: folder.to_owned(), source });
    }
    // Its path is gone: nothing is left to remove.
    let _moved = staging.keep();
    Ok(())
}

fn parent_of(folder: &Path) -> &Path {
    match folder.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(text: &str) -> Vec<(String, Vec<u8>)> {
        let json = format!(r#"{{"format":"{}","files":["report.json","a.txt"]}}"#, report::FORMAT);
        vec![("a.txt".into(), text.into()), (REPORT_JSON.into(), json.into_bytes())]
    }

    #[test]
    fn an_earlier_report_is_replaced_and_nothing_else() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("report");
        write_folder(&folder, &files("first")).unwrap();
        write_folder(&folder, &files("second")).unwrap();
        assert_eq!(fs::read_to_string(folder.join("a.txt")).unwrap(), "second");
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1, "something is left over");
        fs::write(folder.join("thesis.tex"), "years of work").unwrap();
        let error = write_folder(&folder, &files("third")).unwrap_err().to_string();
        assert!(error.contains("thesis.tex"), "{error}");
        assert_eq!(fs::read_to_string(folder.join("a.txt")).unwrap(), "second");
    }

    #[test]
    fn what_cannot_be_a_report_is_refused_before_the_work() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        assert!(check_folder(&at("new")).is_ok());
        assert!(check_folder(&at("missing/new")).unwrap_err().to_string().contains("missing"));
        fs::write(at("file"), "").unwrap();
        assert!(check_folder(&at("file")).unwrap_err().to_string().contains("file"));
        fs::create_dir(at("empty")).unwrap();
        assert!(check_folder(&at("empty")).is_ok());
        fs::write(at("empty/report.json"), "{}").unwrap();
        assert!(check_folder(&at("empty")).is_err());
        assert!(check_folder(Path::new("..")).is_err());
    }
}

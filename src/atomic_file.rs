//! Files that appear under their names only when they are complete.
//!
//! Bytes go to a temporary file beside the target, which is renamed over it at the end. Whatever happens before (an
//! error, a panic, a killed process, a power cut), the target stays as it was. A dropped [`AtomicFile`] removes its
//! temporary file. A killed process cannot: the next writer of the same target does it, see `remove_abandoned` below.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Tries to make a temporary file that nobody takes for abandoned before it is locked; one is nearly always enough.
const ATTEMPTS: usize = 100;
/// Symbolic links followed one after the other, as systems do.
const MAX_LINKS: usize = 40;

/// A file being written. Dropped without [`AtomicFile::commit`], it leaves no trace.
#[derive(Debug)]
pub(crate) struct AtomicFile {
    /// The path with symbolic links followed: what is replaced.
    target: PathBuf,
    temporary: NamedTempFile,
}

/// What [`AtomicFile::commit`] could not do, as in "cannot ...".
#[derive(Debug)]
pub(crate) struct CommitError {
    pub doing: &'static str,
    pub source: io::Error,
}

/// Whether `path` is there and is no regular file: a pipe, a device, a folder. Renaming over one would remove it.
pub(crate) fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|metadata| !metadata.is_file())
}

impl AtomicFile {
    /// Starts a file that will stand at `path`, or at what `path` links to.
    ///
    /// # Errors
    ///
    /// `path` is special (see [`is_special`]), or its folder does not exist or cannot be written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let not_a_file = || io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file");
        if is_special(path) {
            return Err(not_a_file());
        }
        let target = follow_links(path);
        let prefix = temporary_prefix(target.file_name().ok_or_else(not_a_file)?);
        let folder = folder_of(&target);
        remove_abandoned(folder, &prefix);

        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Like any new file, less the process's umask; a temporary file would be for its owner only.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        for _ in 0..ATTEMPTS {
            let temporary = builder.tempfile_in(folder)?;
            if is_ours(&temporary) {
                return Ok(AtomicFile { target, temporary });
            }
        }
        Err(io::Error::other("other writers of it remove its temporary files"))
    }

    /// Makes sure that the file is on the disk, and puts it in the target's place in one step.
    pub fn commit(self) -> Result<(), CommitError> {
        let fail = |doing| move |source| CommitError { doing, source };
        self.temporary.as_file().sync_all().map_err(fail("bring to the disk"))?;
        self.temporary.persist(&self.target).map_err(|error| fail("replace")(error.error))?;
        sync_folder(folder_of(&self.target)).map_err(fail("bring its folder to the disk"))
    }
}

/// Writes a whole file, or nothing.
#[cfg(feature = "viewer")]
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    Ok(file.commit()?)
}

impl From<CommitError> for io::Error {
    fn from(CommitError { doing, source }: CommitError) -> Self {
        io::Error::new(source.kind(), format!("cannot {doing}: {source}"))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temporary.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.temporary.seek(to)
    }
}

/// Where a file at `path` really lies, also when it is not there yet.
fn follow_links(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| {
        let mut path = path.to_owned();
        for _ in 0..MAX_LINKS {
            let Ok(to) = fs::read_link(&path) else { break };
            path = folder_of(&path).join(to);
        }
        path
    })
}

/// Takes the lock that tells other writers of a process that lives. False when one of them was faster and has removed
/// the file, or is about to.
///
/// Where locks are not supported nobody can take the file for abandoned either.
fn is_ours(temporary: &NamedTempFile) -> bool {
    match temporary.as_file().try_lock() {
        Err(fs::TryLockError::WouldBlock) => false,
        // Whoever removes the file holds its lock meanwhile: if it is still there now, it stays.
        Ok(()) => temporary.path().exists(),
        Err(fs::TryLockError::Error(_)) => true,
    }
}

/// `.NAME.tmp-`, followed by random characters.
fn temporary_prefix(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(name);
    prefix.push(".tmp-");
    prefix
}

fn folder_of(target: &Path) -> &Path {
    match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Removes temporary files of the same target whose writers were killed.
///
/// Safe beside a writer that lives: that one holds a lock on its file, which ends with its process, however it ends.
/// A new file has no lock for a moment: its writer notices when it is removed then, see [`is_ours`]. Where locks are
/// not supported nothing is removed. Failures are of no consequence: the file just stays.
fn remove_abandoned(folder: &Path, prefix: &OsStr) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let named = entry.file_name().as_encoded_bytes().starts_with(prefix.as_encoded_bytes());
        if named
            && entry.metadata().is_ok_and(|metadata| metadata.is_file())
            && let Ok(file) = File::options().write(true).open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Makes the renaming itself last through a power cut.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Folders cannot be synchronized here; the file system's journal has the renaming.
#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed test panics")]
mod tests {
    use super::*;

    fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = AtomicFile::create(path)?;
        file.write_all(bytes)?;
        Ok(file.commit()?)
    }

    fn count(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let mut dropped = AtomicFile::create(&path).unwrap();
        dropped.write_all(b"half").unwrap();
        drop(dropped);
        assert_eq!(count(folder.path()), 0);
        write(&path, b"first").unwrap();
        write(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(count(folder.path()), 1);
    }

    #[test]
    fn what_a_dead_writer_left_goes_at_once_and_a_living_one_keeps_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let mut living = AtomicFile::create(&path).unwrap();
        living.write_all(b"living").unwrap();
        for name in [".a.json.tmp-dead", ".b.json.tmp-other"] {
            fs::write(folder.path().join(name), b"half").unwrap();
        }
        write(&path, b"other").unwrap();
        assert_eq!(count(folder.path()), 3, "the file, the living one's, the other target's");
        living.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"living");
    }

    #[test]
    fn writers_of_one_target_at_a_time_do_not_take_each_others_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..50).for_each(|_| write(&path, b"whole").unwrap()));
            }
        });
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(count(folder.path()), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_devices_refused_and_rights_are_those_of_a_new_file() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        symlink("real", at("link")).unwrap();
        for bytes in [b"new".as_slice(), b"replaced"] {
            write(&at("link"), bytes).unwrap();
            assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
            assert_eq!(fs::read(at("real")).unwrap(), bytes);
        }
        fs::write(at("plain"), b"").unwrap();
        let mode = |name: &str| fs::metadata(at(name)).unwrap().permissions().mode();
        assert_eq!(mode("real"), mode("plain"));
        for special in [Path::new("/dev/null"), folder.path()] {
            let error = write(special, b"text").unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::InvalidInput, "{error}");
        }
    }
}

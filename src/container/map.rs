//! The memory map: the only unsafe code of this crate.

use std::fs::File;
use std::io;

use memmap2::Mmap;

/// Maps a whole file for reading. The map starts at a page border, so every section is aligned for its records.
///
/// The file must not be changed while it is mapped. Voxsight itself never does: a build writes another file and
/// renames it, which leaves the mapped one as it is. If some other program writes into the file, what was checked at
/// opening may no longer hold (a later access may then panic); if it shortens the file, the operating system ends the
/// process.
#[expect(
    unsafe_code,
    reason = "mapping a file is unsafe by nature; reading gigabytes instead would defeat the format"
)]
pub(super) fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: the map is read-only and private to `Container`, which gives out shared slices of plain old data (every
    // bit pattern is a value) for its own lifetime only. What remains is that another process changes the file
    // meanwhile, which no program can exclude; the doc comment above states it.
    unsafe { Mmap::map(file) }
}

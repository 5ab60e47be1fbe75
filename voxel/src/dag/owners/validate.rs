//! Checks owner pages of unknown origin before anything trusts them.

use super::bits::width_of;
use super::page::{HEADER_WORDS, MAX_RUNS, Page};
use super::{OwnersIndex, OwnersRef};
use crate::dag::{DagError, DagRef};

/// A broken rule, told without its place.
type Broken = &'static str;

impl OwnersIndex {
    /// Checks an owner table of unknown origin in one linear pass: pages follow each other and cover the bricks; in each
    /// page runs rise, and name entries of drawables below `drawables` that rise; masked runs are one brick with several
    /// owners, and their codes lie in the page.
    ///
    /// # Errors
    ///
    /// Names the broken rule and the page.
    pub fn validate(
        directory: &[[u64; 2]],
        pages: &[u64],
        bricks: u64,
        drawables: u32,
    ) -> Result<Self, DagError> {
        let broken = |rule, page: usize| Err(DagError::Broken { rule, place: format!("owner page {page}") });
        if (bricks == 0) != directory.is_empty() || directory.first().is_some_and(|&page| page != [0, 0]) {
            return broken("owner pages cover every brick", 0);
        }
        if directory.is_empty() && !pages.is_empty() {
            return broken("owner pages are in the directory", 0);
        }
        if u32::try_from(directory.len()).is_err() {
            return broken("there are fewer than 2^32 owner pages", directory.len());
        }
        for (index, &[first, word]) in directory.iter().enumerate() {
            let [next, next_word] = directory.get(index + 1).copied().unwrap_or([bricks, pages.len() as u64]);
            if next <= first || next > bricks {
                return broken("owner pages rise and lie within the bricks", index);
            }
            let words = usize::try_from(word).ok().zip(usize::try_from(next_word).ok());
            let words = words.and_then(|(start, end)| pages.get(start..end));
            let Some(words) = words.filter(|words| words.len() >= HEADER_WORDS) else {
                return broken("an owner page lies within the pages and has a header", index);
            };
            if let Err(rule) = check_page(&Page::new(words), next - first, drawables) {
                return broken(rule, index);
            }
        }
        Ok(Self::new(directory, bricks))
    }
}

/// Checks a page over `bricks` bricks.
fn check_page(page: &Page, bricks: u64, drawables: u32) -> Result<(), Broken> {
    let header = &page.header;
    // Before anything is as long as they say.
    let length = page.bit_length();
    let fits = header.pool <= length + 1 && page.fixed_end <= length;
    if !fits || header.drawable_width > 32 || header.pool < header.entries {
        return Err("the parts of an owner page lie in it");
    }
    if page.start_ones() != header.runs - 1 || page.mark_ones() != header.entries - 1 {
        return Err("an owner page has a start for each run and a mark for each entry");
    }
    let mut lengths = [0usize; MAX_RUNS];
    let (mut entry, mut last) = (0, 0);
    for index in 0..header.pool {
        let begins = page.is_entry_start(index);
        entry += usize::from(begins && index > 0);
        let drawable = page.drawable(index);
        if drawable < header.lowest || drawable >= drawables || !begins && drawable <= last {
            return Err("an owner is a drawable, and owners of a set rise");
        }
        last = drawable;
        // There are as many starts as entries, at most 256.
        lengths[entry] += 1;
    }
    let mut masked = 0;
    let mut start = 0;
    for run in 0..header.runs {
        let end = if run + 1 == header.runs { Some(bricks) } else { page.start(run + 1) };
        let Some(end) = end.filter(|&end| start < end && end <= bricks) else {
            return Err("owner runs rise and lie within their page");
        };
        let value = page.value(run);
        if value >= header.entries {
            return Err("an owner run names an entry of its page's palette");
        }
        if page.is_masked(run) {
            masked += 1;
            if end != start + 1 || lengths[value] < 2 {
                return Err("a masked owner run is one brick with several owners");
            }
        }
        start = end;
    }
    check_codes(page, masked, length)
}

fn check_codes(page: &Page, masked: usize, length: usize) -> Result<(), Broken> {
    if (masked > 0) != page.header.has_masks {
        return Err("an owner page has codes where it has masked runs");
    }
    let starts = page.code_starts();
    let end = page.fixed_end + if page.header.has_masks { starts.shape.bits() } else { 0 };
    if end > length || page.header.has_masks && starts.get(masked.saturating_sub(1)).is_some() {
        return Err("the parts of an owner page lie in it");
    }
    let mut before = page.code_at(0);
    for index in 1..masked {
        let at = page.code_at(index);
        if at <= before || at > length {
            return Err("owner codes rise and lie in their page");
        }
        before = at;
    }
    if !page.header.has_masks && (page.header.code_low, page.header.code_upper) != (0, 0) {
        return Err("an owner page has codes where it has masked runs");
    }
    // Less than a word of padding.
    if !page.header.has_masks && width_of((length - page.fixed_end) as u64) > 6 {
        return Err("an owner page ends with its last word of bits");
    }
    Ok(())
}

impl OwnersRef<'_> {
    /// Checks that the code of every masked brick is as long as its brick's voxels ask for, and that every owner owns
    /// a voxel. That owners own the voxels of their brick and no others needs no check: they cannot be written otherwise. Only
    /// bricks with codes are looked at, so that the time is bounded by the bytes of the pages.
    ///
    /// # Errors
    ///
    /// Names the first brick of which that is not true.
    pub fn check_masks(&self, dag: &DagRef) -> Result<(), DagError> {
        for (index, &[first, _]) in self.directory.iter().enumerate() {
            let page = self.page(index);
            let masked = page.masked_runs();
            let mut seen = 0;
            for run in (0..page.header.runs).filter(|&run| page.is_masked(run)) {
                let brick = page.start(run).unwrap_or(0);
                let ordinal = first + brick;
                let broken = |rule| Err(DagError::Broken { rule, place: format!("brick {ordinal}") });
                let Some(mask) = dag.brick_mask(ordinal) else {
                    return broken("owners belong to a brick");
                };
                let (owners, bits) = page.owners(brick, mask).masks();
                let start = page.code_at(seen);
                seen += 1;
                let is_last = seen == masked;
                let end = if is_last { page.bit_length() } else { page.code_at(seen) };
                let exact = if is_last {
                    end - start < bits + 64 && start + bits <= end
                } else {
                    end - start == bits
                };
                if !exact {
                    return broken("an owner code is as long as its brick's voxels ask for");
                }
                if owners.iter().any(|&(_, mask)| mask == 0) {
                    return broken("every owner of a brick owns a voxel of it");
                }
            }
        }
        Ok(())
    }
}

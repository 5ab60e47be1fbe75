// Who owns a voxel: the pages of `voxel/src/dag/owners`, read as the library reads them, in words of 32 bits.

// log2 of the words of a slab; slabs there are.
override OWNERS_SHIFT: u32;
override OWNERS_SLABS: u32;

@group(2) @binding(0) var<storage, read> owners_0: array<u32>;
@group(2) @binding(1) var<storage, read> owners_1: array<u32>;
@group(2) @binding(2) var<storage, read> owners_2: array<u32>;
@group(2) @binding(3) var<storage, read> owners_3: array<u32>;
@group(2) @binding(4) var<uniform> owners: Owners;

// `gpu::owners::OwnersUniform`.
struct Owners {
    // Pages.
    pages: u32,
    // Word of the directory: first ordinal and first word of each page.
    directory_at: u32,
    padding_0: u32,
    padding_1: u32,
}

// A page, unpacked: places are bits from `bits_at`, a word.
struct OwnerPage {
    bits_at: u32,
    runs: u32,
    entries: u32,
    drawable_width: u32,
    start_low: u32,
    start_upper: u32,
    code_low: u32,
    code_upper: u32,
    has_masks: bool,
    lowest: u32,
    pool: u32,
    value_width: u32,
    values_at: u32,
    marks_at: u32,
    pool_at: u32,
    masked_at: u32,
    fixed_end: u32,
}

// The owners of a brick, still packed.
struct OwnerSet {
    bits_at: u32,
    lowest: u32,
    width: u32,
    pool_at: u32,
    count: u32,
    // Occupied voxels of the brick.
    voxels: u32,
    is_masked: bool,
    code_at: u32,
}

const NOWHERE: u32 = 0xffffffffu;

fn owners_word(at: u32) -> u32 {
    if OWNERS_SLABS == 1u {
        return owners_0[at];
    }
    let inside = at & ((1u << OWNERS_SHIFT) - 1u);
    switch at >> OWNERS_SHIFT {
        case 0u: { return owners_0[inside]; }
        case 1u: { return owners_1[inside]; }
        case 2u: { return owners_2[inside]; }
        default: { return owners_3[inside]; }
    }
}

fn low_mask(width: u32) -> u32 {
    return select((1u << (width & 31u)) - 1u, 0xffffffffu, width >= 32u);
}

// Up to 32 bits.
fn bits_of(bits_at: u32, at: u32, width: u32) -> u32 {
    let word = bits_at + (at >> 5u);
    let shift = at & 31u;
    var value = owners_word(word) >> shift;
    if shift + width > 32u {
        value |= owners_word(word + 1u) << (32u - shift);
    }
    return value & low_mask(width);
}

// Set bits among the `length` from `at`.
fn ones_of(bits_at: u32, at: u32, length: u32) -> u32 {
    var ones = 0u;
    for (var from_ = 0u; from_ < length; from_ += 32u) {
        ones += countOneBits(bits_of(bits_at, at + from_, min(length - from_, 32u)));
    }
    return ones;
}

// Position, counted from `at`, of the bit with `n` such bits before it; `flip` is 0 for set bits, all ones for clear ones.
fn select_bit(bits_at: u32, at: u32, length: u32, n: u32, flip: u32) -> u32 {
    var left = n;
    for (var from_ = 0u; from_ < length; from_ += 32u) {
        let width = min(length - from_, 32u);
        var word = (bits_of(bits_at, at + from_, width) ^ flip) & low_mask(width);
        let ones = countOneBits(word);
        if left < ones {
            for (var i = 0u; i < left; i++) {
                word &= word - 1u;
            }
            return from_ + countTrailingZeros(word);
        }
        left -= ones;
    }
    return NOWHERE;
}

// Bits that it takes to write any number up to this.
fn width_of(number: u32) -> u32 {
    return 32u - countLeadingZeros(number);
}

fn owner_page(word: u32) -> OwnerPage {
    var page: OwnerPage;
    page.runs = bits_of(word, 0u, 8u) + 1u;
    page.entries = bits_of(word, 8u, 8u) + 1u;
    page.drawable_width = bits_of(word, 16u, 6u);
    page.start_low = bits_of(word, 22u, 6u);
    page.start_upper = bits_of(word, 28u, 10u);
    page.code_low = bits_of(word, 38u, 6u);
    page.code_upper = bits_of(word, 44u, 10u);
    page.has_masks = bits_of(word, 54u, 1u) == 1u;
    page.lowest = owners_word(word + 2u);
    page.pool = owners_word(word + 3u);
    page.bits_at = word + 4u;
    page.value_width = width_of(page.entries - 1u);
    page.values_at = page.start_upper + (page.runs - 1u) * page.start_low;
    page.marks_at = page.values_at + page.runs * page.value_width;
    page.pool_at = page.marks_at + select(0u, page.pool - 1u, page.pool != page.entries);
    page.masked_at = page.pool_at + page.pool * page.drawable_width;
    page.fixed_end = page.masked_at + select(0u, page.runs, page.has_masks);
    return page;
}

// Number `i` of a rising list (Elias-Fano): `upper` bits in unary at `at`, then `low` bits each.
fn elias_fano(bits_at: u32, at: u32, upper: u32, low: u32, i: u32) -> u32 {
    let position = select_bit(bits_at, at, upper, i, 0u);
    return ((position - i) << low) | bits_of(bits_at, at + upper + i * low, low);
}

// The run that holds the page's brick number `brick`: how many of the other runs' starts are at most that.
fn run_of(page: OwnerPage, brick: u32) -> u32 {
    let step = select(brick >> (page.start_low & 31u), 0u, page.start_low >= 32u);
    var start = 0u;
    if step > 0u {
        let zero = select_bit(page.bits_at, 0u, page.start_upper, step - 1u, 0xffffffffu);
        if zero == NOWHERE {
            return page.runs - 1u;
        }
        start = zero + 1u;
    }
    let low = brick & low_mask(page.start_low);
    var i = start - step;
    var at = start;
    while at < page.start_upper && bits_of(page.bits_at, at, 1u) == 1u
        && bits_of(page.bits_at, page.start_upper + i * page.start_low, page.start_low) <= low {
        i++;
        at++;
    }
    return i;
}

// Where a palette entry begins in the pool.
fn entry_start(page: OwnerPage, entry: u32) -> u32 {
    if page.pool == page.entries || entry == 0u {
        return entry;
    }
    let mark = select_bit(page.bits_at, page.marks_at, page.pool - 1u, entry - 1u, 0u);
    return select(mark + 1u, page.pool, mark == NOWHERE);
}

// Place in the directory of the page that holds a brick.
fn page_of(ordinal: u32) -> u32 {
    var first = 0u;
    var end = owners.pages;
    while end - first > 1u {
        let middle = (first + end) / 2u;
        if owners_word(owners.directory_at + 2u * middle) <= ordinal {
            first = middle;
        } else {
            end = middle;
        }
    }
    return first;
}

// The owners of the brick with this ordinal and this mask of occupied voxels.
fn owners_of(ordinal: u32, mask: vec2u) -> OwnerSet {
    let number = page_of(ordinal);
    let page = owner_page(owners_word(owners.directory_at + 2u * number + 1u));
    let run = run_of(page, ordinal - owners_word(owners.directory_at + 2u * number));
    let entry = bits_of(page.bits_at, page.values_at + run * page.value_width, page.value_width);
    let first = entry_start(page, entry);
    var packed: OwnerSet;
    packed.bits_at = page.bits_at;
    packed.lowest = page.lowest;
    packed.width = page.drawable_width;
    packed.pool_at = page.pool_at + first * page.drawable_width;
    packed.count = entry_start(page, entry + 1u) - first;
    packed.voxels = countOneBits(mask.x) + countOneBits(mask.y);
    packed.is_masked = page.has_masks && bits_of(page.bits_at, page.masked_at + run, 1u) == 1u;
    packed.code_at = 0u;
    if packed.is_masked {
        let masked = ones_of(page.bits_at, page.masked_at, page.runs);
        let before = ones_of(page.bits_at, page.masked_at, run);
        let bits = page.code_upper + (masked - 1u) * page.code_low;
        var offset = 0u;
        if before > 0u {
            offset = elias_fano(page.bits_at, page.fixed_end, page.code_upper, page.code_low, before - 1u);
        }
        packed.code_at = page.fixed_end + bits + offset;
    }
    return packed;
}

fn owner_at(packed: OwnerSet, i: u32) -> u32 {
    return packed.lowest + bits_of(packed.bits_at, packed.pool_at + i * packed.width, packed.width);
}

// Does owner `i` own the voxel that has `rank` occupied ones of its brick before it?
fn owns(packed: OwnerSet, i: u32, rank: u32) -> bool {
    if !packed.is_masked {
        return true;
    }
    if i + 1u < packed.count {
        return bits_of(packed.bits_at, packed.code_at + i * packed.voxels + rank, 1u) == 1u;
    }
    // The last owner's code has bits only for voxels that another one owns; the others are its own.
    var is_covered = false;
    var before = 0u;
    for (var voxel = 0u; voxel <= rank; voxel++) {
        var covered = false;
        for (var other = 0u; other + 1u < packed.count; other++) {
            covered |= bits_of(packed.bits_at, packed.code_at + other * packed.voxels + voxel, 1u) == 1u;
        }
        if voxel == rank {
            is_covered = covered;
        } else if covered {
            before++;
        }
    }
    return !is_covered || bits_of(packed.bits_at, packed.code_at + i * packed.voxels + before, 1u) == 1u;
}

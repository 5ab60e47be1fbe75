//! One question, asked of every path of the ray caster.

use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::{Footprint, GridRay, Instructions, Next, RayCaster, RayPacket, VoxelHit};

use super::random::{Random, mixed};

/// A way to cast rays; a new one belongs here, in [`Path::Reference`]'s company or with instruction sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    Reference,
    Single(Instructions),
    Batch(Instructions),
    Packet(Instructions),
}

/// What the caller does at each hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Goes on: all hits.
    All,
    /// Ends: first hit, any hit.
    First,
    /// Past the brick.
    Bricks,
    /// Each of them, by the voxel.
    Mixed,
}

/// How a group of rays is cast.
#[derive(Clone, Copy, Debug)]
pub struct Question {
    pub mode: Mode,
    pub footprint: Footprint,
    /// Compare the ordinals of bricks as well.
    pub ordinals: bool,
}

impl Question {
    pub fn new(random: &mut Random, side: f64, ordinals: bool) -> Self {
        let mode = random.pick(&[Mode::First, Mode::First, Mode::All, Mode::Bricks, Mode::Mixed]);
        let footprint = match random.below(12) {
            0 => Footprint { width: 8.0 * random.unit(), growth: 0.0 },
            1 => Footprint { width: 0.0, growth: 16.0 * random.unit() / side },
            _ => Footprint::default(),
        };
        Question { mode, footprint, ordinals }
    }

    /// All hits, voxel by voxel.
    pub fn all() -> Self {
        Question { mode: Mode::All, footprint: Footprint::default(), ordinals: true }
    }

    fn next(&self, voxel: [i32; 3]) -> Next {
        match self.mode {
            Mode::All => Next::Voxel,
            Mode::First => Next::End,
            Mode::Bricks => Next::Brick,
            Mode::Mixed => match mixed(voxel.iter().fold(0, |h, &c| h << 20 ^ c as u64)) % 8 {
                0 => Next::Brick,
                1 => Next::End,
                _ => Next::Voxel,
            },
        }
    }
}

/// What one ray met on one path.
#[derive(Clone, Debug, PartialEq)]
pub struct Met {
    /// The ray's first hit and its t.
    pub first: Option<([i32; 3], f64)>,
    pub hits: u64,
    /// Of all hits: voxel, t, whole brick or not, and ordinal where asked for.
    digest: u64,
    /// Hits with a smaller t than the one before.
    pub backwards: u64,
    /// Hits that are not a step onwards from the one before, as the same voxel again is not.
    pub repeated: u64,
    last: ([i32; 3], f64, bool),
}

impl Met {
    pub fn nothing() -> Self {
        Met {
            first: None,
            hits: 0,
            digest: 0,
            backwards: 0,
            repeated: 0,
            last: ([0; 3], f64::NEG_INFINITY, false),
        }
    }

    #[inline]
    fn note(&mut self, ray: &GridRay, hit: &VoxelHit, ordinals: bool) {
        let (voxel, t) = (hit.voxel, hit.t());
        let bits = u64::from(hit.whole_brick) | if ordinals { hit.brick_ordinal() << 1 } else { 0 };
        for part in [voxel[0] as u64 | (voxel[1] as u64) << 32, voxel[2] as u64 | bits << 32, t.to_bits()] {
            self.digest = (self.digest.rotate_left(23) ^ part).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        }
        if self.first.is_none() {
            self.first = Some((voxel, t));
        } else {
            // Written so that a NaN is out of order too.
            self.backwards += u64::from(!matches!(t.partial_cmp(&self.last.1), Some(o) if o.is_ge()));
            // A whole brick counts as the brick, wherever in it the voxel before was.
            let shift = if hit.whole_brick || self.last.2 { 2 } else { 0 };
            let (mut back, mut on) = (false, false);
            for (k, c) in voxel.into_iter().enumerate() {
                let by = (c >> shift) - (self.last.0[k] >> shift);
                let falls = ray.direction[k] < 0.0;
                back |= if falls { by > 0 } else { by < 0 };
                on |= by != 0;
            }
            let onwards = on && !back;
            self.repeated += u64::from(!onwards);
        }
        self.hits += 1;
        self.last = (voxel, t, hit.whole_brick);
    }
}

/// Asks one path; the answers replace those in `met`.
pub fn ask(
    path: Path,
    dag: DagRef,
    rays: &[GridRay],
    question: &Question,
    packet: &mut RayPacket,
    met: &mut Vec<Met>,
) {
    met.clear();
    met.resize(rays.len(), Met::nothing());
    let caster = RayCaster::new(dag).with_footprint(question.footprint);
    match path {
        Path::Reference => {
            for (ray, met) in rays.iter().zip(met) {
                dag.cast_footprint(ray, question.footprint, |hit| {
                    met.note(ray, hit, question.ordinals);
                    question.next(hit.voxel)
                });
            }
        }
        Path::Single(instructions) => {
            let caster = caster.with_instructions(instructions);
            for (ray, met) in rays.iter().zip(met) {
                caster.cast(ray, |hit| {
                    met.note(ray, hit, question.ordinals);
                    question.next(hit.voxel)
                });
            }
        }
        Path::Batch(instructions) => {
            caster.with_instructions(instructions).cast_batch(rays, |i, hit| {
                met[i].note(&rays[i], hit, question.ordinals);
                question.next(hit.voxel)
            });
        }
        Path::Packet(instructions) => {
            packet.fill(rays.iter().copied());
            caster.with_instructions(instructions).cast_packet(packet, |i, hit| {
                met[i].note(&rays[i], hit, question.ordinals);
                question.next(hit.voxel)
            });
        }
    }
}

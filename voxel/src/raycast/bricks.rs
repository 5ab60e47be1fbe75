//! The bricks that the rays of a packet cross, each visited once for all of an octant: for callers that test what is inside
//! by other means, such as the triangles of a brick's owners.

use fearless_simd::Simd;

use super::lanes::Lanes;
use super::packet::{RayPacket, for_each_octant};
use super::single::{cast_alone, child_corner, child_size, true_corner};
use super::slabs::{Columns, TileSlabs, rounded_up};
use super::{Footprint, MAX_STACK, Next, PACKET_RAYS, mask, ordinal};
use crate::bits::{SetBits, mirror, mirror_slot};
use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at};

/// Rays are tested against the children of nodes of this height and below; above, the tile's frustum alone decides.
const RAY_TEST_HEIGHT: usize = 2;

/// A brick that rays of a packet may cross.
pub struct PacketBrick<'t> {
    /// Its low corner, voxels.
    pub corner: [i32; 3],
    /// The rays that may cross it, as bits: none that does is missing, some may pass it by 2^-19 of the grid's side.
    pub rays: u64,
    dag: &'t DagRef<'t>,
    nodes: &'t [u32; MAX_STACK],
}

impl PacketBrick<'_> {
    /// Its ordinal in depth-first order, for [`crate::dag::OwnersRef::of_brick`].
    #[inline]
    pub fn ordinal(&self) -> u64 {
        ordinal(self.dag, self.nodes, self.corner)
    }

    /// Mask of its occupied voxels, for [`crate::dag::OwnersRef::of_brick`].
    #[inline]
    pub fn mask(&self) -> u64 {
        mask(self.dag, self.nodes, self.corner)
    }
}

/// How far the rays of a packet still look, in their own parameter.
pub struct RayEnds {
    t: [f64; PACKET_RAYS],
    /// Rays that were shortened since somebody looked.
    shortened: u64,
}

impl RayEnds {
    /// From now on this ray looks no farther than to `t`.
    #[inline]
    pub fn shorten(&mut self, ray: usize, t: f64) {
        if t < self.t[ray] {
            self.t[ray] = t;
            self.shortened |= 1 << ray;
        }
    }

    /// The farthest of some rays.
    #[inline(always)]
    fn farthest(&self, rays: u64) -> f64 {
        let mut farthest = f64::NEG_INFINITY;
        for i in 0..PACKET_RAYS {
            let t = if rays >> i & 1 != 0 { self.t[i] } else { f64::NEG_INFINITY };
            farthest = if t > farthest { t } else { farthest };
        }
        farthest
    }
}

/// See [`super::RayCaster::cast_bricks`].
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    dag: &DagRef,
    packet: &mut RayPacket,
    visit: &mut impl FnMut(&PacketBrick, &mut RayEnds),
) {
    let Some(root) = dag.root else { return };
    let mut ends = RayEnds { t: packet.rays.t_max, shortened: 0 };
    let mut nodes = [0u32; MAX_STACK];
    nodes[dag.height as usize] = root;
    let apart = for_each_octant(
        simd,
        dag,
        packet,
        #[inline(always)]
        |packet, flip, tile, ready| {
            let mut descent = Descent::new(simd, dag, flip, tile);
            if let Some(rays) = ready {
                descent.take(rays, packet.lanes.t_start());
                // Another octant's visits may have shortened them.
                ends.shortened |= rays;
                descent.shorten(&mut packet.lanes, &mut ends);
            }
            descent.run(packet, &mut nodes, &mut ends, visit)
        },
    );
    for i in SetBits(apart) {
        let ray = i as usize;
        // Every brick is below this footprint.
        let footprint = Footprint { width: f64::INFINITY, growth: 0.0 };
        let columns = Columns::new(simd);
        cast_alone(columns, dag, &packet.walks.get(ray), &mut nodes, footprint, &mut |hit| {
            if hit.t() > ends.t[ray] {
                return Next::End;
            }
            visit(&PacketBrick { corner: hit.voxel, rays: 1 << ray, dag, nodes: hit.nodes }, &mut ends);
            Next::Brick
        });
    }
}

/// Rays of one octant on their way down from the root.
struct Descent<'d, S: Simd> {
    columns: Columns<S>,
    dag: &'d DagRef<'d>,
    flip: u32,
    tile: TileSlabs,
    /// Where the tile's parameter begins, in the rays' own.
    t_start: f64,
    /// Rays whose lanes are set up; none until a node low enough is met.
    alive: u64,
    is_ready: bool,
    apart: u64,
    /// Of each height: children to come, low corner, rays.
    left: [u64; MAX_STACK],
    corners: [[f32; 3]; MAX_STACK],
    rays: [u64; MAX_STACK],
    /// Of the heights at which rays are tested: the rays of each child, where they were found ray by ray.
    rays_of: [[u64; 64]; RAY_TEST_HEIGHT + 1],
    is_divided: [bool; RAY_TEST_HEIGHT + 1],
    /// Rays were shortened since.
    is_stale: [bool; RAY_TEST_HEIGHT + 1],
}

impl<'d, S: Simd> Descent<'d, S> {
    #[inline(always)]
    fn new(simd: S, dag: &'d DagRef<'d>, flip: u32, tile: &TileSlabs) -> Self {
        Descent {
            columns: Columns::new(simd),
            dag,
            flip,
            tile: *tile,
            t_start: 0.0,
            alive: u64::MAX,
            is_ready: false,
            apart: 0,
            left: [0; MAX_STACK],
            corners: [[0.0; 3]; MAX_STACK],
            rays: [0; MAX_STACK],
            rays_of: [[0; 64]; RAY_TEST_HEIGHT + 1],
            is_divided: [false; RAY_TEST_HEIGHT + 1],
            is_stale: [false; RAY_TEST_HEIGHT + 1],
        }
    }

    /// Rays whose lanes are set up already, and where their parameter and the tile's begins.
    #[inline(always)]
    fn take(&mut self, rays: u64, t_start: f64) {
        self.alive = rays;
        self.t_start = t_start;
        self.is_ready = true;
    }

    /// From the root, which is in `nodes` already. Returns the rays that have to go alone.
    #[inline(always)]
    fn run(
        mut self,
        packet: &mut RayPacket,
        nodes: &mut [u32; MAX_STACK],
        ends: &mut RayEnds,
        visit: &mut impl FnMut(&PacketBrick, &mut RayEnds),
    ) -> u64 {
        let dag = self.dag;
        let slot_flip = mirror_slot(self.flip);
        let top = dag.height as usize;
        let mut height = top;
        self.left[top] = self.children(nodes[top], self.corners[top], top);
        self.rays[top] = self.alive;
        if top <= RAY_TEST_HEIGHT {
            self.set_up(packet);
            self.rays[top] = self.alive;
        }
        loop {
            if self.left[height] == 0 {
                if height == top {
                    return self.apart;
                }
                height += 1;
                continue;
            }
            let bit = self.left[height].trailing_zeros();
            self.left[height] &= self.left[height] - 1;
            let size = child_size(height);
            let corner = child_corner(self.corners[height], bit, size);
            let mut rays = self.alive;
            if height <= RAY_TEST_HEIGHT {
                let is_divided = self.is_divided[height];
                rays = if is_divided { self.rays_of[height][bit as usize] } else { self.rays[height] };
                if !is_divided || self.is_stale[height] {
                    rays = packet.lanes.crossing::<S, false>(self.columns.witness(), rays, corner, size);
                }
                if rays == 0 {
                    continue;
                }
            }
            let node = nodes[height];
            let child = dag.words[child_word(mask_at(dag.words, node), node, bit ^ slot_flip)];
            if height == 1 {
                let corner = true_corner(dag, corner, 4, self.flip);
                visit(&PacketBrick { corner, rays, dag, nodes }, ends);
                if ends.shortened != 0 {
                    self.shorten(&mut packet.lanes, ends);
                }
                continue;
            }
            let mut candidates = self.children(child, corner, height - 1);
            if height - 1 <= RAY_TEST_HEIGHT {
                if !self.is_ready {
                    self.set_up(packet);
                    rays = self.alive;
                    if rays == 0 {
                        return self.apart;
                    }
                }
                candidates = self.divide(&packet.lanes, height - 1, rays, corner, candidates);
            }
            height -= 1;
            nodes[height] = child;
            self.corners[height] = corner;
            self.left[height] = candidates;
            self.rays[height] = rays;
        }
    }

    /// Occupied children of a node that the tile may cross, mirrored.
    #[inline(always)]
    fn children(&self, node: u32, corner: [f32; 3], height: usize) -> u64 {
        let occupied = mirror(mask_at(self.dag.words, node), self.flip);
        occupied & self.tile.children(self.columns, corner, child_size(height))
    }

    /// Finds the rays of each child where that is done ray by ray: a test of one ray against all children instead of
    /// one of all rays against a child, whichever are fewer. Returns the children that are left.
    #[inline(always)]
    fn divide(&mut self, lanes: &Lanes, height: usize, rays: u64, corner: [f32; 3], candidates: u64) -> u64 {
        self.is_divided[height] = rays.count_ones() <= candidates.count_ones();
        if !self.is_divided[height] {
            return candidates;
        }
        self.is_stale[height] = false;
        let of = &mut self.rays_of[height];
        *of = [0; 64];
        let mut crossed = 0;
        for i in SetBits(rays) {
            let children =
                candidates & lanes.slabs(i as usize).children(self.columns, corner, child_size(height));
            crossed |= children;
            for bit in SetBits(children) {
                of[bit as usize] |= 1 << i;
            }
        }
        crossed
    }

    /// Sets up the lanes: not before a node is met, many tiles meet nothing at all.
    #[inline(always)]
    fn set_up(&mut self, packet: &mut RayPacket) {
        if !self.is_ready {
            let simd = self.columns.witness();
            (self.alive, self.apart) = packet.set_up(simd, self.dag, self.flip);
            self.is_ready = true;
        }
    }

    /// Tells lanes and tile of rays that were shortened.
    #[inline(always)]
    fn shorten(&mut self, lanes: &mut Lanes, ends: &mut RayEnds) {
        for i in SetBits(std::mem::take(&mut ends.shortened)) {
            lanes.shorten(i as usize, ends.t[i as usize]);
        }
        self.is_stale = [true; RAY_TEST_HEIGHT + 1];
        let farthest = rounded_up(ends.farthest(self.alive) - self.t_start);
        if farthest < self.tile.t_max {
            self.tile.t_max = farthest;
        }
    }
}

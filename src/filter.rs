//! What a view leaves out: hidden drawables, and everything on the outer side of clip planes; and what it looks through. Nothing is
//! rebuilt for it.

use crate::camera::Plane;
use crate::ray::Ray;
use glam::DVec3;

/// How opaque a drawable is drawn that is looked through (x-ray), of 255.
const SEEN_THROUGH_ALPHA: u8 = 40;

/// A set of drawables: a bit each; words that are missing have none.
#[derive(Clone, Debug, Default, PartialEq)]
struct Bits(Vec<u64>);

impl Bits {
    fn set(&mut self, drawable: u32, is_in: bool) {
        let (word, bit) = (drawable as usize / 64, 1 << (drawable % 64));
        if self.0.len() <= word {
            self.0.resize(word + 1, 0);
        }
        if is_in { self.0[word] |= bit } else { self.0[word] &= !bit }
    }

    #[inline]
    fn has(&self, drawable: u32) -> bool {
        self.0.get(drawable as usize / 64).is_some_and(|word| word >> (drawable % 64) & 1 == 1)
    }
}

/// Hidden drawables, clip planes, and drawables that are looked through. The default leaves out nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    hidden: Bits,
    seen_through: Bits,
    /// Only what is inside all of them is there.
    clip: Vec<Plane>,
}

impl Filter {
    /// Hides a drawable, or shows it again.
    pub fn set_hidden(&mut self, drawable: u32, is_hidden: bool) {
        self.hidden.set(drawable, is_hidden);
    }

    /// Is it hidden?
    #[inline]
    pub fn is_hidden(&self, drawable: u32) -> bool {
        self.hidden.has(drawable)
    }

    /// Looks through a drawable as if it were of glass, or does not any more: it neither hides what is behind it nor casts shadows.
    pub fn set_seen_through(&mut self, drawable: u32, is_seen_through: bool) {
        self.seen_through.set(drawable, is_seen_through);
    }

    /// Is it looked through, whatever it is made of?
    #[inline]
    pub fn is_seen_through(&self, drawable: u32) -> bool {
        self.seen_through.has(drawable)
    }

    /// How opaque a drawable of this opacity, of 255, is drawn.
    #[inline]
    pub fn alpha_of(&self, drawable: u32, alpha: u8) -> u8 {
        if self.is_seen_through(drawable) { alpha.min(SEEN_THROUGH_ALPHA) } else { alpha }
    }

    /// Are the same drawables hidden and looked through, whatever is cut away?
    pub fn is_same_but_for_planes(&self, other: &Filter) -> bool {
        (&self.hidden, &self.seen_through) == (&other.hidden, &other.seen_through)
    }

    /// Adds a clip plane: what is not inside of it is not there.
    pub fn clip_by(&mut self, plane: Plane) {
        self.clip.push(plane);
    }

    /// The same with other clip planes.
    pub fn with_planes(&self, clip: Vec<Plane>) -> Self {
        Filter { clip, ..self.clone() }
    }

    /// The clip planes.
    pub fn clip_planes(&self) -> &[Plane] {
        &self.clip
    }

    /// The part of a ray that is inside all clip planes; `None` when nothing is left of it.
    #[inline]
    pub fn clipped(&self, ray: &Ray) -> Option<Ray> {
        let (mut t_min, mut t_max) = (ray.t_min, ray.t_max);
        for plane in &self.clip {
            let height = plane.normal.dot(ray.origin - plane.point);
            let slope = plane.normal.dot(ray.direction);
            if slope == 0.0 {
                if height < 0.0 {
                    return None;
                }
                continue;
            }
            let t = -height / slope;
            if slope > 0.0 { t_min = t_min.max(t) } else { t_max = t_max.min(t) }
        }
        (t_min <= t_max).then_some(Ray { t_min, t_max, ..*ray })
    }

    /// Is any part of the box inside each clip plane?
    pub fn reaches(&self, min: DVec3, max: DVec3) -> bool {
        self.clip.iter().all(|plane| plane.reaches(min, max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_drawables_are_those_that_were_hidden_last() {
        let mut filter = Filter::default();
        assert!(!filter.is_hidden(0) && !filter.is_hidden(1_000_000));
        [3, 64, 700].iter().for_each(|&d| filter.set_hidden(d, true));
        filter.set_hidden(64, false);
        let hidden: Vec<u32> = (0..1000).filter(|&d| filter.is_hidden(d)).collect();
        assert_eq!(hidden, [3, 700]);
    }

    #[test]
    fn a_clipped_ray_keeps_the_points_inside_all_planes() {
        let mut random = oorandom::Rand64::new(3);
        let mut unit =
            || DVec3::new(random.rand_float(), random.rand_float(), random.rand_float()) * 2.0 - 1.0;
        let (mut cut, mut gone) = (0, 0);
        for round in 0..2000 {
            let mut filter = Filter::default();
            let planes: Vec<Plane> =
                (0..round % 4).map(|_| Plane { normal: unit(), point: unit() }).collect();
            planes.iter().for_each(|&plane| filter.clip_by(plane));
            let ray = Ray { t_max: 3.0, ..Ray::new(unit(), unit()) };
            let clipped = filter.clipped(&ray);
            for step in 0..=60 {
                let t = f64::from(step) / 20.0;
                let depth = |plane: &Plane| plane.normal.dot(ray.at(t) - plane.point);
                let least = planes.iter().map(depth).fold(f64::INFINITY, f64::min);
                let kept = clipped.is_some_and(|ray| ray.t_min <= t && t <= ray.t_max);
                assert!(
                    kept == (least >= 0.0) || least.abs() < 1e-12,
                    "seed 3, round {round}, t {t}: {least}"
                );
            }
            cut += u32::from(clipped.is_some_and(|clipped| clipped != ray));
            gone += u32::from(clipped.is_none());
        }
        assert!(cut > 200 && gone > 200, "{cut} {gone}");
    }
}

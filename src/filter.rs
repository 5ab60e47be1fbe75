//! What a view leaves out: hidden drawables, and everything on the outer side of clip planes. Nothing is rebuilt for it.

use crate::camera::Plane;
use crate::ray::Ray;
use glam::DVec3;

/// Hidden drawables and clip planes. The default leaves out nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// Bit a drawable; words that are missing have none.
    hidden: Vec<u64>,
    /// Only what is inside all of them is there.
    clip: Vec<Plane>,
}

impl Filter {
    /// Hides a drawable, or shows it again.
    pub fn set_hidden(&mut self, drawable: u32, is_hidden: bool) {
        let (word, bit) = (drawable as usize / 64, 1 << (drawable % 64));
        if self.hidden.len() <= word {
            self.hidden.resize(word + 1, 0);
        }
        if is_hidden { self.hidden[word] |= bit } else { self.hidden[word] &= !bit }
    }

    /// Is it hidden?
    #[inline]
    pub fn is_hidden(&self, drawable: u32) -> bool {
        self.hidden.get(drawable as usize / 64).is_some_and(|word| word >> (drawable % 64) & 1 == 1)
    }

    /// Adds a clip plane: what is not inside of it is not there.
    pub fn clip_by(&mut self, plane: Plane) {
        self.clip.push(plane);
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

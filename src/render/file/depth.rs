//! Depths as a grey picture: raw while it is rendered, scaled to their range when all are there.

/// The range of a picture's depths, model units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthRange {
    /// Least depth of the picture; infinite when it shows nothing.
    pub near: f32,
    /// Greatest depth.
    pub far: f32,
}

/// Bytes of a raw depth.
pub(super) const BYTES: usize = 4;

impl DepthRange {
    /// Of nothing.
    pub(super) const EMPTY: Self = DepthRange { near: f32::INFINITY, far: 0.0 };

    /// With more raw depths.
    pub(super) fn with(self, raw: &[u8]) -> Self {
        depths(raw)
            .filter(|depth| depth.is_finite())
            .fold(self, |range, depth| DepthRange { near: range.near.min(depth), far: range.far.max(depth) })
    }

    /// Raw depths as grey: 0 where there is nothing, 1 to 65,535 from near to far, linear; high byte first.
    pub(super) fn grey(self, raw: &[u8]) -> Vec<u8> {
        let (near, span) = (f64::from(self.near), f64::from(self.far) - f64::from(self.near));
        let grey = |depth: f32| match depth.is_finite() {
            true => 1 + ((f64::from(depth) - near) / span.max(f64::MIN_POSITIVE) * 65_534.0).round() as u16,
            false => 0,
        };
        depths(raw).flat_map(|depth| grey(depth).to_be_bytes()).collect()
    }

    /// As it stands in the picture.
    pub(super) fn text(self) -> String {
        format!("{} {}", self.near, self.far)
    }

    /// What [`DepthRange::text`] wrote.
    pub(super) fn from_text(text: &str) -> Option<Self> {
        let (near, far) = text.split_once(' ')?;
        Some(DepthRange { near: near.parse().ok()?, far: far.parse().ok()? })
    }
}

fn depths(raw: &[u8]) -> impl Iterator<Item = f32> + '_ {
    raw.chunks_exact(BYTES).map(|bytes| bytes.try_into().map_or(f32::INFINITY, f32::from_le_bytes))
}

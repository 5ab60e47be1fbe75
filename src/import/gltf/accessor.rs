//! Typed access to the numbers in buffers. Everything is checked when an [`Elements`] is made, so that
//! reading cannot fail.

use super::container::Buffers;
use super::extensions::{MESHOPT, unsupported};
use super::json::{Accessor, Document};
use crate::import::draft::Source;
use crate::import::error::{ImportError, excerpt};

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_gl(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// The number at `at`. The caller has checked the range; what is not there reads as 0.
    #[inline]
    fn read(self, data: &[u8], at: usize, normalized: bool) -> f64 {
        match self {
            Component::F32 => f64::from(f32::from_le_bytes(bytes_at(data, at))),
            Component::U16 => scaled(u16::from_le_bytes(bytes_at(data, at)).into(), 65_535.0, normalized),
            Component::I16 => scaled(i16::from_le_bytes(bytes_at(data, at)).into(), 32_767.0, normalized),
            Component::U8 => scaled(u8::from_le_bytes(bytes_at(data, at)).into(), 255.0, normalized),
            Component::I8 => scaled(i8::from_le_bytes(bytes_at(data, at)).into(), 127.0, normalized),
            Component::U32 => f64::from(u32::from_le_bytes(bytes_at(data, at))),
        }
    }
}

/// glTF 2.0, section 3.11: signed numbers are clamped, so that 0 is exact.
#[inline]
fn scaled(value: f64, max: f64, normalized: bool) -> f64 {
    if normalized { (value / max).max(-1.0) } else { value }
}

#[inline]
fn bytes_at<const N: usize>(data: &[u8], at: usize) -> [u8; N] {
    data.get(at..).and_then(|tail| tail.first_chunk()).copied().unwrap_or([0; N])
}

/// A document with its buffers.
#[derive(Clone, Copy)]
pub(super) struct Contents<'a> {
    pub source: &'a Source<'a>,
    pub document: &'a Document,
    pub buffers: &'a Buffers<'a>,
    /// Bytes of JSON and buffers together: nothing honest has more elements than that.
    pub total_bytes: u64,
}

/// The elements of an accessor.
pub(super) struct Elements<'a> {
    /// From the first element on; empty when the accessor has no buffer view.
    data: &'a [u8],
    stride: usize,
    count: usize,
    lanes: usize,
    component: Component,
    normalized: bool,
    /// Sparse replacements, sorted by element.
    replaced: Vec<(u32, [f64; 4])>,
}

impl<'a> Elements<'a> {
    /// Elements of an accessor that must be of type `kind` (SCALAR, VEC3, VEC4) with one of the `components`.
    pub fn new(
        contents: Contents<'a>,
        index: usize,
        kind: &str,
        components: &[Component],
    ) -> Result<Self, ImportError> {
        let source = contents.source;
        let place = || format!("accessor {index}");
        let accessors = contents.document.accessors.len();
        let accessor = contents.document.accessors.get(index);
        let accessor = accessor
            .ok_or_else(|| source.invalid(place(), format!("one of {accessors} accessors"), "no such one"))?;
        if accessor.kind != kind {
            return Err(source.invalid(place(), format!("type {kind}"), excerpt(accessor.kind.as_bytes())));
        }
        let lanes = match kind {
            "VEC4" => 4,
            "VEC3" => 3,
            _ => 1,
        };
        let component = Component::from_gl(accessor.component_type)
            .filter(|component| components.contains(component))
            .ok_or_else(|| {
                let expected = format!("a component type of {components:?}");
                source.invalid(place(), expected, accessor.component_type.to_string())
            })?;
        let element_bytes = lanes * component.bytes();
        let mut stride = element_bytes;
        let mut data: &[u8] = &[];
        if let Some(view_index) = accessor.buffer_view {
            let view = View::new(contents, view_index, index)?;
            stride = view.stride.unwrap_or(element_bytes);
            if stride < element_bytes {
                let expected = format!("a byteStride of at least {element_bytes}");
                return Err(source.invalid(format!("bufferView {view_index}"), expected, stride.to_string()));
            }
            data =
                view.elements(contents, index, accessor.byte_offset, accessor.count, stride, element_bytes)?;
        } else if accessor.count as u64 > contents.total_bytes {
            // All zeros, without a byte behind them.
            let expected = format!("at most {} elements without bufferView", contents.total_bytes);
            return Err(source.invalid(place(), expected, accessor.count.to_string()));
        }
        let (count, normalized) = (accessor.count, accessor.normalized);
        let mut elements =
            Elements { data, stride, count, lanes, component, normalized, replaced: Vec::new() };
        if accessor.sparse.is_some() {
            elements.replaced = elements.sparse(contents, index, accessor)?;
        }
        Ok(elements)
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// The numbers of element `i`, as many as its type has; 0 in the others.
    #[inline]
    pub fn get(&self, i: usize) -> [f64; 4] {
        if !self.replaced.is_empty()
            && let Ok(at) = self.replaced.binary_search_by_key(&i, |entry| entry.0 as usize)
        {
            return self.replaced.get(at).map_or([0.0; 4], |entry| entry.1);
        }
        self.decode(self.data, i.saturating_mul(self.stride))
    }

    /// All elements as whole numbers: for indices, whose components are unsigned.
    pub fn to_indices(&self) -> Vec<u32> {
        let plain = self.replaced.is_empty() && self.data.len() >= self.count.saturating_mul(self.stride);
        let packed = self.data.get(..self.count.saturating_mul(self.stride)).filter(|_| plain);
        match (self.component, packed) {
            (Component::U8, Some(data)) if self.stride == 1 => data.iter().map(|&i| i.into()).collect(),
            (Component::U16, Some(data)) if self.stride == 2 => {
                data.chunks_exact(2).map(|pair| u16::from_le_bytes(bytes_at(pair, 0)).into()).collect()
            }
            (Component::U32, Some(data)) if self.stride == 4 => {
                data.chunks_exact(4).map(|four| u32::from_le_bytes(bytes_at(four, 0))).collect()
            }
            // `as` is exact: whole numbers below 2^32.
            _ => (0..self.count).map(|i| self.get(i)[0] as u32).collect(),
        }
    }

    #[inline]
    fn decode(&self, data: &[u8], at: usize) -> [f64; 4] {
        let mut numbers = [0.0; 4];
        for (lane, number) in numbers.iter_mut().enumerate().take(self.lanes) {
            *number = self.component.read(data, at + lane * self.component.bytes(), self.normalized);
        }
        numbers
    }

    fn sparse(
        &self,
        contents: Contents<'a>,
        index: usize,
        accessor: &Accessor,
    ) -> Result<Vec<(u32, [f64; 4])>, ImportError> {
        let Some(sparse) = &accessor.sparse else { return Ok(Vec::new()) };
        let invalid = |expected: String, found: String| {
            contents.source.invalid(format!("accessor {index}, sparse"), expected, found)
        };
        if sparse.count > self.count {
            return Err(invalid(format!("at most {} values", self.count), sparse.count.to_string()));
        }
        let component = Component::from_gl(sparse.indices.component_type)
            .filter(|c| matches!(c, Component::U8 | Component::U16 | Component::U32))
            .ok_or_else(|| {
                invalid("unsigned whole indices".to_owned(), sparse.indices.component_type.to_string())
            })?;
        let view = View::new(contents, sparse.indices.buffer_view, index)?;
        let size = component.bytes();
        let places = view.elements(contents, index, sparse.indices.byte_offset, sparse.count, size, size)?;
        let view = View::new(contents, sparse.values.buffer_view, index)?;
        let size = self.lanes * self.component.bytes();
        let values = view.elements(contents, index, sparse.values.byte_offset, sparse.count, size, size)?;
        let mut replaced = Vec::with_capacity(sparse.count);
        for i in 0..sparse.count {
            let place = component.read(places, i * component.bytes(), false) as u32;
            if place as usize >= self.count {
                return Err(invalid(format!("indices below {}", self.count), place.to_string()));
            }
            replaced.push((place, self.decode(values, i * size)));
        }
        // In order by specification; where it is not, or an index comes twice, the first wins.
        replaced.sort_by_key(|entry| entry.0);
        replaced.dedup_by_key(|entry| entry.0);
        Ok(replaced)
    }
}

/// The bytes of a buffer view.
struct View<'a> {
    index: usize,
    bytes: &'a [u8],
    stride: Option<usize>,
}

impl<'a> View<'a> {
    /// View number `index`, which `accessor` asks for.
    fn new(contents: Contents<'a>, index: usize, accessor: usize) -> Result<Self, ImportError> {
        let source = contents.source;
        let views = &contents.document.buffer_views;
        let view = views.get(index).ok_or_else(|| {
            let expected = format!("one of {} bufferViews", views.len());
            source.invalid(format!("accessor {accessor}"), expected, index.to_string())
        })?;
        let place = || format!("bufferView {index}");
        let Some(buffer) = contents.buffers.get(view.buffer) else {
            if view.extensions.contains_key(MESHOPT) {
                return Err(unsupported(source, MESHOPT));
            }
            let found = format!("buffer {}, which has none", view.buffer);
            return Err(source.invalid(place(), "a buffer with content", found));
        };
        let end = view.byte_offset.checked_add(view.byte_length);
        let bytes = end.and_then(|end| buffer.get(view.byte_offset..end)).ok_or_else(|| {
            let expected = format!("a range inside the {} bytes of buffer {}", buffer.len(), view.buffer);
            source.invalid(place(), expected, format!("{} bytes from {}", view.byte_length, view.byte_offset))
        })?;
        Ok(View { index, bytes, stride: view.byte_stride })
    }

    /// The bytes from `offset` on, which must hold `count` elements.
    fn elements(
        &self,
        contents: Contents,
        accessor: usize,
        offset: usize,
        count: usize,
        stride: usize,
        element_bytes: usize,
    ) -> Result<&'a [u8], ImportError> {
        // The last element need not be followed by the rest of its stride.
        let needed = match count.checked_sub(1) {
            None => Some(0),
            Some(before_last) => before_last
                .checked_mul(stride)
                .and_then(|bytes| bytes.checked_add(element_bytes))
                .and_then(|bytes| bytes.checked_add(offset)),
        };
        match needed {
            Some(needed) if needed <= self.bytes.len() => Ok(self.bytes.get(offset..).unwrap_or_default()),
            _ => {
                let place = format!("accessor {accessor}");
                let expected =
                    format!("elements inside the {} bytes of bufferView {}", self.bytes.len(), self.index);
                let found = format!("{count} elements of {stride} bytes from {offset}");
                Err(contents.source.invalid(place, expected, found))
            }
        }
    }
}

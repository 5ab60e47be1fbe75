//! What is selected or highlighted: four bits a drawable, beside the scene's own data.

use wgpu::BufferUsages;

use super::context::Context;

/// Bits of a drawable.
pub const SELECTED: u32 = 1;
/// Tinted.
pub const HIGHLIGHTED: u32 = 2;

const BITS: u32 = 4;

/// Marks of all drawables.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    words: Vec<u32>,
}

impl Marks {
    /// Sets or takes away marks of a drawable.
    pub fn set(&mut self, drawable: u32, marks: u32, is_set: bool) {
        let (word, shift) = ((drawable / 8) as usize, BITS * (drawable % 8));
        if self.words.len() <= word {
            self.words.resize(word + 1, 0);
        }
        let bits = (marks & 15) << shift;
        if is_set { self.words[word] |= bits } else { self.words[word] &= !bits }
    }

    /// No marks at all.
    pub fn clear(&mut self) {
        self.words.clear();
    }

    pub(super) fn buffer(&self, context: &Context) -> wgpu::Buffer {
        let none = [0];
        let words: &[u32] = if self.words.is_empty() { &none } else { &self.words };
        context.buffer("marks", words, BufferUsages::STORAGE)
    }
}

//! Sets of objects.

use std::ops::Range;

/// Objects, a bit each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectSet {
    words: Vec<u64>,
    count: u32,
}

impl ObjectSet {
    /// Adds or takes away an object.
    pub fn set(&mut self, object: u32, is_in: bool) {
        if self.has(object) == is_in {
            return;
        }
        let (word, bit) = (object as usize / 64, 1 << (object % 64));
        if self.words.len() <= word {
            self.words.resize(word + 1, 0);
        }
        self.words[word] ^= bit;
        if is_in { self.count += 1 } else { self.count -= 1 }
    }

    /// Is an object in it?
    pub fn has(&self, object: u32) -> bool {
        self.words.get(object as usize / 64).is_some_and(|word| word >> (object % 64) & 1 == 1)
    }

    /// How many there are.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// How many of a range are in it.
    pub fn count_of(&self, objects: Range<u32>) -> u32 {
        let (first, last) = (objects.start as usize / 64, objects.end as usize / 64);
        let within = |word: usize| {
            let below = |end: u32| if end as usize / 64 > word { u64::MAX } else { (1 << (end % 64)) - 1 };
            let from = if word == first { !((1u64 << (objects.start % 64)) - 1) } else { u64::MAX };
            self.words.get(word).copied().unwrap_or(0) & from & below(objects.end)
        };
        if objects.is_empty() { 0 } else { (first..=last).map(|word| within(word).count_ones()).sum() }
    }

    /// All of them, rising.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        let bits = |(index, &word): (usize, &u64)| {
            let rest = |word: &u64| Some(word & (word - 1)).filter(|&rest| rest != 0);
            let words = std::iter::successors(Some(word).filter(|&word| word != 0), rest);
            words.map(move |word| index as u32 * 64 + word.trailing_zeros())
        };
        self.words.iter().enumerate().flat_map(bits)
    }

    /// Empties it.
    pub fn clear(&mut self) {
        *self = ObjectSet::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_count_what_they_hold() {
        let mut random = oorandom::Rand32::new(7);
        let (mut set, mut list) = (ObjectSet::default(), vec![false; 300]);
        for round in 0..4000 {
            let (object, is_in) = (random.rand_range(0..300), random.rand_u32() & 1 == 1);
            set.set(object, is_in);
            list[object as usize] = is_in;
            let (a, b) = (random.rand_range(0..301), random.rand_range(0..301));
            let range = a.min(b)..a.max(b);
            let expected = range.clone().filter(|&object| list[object as usize]).count();
            assert_eq!(set.count_of(range.clone()) as usize, expected, "seed 7, round {round}: {range:?}");
            assert_eq!(set.count() as usize, list.iter().filter(|is_in| **is_in).count());
        }
        let expected: Vec<u32> = (0..300).filter(|&object| list[object as usize]).collect();
        assert_eq!(set.iter().collect::<Vec<_>>(), expected);
        set.clear();
        assert_eq!(set.count_of(0..300), 0);
    }
}

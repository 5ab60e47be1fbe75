//! Lines and words of text files, as bytes: CAD exporters write names in any encoding, numbers are ASCII.

/// The line without white space around it.
pub(super) fn trim(line: &[u8]) -> &[u8] {
    line.trim_ascii()
}

/// The first word and what follows it. Both are empty for an empty line.
pub(super) fn first_word(line: &[u8]) -> (&[u8], &[u8]) {
    let line = line.trim_ascii_start();
    match line.iter().position(u8::is_ascii_whitespace) {
        Some(end) => line.split_at(end),
        None => (line, &[]),
    }
}

/// Words between white space.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A decimal number. NaN and infinities are accepted here and dropped later, where they are counted.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Three numbers from the front of `words`.
pub(super) fn three_numbers<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Option<[f64; 3]> {
    Some([number(words.next()?)?, number(words.next()?)?, number(words.next()?)?])
}

/// A name, whatever its encoding.
pub(super) fn name(text: &[u8]) -> String {
    String::from_utf8_lossy(text.trim_ascii()).into_owned()
}

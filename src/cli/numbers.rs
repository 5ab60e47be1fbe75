//! Numbers with suffixes: 12M, 4G, 2mm, 1024x768.

/// A count: decimal suffixes k, M, G (10^3, 10^6, 10^9).
pub fn parse_count(text: &str) -> Result<u64, String> {
    parse_scaled(text, &[("k", 1e3), ("K", 1e3), ("M", 1e6), ("G", 1e9)], "a count such as 2000, 500k or 12M")
}

/// Bytes: binary suffixes K, M, G, T (2^10 ...), with or without B or iB.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let short = text.trim_end_matches(['B', 'b']).trim_end_matches('i');
    const SCALES: [(&str, f64); 4] =
        [("K", 1024.0), ("M", 1048576.0), ("G", 1073741824.0), ("T", 1099511627776.0)];
    parse_scaled(short, &SCALES, "bytes such as 4G or 512M")
}

fn parse_scaled(text: &str, scales: &[(&str, f64)], expected: &str) -> Result<u64, String> {
    let text = text.trim();
    let scaled = scales.iter().find_map(|(suffix, scale)| Some((text.strip_suffix(suffix)?, *scale)));
    let (digits, scale) = scaled.unwrap_or((text, 1.0));
    match digits.trim().replace('_', "").parse::<f64>() {
        Ok(value) if value >= 0.0 && value * scale < 1.8e19 => Ok((value * scale).round() as u64),
        _ => Err(format!("expected {expected}, found \"{text}\"")),
    }
}

/// A length: a number with a unit of [`metres_of_unit`], or without one (model units).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// In metres.
    Metres(f64),
    /// In the model's own units.
    ModelUnits(f64),
}

impl Length {
    /// In model units of so many metres.
    pub fn in_units(self, metres_per_unit: f64) -> f64 {
        match self {
            Length::Metres(metres) => metres / metres_per_unit,
            Length::ModelUnits(units) => units,
        }
    }
}

/// A length such as `2mm`, `0.5in` or `3` (model units).
pub fn parse_length(text: &str) -> Result<Length, String> {
    let text = text.trim();
    let split = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e' && c != 'E').unwrap_or(text.len());
    let (digits, unit) = text.split_at(split);
    let wrong = || format!("expected a length such as 2mm, 0.5in or 3 (model units), found \"{text}\"");
    let value: f64 = digits.trim().parse().map_err(|_| wrong())?;
    if !(value.is_finite() && value > 0.0) {
        return Err(wrong());
    }
    match unit.trim() {
        "" => Ok(Length::ModelUnits(value)),
        unit => metres_of_unit(unit).map(|metres| Length::Metres(value * metres)).ok_or_else(wrong),
    }
}

/// Numbers of frames: `7`, or `0-299` with both ends.
pub fn parse_frames(text: &str) -> Result<std::ops::Range<usize>, String> {
    let (first, last) = text.trim().split_once('-').unwrap_or((text.trim(), text.trim()));
    match (first.trim().parse::<u32>(), last.trim().parse::<u32>()) {
        (Ok(first), Ok(last)) if first <= last => Ok(first as usize..last as usize + 1),
        _ => Err(format!("expected frames such as 7 or 0-299, found \"{text}\"")),
    }
}

/// Metres of a unit name.
pub fn metres_of_unit(unit: &str) -> Option<f64> {
    Some(match unit {
        "um" => 1e-6,
        "mm" => 1e-3,
        "cm" => 1e-2,
        "dm" => 1e-1,
        "m" => 1.0,
        "km" => 1e3,
        "in" => 0.0254,
        "ft" => 0.3048,
        _ => return None,
    })
}

/// A unit name, checked.
pub fn parse_unit(text: &str) -> Result<String, String> {
    match metres_of_unit(text) {
        Some(_) => Ok(text.to_owned()),
        None => Err(format!("expected um, mm, cm, dm, m, km, in or ft, found \"{text}\"")),
    }
}

/// An image size such as `1920x1080`.
pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once(['x', 'X']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match sides {
        Some((Ok(width), Ok(height))) if width > 0 && height > 0 => Ok((width, height)),
        _ => Err(format!("expected a size such as 1920x1080, found \"{text}\"")),
    }
}

/// Three numbers such as `0.3,1,0.2`.
pub fn parse_vector(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|c: &f64| c.is_finite()) => Ok([x, y, z]),
        _ => Err(format!("expected three numbers such as 0.3,1,0.2, found \"{text}\"")),
    }
}

/// log2 of the voxels a side: a power of two from 64 to 131072, with or without k (= 1024).
pub fn parse_resolution(text: &str) -> Result<u32, String> {
    let wrong =
        || format!("expected a power of two from 64 to 131072 (such as 4096 or 8k), found \"{text}\"");
    let (digits, scale) = match text.trim().strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 1024u32),
        None => (text.trim(), 1),
    };
    let side = digits.parse::<u32>().ok().and_then(|n| n.checked_mul(scale)).ok_or_else(wrong)?;
    if side.is_power_of_two() && (64..=131_072).contains(&side) {
        Ok(side.trailing_zeros())
    } else {
        Err(wrong())
    }
}

/// Rays or samples per pixel: 1 to 65,536.
pub fn parse_rays(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(rays) if (1..=65_536).contains(&rays) => Ok(rays),
        _ => Err(format!("expected a whole number from 1 to 65536, found \"{text}\"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suffixes_scale() {
        assert_eq!(parse_count("12M"), Ok(12_000_000));
        assert_eq!(parse_count("1.5k"), Ok(1500));
        assert_eq!(parse_count("2_000"), Ok(2000));
        assert_eq!(parse_bytes("4G"), Ok(4 << 30));
        assert_eq!(parse_bytes("512MiB"), Ok(512 << 20));
        assert_eq!(parse_resolution("8k"), Ok(13));
        assert_eq!(parse_resolution("4096"), Ok(12));
        assert_eq!(parse_size("1920x1080"), Ok((1920, 1080)));
        assert_eq!(parse_vector("0.3, 1,-2e1"), Ok([0.3, 1.0, -20.0]));
    }

    #[test]
    fn lengths_know_their_unit() {
        assert_eq!(parse_length("2mm").map(|l| l.in_units(0.001)), Ok(2.0));
        assert_eq!(parse_length("1e-3 m").map(|l| l.in_units(0.001)), Ok(1.0));
        assert_eq!(parse_length("3").map(|l| l.in_units(0.001)), Ok(3.0));
    }

    #[test]
    fn nonsense_is_refused_with_an_example() {
        for error in [
            parse_count("-1").unwrap_err(),
            parse_count("many").unwrap_err(),
            parse_bytes("1e300G").unwrap_err(),
            parse_resolution("1000").unwrap_err(),
            parse_resolution("4294967296k").unwrap_err(),
            parse_length("0mm").unwrap_err(),
            parse_length("3 parsec").unwrap_err(),
            parse_size("0x3").unwrap_err(),
            parse_vector("1,2").unwrap_err(),
            parse_rays("0").unwrap_err(),
        ] {
            assert!(error.starts_with("expected "), "{error}");
        }
    }
}

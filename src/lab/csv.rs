//! The table for other programs: a line for each view and method. Quoted as RFC 4180 says; lines end in CR LF.

use super::report::Report;

/// Names of the columns; times are the last ones.
const COLUMNS: [&str; 25] = [
    "view",
    "name",
    "method",
    "rays_per_pixel",
    "resolution",
    "is_floor",
    "rays",
    "in_frustum",
    "reference",
    "answer",
    "wrongly_hidden",
    "reference_1px",
    "wrongly_hidden_1px",
    "reference_4px",
    "wrongly_hidden_4px",
    "reference_16px",
    "wrongly_hidden_16px",
    "reference_small",
    "wrongly_hidden_small",
    "lost_pixels",
    "needlessly_drawn",
    "needless_triangles",
    "sample_count_error",
    "time_ms",
    "time_stages_ms",
];

/// The whole table.
pub fn frames_csv(report: &Report) -> String {
    let mut text = String::new();
    line(&mut text, COLUMNS.map(String::from).into_iter());
    for method in &report.methods {
        let frames = method.frames.iter().zip(&method.time.frames).zip(&report.views).enumerate();
        for (index, ((frame, time), view)) in frames {
            let accuracy = &frame.accuracy;
            let or_empty = |value: Option<String>| value.unwrap_or_default();
            let mut fields = vec![
                index.to_string(),
                view.view.name.clone(),
                method.variant.method.clone(),
                or_empty(method.variant.rays_per_pixel.map(|rays| rays.get().to_string())),
                or_empty(method.variant.resolution.map(|resolution| resolution.to_string())),
                method.is_floor.to_string(),
                frame.rays.to_string(),
                view.facts.in_frustum.to_string(),
                accuracy.reference.to_string(),
                accuracy.answer.to_string(),
                accuracy.wrongly_hidden.to_string(),
            ];
            for class in &accuracy.classes {
                fields.extend([class.reference.to_string(), class.wrongly_hidden.to_string()]);
            }
            fields.extend([frame.small.reference.to_string(), frame.small.wrongly_hidden.to_string()]);
            let stages = time.stages.iter().map(|stage| format!("{}={}", stage.stage, 1e3 * stage.seconds));
            fields.extend([
                accuracy.lost_pixels.to_string(),
                accuracy.needlessly_drawn.to_string(),
                accuracy.needless_triangles.to_string(),
                or_empty(accuracy.sample_count_error.map(|error| error.to_string())),
                (1e3 * time.seconds).to_string(),
                stages.collect::<Vec<_>>().join(";"),
            ]);
            line(&mut text, fields.into_iter());
        }
    }
    text
}

fn line(text: &mut String, fields: impl Iterator<Item = String>) {
    for (index, field) in fields.enumerate() {
        if index > 0 {
            text.push(',');
        }
        text.push_str(&quoted(&field));
    }
    text.push_str("\r\n");
}

/// A field, in quotes where it must be.
fn quoted(field: &str) -> String {
    if !field.contains([',', '"', '\r', '\n']) {
        return field.to_owned();
    }
    format!("\"{}\"", field.replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_quoted_where_they_must_be() {
        assert_eq!(quoted("PUMP 1"), "PUMP 1");
        assert_eq!(quoted("a,b"), "\"a,b\"");
        assert_eq!(quoted("3\" pipe"), "\"3\"\" pipe\"");
        assert_eq!(quoted("two\nlines"), "\"two\nlines\"");
    }
}

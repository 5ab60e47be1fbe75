//! A small writer of HTML: whatever is not markup is escaped, and every tag is closed.

/// Elements without content, which are not closed.
const VOID: [&str; 4] = ["meta", "img", "br", "hr"];

/// A document being written.
#[derive(Default)]
pub struct Html {
    text: String,
    open: Vec<&'static str>,
}

/// An attribute: its name and its value, which is escaped.
pub type Attribute<'a> = (&'static str, &'a str);

impl Html {
    /// Opens an element. Must be followed by [`Html::close`], but for `meta`, `img`, `br` and `hr`.
    pub fn open(&mut self, tag: &'static str, attributes: &[Attribute]) -> &mut Self {
        self.text.push('<');
        self.text.push_str(tag);
        for (name, value) in attributes {
            self.text.push(' ');
            self.text.push_str(name);
            self.text.push_str("=\"");
            self.text(value);
            self.text.push('"');
        }
        self.text.push('>');
        if !VOID.contains(&tag) {
            self.open.push(tag);
        }
        self
    }

    /// Closes the element opened last.
    pub fn close(&mut self) -> &mut Self {
        if let Some(tag) = self.open.pop() {
            self.text.push_str("</");
            self.text.push_str(tag);
            self.text.push('>');
            if BLOCKS.contains(&tag) {
                self.text.push('\n');
            }
        }
        self
    }

    /// Text, escaped.
    pub fn text(&mut self, text: &str) -> &mut Self {
        for character in text.chars() {
            match character {
                '&' => self.text.push_str("&amp;"),
                '<' => self.text.push_str("&lt;"),
                '>' => self.text.push_str("&gt;"),
                '"' => self.text.push_str("&quot;"),
                '\'' => self.text.push_str("&#39;"),
                // Control characters are not allowed in HTML, escaped or not.
                c if c.is_control() && c != '\n' && c != '\t' => self.text.push('\u{fffd}'),
                c => self.text.push(c),
            }
        }
        self
    }

    /// An element with text in it.
    pub fn element(&mut self, tag: &'static str, attributes: &[Attribute], text: &str) -> &mut Self {
        self.open(tag, attributes).text(text).close()
    }

    /// Markup of our own making: a style sheet, a chart.
    pub fn trusted(&mut self, markup: &str) -> &mut Self {
        self.text.push_str(markup);
        self
    }

    /// The document; what is still open is closed.
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.close();
        }
        format!("<!DOCTYPE html>\n{}", self.text)
    }
}

/// A line of the file ends after these.
const BLOCKS: [&str; 12] =
    ["title", "style", "head", "h1", "h2", "h3", "p", "tr", "table", "figure", "section", "li"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_is_written_as_text_becomes_markup() {
        let mut html = Html::default();
        html.open("p", &[("title", "a\"b<c>'")]).text("<script>alert('x & y')</script>\u{7}");
        assert_eq!(
            html.finish(),
            "<!DOCTYPE html>\n<p title=\"a&quot;b&lt;c&gt;&#39;\">&lt;script&gt;alert(&#39;x &amp; y&#39;)\
             &lt;/script&gt;\u{fffd}</p>\n"
        );
    }

    #[test]
    fn what_is_left_open_is_closed_in_order() {
        let mut html = Html::default();
        html.open("div", &[]).open("b", &[]).open("br", &[]);
        assert_eq!(html.finish(), "<!DOCTYPE html>\n<div><b><br></b></div>");
    }
}

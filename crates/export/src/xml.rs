//! Writing of XML files.

use std::path::Path;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};
use roadplane_write::{OutFile, WriteError};

/// An XML element with its attributes and its content: text, or child elements.
#[derive(Clone, Debug)]
pub struct Element {
    name: &'static str,
    attributes: Vec<(&'static str, String)>,
    text: String,
    children: Vec<Element>,
}

impl Element {
    /// Creates an element without attributes and content.
    #[must_use]
    pub fn new(name: &'static str) -> Self {
        Self { name, attributes: Vec::new(), text: String::new(), children: Vec::new() }
    }

    /// Creates an element that contains only text.
    #[must_use]
    pub fn text(name: &'static str, text: impl ToString) -> Self {
        Self { text: text.to_string(), ..Self::new(name) }
    }

    /// Appends an attribute to the element.
    #[must_use]
    pub fn with(mut self, name: &'static str, value: impl ToString) -> Self {
        self.attributes.push((name, value.to_string()));
        self
    }

    /// Appends children to the element.
    #[must_use]
    pub fn holding(mut self, children: impl IntoIterator<Item = Self>) -> Self {
        self.children.extend(children);
        self
    }

    /// Writes an XML file whose root is this element.
    ///
    /// # Errors
    /// [`WriteError::Io`] or [`WriteError::DiskFull`]. After an error, no file appears under the name.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let mut file = OutFile::create(path)?;
        let mut xml = Writer::new_with_indent(&mut file, b' ', 2);
        let failed = |source| WriteError::Io { doing: "write", source, path: path.to_path_buf() };
        xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None))).map_err(failed)?;
        self.write_into(&mut xml).map_err(failed)?;
        file.write_bytes(b"\n")?;
        file.finish()
    }

    fn write_into(&self, xml: &mut Writer<&mut OutFile>) -> std::io::Result<()> {
        let attributes = self.attributes.iter().map(|(name, value)| (*name, value.as_str()));
        let start = xml.create_element(self.name).with_attributes(attributes);
        if !self.text.is_empty() {
            return start.write_text_content(BytesText::new(&self.text)).map(|_| ());
        }
        if self.children.is_empty() {
            return start.write_empty().map(|_| ());
        }
        start.write_inner_content(|xml| self.children.iter().try_for_each(|c| c.write_into(xml))).map(|_| ())
    }
}

/// Formats a number with `decimals` decimals. −0 becomes 0.
#[must_use]
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.starts_with('-') && text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.'));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_zero_has_no_sign() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.xml");
        let root =
            Element::new("a").with("name", "x<\"&").holding([Element::new("b"), Element::text("c", "1 < 2")]);
        root.write(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.ends_with("<a name=\"x&lt;&quot;&amp;\">\n  <b/>\n  <c>1 &lt; 2</c>\n</a>\n"), "{text}");
        assert_eq!((fixed(-0.0001, 2), fixed(-0.01, 2)), ("0.00".to_owned(), "-0.01".to_owned()));
    }
}

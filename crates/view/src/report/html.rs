//! Functions that write text to an HTML page.

use std::fmt::Write as _;

/// Appends formatted text to the page. Writing to a string cannot fail.
pub(crate) fn put(page: &mut String, text: std::fmt::Arguments<'_>) {
    let _infallible = page.write_fmt(text);
}

/// Replaces the special characters of HTML in a text by entities.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

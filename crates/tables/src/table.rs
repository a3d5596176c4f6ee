//! Tables as aligned text, CSV and HTML.

use crate::html::escape;
use crate::{Estimate, TableError};

/// A table of results.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Title of the table.
    pub title: String,
    /// Note below the table, such as the source of the numbers. It may be empty.
    pub note: String,
    /// Columns. The first column contains the names of the rows.
    pub columns: Vec<Column>,
    /// Rows. Missing cells at the end of a row are empty.
    pub rows: Vec<Vec<Cell>>,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Title of the column, with the unit.
    pub title: String,
    /// Number of decimals that are printed in the column.
    pub decimals: usize,
}

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Text.
    Text(String),
    /// A number, with its confidence interval if it has one.
    Number(Estimate),
}

impl Column {
    /// Creates a column from its title and its number of decimals.
    #[must_use]
    pub fn new(title: impl Into<String>, decimals: usize) -> Self {
        Self { title: title.into(), decimals }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<Estimate> for Cell {
    fn from(estimate: Estimate) -> Self {
        Self::Number(estimate)
    }
}

impl From<f64> for Cell {
    /// Creates a cell with a number that has no confidence interval.
    fn from(value: f64) -> Self {
        Self::Number(Estimate { value, low: f64::NAN, high: f64::NAN, n: 1 })
    }
}

impl Cell {
    /// Returns the cell as text, such as `78.0 [75.1, 80.9]`. An infinite number is `∞`, and NaN is `–`.
    fn text(&self, decimals: usize) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(Estimate { value, low, high, .. }) if low.is_finite() || high.is_finite() => {
                let [value, low, high] = [value, low, high].map(|v| number(*v, decimals));
                format!("{value} [{low}, {high}]")
            }
            Self::Number(estimate) => number(estimate.value, decimals),
        }
    }
}

fn number(value: f64, decimals: usize) -> String {
    if value.is_nan() {
        "–".to_owned()
    } else if value.is_infinite() {
        "∞".to_owned()
    } else {
        // A number that is rounded to zero has no minus sign.
        let text = format!("{value:.decimals$}");
        if text.trim_start_matches(['-', '0', '.']).is_empty() {
            text.trim_start_matches('-').to_owned()
        } else {
            text
        }
    }
}

impl Table {
    /// Creates a table without rows.
    #[must_use]
    pub fn new(title: impl Into<String>, note: impl Into<String>, columns: Vec<Column>) -> Self {
        Self { title: title.into(), note: note.into(), columns, rows: Vec::new() }
    }

    fn texts(&self) -> Vec<Vec<String>> {
        let cells = |row: &Vec<Cell>| {
            let text =
                |(i, column): (usize, &Column)| row.get(i).map_or(String::new(), |c| c.text(column.decimals));
            self.columns.iter().enumerate().map(text).collect()
        };
        self.rows.iter().map(cells).collect()
    }

    /// Returns the table as aligned text. The text ends with a line break.
    #[must_use]
    pub fn to_text(&self) -> String {
        let heads: Vec<String> = self.columns.iter().map(|c| c.title.clone()).collect();
        let rows = self.texts();
        let mut widths: Vec<usize> = heads.iter().map(|h| h.chars().count()).collect();
        for row in &rows {
            for (width, text) in widths.iter_mut().zip(row) {
                *width = (*width).max(text.chars().count());
            }
        }
        let line = |texts: &[String]| {
            let pad = |i: usize| " ".repeat(widths[i].saturating_sub(texts[i].chars().count()));
            let cell = |i: usize| if i == 0 { texts[i].clone() + &pad(i) } else { pad(i) + &texts[i] };
            (0..texts.len()).map(cell).collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
        };
        let mut page = format!("{}\n", self.title);
        page.push_str(&line(&heads));
        page.push_str(
            &("─".repeat(widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1)) + "\n"),
        );
        for row in &rows {
            page.push_str(&line(row));
        }
        if !self.note.is_empty() {
            page.push_str(&format!("{}\n", self.note));
        }
        page
    }

    /// Returns the table as CSV, with all digits. NaN is an empty field.
    ///
    /// Three more columns follow each column `TITLE` with numbers: `TITLE low` and `TITLE high` for the confidence
    /// interval, and `TITLE n` for the number of values.
    ///
    /// # Errors
    /// Returns [`TableError::Csv`] if the CSV writer fails.
    pub fn to_csv(&self) -> Result<String, TableError> {
        let is_number = |i: usize| self.rows.iter().any(|row| matches!(row.get(i), Some(Cell::Number(_))));
        let mut writer = csv::Writer::from_writer(Vec::new());
        let mut head = Vec::new();
        for (i, column) in self.columns.iter().enumerate() {
            head.push(column.title.clone());
            if is_number(i) {
                head.extend(["low", "high", "n"].map(|part| format!("{} {part}", column.title)));
            }
        }
        writer.write_record(&head)?;
        for row in &self.rows {
            let mut fields = Vec::new();
            for i in 0..self.columns.len() {
                let empty = if is_number(i) { 4 } else { 1 };
                match row.get(i) {
                    Some(Cell::Number(e)) => {
                        let digits = |v: f64| if v.is_nan() { String::new() } else { v.to_string() };
                        fields.extend([e.value, e.low, e.high].map(digits));
                        fields.push(e.n.to_string());
                    }
                    Some(Cell::Text(text)) => {
                        fields.push(text.clone());
                        fields.extend(std::iter::repeat_n(String::new(), empty - 1));
                    }
                    None => fields.extend(std::iter::repeat_n(String::new(), empty)),
                }
            }
            writer.write_record(&fields)?;
        }
        let bytes = writer.into_inner().map_err(|e| csv::Error::from(e.into_error()))?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Returns the table as a part of an HTML page.
    #[must_use]
    pub fn to_html(&self) -> String {
        let mut page = format!("<h2>{}</h2>\n<div class=\"scroll\"><table><thead><tr>", escape(&self.title));
        for column in &self.columns {
            page.push_str(&format!("<th>{}</th>", escape(&column.title)));
        }
        page.push_str("</tr></thead>\n");
        for row in self.texts() {
            page.push_str("<tr>");
            for (i, text) in row.iter().enumerate() {
                let tag = if i == 0 { "th" } else { "td" };
                // The interval is in a smaller font, so that readers can compare the numbers down a column.
                let text = escape(text).replacen(" [", " <small>[", 1);
                let end = if text.contains("<small>") { "</small>" } else { "" };
                page.push_str(&format!("<{tag}>{text}{end}</{tag}>"));
            }
            page.push_str("</tr>\n");
        }
        page.push_str("</table></div>\n");
        if !self.note.is_empty() {
            page.push_str(&format!("<p class=\"hint\">{}</p>\n", escape(&self.note)));
        }
        page
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new(
            "ADD",
            "a < b",
            vec![Column::new("system", 0), Column::new("0.4, %", 1), Column::new("note", 0)],
        );
        let estimate = Estimate { value: 77.99, low: 75.0, high: 80.04, n: 12 };
        table.rows.push(vec!["ours, \"plane\"".into(), estimate.into(), "x".into()]);
        table.rows.push(vec!["none".into(), f64::NAN.into()]);
        table.rows.push(vec!["zero".into(), (-0.01).into()]);
        table
    }

    #[test]
    fn text_is_aligned() {
        let text = table().to_text();
        let expected = "ADD\n\
            system                    0.4, %  note\n\
            ──────────────────────────────────────\n\
            ours, \"plane\"  78.0 [75.0, 80.0]     x\n\
            none                           –\n\
            zero                         0.0\n\
            a < b\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn csv_has_columns_for_the_interval() {
        let csv = table().to_csv().unwrap();
        let expected = "system,\"0.4, %\",\"0.4, % low\",\"0.4, % high\",\"0.4, % n\",note\n\
            \"ours, \"\"plane\"\"\",77.99,75,80.04,12,x\nnone,,,,1,\nzero,-0.01,,,1,\n";
        assert_eq!(csv, expected);
    }

    #[test]
    fn html_is_escaped() {
        let html = table().to_html();
        assert!(html.contains("a &lt; b") && html.contains("<th>ours, &quot;plane&quot;</th>"));
        assert!(html.contains("<td>78.0 <small>[75.0, 80.0]</small></td>"));
    }
}

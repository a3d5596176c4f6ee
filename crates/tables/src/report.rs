//! A report of tables, plots and pictures as text, CSV files and one HTML page.

use std::path::Path;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use roadplane_write::{OutFile, WriteError};

use crate::html::escape;
use crate::{Plot, Table, TableError};

/// JPEG quality of pictures, 0 to 100.
const QUALITY: u8 = 85;

/// The report of an evaluation: tables, plots and pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Title of the report.
    pub title: String,
    /// Tables, in the order of the report.
    pub tables: Vec<Table>,
    /// Plots, in the order of the report.
    pub plots: Vec<Plot>,
    /// Pictures, in the order of the report.
    pub pictures: Vec<Picture>,
}

/// A picture with a caption.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Caption of the picture.
    pub caption: String,
    /// Content of the JPEG file.
    pub jpeg: Vec<u8>,
}

impl Picture {
    /// Compresses a picture as JPEG and adds a caption.
    ///
    /// # Errors
    /// Returns [`TableError::Picture`] if the picture cannot be compressed.
    pub fn new(caption: String, picture: &RgbImage) -> Result<Self, TableError> {
        let mut jpeg = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
        picture.write_with_encoder(encoder)?;
        Ok(Self { caption, jpeg })
    }

    fn to_html(&self) -> String {
        let (caption, data) = (escape(&self.caption), STANDARD.encode(&self.jpeg));
        format!(
            "<figure><img alt=\"{caption}\" src=\"data:image/jpeg;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
        )
    }
}

impl Report {
    /// Returns all tables as aligned text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let tables: Vec<String> = self.tables.iter().map(Table::to_text).collect();
        tables.join("\n")
    }

    /// Returns the report as one self-contained HTML page.
    #[must_use]
    pub fn to_html(&self) -> String {
        let mut page = format!(
            "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\n\
             <title>{0}</title>\n<style>{STYLE}</style>\n<main>\n<h1>{0}</h1>\n",
            escape(&self.title)
        );
        for table in &self.tables {
            page.push_str(&table.to_html());
        }
        let plots: String = self.plots.iter().map(Plot::to_svg).collect();
        if !plots.is_empty() {
            page.push_str(&format!("<h2>Plots</h2>\n<div class=\"plots\">\n{plots}</div>\n"));
        }
        if !self.pictures.is_empty() {
            page.push_str("<h2>Pictures</h2>\n");
            page.extend(self.pictures.iter().map(Picture::to_html));
        }
        page.push_str("</main></html>\n");
        page
    }

    /// Writes `report.html`, `tables.txt` and one CSV file per table (`01-title.csv`). The function creates the folder
    /// if needed.
    ///
    /// # Errors
    /// Returns [`TableError::Write`] if the folder or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), TableError> {
        std::fs::create_dir_all(folder).map_err(|source| WriteError::Io {
            doing: "create the folder",
            source,
            path: folder.to_path_buf(),
        })?;
        for (i, table) in self.tables.iter().enumerate() {
            let name = format!("{:02}-{}.csv", i + 1, file_name(&table.title));
            write_text(&folder.join(name), &table.to_csv()?)?;
        }
        write_text(&folder.join("tables.txt"), &self.to_text())?;
        write_text(&folder.join("report.html"), &self.to_html())
    }
}

fn write_text(path: &Path, text: &str) -> Result<(), TableError> {
    let mut file = OutFile::create(path)?;
    file.write_bytes(text.as_bytes())?;
    Ok(file.finish()?)
}

/// Returns the first six words of a title in lower case, joined by hyphens.
fn file_name(title: &str) -> String {
    let words = title.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.take(6).collect::<Vec<_>>().join("-").to_ascii_lowercase()
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:0;background:#f5f6f7;color:#1c2126}\
main{max-width:1120px;margin:0 auto;padding:24px}h1{font-size:24px}h2{font-size:18px;margin-top:32px}\
table{border-collapse:collapse;background:#fff}td,th{padding:4px 10px;border-bottom:1px solid #e3e6e9;text-align:right;\
font-variant-numeric:tabular-nums;white-space:nowrap}th{text-align:left;font-weight:600}thead th{text-align:right;\
white-space:normal;vertical-align:bottom}thead th:first-child{text-align:left}small{color:#66707a;font-size:11px}\
.hint{color:#66707a;font-size:13px;max-width:760px}.scroll{overflow-x:auto}.plots{display:flex;flex-wrap:wrap;gap:16px}\
.plot,img{max-width:100%;height:auto;border-radius:6px}figure{margin:12px 0}figcaption{color:#66707a;font-size:13px}";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Column, Mark};

    #[test]
    fn a_folder_contains_page_text_and_tables() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = Table::new("Camera, 1 still", "", vec![Column::new("what", 0), Column::new("x", 1)]);
        table.rows.push(vec!["focal".into(), 1.25.into()]);
        let plot = Plot::new("ADD", "d", "%").with("ours", Mark::Line, vec![(0.0, 1.0), (1.0, 2.0)]);
        let report = Report {
            title: "lot".to_owned(),
            tables: vec![table.clone(), table],
            plots: vec![plot],
            ..Report::default()
        };
        let out = folder.path().join("new/report");
        report.write(&out).unwrap();
        let csv = std::fs::read_to_string(out.join("02-camera-1-still.csv")).unwrap();
        assert_eq!(csv, "what,x,x low,x high,x n\nfocal,1.25,,,1\n");
        let page = std::fs::read_to_string(out.join("report.html")).unwrap();
        assert!(page.contains("<svg") && page.matches("<table").count() == 2 && !page.contains("src="));
        assert_eq!(std::fs::read_to_string(out.join("tables.txt")).unwrap(), report.to_text());
        let picture = Picture::new("a < b".to_owned(), &RgbImage::new(8, 8)).unwrap();
        let page = Report { pictures: vec![picture], ..report }.to_html();
        assert!(
            page.contains("<figcaption>a &lt; b</figcaption>")
                && page.contains("data:image/jpeg;base64,/9j/")
        );
    }
}

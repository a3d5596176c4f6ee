//! Tables and plots of numbers with confidence intervals, as text, CSV files and one HTML page.
//!
//! # Contents
//! ```text
//! statistics.rs   mean, median, quantile, share within a limit: NaN without values; infinite values are allowed
//! bootstrap.rs    a statistic with its 95 % confidence interval over scenes → Estimate
//! table.rs        Table of Cells: aligned text, CSV, HTML
//! plot.rs         Plot: curves and dots as SVG
//! report.rs       Report: tables, plots and pictures → report.html, tables.txt, one CSV file per table
//! ```
//!
//! # Example
//! ```
//! use roadplane_tables::{Column, Report, Table, bootstrap, median};
//!
//! // Errors of two cars in one scene and of one car in another scene. Errors within a scene are correlated, so whole
//! // scenes are resampled.
//! let scenes = [vec![0.2, 0.3], vec![0.5]];
//! let mut table = Table::new("Position", "", vec![Column::new("system", 0), Column::new("median error, m", 2)]);
//! table.rows.push(vec!["ours".into(), bootstrap(&scenes, median).into()]);
//! let report = Report { title: "Two scenes".to_owned(), tables: vec![table], ..Report::default() };
//! assert!(report.to_text().contains("ours"));
//! ```

mod bootstrap;
mod error;
mod html;
mod plot;
mod report;
mod statistics;
mod table;

pub use bootstrap::{Estimate, bootstrap, bootstrap_scenes};
pub use error::TableError;
pub use plot::{Mark, Plot, Series};
pub use report::{Picture, Report};
pub use statistics::{SD_FROM_MEDIAN, mean, median, quantile, share_within};
pub use table::{Cell, Column, Table};

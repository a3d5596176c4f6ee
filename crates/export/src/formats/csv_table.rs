//! Writing of CSV files with a header.

use std::path::Path;

use roadplane_write::{OutFile, WriteError};

/// Writes a CSV file with a header. Each row has as many cells as the header.
pub fn write_table<const N: usize>(
    path: &Path,
    header: &[&str; N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> Result<(), WriteError> {
    let failed = WriteError::csv("write", path);
    let mut writer = csv::Writer::from_writer(OutFile::create(path)?);
    writer.write_record(header).map_err(&failed)?;
    for row in rows {
        writer.write_record(&row).map_err(&failed)?;
    }
    let unwritten = |error: csv::IntoInnerError<csv::Writer<OutFile>>| WriteError::Io {
        doing: "write",
        source: error.into_error(),
        path: path.to_path_buf(),
    };
    writer.into_inner().map_err(unwritten)?.finish()
}

//! TableRows of cells of a text file or a spreadsheet.

use std::io::{Cursor, Read};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use calamine::{Data, Reader, open_workbook_auto_from_rs};
use paig::support::storage;

/// Most bytes of a file, and most rows.
const MOST_BYTES: u64 = 1 << 26;
const MOST_ROWS: usize = 1 << 20;

/// TableRows of a table, the header first.
pub(super) type TableRows = Vec<Vec<String>>;

/// TableRows of a text whose cells are separated by commas, semicolons or tabs.
pub(super) fn of_text(path: &Path) -> Result<TableRows> {
    let bytes = bytes(path)?;
    let first = bytes.split(|byte| *byte == b'\n').find(|line| !line.trim_ascii().is_empty()).unwrap_or_default();
    let count = |separator: u8| first.iter().filter(|byte| **byte == separator).count();
    let separator = [b';', b'\t', b','].into_iter().max_by_key(|separator| count(*separator)).unwrap_or(b',');
    let mut reader =
        csv::ReaderBuilder::new().delimiter(separator).has_headers(false).flexible(true).from_reader(&bytes[..]);
    let mut rows = TableRows::new();
    for record in reader.byte_records() {
        let record = record.context("not a readable table")?;
        rows.push(record.iter().map(|cell| String::from_utf8_lossy(cell).trim().to_string()).collect());
        ensure!(rows.len() <= MOST_ROWS, "more than {MOST_ROWS} rows");
    }
    Ok(rows)
}

/// TableRows of the first sheet of a spreadsheet.
pub(super) fn of_spreadsheet(path: &Path) -> Result<TableRows> {
    let mut book = open_workbook_auto_from_rs(Cursor::new(bytes(path)?)).context("not a readable spreadsheet")?;
    let sheet = book.worksheet_range_at(0).context("no sheet in it")?.context("its first sheet cannot be read")?;
    ensure!(sheet.height() <= MOST_ROWS, "more than {MOST_ROWS} rows");
    let cell = |cell: &Data| match cell {
        Data::Empty | Data::Error(_) => String::new(),
        other => other.to_string().trim().to_string(),
    };
    Ok(sheet.rows().map(|row| row.iter().map(cell).collect()).collect())
}

fn bytes(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    storage::open(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    ensure!(bytes.len() as u64 <= MOST_BYTES, "more than {} MiB", MOST_BYTES >> 20);
    Ok(bytes)
}

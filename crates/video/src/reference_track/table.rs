//! TableRows of cells of a text file or a spreadsheet.

use std::io::{self, Cursor, Read};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use calamine::{Data, Reader, Sheets, Xlsx, open_workbook_auto_from_rs};
use paig::support::storage;
use zip::ZipArchive;

/// Most bytes of a file, and most rows and columns: those of a spreadsheet.
const MOST_BYTES: u64 = 1 << 26;
const MOST_ROWS: usize = 1 << 20;
const MOST_COLUMNS: usize = 1 << 14;
/// Most bytes of a spreadsheet without its compression.
const MOST_UNPACKED: u64 = 1 << 28;
/// Most cells of a sheet, with the empty ones between.
const MOST_CELLS: u64 = 1 << 22;

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
        ensure!(record.len() <= MOST_COLUMNS, "more than {MOST_COLUMNS} columns");
        rows.push(record.iter().map(|cell| String::from_utf8_lossy(cell).trim().to_string()).collect());
        ensure!(rows.len() <= MOST_ROWS, "more than {MOST_ROWS} rows");
    }
    Ok(rows)
}

/// TableRows of the first sheet of a spreadsheet.
pub(super) fn of_spreadsheet(path: &Path) -> Result<TableRows> {
    let bytes = bytes(path)?;
    check_unpacked(&bytes, MOST_UNPACKED)?;
    let mut book = open_workbook_auto_from_rs(Cursor::new(bytes)).context("not a readable spreadsheet")?;
    match &mut book {
        Sheets::Xlsx(book) => check_cells(book)?,
        Sheets::Xlsb(_) => bail!("a binary workbook; save it as .xlsx or .csv"),
        // Their sheets have at most 2^24 and 10^8 cells.
        Sheets::Xls(_) | Sheets::Ods(_) => {}
    }
    let sheet = book.worksheet_range_at(0).context("no sheet in it")?.context("its first sheet cannot be read")?;
    ensure!(sheet.height() <= MOST_ROWS, "more than {MOST_ROWS} rows");
    let cell = |cell: &Data| match cell {
        Data::Empty | Data::Error(_) => String::new(),
        other => other.to_string().trim().to_string(),
    };
    Ok(sheet.rows().map(|row| row.iter().map(cell).collect()).collect())
}

/// Refuses an archive whose parts are too large once unpacked, whatever sizes it states.
fn check_unpacked(bytes: &[u8], most: u64) -> Result<()> {
    // The older format is none.
    let Ok(mut archive) = ZipArchive::new(Cursor::new(bytes)) else { return Ok(()) };
    let mut left = most;
    for number in 0..archive.len() {
        let part = archive.by_index(number).context("not a readable spreadsheet")?;
        left -= io::copy(&mut part.take(left), &mut io::sink())?;
        ensure!(left > 0, "more than {most} bytes without its compression");
    }
    Ok(())
}

/// Refuses a sheet with cells so far apart that those between would fill the memory.
fn check_cells(book: &mut Xlsx<Cursor<Vec<u8>>>) -> Result<()> {
    let name = book.sheet_names().into_iter().next().context("no sheet in it")?;
    let mut cells = book.worksheet_cells_reader(&name).context("its first sheet cannot be read")?;
    let (mut first, mut last) = ([u32::MAX; 2], [0; 2]);
    while let Some(cell) = cells.next_cell().context("its first sheet cannot be read")? {
        let (row, column) = cell.get_position();
        first = [first[0].min(row), first[1].min(column)];
        last = [last[0].max(row), last[1].max(column)];
        let [rows, columns] = [0, 1].map(|axis| u64::from(last[axis] - first[axis]) + 1);
        ensure!(
            rows * columns <= MOST_CELLS,
            "its first sheet has {rows} x {columns} cells; at most {MOST_CELLS} are read"
        );
    }
    Ok(())
}

fn bytes(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    storage::open(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    ensure!(bytes.len() as u64 <= MOST_BYTES, "more than {} MiB", MOST_BYTES >> 20);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    use super::*;

    /// A workbook with this text in its sheet's `sheetData`, and a part of so many zeros.
    fn workbook(cells: &str, zeros: usize) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut archive = ZipWriter::new(file.reopen().unwrap());
        let office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
        let main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main";
        let package = "http://schemas.openxmlformats.org/package/2006/relationships";
        let sheets = r#"<sheets><sheet name="a" sheetId="1" r:id="r1"/></sheets>"#;
        let relations = |kind: &str, target: &str| {
            let relation = format!(r#"<Relationship Id="r1" Type="{office}/{kind}" Target="{target}"/>"#);
            format!(r#"<Relationships xmlns="{package}">{relation}</Relationships>"#)
        };
        let sheet = format!(r#"<worksheet xmlns="{main}"><sheetData>{cells}</sheetData></worksheet>"#);
        for (name, text) in [
            ("_rels/.rels", relations("officeDocument", "xl/workbook.xml")),
            ("xl/workbook.xml", format!(r#"<workbook xmlns="{main}" xmlns:r="{office}">{sheets}</workbook>"#)),
            ("xl/_rels/workbook.xml.rels", relations("worksheet", "worksheets/sheet1.xml")),
            ("xl/worksheets/sheet1.xml", sheet),
        ] {
            archive.start_file(name, SimpleFileOptions::default()).unwrap();
            archive.write_all(text.as_bytes()).unwrap();
        }
        archive.start_file("xl/media/zeros", SimpleFileOptions::default()).unwrap();
        io::copy(&mut io::repeat(0).take(zeros as u64), &mut archive).unwrap();
        archive.finish().unwrap();
        file
    }

    #[test]
    fn a_table_of_too_many_columns_is_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "x,".repeat(MOST_COLUMNS)).unwrap();
        assert_eq!(of_text(file.path()).unwrap_err().to_string(), "more than 16384 columns");
    }

    /// The second one would need 400 GB for the empty cells.
    #[test]
    fn a_sheet_is_read_and_one_with_cells_far_apart_is_refused() {
        let read = |last: &str| {
            let number = |place: &str, value: f64| format!(r#"<c r="{place}"><v>{value}</v></c>"#);
            let row = last.trim_start_matches(|c: char| c.is_ascii_alphabetic());
            let cells = format!(r#"<row r="1">{}</row><row r="{row}">{}</row>"#, number("A1", 0.5), number(last, 2.0));
            of_spreadsheet(workbook(&cells, 0).path())
        };
        assert_eq!(read("B2").unwrap(), [["0.5", ""], ["", "2"]]);
        let refusal = format!("{:#}", read("XFD1048576").unwrap_err());
        assert!(refusal.contains("1048576 x 16384 cells"), "{refusal}");
    }

    #[test]
    fn an_archive_that_unpacks_to_more_than_the_limit_is_refused() {
        let packed = std::fs::read(workbook("", 1 << 20).path()).unwrap();
        assert!(packed.len() < 1 << 14);
        check_unpacked(&packed, (1 << 20) + (1 << 12)).unwrap();
        assert!(check_unpacked(&packed, 1 << 20).unwrap_err().to_string().contains("more than 1048576 bytes"));
    }
}

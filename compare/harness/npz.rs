//! Reads `.npz` archives of little-endian numbers and of text, strictly.
//!
//! NumPy's text arrays (`<U28`: fixed-width UTF-32) are what `ndarray-npy` cannot read, so the small `.npy` format is
//! parsed here: magic, version, a header that is a Python dictionary with `descr`, `fortran_order` and `shape`, data.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

/// One array, in row-major order.
#[derive(Debug)]
pub struct NpzArray {
    pub shape: Vec<usize>,
    pub values: ArrayValues,
}

#[derive(Debug)]
pub enum ArrayValues {
    /// `<f4` or `<f8`; a float32 is exact as f64.
    Floats(Vec<f64>),
    /// `<i4` or `<i8`.
    Integers(Vec<i64>),
    /// `<U..`.
    Texts(Vec<String>),
}

/// All arrays of an archive by name, without the `.npy`.
///
/// # Errors
/// A file that is not a whole archive, or an entry that is not a whole array of one of the types above. The message
/// names the entry.
pub fn read(path: &Path) -> Result<BTreeMap<String, NpzArray>> {
    let file = File::open(path).context("cannot be opened")?;
    let mut archive = zip::ZipArchive::new(file).context("not a whole .npz archive (cut short?)")?;
    let mut arrays = BTreeMap::new();
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index).with_context(|| format!("entry {index} of the archive is damaged"))?;
        let entry_name = entry.name().to_string();
        let name = entry_name.strip_suffix(".npy").with_context(|| format!("entry {entry_name:?} is no array"))?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).with_context(|| format!("tensor {name}: data damaged or cut short"))?;
        let array = parse(&bytes).with_context(|| format!("tensor {name}"))?;
        arrays.insert(name.to_string(), array);
    }
    Ok(arrays)
}

/// Parses the bytes of one `.npy` file.
fn parse(bytes: &[u8]) -> Result<NpzArray> {
    let (header, data) = split_header(bytes)?;
    let descr = dictionary_value(header, "descr")?;
    let descr = descr.trim().trim_matches('\'');
    ensure!(dictionary_value(header, "fortran_order")?.trim() == "False", "not in row-major order");
    let shape = parse_shape(dictionary_value(header, "shape")?)?;
    let count = shape
        .iter()
        .try_fold(1usize, |count, &n| count.checked_mul(n))
        .with_context(|| format!("shape {shape:?} is too large"))?;
    let values = match descr {
        "<f4" => ArrayValues::Floats(numbers(data, count, |b| f64::from(f32::from_le_bytes(b)))?),
        "<f8" => ArrayValues::Floats(numbers(data, count, f64::from_le_bytes)?),
        "<i4" => ArrayValues::Integers(numbers(data, count, |b| i64::from(i32::from_le_bytes(b)))?),
        "<i8" => ArrayValues::Integers(numbers(data, count, i64::from_le_bytes)?),
        _ => match descr.strip_prefix("<U").and_then(|width| width.parse().ok()) {
            Some(width) => ArrayValues::Texts(texts(data, count, width)?),
            None => bail!("type {descr:?} is none of <f4, <f8, <i4, <i8, <U.."),
        },
    };
    Ok(NpzArray { shape, values })
}

/// Magic, version and header length off; gives the header's text and the data.
fn split_header(bytes: &[u8]) -> Result<(&str, &[u8])> {
    let body = bytes.strip_prefix(b"\x93NUMPY").context("no .npy magic")?;
    let (length, rest) = match body {
        [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
        _ => bail!("unknown .npy version or no header"),
    };
    let (header, data) = rest.split_at_checked(length).context("header cut short")?;
    Ok((std::str::from_utf8(header).context("header is not text")?, data))
}

/// What stands between `'key':` and the comma after it (or, for a tuple, its closing parenthesis).
fn dictionary_value<'a>(header: &'a str, key: &str) -> Result<&'a str> {
    let quoted = format!("'{key}':");
    let (_, value) = header.split_once(&quoted).with_context(|| format!("header has no {key:?}"))?;
    let value = value.trim_start();
    let end = if value.starts_with('(') { value.find(')').map(|at| at + 1) } else { value.find([',', '}']) };
    Ok(&value[..end.with_context(|| format!("header's {key:?} does not end"))?])
}

/// `()`, `(3,)`, `(3, 4)`.
fn parse_shape(tuple: &str) -> Result<Vec<usize>> {
    let inside = tuple
        .strip_prefix('(')
        .and_then(|rest| rest.strip_suffix(')'))
        .with_context(|| format!("shape {tuple:?} is no tuple"))?;
    let parts = inside.split(',').map(str::trim).filter(|part| !part.is_empty());
    parts.map(|part| part.parse().with_context(|| format!("shape {tuple:?}"))).collect()
}

fn numbers<const N: usize, T>(data: &[u8], count: usize, read: impl Fn([u8; N]) -> T) -> Result<Vec<T>> {
    let (chunks, rest) = data.as_chunks::<N>();
    ensure!(
        chunks.len() == count && rest.is_empty(),
        "{} bytes of data for {count} values of {N} bytes: cut short or of another shape",
        data.len()
    );
    Ok(chunks.iter().map(|chunk| read(*chunk)).collect())
}

fn texts(data: &[u8], count: usize, width: usize) -> Result<Vec<String>> {
    let total = count.checked_mul(width).context("the text array is too large")?;
    let points = numbers(data, total, u32::from_le_bytes)?;
    if width == 0 {
        return Ok(vec![String::new(); count]);
    }
    let text = |points: &[u32]| {
        // Shorter texts are padded with zeros.
        let used = points.iter().rposition(|&point| point != 0).map_or(0, |last| last + 1);
        points[..used].iter().map(|&point| char::from_u32(point).context("not a Unicode character")).collect()
    };
    points.chunks(width).map(text).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn reads_text_and_scalars() {
        let data: Vec<u8> = "abc".chars().chain("d\0\0".chars()).flat_map(|c| (c as u32).to_le_bytes()).collect();
        let array = parse(&npy("{'descr': '<U3', 'fortran_order': False, 'shape': (2,), }\n", &data)).unwrap();
        assert_eq!(array.shape, [2]);
        assert!(matches!(array.values, ArrayValues::Texts(texts) if texts == ["abc", "d"]));
        let array =
            parse(&npy("{'descr': '<i8', 'fortran_order': False, 'shape': (), }", &7i64.to_le_bytes())).unwrap();
        assert!(array.shape.is_empty());
        assert!(matches!(array.values, ArrayValues::Integers(values) if values == [7]));
    }

    #[test]
    fn refuses_what_it_does_not_know() {
        let header = |descr: &str, order: &str, shape: &str| {
            format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}")
        };
        let data = 1f32.to_le_bytes();
        assert!(parse(&npy(&header("<f4", "False", "(1,)"), &data)).is_ok());
        assert!(parse(&npy(&header("<f4", "True", "(1,)"), &data)).is_err());
        assert!(parse(&npy(&header(">f4", "False", "(1,)"), &data)).is_err());
        assert!(parse(&npy(&header("<f4", "False", "(2,)"), &data)).is_err());
        assert!(parse(&npy(&header("<f4", "False", "1"), &data)).is_err());
        assert!(parse(&npy(&header("<f4", "False", "(18446744073709551615, 9)"), &data)).is_err());
        assert!(parse(b"\x93NUMPY\x01\x00\xff\xff{").is_err());
        assert!(parse(b"PK").is_err());
    }
}

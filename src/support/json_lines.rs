//! JSON with a line for each row: small, and a change of one row changes one line.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::ser::{Formatter, Serializer};

/// Writes a value as JSON. Lists and objects down to `levels` have a line for each of their elements, deeper ones stand on
/// their element's line.
///
/// # Errors
/// A writer that fails, a value that JSON cannot hold.
pub fn write(writer: impl Write, value: &impl Serialize, levels: usize) -> serde_json::Result<()> {
    value.serialize(&mut Serializer::with_formatter(writer, Lines { levels, depth: 0 }))
}

struct Lines {
    levels: usize,
    /// Of the list or object that is being written.
    depth: usize,
}

impl Lines {
    fn open<W: ?Sized + Write>(&mut self, writer: &mut W, bracket: &str) -> io::Result<()> {
        self.depth += 1;
        writer.write_all(bracket.as_bytes())
    }

    fn element<W: ?Sized + Write>(&self, writer: &mut W, first: bool) -> io::Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        self.end_line(writer)
    }

    fn end_line<W: ?Sized + Write>(&self, writer: &mut W) -> io::Result<()> {
        if self.depth <= self.levels { writer.write_all(b"\n") } else { Ok(()) }
    }

    fn close<W: ?Sized + Write>(&mut self, writer: &mut W, bracket: &str) -> io::Result<()> {
        self.end_line(writer)?;
        self.depth -= 1;
        writer.write_all(bracket.as_bytes())
    }
}

impl Formatter for Lines {
    fn begin_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open(writer, "[")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.element(writer, first)
    }

    fn end_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, "]")
    }

    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open(writer, "{")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.element(writer, first)
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, "}")
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::write;

    #[test]
    fn every_row_has_a_line_and_every_value_comes_back() {
        let value = json!({"format": 1, "rows": [{"a": [1.5, 2], "b": {}}, {"a": [], "b": {"c": "x,\n[y]"}}]});
        let text = |levels: usize| {
            let mut bytes = Vec::new();
            write(&mut bytes, &value, levels).unwrap();
            assert_eq!(serde_json::from_slice::<Value>(&bytes).unwrap(), value);
            String::from_utf8(bytes).unwrap()
        };
        let rows = "[\n{\"a\":[1.5,2],\"b\":{}},\n{\"a\":[],\"b\":{\"c\":\"x,\\n[y]\"}}\n]";
        assert_eq!(text(2), format!("{{\n\"format\":1,\n\"rows\":{rows}\n}}"));
        assert_eq!(text(0), serde_json::to_string(&value).unwrap());
    }
}

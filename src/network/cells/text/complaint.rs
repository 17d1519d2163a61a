//! What is wrong with a text, and where.

use std::ops::Range;

/// A place in a text, in bytes.
pub(super) type TextSpan = Range<usize>;

/// What is wrong at a place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Complaint {
    pub at: TextSpan,
    pub what: String,
    /// Name and text of the definition in which the place is; none of the acceleration itself.
    pub definition: Option<(String, String)>,
}

impl Complaint {
    pub(super) fn new(at: &TextSpan, what: impl Into<String>) -> Self {
        Complaint { at: at.clone(), what: what.into(), definition: None }
    }

    /// The same about a place in a definition, if it is not about one inside of that.
    pub(super) fn within(mut self, name: &str, text: &str) -> Self {
        self.definition.get_or_insert_with(|| (name.into(), text.into()));
        self
    }

    /// The complaint with its line and column in `text`, and the line itself with a mark under the place.
    pub(super) fn shown(&self, text: &str) -> String {
        match &self.definition {
            Some((name, text)) => format!("where {name}, {}", self.marked(text)),
            None => self.marked(text),
        }
    }

    fn marked(&self, text: &str) -> String {
        let before = text.get(..self.at.start).unwrap_or(text);
        let begins = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = text[begins..].lines().next().unwrap_or_default();
        let column = before[begins..].chars().count();
        let rest = line.chars().count() - column.min(line.chars().count());
        let width = text.get(self.at.clone()).map_or(1, |marked| marked.trim_end().chars().count()).min(rest).max(1);
        let place = match before.matches('\n').count() {
            0 => format!("column {}", column + 1),
            lines => format!("line {}, column {}", lines + 1, column + 1),
        };
        // Tabs stay tabs, so that the mark stands where it should.
        let blank: String = line.chars().take(column).map(|c| if c == '\t' { c } else { ' ' }).collect();
        format!("{place}: {}\n  {line}\n  {blank}{}", self.what, "^".repeat(width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_complaint_shows_its_place() {
        let shown = |at: TextSpan, text: &str| Complaint::new(&at, "wrong").shown(text);
        assert_eq!(shown(2..4, "a bc d"), "column 3: wrong\n  a bc d\n    ^^");
        assert_eq!(shown(6..9, "ab +\n cde"), "line 2, column 2: wrong\n   cde\n   ^^^");
        // At the end there is nothing to mark; letters of several bytes count once.
        assert_eq!(shown(3..3, "é+"), "column 3: wrong\n  é+\n    ^");
        assert_eq!(shown(0..0, ""), "column 1: wrong\n  \n  ^");
    }
}

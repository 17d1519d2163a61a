//! Sets of pixels as runs of rows.

/// Set of pixels: runs `(row, first column, end column)`, sorted by row and column.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Mask {
    runs: Vec<(u32, u32, u32)>,
}

impl Mask {
    /// Mask of the given runs in any order.
    pub(crate) fn from_runs(mut runs: Vec<(u32, u32, u32)>) -> Self {
        runs.sort_unstable();
        Self { runs }
    }

    /// Runs `(row, first column, end column)`.
    pub(crate) fn runs(&self) -> &[(u32, u32, u32)] {
        &self.runs
    }

    /// Runs of one row.
    pub(crate) fn row(&self, y: usize) -> &[(u32, u32, u32)] {
        let y = y as u32;
        let start = self.runs.partition_point(|run| run.0 < y);
        let count = self.runs[start..].partition_point(|run| run.0 == y);
        &self.runs[start..start + count]
    }

    /// Union with another mask.
    pub(crate) fn join(&mut self, other: &Self) {
        self.runs.extend_from_slice(&other.runs);
        self.runs.sort_unstable();
    }

    /// Mask widened by `margin` pixels on all sides.
    pub(crate) fn widened(&self, margin: u32) -> Self {
        let widen = |&(y, first, end): &(u32, u32, u32)| {
            (y.saturating_sub(margin)..=y + margin).map(move |row| (row, first.saturating_sub(margin), end + margin))
        };
        let mut runs: Vec<_> = self.runs.iter().flat_map(widen).collect();
        runs.sort_unstable();
        // Neighbouring rows give overlapping runs: they are merged.
        runs.dedup_by(|next, last| {
            let joins = next.0 == last.0 && next.1 <= last.2;
            if joins {
                last.2 = last.2.max(next.2);
            }
            joins
        });
        Self { runs }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widening_a_pixel_gives_a_square() {
        let square = Mask::from_runs(vec![(5, 7, 8)]).widened(2);
        assert_eq!(square.runs(), [(3, 5, 10), (4, 5, 10), (5, 5, 10), (6, 5, 10), (7, 5, 10)]);
        assert_eq!(square.row(7), [(7, 5, 10)]);
        assert!(square.row(8).is_empty());
    }

    #[test]
    fn runs_that_touch_after_widening_are_merged() {
        let mask = Mask::from_runs(vec![(2, 0, 3), (2, 5, 6)]).widened(1);
        assert!(mask.runs().iter().all(|&(_, first, end)| (first, end) == (0, 7)));
    }
}

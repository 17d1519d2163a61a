//! Columns of a table of positions, found by their headers.

use anyhow::{Context, Result, ensure};

use super::table::TableRows;
use super::{Position, ReferenceTrack, TrackedPoint, UNKNOWN};

/// Headers, without units, of the number of a frame and of a time.
const FRAMES: [&str; 6] = ["frame", "frames", "step", "image", "n", "quadro"];
const TIMES: [&str; 8] = ["t", "time", "seconds", "tempo", "temps", "zeit", "tiempo", "s"];

/// A header: its name in lower case, and the unit behind it in brackets or after an underscore.
#[derive(Debug, PartialEq)]
struct Header {
    name: String,
    unit: Option<String>,
}

impl Header {
    fn of(cell: &str) -> Self {
        let cell = cell.trim_start_matches('\u{feff}').trim().to_lowercase();
        let brackets = cell.split_once(['(', '[']).map(|(name, unit)| (name, unit.trim_end_matches([')', ']'])));
        let underscore = cell.rsplit_once('_').filter(|(_, unit)| ["px", "m", "cm", "mm", "s", "ms"].contains(unit));
        let (name, unit) = brackets.or(underscore).unwrap_or((&cell, ""));
        let unit = unit.trim();
        Header { name: name.trim().to_string(), unit: (!unit.is_empty()).then(|| unit.to_string()) }
    }

    /// What follows `x` or `y` in a header of positions: a number or a name of the point, or nothing.
    fn of_axis(&self, axis: char) -> Option<&str> {
        let rest = self.name.strip_prefix(axis)?;
        let rest = rest.trim_start_matches(['_', ' ', '-']);
        let plain = rest.is_empty() || rest.chars().all(|it| it.is_ascii_digit());
        plain.then_some(rest)
    }
}

/// Columns of one point.
struct Axes<'a> {
    name: &'a str,
    unit: Option<&'a str>,
    columns: [usize; 2],
}

/// The track of a table with a header. Of positions in several units those in pixels are taken.
pub(super) fn track(rows: &TableRows) -> Result<ReferenceTrack> {
    let (first, rest) = rows.split_first().context("the table is empty")?;
    let headers: Vec<Header> = first.iter().map(|cell| Header::of(cell)).collect();
    let found = || format!("found {}", first.join(", "));
    let place = |names: &[&str]| headers.iter().position(|header| names.contains(&header.name.as_str()));
    let (frame, time) = (place(&FRAMES), place(&TIMES));
    ensure!(
        frame.is_some() || time.is_some(),
        "no column of frames or times (frame, t); expected a header with one, {}",
        found()
    );
    let axes = axes(&headers);
    let unit = axes.iter().find(|it| it.unit == Some("px")).or(axes.first()).map(|it| it.unit);
    let unit = unit.with_context(|| format!("no columns x and y, {}", found()))?;
    let milliseconds = time.is_some_and(|time| headers[time].unit.as_deref() == Some("ms"));
    let points = axes.iter().filter(|it| it.unit == unit).map(|it| {
        let position = |row: &Vec<String>| {
            let number = |column: usize| row.get(column).and_then(|cell| number(cell));
            let [x, y] = it.columns.map(number);
            let seconds = time.and_then(number).map(|time| if milliseconds { time / 1000.0 } else { time });
            let frame = frame.and_then(number).filter(|frame| *frame >= 0.0).map(|frame| frame.round() as u64);
            (seconds.is_some() || frame.is_some()).then_some(Position { frame, seconds, at: [x?, y?] })
        };
        let name = if it.name.is_empty() { "the point".to_string() } else { format!("point {}", it.name) };
        TrackedPoint { name, positions: rest.iter().filter_map(position).collect() }
    });
    Ok(ReferenceTrack { points: points.collect(), unit: unit.unwrap_or(UNKNOWN).into() })
}

/// Columns `x` and `y` with the same ending and unit.
fn axes(headers: &[Header]) -> Vec<Axes<'_>> {
    let of_x = |(column, x): (usize, &'_ Header)| {
        let name = x.of_axis('x')?;
        let is_its_y = |y: &Header| y.of_axis('y') == Some(name) && y.unit == x.unit;
        Some((column, headers.iter().position(is_its_y)?))
    };
    let pairs = headers.iter().enumerate().filter_map(of_x);
    let axes = pairs.map(|(x, y)| Axes {
        name: headers[x].of_axis('x').unwrap_or_default(),
        unit: headers[x].unit.as_deref(),
        columns: [x, y],
    });
    axes.collect()
}

/// A number with a decimal point or comma.
fn number(cell: &str) -> Option<f64> {
    cell.replace(',', ".").parse::<f64>().ok().filter(|number| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> TableRows {
        text.lines().map(|line| line.split(';').map(String::from).collect()).collect()
    }

    #[test]
    fn pixels_are_taken_before_metres() {
        let track =
            track(&rows("frame;tempo (s);x (m);y (m);x (px);y (px)\n3;0,5;1;2;100;200\n4;0,6;;;101;201")).unwrap();
        let position = |frame, seconds, at| Position { frame: Some(frame), seconds: Some(seconds), at };
        assert_eq!(track.unit, "px");
        assert_eq!(track.points[0].positions, [position(3, 0.5, [100.0, 200.0]), position(4, 0.6, [101.0, 201.0])]);
    }

    #[test]
    fn several_points_have_columns_of_their_own() {
        let track = track(&rows("t_ms;x1;y1;x2;y2;vx;vy\n500;1;2;3;4;9;9\n600;1;2;;;9;9")).unwrap();
        let counts: Vec<_> = track.points.iter().map(|it| (it.name.as_str(), it.positions.len())).collect();
        assert_eq!(counts, [("point 1", 2), ("point 2", 1)]);
        assert_eq!(track.points[1].positions[0], Position { frame: None, seconds: Some(0.5), at: [3.0, 4.0] });
    }

    #[test]
    fn a_table_without_such_columns_says_what_it_found() {
        for (text, missing) in [("a;x;y\n1;2;3", "frames or times"), ("t;a;b\n1;2;3", "x and y"), ("", "empty")] {
            let error = format!("{:#}", track(&rows(text)).unwrap_err());
            assert!(error.contains(missing), "{error}");
        }
    }
}

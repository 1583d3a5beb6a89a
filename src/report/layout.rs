//! Text in lines of 80 columns: paragraphs and tables.

use std::fmt::Write;

/// Columns of the text.
pub(super) const WIDTH: usize = 80;

/// `text` cut to `width` characters.
pub(super) fn shorten(text: &str, width: usize) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if clean.chars().count() <= width {
        return clean;
    }
    let mut short: String = clean.chars().take(width - 2).collect();
    short.push_str("..");
    short
}

/// One paragraph, broken between words.
pub(super) fn line(out: &mut String, text: &str) {
    for paragraph in text.split('\n') {
        let mut used = 0;
        for word in paragraph.split(' ') {
            let width = word.chars().count();
            if used > 0 && used + 1 + width > WIDTH {
                out.push('\n');
                used = 0;
            } else if used > 0 {
                out.push(' ');
                used += 1;
            }
            out.push_str(word);
            used += width;
        }
        out.push('\n');
    }
}

#[derive(Clone)]
pub(super) struct Cell {
    text: String,
    right: bool,
}

pub(super) fn left(text: &str) -> Cell {
    Cell { text: text.into(), right: false }
}

pub(super) fn right(text: &str) -> Cell {
    Cell { text: text.into(), right: true }
}

/// Columns aligned two spaces apart.
#[derive(Default)]
pub(super) struct Table {
    rows: Vec<Vec<Cell>>,
}

impl Table {
    pub(super) fn row(&mut self, row: Vec<Cell>) {
        self.rows.push(row);
    }

    pub(super) fn columns(&self) -> usize {
        self.rows.iter().map(Vec::len).max().unwrap_or(0)
    }

    pub(super) fn widths(&self) -> Vec<usize> {
        let width = |k: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(k));
            cells.map(|c| c.text.chars().count()).max().unwrap_or(0)
        };
        (0..self.columns()).map(width).collect()
    }

    pub(super) fn width(&self) -> usize {
        self.widths().iter().map(|w| w + 2).sum()
    }

    /// Keeps the first `columns` columns.
    pub(super) fn drop_last(&mut self, columns: usize) {
        for row in &mut self.rows {
            row.truncate(columns);
        }
    }

    pub(super) fn print(&self, out: &mut String) {
        let widths = self.widths();
        for row in &self.rows {
            let mut text = String::new();
            for (cell, &w) in row.iter().zip(&widths) {
                text.push_str("  ");
                // writing to a String cannot fail
                let _ = if cell.right {
                    write!(text, "{:>w$}", cell.text)
                } else {
                    write!(text, "{:<w$}", cell.text)
                };
            }
            out.push_str(text.trim_end());
            out.push('\n');
        }
    }
}

/// A table of plain columns: the first to the left and shortened to fit, the
/// others to the right.
pub(crate) fn grid<const N: usize>(
    head: &[&str; N],
    rows: impl Iterator<Item = [String; N]>,
) -> String {
    columns(head, rows.map(Vec::from))
}

/// As [`grid`], with a number of columns that is found while running.
pub(crate) fn columns(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    const FIRST: usize = 28;
    let mut table = Table::default();
    table.row(
        head.iter().enumerate().map(|(k, h)| if k == 0 { left(h) } else { right(h) }).collect(),
    );
    for row in rows {
        let cells = row.iter().enumerate();
        table.row(
            cells.map(|(k, c)| if k == 0 { left(&shorten(c, FIRST)) } else { right(c) }).collect(),
        );
    }
    let mut out = String::new();
    table.print(&mut out);
    out
}

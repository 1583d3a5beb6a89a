//! A result as one HTML file: pictures, tables, scenario, manifest.
//!
//! Everything is inside: the file needs no network, runs no script (a content
//! policy forbids both), and prints.

mod study;
mod style;

pub use study::study;

use std::io::{self, Write};

use crate::report::manifest::Manifest;

/// A table with its heading.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// What stands above it.
    pub caption: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<String>>,
    /// What stands below it, one paragraph each.
    pub notes: Vec<String>,
}

/// A picture with its heading.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What stands above it.
    pub caption: String,
    /// An SVG document.
    pub svg: String,
}

/// What a report shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Page<'a> {
    /// The heading.
    pub title: &'a str,
    /// One line below it.
    pub subtitle: &'a str,
    /// The pictures.
    pub figures: Vec<Figure>,
    /// The tables.
    pub tables: Vec<Table>,
    /// The scenario, as read.
    pub scenario: &'a str,
    /// How the result came to be, without the report itself.
    pub manifest: &'a Manifest,
}

/// Writes the report.
///
/// # Errors
/// Whatever `out` reports.
pub fn write(page: &Page<'_>, mut out: impl Write) -> io::Result<()> {
    let (title, subtitle) = (escape(page.title), escape(page.subtitle));
    write!(out, "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n")?;
    writeln!(out, "<meta http-equiv=\"Content-Security-Policy\" content=\"{}\">", style::POLICY)?;
    writeln!(out, "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">")?;
    writeln!(out, "<title>{title}</title>\n<style>\n{}</style>\n</head>\n<body>", style::SHEET)?;
    writeln!(out, "<h1>{title}</h1>\n<p class=\"lead\">{subtitle}</p>")?;
    for (k, figure) in page.figures.iter().enumerate() {
        writeln!(out, "<h2>{}</h2>", escape(&figure.caption))?;
        writeln!(out, "<figure>\n{}</figure>", inline(&figure.svg, k))?;
    }
    for table in &page.tables {
        write_table(table, &mut out)?;
    }
    write!(out, "<h2>Scenario</h2>\n<pre>{}</pre>\n", escape(page.scenario))?;
    manifest(page.manifest, &mut out)?;
    out.write_all(b"</body>\n</html>\n")
}

fn write_table(table: &Table, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "<h2>{}</h2>", escape(&table.caption))?;
    if !table.rows.is_empty() {
        out.write_all(b"<div class=\"wide\"><table>\n<thead><tr>")?;
        for cell in &table.head {
            write!(out, "<th>{}</th>", escape(cell))?;
        }
        out.write_all(b"</tr></thead>\n<tbody>\n")?;
        for row in &table.rows {
            out.write_all(b"<tr>")?;
            for cell in row {
                write!(out, "<td>{}</td>", escape(cell))?;
            }
            out.write_all(b"</tr>\n")?;
        }
        out.write_all(b"</tbody></table></div>\n")?;
    }
    for note in &table.notes {
        writeln!(out, "<p>{}</p>", escape(note))?;
    }
    Ok(())
}

fn manifest(of: &Manifest, out: &mut impl Write) -> io::Result<()> {
    let row = |name: &str, value: &str| vec![name.to_string(), value.to_string()];
    let mut rows = vec![
        row("version", of.version),
        row("command", &of.command.join(" ")),
        row("scenario", &of.scenario.path),
        row("its SHA-256", &of.scenario.sha256),
        row("instruction set", &of.cpu_tier),
        row("threads", &of.threads.to_string()),
        row("started", &of.started),
        row("seconds", &super::significant(of.seconds, 3)),
    ];
    for file in &of.files {
        rows.push(row(&file.name, &format!("{} bytes, SHA-256 {}", file.bytes, file.sha256)));
    }
    let head = row("what", "value");
    write_table(&Table { caption: "Manifest".into(), head, rows, notes: Vec::new() }, out)
}

/// An SVG document for the inside of a page: without its prologue, and with names
/// of its own for the things that it refers to.
fn inline(svg: &str, figure: usize) -> String {
    let start = svg.find("<svg").unwrap_or(0);
    let own = |text: &str, mark: &str| text.replace(mark, &format!("{mark}f{figure}-"));
    // a quotation mark or bracket in a text is no mark: it is escaped, or harmless
    own(&own(&svg[start..], " id=\""), "url(#")
}

/// Text for HTML; control characters that it does not allow are dropped.
fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\n' | '\t' => safe.push(c),
            c if c.is_control() => {}
            c => safe.push(c),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_pictures_keep_their_names_apart() {
        assert_eq!(escape("<a href='x'>&\u{0}\"\r\n"), "&lt;a href=&#39;x&#39;&gt;&amp;&quot;\n");
        let svg = "<?xml?>\n<svg><clipPath id=\"a\"/><path clip-path=\"url(#a)\"/></svg>";
        let wanted = "<svg><clipPath id=\"f1-a\"/><path clip-path=\"url(#f1-a)\"/></svg>";
        assert_eq!(inline(svg, 1), wanted);
    }
}

//! How a report looks, on a screen and on paper.

/// No script, nothing from elsewhere.
pub(super) const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

pub(super) const SHEET: &str = "\
body { font: 16px/1.45 sans-serif; color: #222; background: #fff; max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin: 0; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; break-after: avoid; }
.lead { color: #555; margin: .2rem 0 1rem; }
figure { margin: 0; break-inside: avoid; }
figure svg { display: block; width: 100%; height: auto; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem .9rem .25rem 0;
  border-bottom: 1px solid #ddd; overflow-wrap: anywhere; }
td:first-child, th:first-child { overflow-wrap: normal; }
th { border-bottom: 1.5px solid #888; }
tr { break-inside: avoid; }
thead { display: table-header-group; }
pre { font: 13px/1.4 monospace; background: #f6f6f6; padding: .8rem; white-space: pre-wrap;
  overflow-wrap: anywhere; }
@page { margin: 16mm; }
@media print {
  body { font-size: 10.5pt; max-width: none; margin: 0; padding: 0; }
  pre { font-size: 8.5pt; background: none; border: 1px solid #ddd; }
  figure svg { max-height: 225mm; }
}
";

//! How pages look: on a screen, light or dark, on a phone, in print, and to people who see colours differently.

/// A page may run its own script and show its own pictures, and fetch nothing.
pub(super) const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:";

/// The colours have names, which plots use too. `paper` is the class of the root while it is printed.
pub const COLOURS: &str = "
:root { color-scheme: light dark; --paper: #ffffff; --ink: #1a1a1a; --muted: #555555; --faint: #999999; --grid: #e4e4e4;
  --code: #f4f4f4; --link: #005a92; --banner: #fff3cd; --synthetic: #7a5f00; --good: #00694c; --bad: #a83c00; --low: #e9f1f8;
  --truth: #000000; --c0: #0072b2; --c1: #e69f00; --c2: #009e73; --c3: #cc79a7; --c4: #56b4e9; --c5: #d55e00; --c6: #8c8000; }
@media (prefers-color-scheme: dark) { :root:not(.paper) { --paper: #16181c; --ink: #e6e6e6; --muted: #b0b0b0;
  --faint: #777777; --grid: #2e3238; --code: #22262c; --link: #7cc4f5; --banner: #3d3210; --synthetic: #f0cf6a; --good: #4fd0a6;
  --bad: #ff9a5c; --low: #1b2a38; --truth: #ffffff; --c0: #4aa8e8; --c1: #f0b53a; --c2: #2fc79a; --c3: #e19ac2; --c4: #9ad3f5;
  --c5: #f08046; --c6: #c9bd3c; } }
:root.paper { color-scheme: light; }
";

/// Everything else of the looks.
pub(super) const SHEET: &str = "
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 68rem; margin: 0 auto;
  padding: 1rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .5rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; border-bottom: 1px solid var(--faint); }
nav { font-size: .9rem; } nav a { margin-right: .7rem; color: var(--link); white-space: nowrap; }
p { max-width: 46rem; margin: .5rem 0; overflow-wrap: anywhere; }
.synthetic { background: var(--banner); border-left: .4rem solid #e69f00; padding: .4rem .8rem; font-weight: 600; }
.verdict { border-left: .4rem solid var(--faint); background: var(--code); padding: .6rem .8rem; font-size: 1.1rem; }
.verdict.better { border-color: var(--good); } .verdict.worse { border-color: var(--bad); }
.verdict strong { font-size: 1.2rem; } .better strong { color: var(--good); } .worse strong { color: var(--bad); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .6rem 0; font-size: .9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: .2rem 0; }
th, td { padding: .2rem .7rem .2rem 0; border-bottom: 1px solid var(--grid); text-align: right; vertical-align: top; }
th:first-child { text-align: left; font-weight: 400; } thead th { font-weight: 600; } thead th:first-child { font-weight: 600; }
pre { background: var(--code); padding: .6rem; white-space: pre-wrap; overflow-wrap: anywhere; font-size: .85rem; }
figure { margin: 1.2rem 0; } figcaption { font-size: .9rem; color: var(--muted); max-width: 46rem; }
.plot { width: 100%; padding-top: 30px; }
.plot .modebar-container { top: -30px !important; }
.beside { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 0 1.5rem; align-items: end; }
@media (max-width: 40rem) { body { padding: .6rem; font-size: 15px; } .beside { grid-template-columns: minmax(0, 1fr); } }
@page { margin: 15mm; }
@media print { nav, .modebar-container { display: none !important; } body { max-width: none; padding: 0; font-size: 10pt; }
  .plot { padding-top: 0; } figure, tr, .verdict { break-inside: avoid; } h2, caption, thead { break-after: avoid; }
  .scroll { overflow: visible; } table { font-size: 8pt; } th, td { padding-right: .4rem; }
  td, tbody th { overflow-wrap: anywhere; } td[data-value] { overflow-wrap: normal; white-space: nowrap; } }
";

/// Draws the plots: in the colours that the page has, at the width there is, and anew where either changes. Paper is light and
/// narrower than a window. A finger scrolls a page, and does not zoom.
pub(super) const DRAW: &str = "
const PAPER_PX = 680, root = document.documentElement, touch = matchMedia('(hover: none)').matches;
const colours = (value, key, of) => {
  if (Array.isArray(value)) return value.map(one => colours(one, key, of));
  if (value && typeof value === 'object')
    return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, colours(one, name, of)]));
  const named = typeof value === 'string' && value.startsWith('--') && /(color|colorscale)$/.test(key);
  return named ? of.getPropertyValue(value).trim() : value;
};
function draw(paper) {
  const of = getComputedStyle(root);
  for (const plot of document.querySelectorAll('.plot > div')) {
    const { data, layout } = colours(JSON.parse(plot.nextElementSibling.textContent), '', of);
    if (paper) layout.width = plot.closest('.beside') ? PAPER_PX / 2 - 12 : PAPER_PX;
    layout.dragmode = touch ? false : 'zoom';
    Plotly.react(plot, data, layout, { responsive: true, displaylogo: false, displayModeBar: touch ? false : 'hover',
      modeBarButtonsToRemove: ['select2d', 'lasso2d'] });
  }
}
draw(false);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => draw(false));
addEventListener('beforeprint', () => { root.classList.add('paper'); draw(true); });
addEventListener('afterprint', () => { root.classList.remove('paper'); draw(false); });
";

pub(super) const FONT: &str = "system-ui, sans-serif";

/// How one series looks in every plot of a page: told apart by colour, and without colour by dash and marker.
#[derive(Debug, Clone)]
pub struct Style {
    /// Its name in the style sheet.
    pub(super) colour: &'static str,
    pub(super) dash: &'static str,
    pub(super) symbol: &'static str,
    pub(super) width: f64,
    pub(super) markers: bool,
    pub(super) marker_px: usize,
}

impl Style {
    /// The style of the series of this number; after seven they begin again.
    ///
    /// # Source
    /// Colours that people tell apart however they see them: Okabe and Ito, "Color Universal Design", 2008. Those of dark
    /// pages are lighter shades of them.
    pub fn of(idx: usize) -> Self {
        let (colour, dash, symbol) = match idx % 7 {
            0 => ("--c0", "solid", "circle"),
            1 => ("--c1", "dash", "square"),
            2 => ("--c2", "dashdot", "diamond"),
            3 => ("--c3", "dot", "triangle-up"),
            4 => ("--c4", "longdash", "cross"),
            5 => ("--c5", "longdashdot", "x"),
            _ => ("--c6", "solid", "star"),
        };
        Style { colour, dash, symbol, width: 2.0, markers: false, marker_px: 6 }
    }

    /// That of the truth: black, or white on a dark page.
    pub fn truth() -> Self {
        Style { colour: "--truth", dash: "solid", symbol: "circle-open", width: 1.5, markers: false, marker_px: 6 }
    }

    /// A marker at every point besides.
    pub fn marked(self) -> Self {
        Style { markers: true, ..self }
    }

    /// With large markers, for single points that matter.
    pub fn large(self) -> Self {
        Style { marker_px: 13, ..self }
    }

    /// A solid line, for series that are long enough to hide a dash.
    pub fn solid(self) -> Self {
        Style { dash: "solid", width: 1.5, ..self }
    }
}

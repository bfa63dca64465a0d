//! How pages look: on a screen, on a phone, in print, and to people who see colours differently.

use plotly::common::{DashType, MarkerSymbol};

/// A page may run its own script and show its own pictures, and fetch nothing.
pub(super) const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:";

pub(super) const SHEET: &str = "
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 68rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .5rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; border-bottom: 1px solid #ccc; }
nav { font-size: .9rem; } nav a { margin-right: .7rem; color: #005a92; white-space: nowrap; }
p { max-width: 46rem; margin: .5rem 0; overflow-wrap: anywhere; }
.synthetic { background: #fff3cd; border-left: .4rem solid #e69f00; padding: .4rem .8rem; font-weight: 600; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .6rem 0; font-size: .9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: .2rem 0; }
th, td { padding: .2rem .7rem .2rem 0; border-bottom: 1px solid #ddd; text-align: right; vertical-align: top; }
th:first-child { text-align: left; font-weight: 400; } thead th { font-weight: 600; }
pre { background: #f4f4f4; padding: .6rem; white-space: pre-wrap; overflow-wrap: anywhere; font-size: .85rem; }
figure { margin: 1rem 0; } figcaption { font-size: .9rem; color: #444; max-width: 46rem; }
.plot { width: 100%; }
@media (max-width: 40rem) { body { padding: .6rem; font-size: 15px; } }
@media print { nav, .modebar-container { display: none !important; } body { max-width: none; padding: 0; }
  figure, table { break-inside: avoid; } h2 { break-after: avoid; } .scroll { overflow: visible; } }
";

/// Plots take the width there is; paper is narrower than the window was.
pub(super) const FIT: &str = "
function fit() { document.querySelectorAll('.js-plotly-plot').forEach(plot => Plotly.Plots.resize(plot)); }
addEventListener('beforeprint', fit); addEventListener('afterprint', fit);
";

pub(super) const FONT: &str = "system-ui, sans-serif";
pub(super) const INK: &str = "#1a1a1a";
pub(super) const GRID: &str = "#e4e4e4";

/// How one series looks in every plot of a page: told apart by colour, and without colour by dash and marker.
#[derive(Debug, Clone)]
pub struct Style {
    pub(super) colour: &'static str,
    pub(super) dash: DashType,
    pub(super) symbol: MarkerSymbol,
    pub(super) width: f64,
    pub(super) markers: bool,
}

impl Style {
    /// The style of the series of this number; after seven they begin again.
    ///
    /// # Source
    /// Colours that people tell apart however they see them: Okabe and Ito, "Color Universal Design", 2008.
    pub fn of(idx: usize) -> Self {
        let (colour, dash, symbol) = match idx % 7 {
            0 => ("#0072b2", DashType::Solid, MarkerSymbol::Circle),
            1 => ("#e69f00", DashType::Dash, MarkerSymbol::Square),
            2 => ("#009e73", DashType::DashDot, MarkerSymbol::Diamond),
            3 => ("#cc79a7", DashType::Dot, MarkerSymbol::TriangleUp),
            4 => ("#56b4e9", DashType::LongDash, MarkerSymbol::Cross),
            5 => ("#d55e00", DashType::LongDashDot, MarkerSymbol::X),
            _ => ("#8c8000", DashType::Solid, MarkerSymbol::Star),
        };
        Style { colour, dash, symbol, width: 2.0, markers: false }
    }

    /// That of the truth: black.
    pub fn truth() -> Self {
        Style { colour: "#000000", dash: DashType::Solid, symbol: MarkerSymbol::CircleOpen, width: 1.5, markers: false }
    }

    /// A marker at every point besides.
    pub fn marked(self) -> Self {
        Style { markers: true, ..self }
    }

    /// A solid line, for series that are long enough to hide a dash.
    pub fn solid(self) -> Self {
        Style { dash: DashType::Solid, width: 1.5, ..self }
    }
}

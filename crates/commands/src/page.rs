//! Self-contained HTML pages: text, tables and plots in one file that needs no network and no server.

mod figure;
mod style;

use maud::{DOCTYPE, Markup, PreEscaped, html};

pub use figure::{Density, Figure, Heat, longest_step};
pub use style::{COLOURS, Style};

/// A page of sections.
#[derive(Debug)]
pub struct Page {
    title: String,
    is_synthetic: bool,
    sections: Vec<Section>,
}

/// A part of a page under its own heading.
#[derive(Debug)]
pub struct Section {
    id: String,
    title: String,
    body: Vec<Markup>,
    n_figures: usize,
    is_synthetic: bool,
}

/// The kind of a verdict, for its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VerdictKind {
    /// Something is better than it was.
    Better,
    /// Something is worse, or not as it must be.
    Worse,
    /// Neither, or both.
    Neither,
}

/// A table; the first column names the rows.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Names it within the page.
    pub id: String,
    /// The text above it.
    pub caption: String,
    /// Names of the columns.
    pub header: Vec<String>,
    /// The rows.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cell {
    /// As a person reads it.
    pub text: String,
    /// The number in full, which the page keeps as `data-value`.
    pub value: Option<f64>,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Cell { text: text.to_owned(), value: None }
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Cell { text, value: None }
    }
}

impl Cell {
    /// A number with so many digits behind the point.
    pub fn number(value: f64, digits: usize) -> Self {
        Cell { text: format!("{value:.digits$}"), value: value.is_finite().then_some(value) }
    }

    /// A number, or a dash where there is none.
    pub fn maybe(value: Option<f64>, digits: usize) -> Self {
        value.map_or_else(|| "-".into(), |value| Cell::number(value, digits))
    }

    /// A count.
    pub fn count(n: u64) -> Self {
        Cell { text: n.to_string(), value: Some(n as f64) }
    }
}

impl Page {
    /// A page without sections; on one of synthetic data a banner says so.
    pub fn new(title: &str, is_synthetic: bool) -> Self {
        Page { title: title.to_owned(), is_synthetic, sections: Vec::new() }
    }

    /// Adds a section, which the table of contents leads to.
    pub fn section(&mut self, id: &str, title: &str) -> &mut Section {
        let (id, title) = (id.to_owned(), title.to_owned());
        self.sections.push(Section { id, title, body: Vec::new(), n_figures: 0, is_synthetic: self.is_synthetic });
        let last = self.sections.len() - 1;
        &mut self.sections[last]
    }

    /// The page as one HTML file, with the script that draws its plots.
    pub fn html(&self) -> String {
        let has_figures = self.sections.iter().any(|section| section.n_figures > 0);
        let banner = "SYNTHETIC DATA: made by a simulator, not recorded on a hand.";
        let markup = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    // Whatever a bag or a file name may hold, the page fetches nothing.
                    meta http-equiv="Content-Security-Policy" content=(style::POLICY);
                    title { (self.title) @if self.is_synthetic { " (synthetic)" } }
                    style { (PreEscaped(COLOURS)) (PreEscaped(style::SHEET)) }
                    @if has_figures { (figure::script()) }
                }
                body {
                    header {
                        h1 { (self.title) }
                        @if self.is_synthetic { p.synthetic { (banner) } }
                        nav { @for section in &self.sections { a href={ "#" (section.id) } { (section.title) } " " } }
                    }
                    @for section in &self.sections {
                        section id=(section.id) {
                            h2 { (section.title) }
                            @for block in &section.body { (block) }
                        }
                    }
                    @if has_figures { script { (PreEscaped(style::DRAW)) } }
                }
            }
        };
        markup.into_string()
    }
}

impl Section {
    /// Adds a paragraph.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.body.push(html! { p { (text) } });
        self
    }

    /// Adds lines as they are: a command, a fragment of a file.
    pub fn code(&mut self, text: &str) -> &mut Self {
        self.body.push(html! { pre { code { (text) } } });
        self
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) -> &mut Self {
        self.body.push(html! {
            div.scroll {
                table id=(table.id) {
                    @if !table.caption.is_empty() { caption { (table.caption) } }
                    thead { tr { @for name in &table.header { th scope="col" { (name) } } } }
                    tbody {
                        @for row in &table.rows {
                            tr {
                                @for (idx, cell) in row.iter().enumerate() {
                                    @if idx == 0 { th scope="row" { (cell.text) } }
                                    @else if let Some(value) = cell.value { td data-value=(value) { (cell.text) } }
                                    @else { td { (cell.text) } }
                                }
                            }
                        }
                    }
                }
            }
        });
        self
    }

    /// Adds what everything else comes to, before it: a word and the sentence that explains it.
    pub fn verdict(&mut self, kind: VerdictKind, word: &str, sentence: &str) -> &mut Self {
        let class = match kind {
            VerdictKind::Better => "verdict better",
            VerdictKind::Worse => "verdict worse",
            VerdictKind::Neither => "verdict",
        };
        self.body.push(html! { p class=(class) { strong { (word) } " " (sentence) } });
        self
    }

    /// Adds a plot, where it has something to show; one of synthetic data says so in the picture too, which may go where the
    /// page doesn't.
    pub fn figure(&mut self, figure: &Figure) -> &mut Self {
        self.figures(std::slice::from_ref(figure))
    }

    /// Adds plots that are compared with each other: side by side, where the page is wide enough.
    pub fn figures(&mut self, figures: &[Figure]) -> &mut Self {
        let shown: Vec<Markup> =
            figures.iter().filter(|figure| !figure.is_empty()).map(|figure| figure.markup(self.is_synthetic)).collect();
        self.n_figures += shown.len();
        match shown.len() {
            0 => {}
            1 => self.body.extend(shown),
            _ => self.body.push(html! { div.beside { @for figure in &shown { (figure) } } }),
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_bag_is_called_can_not_become_markup() {
        let name = "</script><script>alert(1)</script>";
        let mut page = Page::new(name, true);
        let section = page.section("a", name);
        section.text(name).code(name);
        let header = vec![name.to_owned()];
        section.table(&Table { header, rows: vec![vec![name.into(), name.into()]], ..Table::default() });
        let mut figure = Figure::new("force", name, "time, s", name);
        figure.line(name, vec![0.0, 1.0], vec![f64::NAN, 2.0], Style::of(0));
        section.figure(&figure);
        let html = page.html();
        assert!(html.contains("\"text\":\"synthetic data\""), "in the picture too");
        assert!(!html.contains("<script>alert"), "escaped in text, tables and plots");
        assert!(html.contains("SYNTHETIC DATA"));
    }

    #[test]
    fn numbers_keep_all_their_digits_beside_what_is_shown() {
        let mut page = Page::new("numbers", false);
        let rows = vec![vec!["a".into(), Cell::number(1.0 / 3.0, 2), Cell::maybe(None, 2), Cell::count(7)]];
        page.section("s", "s").table(&Table { rows, ..Table::default() });
        let html = page.html();
        assert!(html.contains("<td data-value=\"0.3333333333333333\">0.33</td><td>-</td>"), "{html}");
        assert!(!html.contains("SYNTHETIC") && !html.contains("Plotly"), "no plot, no script");
    }
}

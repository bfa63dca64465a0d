//! Everything that was found on one page that people can look at.

mod contacts;
mod origin;
mod scores;
mod stretches;
mod truth;

use tactile_pose_fusion::evaluate::Evaluated;

use crate::page::{Page, Style};

/// The page.
pub fn page(result: &Evaluated) -> Page {
    let judged = result.models.last().map_or("", |model| model.name.as_str());
    let mut page = Page::new(&format!("Evaluation of {judged}"), result.synthetic);
    scores::verdict(&mut page, result);
    if result.has_scores() {
        truth::section(&mut page, result);
    }
    contacts::in_air(&mut page, result);
    if result.has_scores() {
        scores::table_of_all(&mut page, result);
        scores::over_force(&mut page, result);
        scores::users(&mut page, result);
        contacts::contacts(&mut page, result);
    }
    stretches::section(&mut page, result);
    scores::pose_quality(&mut page, result);
    scores::gates(&mut page, result);
    origin::timing(&mut page, result);
    origin::provenance(&mut page, result);
    page
}

/// How the series of this number looks: what is judged stands last and comes first in colour.
fn style(result: &Evaluated, series: usize) -> Style {
    Style::of(result.models.len().saturating_sub(series + 1))
}

/// Letters and digits of a name, to build the name of a plot with.
fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect()
}

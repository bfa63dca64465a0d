//! Force over time where the judged series did best, worst, and as usual.

use tactile_pose_fusion::evaluate::{Evaluated, Stretch};

use crate::page::{Figure, Page, Style};

pub(super) fn section(page: &mut Page, result: &Evaluated) {
    if result.evidence.stretches.is_empty() {
        return;
    }
    let section = page.section("time", "Force over time");
    section.text("Of all stretches of 20 s with touches in them, by the error of the judged series: the best, that of the middle, and the worst. Drag to zoom, double-click to return; the legend hides and shows.");
    for stretch in &result.evidence.stretches {
        section.figure(&figure(stretch));
    }
}

fn figure(stretch: &Stretch) -> Figure {
    let caption = format!(
        "{}: MAE {:.1} gF. Glove {}, {} ({}), {:.0} s after its first scored frame. Artifact: what the pose correction removed.",
        stretch.kind, stretch.mae_gf, stretch.glove, stretch.session, stretch.stage, stretch.from_s
    );
    let id = format!("stretch-{}", stretch.kind.to_lowercase());
    let mut figure = Figure::new(&id, &caption, "time, s", "force, gF").height(460);
    let x = &stretch.seconds;
    if !stretch.base_gf.is_empty() {
        let artifact: Vec<f64> =
            stretch.base_gf.iter().zip(&stretch.force_gf).map(|(base, force)| base - force).collect();
        figure.time_line("artifact", x, &artifact, Style::of(3).solid());
        figure.time_line("base", x, &stretch.base_gf, Style::of(1).solid());
    }
    figure.time_line("truth", x, &stretch.truth_gf, Style::truth());
    figure.time_line("estimate", x, &stretch.force_gf, Style::of(0).solid());
    figure.states("true touch", &stretch.seconds, &stretch.is_touch, Style::truth());
    figure.states("contact", &stretch.seconds, &stretch.contact, Style::of(0));
    figure
}

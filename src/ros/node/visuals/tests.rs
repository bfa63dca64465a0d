use super::*;
use crate::config::parse_param_file;
use crate::fusion::{Adaptation, Contact, Flags, RegionIdx, TactileSourceIdx, TickTaxels};
use crate::msg::Marker;
use crate::units::Newton;

fn cfg(extra: &str) -> Config {
    let text = format!(
        "/**:
  ros__parameters:
    regions: [index, thumb]
    tactile_sources: [glove]
    tactile.glove: {{topic: /taxels, n_taxels: 5}}
    model.m: {{path: m.onnx}}
    region.index: {{model: m, taxels: [0, 1, 2, 3], frame_id: index_tip, normal: [0.0, 0.0, -1.0]}}
    region.thumb: {{model: m, taxels: [4], frame_id: hand, mount.translation: [0.1, 0.2, 0.3], mount.rotation: [1.0, 0.0, 0.0, 0.0]}}
{extra}"
    );
    Config::from_tree(&parse_param_file(&text, "p.yaml", "/tactile_pose_fusion").unwrap()).unwrap()
}

fn refusal(extra: &str) -> String {
    let text = format!(
        "/**:\n  ros__parameters:\n    regions: [a]\n    tactile_sources: [g]\n    tactile.g: {{topic: /t, n_taxels: 5}}\n    \
         model.m: {{path: m.onnx}}\n    region.a: {{model: m, frame_id: a_patch}}\n{extra}"
    );
    Config::from_tree(&parse_param_file(&text, "p.yaml", "/n").unwrap()).unwrap_err().to_string()
}

fn estimate(region: usize, force: Option<f64>) -> Estimate {
    Estimate { region: RegionIdx::at(region), force: force.map(Newton), ..Estimate::default() }
}

fn tick(stamp_ms: i64) -> Tick {
    Tick {
        source: TactileSourceIdx::at(0),
        stamp: Stamp(stamp_ms * 1_000_000),
        epoch: 0,
        number: 0,
        received: Stamp(0),
        age_ns: None,
        estimates: vec![estimate(0, Some(2.0)), estimate(1, None)],
        taxels: TickTaxels {
            reading: vec![1.0, 2.0, 3.0, 4.0, 5.0],
            feature: vec![0.0, -1.0, 2.0, f32::NAN, f32::NAN],
        },
    }
}

/// The first frame of a session, and what draws it.
fn drawn(cfg: &Config, tick: &Tick) -> (Drawing, Shown) {
    let shown = Selection::new(cfg).handle(tick).unwrap();
    let mut drawing = Drawing::new(cfg);
    drawing.handle(&shown);
    (drawing, shown)
}

#[test]
fn frames_are_drawn_at_the_rate_of_pictures_also_after_a_jump_of_time() {
    let mut selection = Selection::new(&cfg("    visualization.rate_hz: 20.0\n"));
    let stamps = [0, 10, 49, 50, 60, 99, 100, -5000, -4990, -4950];
    let chosen: Vec<i64> = stamps.into_iter().filter(|stamp| selection.handle(&tick(*stamp)).is_some()).collect();
    assert_eq!(chosen, [0, 50, 100, -5000, -4950]);
}

#[test]
fn an_arrow_ends_on_the_patch_in_the_frame_of_its_region() {
    let cfg = cfg("    visualization.arrow_m_per_n: 0.01\n");
    let mut seen = tick(0);
    seen.estimates[1].force = Some(Newton(3.0));
    let (drawing, shown) = drawn(&cfg, &seen);
    let markers = drawing.markers(&shown).markers;
    let names: Vec<(&str, i32, &str)> =
        markers.iter().map(|marker| (marker.ns.as_str(), marker.id, marker.header.frame_id.as_str())).collect();
    let expected =
        ["index", "thumb"].map(|ns| [0, 1, 2].map(|id| (ns, id, if ns == "index" { "index_tip" } else { "hand" })));
    assert_eq!(names, expected.concat());
    let ends = |marker: &Marker| [0, 1].map(|end| [marker.points[end].x, marker.points[end].y, marker.points[end].z]);
    // 2 N along the patch's -z, at the origin; 3 N along its z, which a half turn about x points along -z.
    assert_eq!(ends(&markers[1]), [[0.0, 0.0, 0.02], [0.0, 0.0, 0.0]]);
    let [begin, end] = ends(&markers[4]);
    assert_eq!(end, [0.1, 0.2, 0.3]);
    assert!((begin[2] - 0.33).abs() < 1e-12 && (begin[0] - 0.1).abs() < 1e-12, "{begin:?}"); // rounding of one rotation
    assert_eq!(markers[2].text, "index 2.00 N");
}

#[test]
fn a_region_without_a_force_has_no_arrow_and_its_text_gives_the_flags() {
    let mut seen = tick(0);
    seen.estimates[1].flags = Flags::UNCALIBRATED;
    let (drawing, shown) = drawn(&cfg(""), &seen);
    let markers = drawing.markers(&shown).markers;
    assert_eq!((markers[1].action, markers[4].action), (Marker::ADD, Marker::DELETE));
    assert_eq!(markers[5].text, "thumb no estimate\nUNCALIBRATED");
    // Of a lifetime that outlasts the next frames, so that a source that stops vanishes.
    assert!(markers.iter().all(|marker| marker.lifetime.nanos() == 500_000_000));
}

#[test]
fn colours_tell_contact_flags_and_no_estimate_apart() {
    let touching = Estimate { contact: Contact { state: true, ..Contact::default() }, ..estimate(0, Some(1.0)) };
    let flagged = Estimate { flags: Flags::LATE, ..touching };
    let all =
        [estimate(0, None), estimate(0, Some(1.0)), touching, flagged].map(|estimate| colour::of_estimate(&estimate));
    for (idx, colour) in all.iter().enumerate() {
        assert!(!all[..idx].contains(colour), "{all:?}");
    }
    assert_eq!(colour::of_taxel(f32::NAN, 1.0), colour::NONE);
    assert_eq!(colour::of_taxel(0.0, 1.0), colour::PAPER);
    assert_eq!(colour::of_taxel(5.0, 1.0), colour::of_taxel(1.0, 1.0));
    assert_ne!(colour::of_taxel(0.5, 1.0), colour::of_taxel(-0.5, 1.0));
    assert_eq!(colour::of_taxel(1.0, 0.0), colour::PAPER, "nothing has moved yet");
}

#[test]
fn an_image_has_the_taxels_in_their_grid_and_a_second_panel_where_an_artifact_is_removed() {
    let cfg = cfg("    region.index.layout.shape: [1, 4]\n    visualization.taxel_range: 4.0\n");
    let (drawing, mut shown) = drawn(&cfg, &tick(0));
    let image = drawing.image(&shown.regions[0], shown.stamp);
    assert_eq!((image.width, image.height, image.step, image.encoding.as_str()), (96, 24, 288, "rgb8"));
    assert_eq!(image.data.len(), 288 * 24);
    let pixel = |image: &Image, x: usize, y: usize| -> [u8; 3] {
        let at = y * image.step as usize + 3 * x;
        image.data[at..at + 3].try_into().unwrap()
    };
    for taxel in 0..4 {
        assert_eq!(pixel(&image, 24 * taxel + 5, 5), colour::of_taxel(taxel as f32 + 1.0, 4.0));
    }
    shown.regions[0].estimate.adaptation = Adaptation::Learning;
    let image = drawing.image(&shown.regions[0], shown.stamp);
    assert_eq!(image.width, 2 * 96 + 12);
    assert_eq!(pixel(&image, 96 + 12 + 24 + 5, 5), colour::of_taxel(-1.0, 4.0));
    assert_eq!(pixel(&image, 96 + 12 + 3 * 24 + 5, 5), colour::NONE, "NaN");
}

#[test]
fn the_largest_reading_has_the_strongest_colour_and_is_forgotten_slowly() {
    let cfg = cfg("");
    let (mut drawing, mut shown) = drawn(&cfg, &tick(0));
    assert_eq!(drawing.regions[0].range, 4.0);
    for region in &mut shown.regions {
        region.raw.fill(0.0);
        region.corrected.fill(f32::NAN);
    }
    shown.stamp = Stamp(10_000_000_000);
    drawing.handle(&shown);
    assert!((drawing.regions[0].range - 4.0 * (-1.0_f32).exp()).abs() < 1e-6); // rounding of f32
}

#[test]
fn patches_have_frames_of_their_own() {
    let frames = patch_frames(&cfg(""), Stamp(7)).transforms;
    let names: Vec<(&str, &str)> =
        frames.iter().map(|frame| (frame.header.frame_id.as_str(), frame.child_frame_id.as_str())).collect();
    assert_eq!(names, [("index_tip", "index_patch"), ("hand", "thumb_patch")]);
    let of_thumb = &frames[1].transform;
    assert_eq!((of_thumb.translation.x, of_thumb.rotation.x, of_thumb.rotation.w), (0.1, 1.0, 0.0));
}

#[test]
fn a_layout_that_does_not_fit_is_refused() {
    for (line, expected) in [
        ("    region.a.layout.shape: [2, 2]\n", "has 4 places, but the region has 5 taxels"),
        ("    region.a.layout.shape: [5]\n", "must be two numbers: rows and columns"),
        ("    region.a.layout.shape: [0, 5]\n", "must be in [1, 4096]"),
        ("    region.a.layout.positions: [0.1, 0.2]\n", "5 taxels need x, y and z of each, 15 in all"),
        ("    region.a.layout.pitch: 0.0\n", "must be in (0, 1] m"),
        ("    visualization.tf: true\n", "is the frame of the patch itself"),
    ] {
        let text = refusal(line);
        assert!(text.contains(expected), "{line}: {text}");
    }
}

//! Tells how well a model keeps touches that are held while the hand moves, on a synthetic glove:
//! `cargo run --example held_touches -- GLOVE [MODEL] [USERS] [PHYSICS] [SLIPS]`, such as `-- 1 models/glove1_adaptive.onnx 4`. With
//! the physics `none` the hand leaves no artifact, and noise and drift are the limit. SLIPS are sudden slips of the glove a minute, such
//! as 0; without it one comes every 45 s.
//!
//! Users that no model knows move their hands in the air, tracked by markers or by a camera, and touches are laid on the taxels along
//! the pattern that the model knows: for a minute, from before the recording on, as a slow ramp, a grasp of ten minutes, one that is let
//! go in part, and five minutes of a light touch. SYNTHETIC data. For each it prints the share of the frames with contact and the mean
//! force. The tests of `adaptive_touch` ask for some of it.

#[path = "../tests/library/worn.rs"]
#[allow(dead_code)] // tests use more of it
mod worn;

use std::error::Error;
use std::io::Write;
use std::num::NonZeroU32;
use std::path::PathBuf;

use tactile_pose_fusion::sim::{Conditions, Physics, Tracking};
use worn::{CALIBRATED_S, Felt, Worn, for_a_minute, in_span, long_grasp, setup, shipped, slow_ramp};

/// Forces that are held for a minute, gF; 0 is the air.
const HELD_GF: [f64; 7] = [0.0, 5.0, 10.0, 15.0, 20.0, 40.0, 60.0];

/// Forces that are there from before the recording on, gF.
const AT_START_GF: [f64; 5] = [0.0, 5.0, 10.0, 15.0, 60.0];

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let usage =
        "expected GLOVE [MODEL] [USERS] [PHYSICS] [SLIPS], such as: 1 models/glove1_adaptive.onnx 4 separable 0";
    let (Some(glove @ 1..=3), true) = (args.first().and_then(|arg| arg.parse::<u8>().ok()), args.len() <= 5) else {
        return Err(usage.into());
    };
    let model = args.get(1).map_or_else(|| shipped(glove), PathBuf::from);
    let n_users: NonZeroU32 = args.get(2).map_or("2", String::as_str).parse().map_err(|_| usage)?;
    let asked = args.get(3).map_or("separable", String::as_str);
    let physics = Physics::ALL.into_iter().find(|one| one.name() == asked);
    let physics = physics.ok_or_else(|| format!("expected separable, coupled or none for PHYSICS, got {asked:?}"))?;
    let slips_per_min = match args.get(4).map(|arg| arg.parse::<f64>()) {
        None => None,
        Some(Ok(slips)) if (0.0..=60.0).contains(&slips) => Some(slips),
        Some(_) => return Err(format!("expected 0 to 60 for SLIPS, got {:?}", args[4]).into()),
    };
    let conditions = Conditions { physics, slips_per_min, ..Conditions::default() };
    let (_, models) = setup(glove, &model).map_err(|error| error.to_string())?;
    if models.infos[0].contract.artifact.is_none() {
        return Err(format!("{}: has no artifact model, which says how taxels read a touch", model.display()).into());
    }
    let mut out = std::io::stdout().lock();
    let shown = model.display();
    let slips = args.get(4).map(|slips| format!(", {slips} sudden slips/min")).unwrap_or_default();
    writeln!(
        out,
        "SYNTHETIC data. Frames with contact and mean force, glove {glove}, physics {asked}{slips}, {shown}\n"
    )?;
    for tracking in [Tracking::Markers, Tracking::Camera] {
        for user in 1..=n_users.get() {
            let worn = Worn::new((glove, &conditions), &model, tracking, user, 2.0);
            let mut row = |what: &str, felt: &[Felt], spans: &[(&str, f64, f64)]| -> std::io::Result<()> {
                let told: Vec<String> = spans.iter().map(|span| of_span(felt, *span)).collect();
                writeln!(out, "{tracking:?}, user {user}, {what:22} {}", told.join("   "))
            };
            for force in HELD_GF {
                let felt = worn.feel(CALIBRATED_S, for_a_minute(force));
                let spans = [
                    ("first 4 s", 40.5, 44.5),
                    ("last 4 s", 96.0, 100.0),
                    ("after", 101.0, 106.0),
                    ("all but the first second", 41.0, 100.0),
                ];
                row(&format!("{force} gF for a minute"), &felt, &spans)?;
            }
            for force in AT_START_GF {
                let felt = worn.feel(15.0, |at_s| if at_s < 42.0 { force } else { 0.0 });
                let spans = [("first 5 s", 15.0, 20.0), ("last 5 s", 37.0, 42.0), ("after", 43.0, 60.0)];
                row(&format!("{force} gF at the start"), &felt, &spans)?;
            }
            let felt = worn.feel(CALIBRATED_S, slow_ramp);
            let spans = [("5 gF", 49.0, 51.0), ("10 gF", 59.0, 61.0), ("15 gF", 69.0, 71.0), ("30 gF", 110.0, 116.0)];
            row("0.5 gF more a second", &felt, &spans)?;
            let worn = Worn::new((glove, &conditions), &model, tracking, user, 12.0);
            let felt = worn.feel(CALIBRATED_S, long_grasp);
            let spans =
                [("before", 14.0, 40.0), ("grasp", 41.0, 640.0), ("5 s after", 640.3, 645.0), ("later", 645.0, 700.0)];
            row("grasp of ten minutes", &felt, &spans)?;
            let felt = worn.feel(CALIBRATED_S, let_go_in_part);
            let spans = [("30 gF", 345.0, 400.0), ("5 s after", 400.3, 405.0), ("later", 405.0, 460.0)];
            row("let go in part", &felt, &spans)?;
            let felt = worn.feel(CALIBRATED_S, five_light_minutes);
            let spans = [
                ("first 4 s", 41.0, 45.0),
                ("last 10 s", 330.0, 340.0),
                ("5 s after", 340.3, 345.0),
                ("later", 345.0, 400.0),
            ];
            row("five light minutes", &felt, &spans)?;
        }
    }
    Ok(())
}

/// A grasp of five minutes, from 40 s on, of which 30 gF are left for a minute.
fn let_go_in_part(at_s: f64) -> f64 {
    match at_s {
        ..340.0 => long_grasp(at_s),
        340.0..400.0 => 30.0,
        _ => 0.0,
    }
}

/// 20 gF that change a little, for five minutes from 40 s on.
fn five_light_minutes(at_s: f64) -> f64 {
    if (40.0..340.0).contains(&at_s) { 20.0 + 5.0 * (at_s / 3.0).sin() } else { 0.0 }
}

/// What was felt in a span of time, s, with its name.
fn of_span(felt: &[Felt], (name, from_s, to_s): (&str, f64, f64)) -> String {
    let (found, force_gf) = in_span(felt, from_s, to_s);
    format!("{name}: {:.0} %, {force_gf:.1} gF", 100.0 * found)
}

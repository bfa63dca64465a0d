//! Draws how the gain of an artifact is followed while the glove is worn:
//! `cargo run --release --example followed_gain -- params/glove3.yaml models/glove3_adaptive.onnx BAG > gain.svg`.
//!
//! The bag is replayed three times: with the artifact left in the taxels, with that of the calibration, and with the one that is
//! followed. For the taxel with the largest artifact it shows how many times the artifact of the calibration there is: in hindsight,
//! from what the taxel read, and as followed, from what was taken out of it frame by frame, when no later frame was known. Both are
//! least squares over the same frames: those that are annotated as without load, within ten seconds.

use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::BagReader;
use tactile_pose_fusion::config::{self, DEFAULT_NODE};
use tactile_pose_fusion::fusion::Following;
use tactile_pose_fusion::msg::{Stage, from_cdr};
use tactile_pose_fusion::observer::Observer;
use tactile_pose_fusion::protocol::Annotations;
use tactile_pose_fusion::replay::{self, Recording};
use tactile_pose_fusion::units::Stamp;
use tactile_pose_fusion::zero::Wanted;

/// Frames within this time of a moment decide its gain, s.
const AROUND_S: f64 = 10.0;

/// Time from one point of the picture to the next, s.
const STEP_S: f64 = 2.0;

const WIDTH: f64 = 820.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 60.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;

/// Shows nothing.
struct Silent;

impl Observer for Silent {}

/// Stamps, and the taxels of the first region as its model is given them. `[frames][taxels]`
type Features = (Vec<Stamp>, Vec<Vec<f32>>);

fn features(params: &str, model: &str, bag: &str, following: Following) -> Result<Features, Box<dyn Error>> {
    let mut cfg = config::load(Path::new(params), DEFAULT_NODE)?;
    tactile_pose_fusion::glove::replace_model(&mut cfg, PathBuf::from(model))?;
    cfg.calibration.insist = true; // with the artifact left in, the zero looks loaded
    cfg.set_following(following);
    cfg.set_kept_taxels(true);
    let (mut stamps, mut taxels) = (Vec::new(), Vec::new());
    let bags = [PathBuf::from(bag)];
    replay::for_each(cfg, Recording { bags: &bags, zero: Wanted::Any }, &Silent, |tick| {
        stamps.push(tick.stamp);
        taxels.push(tick.taxels.feature.clone());
    })?;
    Ok((stamps, taxels))
}

fn annotations(bag: &str) -> Result<Annotations, Box<dyn Error>> {
    let mut reader = BagReader::open(&[PathBuf::from(bag)])?;
    let mut annotations = Annotations::default();
    while let Some(message) = reader.next_message()? {
        if message.channel.topic == "/stage" {
            annotations.handle(from_cdr::<Stage>(message.data)?.into());
        }
    }
    Ok(annotations)
}

/// The factor by which `of` explains `reading` best. `None` if `of` hardly moves.
fn factor(pairs: impl Iterator<Item = (f64, f64)>, least: f64) -> Option<f64> {
    let (mut products, mut squares) = (0.0, 0.0);
    for (reading, of) in pairs.filter(|(reading, of)| reading.is_finite() && of.is_finite()) {
        products += reading * of;
        squares += of * of;
    }
    (squares > least).then(|| products / squares)
}

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [params, model, bag] = args.as_slice() else { return Err("followed_gain PARAMS.yaml MODEL.onnx BAG".into()) };
    let (stamps, left) = features(params, model, bag, Following::Off)?;
    let (_, calibrated) = features(params, model, bag, Following::Frozen)?;
    let (_, followed) = features(params, model, bag, Following::On)?;
    let annotations = annotations(bag)?;
    let is_air: Vec<bool> =
        stamps.iter().map(|stamp| annotations.at(*stamp).is_some_and(|annotation| annotation.zero_load)).collect();
    let value = |of: &[Vec<f32>], frame: usize, taxel: usize| {
        of.get(frame).and_then(|taxels| taxels.get(taxel)).map_or(f64::NAN, |value| f64::from(*value))
    };
    // Artifacts are what the models are not given.
    let of_calibration = |frame, taxel| value(&left, frame, taxel) - value(&calibrated, frame, taxel);
    let as_followed = |frame, taxel| value(&left, frame, taxel) - value(&followed, frame, taxel);
    let power = |taxel: usize| {
        let squares =
            (0..stamps.len()).map(|frame| of_calibration(frame, taxel).powi(2)).filter(|square| square.is_finite());
        squares.sum::<f64>()
    };
    let n_taxels = left.iter().map(Vec::len).max().unwrap_or(0);
    let taxel = (0..n_taxels).max_by(|a, b| power(*a).total_cmp(&power(*b))).ok_or("the bag has no frames")?;
    // Moments around which the finger hardly bends tell no gain.
    let least = 0.1 * power(taxel) * 2.0 * AROUND_S / (stamps.len() as f64 / 100.0).max(1.0);

    let (Some(first), Some(last)) = (stamps.first(), stamps.last()) else { return Err("the bag has no frames".into()) };
    let seconds = |stamp: &Stamp| stamp.nanos_since(*first) as f64 * 1e-9;
    let (mut hindsight, mut follow) = (Vec::new(), Vec::new());
    let n_points = (seconds(last) / STEP_S) as usize;
    for t_s in (0..n_points).map(|point| point as f64 * STEP_S) {
        let from = stamps.partition_point(|stamp| seconds(stamp) < t_s - AROUND_S);
        let to = stamps.partition_point(|stamp| seconds(stamp) < t_s + AROUND_S);
        let air = || (from..to).filter(|frame| is_air[*frame]);
        let known = factor(air().map(|frame| (value(&left, frame, taxel), of_calibration(frame, taxel))), least);
        hindsight.extend(known.map(|known| (t_s, known)));
        let taken = factor(air().map(|frame| (as_followed(frame, taxel), of_calibration(frame, taxel))), least);
        follow.extend(taken.map(|taken| (t_s, taken)));
    }
    let left_over = |taken: &dyn Fn(usize) -> f64| {
        let air = (0..stamps.len()).filter(|frame| is_air[*frame]);
        let squares: Vec<f64> = air.map(|frame| (value(&left, frame, taxel) - taken(frame)).powi(2)).collect();
        let squares: Vec<f64> = squares.into_iter().filter(|square| square.is_finite()).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    };
    writeln!(
        std::io::stderr(),
        "taxel {taxel} without load, root mean square: {:.1} above its zero; {:.1} without the artifact of the calibration; {:.1} without the one that is followed",
        left_over(&|_| 0.0),
        left_over(&|frame| of_calibration(frame, taxel)),
        left_over(&|frame| as_followed(frame, taxel))
    )?;
    let picture = draw(&hindsight, &follow, seconds(last), taxel);
    std::io::stdout().write_all(picture.as_bytes())?;
    Ok(())
}

fn draw(hindsight: &[(f64, f64)], follow: &[(f64, f64)], end_s: f64, taxel: usize) -> String {
    let all = || hindsight.iter().chain(follow).map(|(_, gain)| *gain).chain([1.0]);
    let low = (10.0 * all().fold(f64::INFINITY, f64::min)).floor() / 10.0;
    let high = (10.0 * all().fold(f64::NEG_INFINITY, f64::max)).ceil() / 10.0;
    let x = |t_s: f64| LEFT + (WIDTH - LEFT - 20.0) * t_s / end_s.max(1.0);
    let y = |gain: f64| TOP + (HEIGHT - TOP - BOTTOM) * (high - gain) / (high - low).max(0.1);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n\
         <text x=\"{LEFT}\" y=\"20\" fill=\"#222222\">SYNTHETIC data, taxel {taxel}: artifact, in multiples of that of the calibration</text>\n"
    );
    let (from, to) = ((10.0 * low).round() as i64, (10.0 * high).round() as i64);
    let every = if to - from > 8 { 2 } else { 1 };
    for tenth in (from..=to).filter(|tenth| tenth % every == 0) {
        let gain = tenth as f64 / 10.0;
        let stroke = if tenth == 10 { "#888888" } else { "#e2e2e2" };
        let _ = writeln!(
            svg,
            "<line x1=\"{LEFT}\" x2=\"{}\" y1=\"{1:.1}\" y2=\"{1:.1}\" stroke=\"{stroke}\"/>\
             <text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\" fill=\"#444444\">{gain:.1}</text>",
            WIDTH - 20.0,
            y(gain),
            LEFT - 8.0,
            y(gain) + 4.0
        );
    }
    for minute in 0..=(end_s / 60.0) as usize {
        let at = x(minute as f64 * 60.0);
        let below = HEIGHT - BOTTOM + 18.0;
        let _ = writeln!(
            svg,
            "<text x=\"{at:.1}\" y=\"{below}\" text-anchor=\"middle\" fill=\"#444444\">{minute} min</text>"
        );
    }
    for (gain, known) in hindsight.iter().map(|(t_s, gain)| (gain, x(*t_s))) {
        let _ = writeln!(svg, "<circle cx=\"{known:.1}\" cy=\"{:.1}\" r=\"2.6\" fill=\"#e69f00\"/>", y(*gain));
    }
    // Where nothing was free of load, nothing is drawn.
    for part in follow.chunk_by(|(before, _), (after, _)| after - before < 1.5 * STEP_S) {
        let line: Vec<String> = part.iter().map(|(t_s, gain)| format!("{:.1},{:.1}", x(*t_s), y(*gain))).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"2\"/>",
            line.join(" ")
        );
    }
    let legend = HEIGHT - 8.0;
    let _ = writeln!(
        svg,
        "<line x1=\"{LEFT}\" x2=\"{}\" y1=\"{1}\" y2=\"{1}\" stroke=\"#0072b2\" stroke-width=\"2\"/>\
         <text x=\"{2}\" y=\"{legend}\" fill=\"#222222\">as followed while the glove is worn</text>\
         <circle cx=\"{3}\" cy=\"{1}\" r=\"2.6\" fill=\"#e69f00\"/>\
         <text x=\"{4}\" y=\"{legend}\" fill=\"#222222\">in hindsight, from frames without load</text>\n</svg>",
        LEFT + 24.0,
        legend - 4.0,
        LEFT + 30.0,
        LEFT + 310.0,
        LEFT + 320.0
    );
    svg
}

//! The touches in a recording: `cargo run --example touches_of_a_bag -- params/glove3.yaml BAG`.
//!
//! Replays the bag in memory and prints, for each region, when each contact began, how long it lasted and how hard it was.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};

use tactile_pose_fusion::config::{self, DEFAULT_NODE};
use tactile_pose_fusion::fusion::RegionIdx;
use tactile_pose_fusion::observer::Observer;
use tactile_pose_fusion::replay::{self, Recording};
use tactile_pose_fusion::units::Stamp;
use tactile_pose_fusion::zero::Wanted;

/// Shows notes, and nothing else.
struct Notes;

impl Observer for Notes {
    fn note(&self, text: &str) {
        let _ = writeln!(std::io::stderr(), "{text}");
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(params), Some(bag)) = (args.next(), args.next()) else {
        return Err("touches_of_a_bag PARAMS.yaml BAG".into());
    };
    let cfg = config::load(Path::new(&params), DEFAULT_NODE)?;
    let names: Vec<String> = cfg.fusion().regions().iter().map(|region| region.name.clone()).collect();
    let bags = [PathBuf::from(bag)];

    // By region: the touch that goes on, since when and how hard.
    let mut touches: BTreeMap<RegionIdx, (Stamp, f64)> = BTreeMap::new();
    let mut stdout = std::io::stdout().lock();
    let mut printed = Ok(());
    let seen = replay::for_each(cfg, Recording { bags: &bags, zero: Wanted::Any }, &Notes, |tick| {
        for estimate in &tick.estimates {
            let force = estimate.force.map_or(0.0, |force| force.0);
            if estimate.contact.state {
                let (_, peak) = touches.entry(estimate.region).or_insert((tick.stamp, 0.0));
                *peak = peak.max(force);
            } else if let Some((since, peak)) = touches.remove(&estimate.region) {
                let (name, lasted_s) = (&names[estimate.region.position()], tick.stamp.nanos_since(since) as f64 / 1e9);
                let line = writeln!(stdout, "{name},{:.3},{lasted_s:.3},{peak:.3}", since.0 as f64 / 1e9);
                printed = std::mem::replace(&mut printed, Ok(())).and(line);
            }
        }
    })?;
    seen.warnings.iter().for_each(|warning| Notes.note(warning));
    Ok(printed?)
}

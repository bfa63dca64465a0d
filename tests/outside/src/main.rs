//! Replays a simulated session in memory and scores it, with the library alone: `outside ROOT FOLDER`.

use std::error::Error;
use std::path::PathBuf;

use tactile_pose_fusion::config::{self, DEFAULT_NODE};
use tactile_pose_fusion::evaluate::{self, Request};
use tactile_pose_fusion::observer::Unobserved;
use tactile_pose_fusion::replay::{self, Recording};
use tactile_pose_fusion::sim::SessionSpec;
use tactile_pose_fusion::synthetic;
use tactile_pose_fusion::zero::Wanted;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [root, folder] = args.as_slice() else { return Err("outside ROOT FOLDER".into()) };
    let (activity, tracking, conditions) = Default::default();
    let spec = SessionSpec { glove: 3, user: 1, session: 3, seed: 1, minutes: 2.0, activity, tracking, conditions };
    let bags = [folder.join("session")];
    synthetic::write(&spec, &bags[0], false, &Unobserved)?;

    let cfg = config::load(&root.join("params/glove3.yaml"), DEFAULT_NODE)?;
    let (mut n_frames, mut n_touching) = (0_u64, 0_u64);
    let recording = Recording { bags: &bags, zero: Wanted::Any };
    let seen = replay::for_each(cfg.clone(), recording, &Unobserved, |tick| {
        n_frames += 1;
        n_touching += u64::from(tick.estimates[0].contact.state);
    })?;
    if !seen.warnings.is_empty() || n_frames < 10_000 || n_touching * 20 < n_frames || n_touching * 4 > 3 * n_frames {
        return Err(format!("{n_touching} of {n_frames} frames touch: {:?}", seen.warnings).into());
    }

    let found = evaluate::run(cfg, &Request::new(&bags), &Unobserved)?;
    let judged = found.models.last().ok_or("nothing was scored")?;
    let ba = judged.by["all"][0].score.ba.value().ok_or("no balanced accuracy")?;
    if !found.synthetic || ba < 0.8 {
        return Err(format!("BA {ba}").into());
    }
    println!("{n_touching} of {n_frames} frames touch, BA {:.1} % (synthetic)", 100.0 * ba);
    Ok(())
}

//! Force from samples of your own: `cargo run --example own_samples -- params/glove3.yaml < samples.csv`.
//!
//! Each line of stdin is a sample: its time in seconds, the taxels of the first tactile source, then the joint angles of the
//! first region in rad. The first seconds (`calibration.min_s`) must be without load. It prints time, force in newtons and flags.

use std::error::Error;
use std::io::{BufRead, Write};

use tactile_pose_fusion::fusion::{BaselineBuilder, Event, JointSample, TactileBlock};
use tactile_pose_fusion::glove::Glove;
use tactile_pose_fusion::units::{NANOS_PER_SEC, Stamp};
use tactile_pose_fusion::zero;

fn main() -> Result<(), Box<dyn Error>> {
    let params = std::env::args().nth(1).ok_or("own_samples PARAMS.yaml < samples.csv")?;
    let glove = Glove::load(params)?;
    let n_taxels = glove.config().fusion().tactile_sources()[0].n_taxels;
    let names = glove.config().fusion().regions()[0].joints.clone();
    let limits = zero::limits(&glove.config().calibration);
    let mut core = glove.into_core()?;
    let tactile = core.config().tactile_source_idxs().next().ok_or("no tactile source")?;
    let hand = core.config().joint_source_idxs().next();

    let mut rest = Some(BaselineBuilder::new(n_taxels, NANOS_PER_SEC / 2));
    let mut stdout = std::io::stdout().lock();
    let mut first = None;
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let numbers = line.split(',').map(|number| number.trim().parse()).collect::<Result<Vec<f64>, _>>()?;
        let [seconds, values @ ..] = numbers.as_slice() else { return Err("a line without numbers".into()) };
        let (taxels, positions) = values.split_at_checked(n_taxels).ok_or("a line with too few taxels")?;
        let taxels: Vec<f32> = taxels.iter().map(|reading| *reading as f32).collect();
        let stamp = Stamp((seconds * 1e9) as i64);

        let begun = *first.get_or_insert(stamp);
        if let Some(builder) = &mut rest {
            builder.handle_sample(stamp, &taxels);
            if stamp.nanos_since(begun) as f64 > limits.min_s * 1e9 {
                core.handle_baseline(tactile, builder.finish(&limits)?)?;
                rest = None;
            }
        }
        if let Some(source) = hand {
            core.handle(Event::Joints(JointSample { source, stamp, names: &names, positions, received: stamp }))?;
        }
        let (source, values, received) = (tactile, taxels.as_slice(), stamp);
        let (rows, row_period_ns, sequence) = (1, 0, None);
        core.handle(Event::Tactile(TactileBlock { source, stamp, rows, row_period_ns, sequence, values, received }))?;
        while let Some(tick) = core.poll()? {
            let estimate = &tick.estimates[0];
            let force = estimate.force.map_or(f64::NAN, |force| force.0);
            writeln!(stdout, "{:.3},{force:.4},{}", tick.stamp.0 as f64 / 1e9, estimate.flags)?;
        }
    }
    Ok(())
}

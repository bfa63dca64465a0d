//! Sequences of events into the core.

use std::num::NonZeroU32;

use arbitrary::{Result, Unstructured};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::units::{Newton, Stamp};

use super::common::fake::{self, MS, Sum};
use super::driver::{Answer, Target};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "core", seeds, mutate: other, run, min_understood: 0.3 };

const JOINTS: [&str; 4] = ["dip", "pip", "mcp", "other"];
const ANGLES: [f64; 10] = [0.0, 0.5, -1.5, 3.0, f64::NAN, f64::INFINITY, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 1e39];
const READINGS: [f32; 9] = [0.0, 1.0, -2.0, 100.0, f32::NAN, f32::INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE];
const STEPS_MS: [i64; 16] = [10, 10, 10, 10, 10, 10, 9, 11, 5, 1, 20, 40, 60, 300, -5, -500];
const STAMPS: [i64; 6] = [0, i64::MAX, i64::MIN, 1, -1, 1_700_000_000_000_000_000];

fn seeds() -> Vec<Vec<u8>> {
    let mut random = Random::new(1);
    (0..40).map(|k| random.bytes(50 + 40 * k)).collect()
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut input = seed.to_vec();
    mutate::bytes(random, &mut input, other);
    if random.percent(20) {
        let n = random.below(400);
        input.extend(random.bytes(n));
    }
    input
}

fn run(input: &[u8]) -> Answer {
    let mut bytes = Unstructured::new(input);
    let Ok(mut core) = setup(&mut bytes) else { return Answer::refused("too short to set anything up") };
    let mut n_ticks = 0;
    let mut newest = Stamp(1_000_000_000);
    while !bytes.is_empty() && event(&mut bytes, &mut core, &mut newest, &mut n_ticks).is_ok() {}
    core.handle_end();
    n_ticks += drain(&mut core);
    check_counters(&core, n_ticks);
    let counters = core.counters();
    // Which counters have ever moved: a sequence that moves another set of them is a new kind.
    let text = serde_json::to_value(&counters).unwrap();
    let mut moved = Vec::new();
    for list in ["tactile", "joints", "regions"] {
        for counts in text[list].as_array().unwrap() {
            moved.extend(counts.as_object().unwrap().values().map(|count| count.as_u64().is_some_and(|n| n > 0)));
        }
    }
    let n_estimates: u64 = counters.regions.iter().map(|region| region.counts.estimates).sum();
    if n_estimates == 0 {
        return Answer::refused("no estimate");
    }
    Answer::understood(&moved)
}

/// A core of a few sources, regions and models.
fn setup(bytes: &mut Unstructured<'_>) -> Result<Fusion> {
    let n_taxels = bytes.int_in_range(1..=3)?;
    let n_sources = bytes.int_in_range(1..=2)?;
    let n_regions = bytes.int_in_range(1..=3)?;
    let window = bytes.int_in_range(1..=5)?;
    let mut models: Vec<Box<dyn Regressor>> = Vec::new();
    let mut regions = Vec::new();
    let rate_hz = *bytes.choose(&[100.0, 100.0, 100.0, 1.0, 37.5, 10_000.0])?;
    for idx in 0..n_regions {
        let joints = &JOINTS[..bytes.int_in_range(0..=2)?];
        let mut contract = fake::contract(window, n_taxels, joints.len());
        contract.has_base = bytes.ratio(3, 4)?;
        contract.rate_hz = rate_hz;
        contract.pose_range = bytes.ratio(1, 2)?.then(|| vec![PoseRange { min: -1.0, max: 1.0 }; joints.len()]);
        let mut region = fake::region(&format!("r{idx}"), &(0..n_taxels).collect::<Vec<_>>(), joints);
        region.source = TactileSourceIdx::at(bytes.int_in_range(0..=n_sources - 1)?);
        region.model = ModelIdx::at(models.len());
        region.contact.on_frames = NonZeroU32::new(bytes.int_in_range(1..=3)?).unwrap();
        models.push(Box::new(Sum { contract }));
        regions.push(region);
    }
    let batch = fake::batch_of(bytes.int_in_range(1..=4)?);
    let tactile_sources = (0..n_sources)
        .map(|idx| -> Result<TactileSource> {
            Ok(TactileSource {
                name: format!("t{idx}"),
                n_taxels,
                stamp_offset_ns: *bytes.choose(&[0, 0, 0, -3 * MS, i64::MAX, i64::MIN])?,
                inverted: bytes.arbitrary()?,
                frame_clock: if bytes.ratio(1, 3)? { FrameClock::Grid } else { FrameClock::Tactile },
            })
        })
        .collect::<Result<_>>()?;
    let joint_sources = (0..2)
        .map(|idx| -> Result<JointSource> {
            let scale = *bytes.choose(&[1.0, 1.0, 0.017, 1e300])?;
            Ok(JointSource { name: format!("j{idx}"), stamp_offset_ns: 0, scale })
        })
        .collect::<Result<_>>()?;
    let cfg =
        FusionConfig::new(tactile_sources, joint_sources, regions, fake::timing()).expect("regions have their source");
    let mut core = Fusion::new(cfg.with_batch(batch), models).expect("regions and models fit");
    for source in 0..n_sources {
        if bytes.ratio(5, 6)? {
            core.handle_baseline(TactileSourceIdx::at(source), Baseline::from_median(vec![0.5; n_taxels])).unwrap();
        }
    }
    Ok(core)
}

/// One event, or something else that a shell does to a core.
fn event(bytes: &mut Unstructured<'_>, core: &mut Fusion, newest: &mut Stamp, n_ticks: &mut u64) -> Result<()> {
    let (n_sources, n_taxels) = (core.config().tactile_sources().len(), core.config().tactile_sources()[0].n_taxels);
    let kind = bytes.int_in_range(0..=15)?;
    let mut stamp = |bytes: &mut Unstructured<'_>, share: i64| -> Result<Stamp> {
        if bytes.ratio(1, 60)? {
            return Ok(Stamp(*bytes.choose(&STAMPS)?));
        }
        let at = newest.offset(*bytes.choose(&STEPS_MS)? * MS / share);
        *newest = at;
        Ok(at)
    };
    match kind {
        0..=7 => {
            let source = bytes.int_in_range(0..=n_sources - 1)?;
            let rows = if bytes.ratio(3, 4)? { 1 } else { bytes.int_in_range(0..=4)? };
            let wrong = usize::from(bytes.ratio(1, 30)?);
            let mut values = Vec::new();
            for _ in 0..rows * n_taxels + wrong {
                let special = bytes.ratio(1, 20)?;
                values.push(if special { *bytes.choose(&READINGS)? } else { f32::from(bytes.arbitrary::<i8>()?) });
            }
            let at = stamp(bytes, 1)?;
            let row_period_ns = if rows == 1 { 0 } else { *bytes.choose(&[MS, 5 * MS, 0, -1, i64::MAX, i64::MIN])? };
            let sequence = if bytes.ratio(1, 2)? { Some(bytes.arbitrary()?) } else { None };
            let source = TactileSourceIdx::at(source);
            core.handle(Event::Tactile(TactileBlock {
                source,
                stamp: at,
                rows,
                row_period_ns,
                sequence,
                values: &values,
                received: at,
            }))
            .unwrap();
        }
        8..=13 => {
            let n = bytes.int_in_range(0..=3)?;
            let names: Vec<String> = JOINTS[..n].iter().map(|name| (*name).to_owned()).collect();
            let n_positions = if bytes.ratio(1, 30)? { n + 1 } else { n };
            let mut positions = Vec::new();
            for _ in 0..n_positions {
                let special = bytes.ratio(1, 10)?;
                positions.push(if special {
                    *bytes.choose(&ANGLES)?
                } else {
                    f64::from(bytes.arbitrary::<i8>()?) / 64.0
                });
            }
            let at = stamp(bytes, 3)?;
            let source = JointSourceIdx::at(bytes.int_in_range(0..=1)?);
            let (names, positions) = (&names[..], &positions[..]);
            core.handle(Event::Joints(JointSample { source, stamp: at, names, positions, received: at })).unwrap();
        }
        14 if bytes.ratio(1, 4)? => {
            let source = TactileSourceIdx::at(bytes.int_in_range(0..=n_sources - 1)?);
            let median = *bytes.choose(&READINGS)?;
            let _ = core.handle_baseline(source, Baseline::from_median(vec![median; n_taxels]));
        }
        15 if bytes.ratio(1, 4)? => {
            let (force_on, force_off) = (Newton(2.0), Newton(1.0));
            let (on_frames, off_frames) = (NonZeroU32::new(2).unwrap(), NonZeroU32::MIN);
            let by = if bytes.ratio(1, 2)? { ContactBy::Model } else { ContactBy::Force };
            let touch = bytes.ratio(1, 2)?.then(|| TouchLevels::from_on(0.5));
            let touch_evidence = *bytes.choose(&[0.0, 6.0, 1000.0])?;
            let thresholds =
                ContactThresholds { by, touch, touch_evidence, force_on, force_off, on_frames, off_frames };
            core.handle_thresholds(&vec![thresholds; core.config().regions().len()]).unwrap();
        }
        _ => *n_ticks += drain(core),
    }
    Ok(())
}

/// Takes out what is finished and checks it; how many ticks it was.
pub fn drain(core: &mut Fusion) -> u64 {
    let mut n_ticks = 0;
    let n_of_source =
        |source| core.config().regions().iter().filter(|region: &&RegionConfig| region.source == source).count();
    let n_of: Vec<usize> = core.config().tactile_source_idxs().map(n_of_source).collect();
    while let Some(tick) = core.poll().expect("the model can't fail") {
        n_ticks += 1;
        assert_eq!(tick.estimates.len(), n_of[tick.source.position()]);
        for estimate in &tick.estimates {
            let finite = |force: Option<Newton>| force.is_none_or(|force| force.0.is_finite());
            assert!(finite(estimate.force) && finite(estimate.force_base) && finite(estimate.artifact()));
            assert!(estimate.force.is_some() || !estimate.flags.is_empty(), "nothing, and no flag says why");
            let none = Flags::WARMUP | Flags::UNCALIBRATED | Flags::NON_FINITE | Flags::FROZEN;
            assert!(estimate.force.is_none() || estimate.flags.bits() & none.bits() == 0, "{}", estimate.flags);
            assert!(!estimate.contact.raw || estimate.force.is_some());
            assert!(estimate.pose_age_ns.is_none_or(|age_ns| age_ns >= 0));
        }
    }
    n_ticks
}

/// Every sample is used or dropped with a reason, and every frame has an estimate or a reason for none.
pub fn check_counters(core: &Fusion, n_ticks: u64) {
    assert_eq!(core.n_pending(), 0);
    let counters = core.counters();
    for (source, cfg) in counters.tactile.iter().zip(core.config().tactile_sources()) {
        let t = source.counts;
        assert_eq!(t.rows, t.used + t.duplicate + t.out_of_order + t.wrong_length + t.no_row_period);
        assert!(cfg.frame_clock == FrameClock::Grid || t.used == t.frames);
        assert!(source.measured_rate_hz.is_none_or(|rate| rate.is_finite() && rate >= 0.0));
    }
    assert_eq!(counters.tactile.iter().map(|source| source.counts.frames).sum::<u64>(), n_ticks);
    for source in &counters.joints {
        let j = source.counts;
        assert_eq!(j.messages, j.used + j.unknown + j.duplicate + j.out_of_order + j.nothing_finite + j.malformed);
    }
    for (region, cfg) in counters.regions.iter().zip(core.config().regions()) {
        let r = region.counts;
        assert_eq!(r.frames, r.estimates + r.warmup + r.uncalibrated + r.stale_pose + r.non_finite + r.frozen);
        assert_eq!(r.frames, counters.tactile[cfg.source.position()].counts.frames);
    }
}

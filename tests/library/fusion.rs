//! What the fusion core promises, shown with a model whose answers can be worked out by hand.

use crate::common;

use common::fake::*;
use proptest::prelude::*;
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::units::{Newton, Stamp};

/// 100 Hz taxels and joints, joints 3 ms after each frame.
fn steady(n_frames: usize, joint_from: usize, joint_to: usize) -> Vec<Sample> {
    let mut samples = Vec::new();
    for k in 0..n_frames {
        samples.push(Sample::tactile(10.0 * k as f64, &[k as f32, 0.0]));
        if (joint_from..joint_to).contains(&k) {
            samples.push(Sample::joints(10.0 * k as f64 + 3.0, &[("dip", 0.25 * k as f64)]));
        }
    }
    samples
}

fn one_region() -> Fusion {
    fusion(config(2, vec![region("index", &[0, 1], &["dip"])]), vec![Sum::boxed(4, 2, 1)])
}

#[test]
fn force_is_the_base_minus_what_pose_explains() {
    let estimates = run(&mut one_region(), &steady(20, 0, 20));
    assert_eq!(estimates.len(), 20);
    for (k, (stamp, estimate)) in estimates.iter().enumerate().skip(4) {
        assert_eq!(stamp.0, k as i64 * 10 * MS);
        // Joint states lie at 3 ms past each frame, so the angle at frame k is 0.25 * (k - 0.3).
        let base = k as f32 + 1e-3 * (k as f32 - 3.0);
        let expected = f64::from(base - (0.25 * (k as f64 - 0.3)) as f32);
        assert!((estimate.force.unwrap().0 - expected).abs() < 1e-5, "frame {k}"); // f32 sums
        assert_eq!(estimate.force_base, Some(Newton(f64::from(base))));
        assert_eq!(estimate.artifact().unwrap().0, f64::from(base) - estimate.force.unwrap().0);
        assert_eq!((estimate.pose_age_ns, estimate.flags), (Some(0), Flags::default()));
    }
}

#[test]
fn a_window_that_is_not_full_gives_no_estimate() {
    let estimates = run(&mut one_region(), &steady(20, 0, 20));
    for (_, estimate) in &estimates[..3] {
        assert_eq!((estimate.force, estimate.flags), (None, Flags::WARMUP));
    }
    assert!(estimates[3].1.flags == Flags::STALE_POSE, "the first frame came before any joint state");
}

#[test]
fn without_a_baseline_there_is_no_estimate() {
    let mut core = Fusion::new(config(2, vec![region("index", &[0, 1], &["dip"])]), vec![Sum::boxed(4, 2, 1)]).unwrap();
    let estimates = run(&mut core, &steady(10, 0, 10));
    assert!(estimates.iter().all(|(_, e)| e.force.is_none() && e.flags == Flags::UNCALIBRATED));
    assert_eq!(core.counters().regions[0].counts.uncalibrated, 10);
}

#[test]
fn a_dead_joint_stream_leaves_the_base_alone_and_recovers() {
    let mut samples = steady(20, 0, 20);
    samples.extend(steady(60, 40, 60).into_iter().filter(|sample| sample.at_ns() >= 200 * MS));
    let estimates = run(&mut one_region(), &samples);
    let held = &estimates[24].1;
    assert_eq!((held.pose_age_ns, held.flags), (Some(47 * MS), Flags::default()), "held up to max_pose_age");
    let stale = &estimates[30].1;
    assert_eq!(stale.flags, Flags::STALE_POSE);
    assert_eq!((stale.force, stale.artifact()), (stale.force_base, None));
    assert_eq!(estimates[43].1.flags, Flags::STALE_POSE, "a window with one stale frame is stale");
    assert_eq!(estimates[44].1.flags, Flags::default());
}

#[test]
fn a_model_without_a_base_branch_gives_nothing_on_a_stale_pose() {
    let mut contract = contract(4, 2, 1);
    contract.has_base = false;
    let mut core = fusion(config(2, vec![region("index", &[0, 1], &["dip"])]), vec![Box::new(Sum { contract })]);
    let estimates = run(&mut core, &steady(30, 0, 10));
    let last = &estimates[29].1;
    assert_eq!((last.force, last.force_base, last.flags), (None, None, Flags::STALE_POSE));
    assert!(core.counters().regions[0].counts.stale_pose > 0);
}

#[test]
fn taxels_that_are_kept_are_those_of_their_frame_and_change_no_estimate() {
    let mut samples = steady(30, 0, 30);
    samples.insert(40, Sample::tactile(200.0, &[f32::NAN, 1.0]));
    samples.retain(
        |sample| !matches!(sample, Sample::Tactile { at_ns, values } if *at_ns == 200 * MS && values[0] == 20.0),
    );
    for batch in [1, 7] {
        let ticks = |keep_taxels: bool| {
            // The second region has its taxels in another order.
            let regions = vec![region("index", &[0, 1], &["dip"]), region("thumb", &[1, 0], &["dip"])];
            let cfg = config(2, regions).with_kept_taxels(keep_taxels).with_batch(batch_of(batch));
            let mut core = Fusion::new(cfg, vec![Sum::boxed(4, 2, 1)]).unwrap();
            let mut ticks = Vec::new();
            for (idx, sample) in samples.iter().enumerate() {
                if idx == 10 {
                    core.handle_baseline(TactileSourceIdx::at(0), Baseline::from_median(vec![2.0, -1.0])).unwrap();
                }
                core.handle(sample.event()).unwrap();
                while let Some(tick) = core.poll().unwrap() {
                    ticks.push(tick.clone());
                }
            }
            core.handle_end();
            while let Some(tick) = core.poll().unwrap() {
                ticks.push(tick.clone());
            }
            ticks
        };
        let (kept, plain) = (ticks(true), ticks(false));
        let estimates = |ticks: &[Tick]| ticks.iter().map(|tick| tick.estimates.clone()).collect::<Vec<_>>();
        assert_eq!(estimates(&kept), estimates(&plain));
        assert!(plain.iter().all(|tick| tick.taxels == TickTaxels::default()));
        assert_eq!(kept.len(), 30);
        for (k, tick) in kept.iter().enumerate() {
            let first = if k == 20 { f32::NAN } else { k as f32 };
            let second = if k == 20 { 1.0 } else { 0.0 };
            let same = |a: &[f32], b: &[f32]| {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
            };
            assert!(same(&tick.taxels.reading, &[first, second, second, first]), "{k}: {:?}", tick.taxels);
            let is_input = tick.estimates[0].flags != Flags::UNCALIBRATED && k != 20;
            let expected = if is_input { [first - 2.0, 1.0, 1.0, first - 2.0] } else { [f32::NAN; 4] };
            assert!(same(&tick.taxels.feature, &expected), "{k}: {:?}", tick.taxels);
        }
        assert!(
            kept[0].estimates[0].flags == Flags::UNCALIBRATED
                && kept[20].estimates[0].flags.contains(Flags::NON_FINITE)
        );
    }
}

#[test]
fn a_frame_far_from_its_receipt_is_late_where_receipts_are_those_of_a_live_run() {
    let samples = steady(30, 0, 30);
    let run = |receipts: Receipts, max_age: Option<std::time::Duration>, delay_ms: i64| {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
        let cfg = cfg.with_receipts(receipts).with_timing(Timing { max_age, ..timing() });
        let mut core = fusion(cfg, vec![Sum::boxed(4, 2, 1)]);
        let mut ticks = Vec::new();
        for sample in &samples {
            match sample.event() {
                Event::Tactile(block) => {
                    let received = block.received.offset(delay_ms * MS);
                    core.handle(Event::Tactile(TactileBlock { received, ..block })).unwrap();
                }
                Event::Joints(sample) => {
                    let received = sample.received.offset(delay_ms * MS);
                    core.handle(Event::Joints(JointSample { received, ..sample })).unwrap();
                }
            }
            while let Some(tick) = core.poll().unwrap() {
                ticks.push((tick.age_ns, tick.estimates[0]));
            }
        }
        let late = core.counters().regions[0].counts.late;
        (ticks, late)
    };
    let limit = Some(std::time::Duration::from_millis(100));
    let (on_time, n_late) = run(Receipts::Live, limit, 90);
    // The joint state 3 ms after a frame completes it.
    assert!(on_time.iter().all(|(age_ns, estimate)| *age_ns == Some(93 * MS) && !estimate.flags.contains(Flags::LATE)));
    assert_eq!(n_late, 0);
    for delay_ms in [98, 2000, -104] {
        let (late, n_late) = run(Receipts::Live, limit, delay_ms);
        assert!(late.iter().all(|(age_ns, _)| *age_ns == Some((delay_ms + 3) * MS)));
        assert!(late.iter().all(|(_, estimate)| estimate.flags.contains(Flags::LATE)), "{delay_ms} ms");
        assert_eq!(n_late as usize, late.len());
        let forces = |ticks: &[(Option<i64>, Estimate)]| ticks.iter().map(|(_, e)| e.force).collect::<Vec<_>>();
        assert_eq!(forces(&late), forces(&on_time), "the force is that of the stamp");
    }
    let (unlimited, _) = run(Receipts::Live, None, 2000);
    assert!(unlimited.iter().all(|(age_ns, e)| *age_ns == Some(2003 * MS) && !e.flags.contains(Flags::LATE)));
    let (unknown, _) = run(Receipts::Unknown, limit, 2000);
    assert!(unknown.iter().all(|(age_ns, e)| age_ns.is_none() && !e.flags.contains(Flags::LATE)));
}

/// Rows of two taxels that scatter by some of their steps, `(k * 7919) % 13` counts about 100 and 200.
fn noisy(k: usize) -> [f32; 2] {
    [100.0 + (k * 7919 % 13) as f32, 200.0 - (k * 7907 % 11) as f32]
}

/// A calibrated core whose taxels have noise of 6 counts, three of their steps.
fn with_noise(frame_clock: FrameClock) -> Fusion {
    let regions = vec![region("index", &[0, 1], &[]), region("thumb", &[1, 0], &[])];
    let cfg = config_of(TactileSource { frame_clock, ..glove(2) }, regions);
    let mut core = fusion(cfg, vec![Sum::boxed(4, 2, 0)]);
    let baseline = Baseline { noise: vec![6.0; 2], ..Baseline::from_median(vec![100.0, 200.0]) };
    core.handle_baseline(TactileSourceIdx::at(0), baseline).unwrap();
    core
}

/// Flags and forces of the first region.
fn index_of(core: &mut Fusion, samples: &[Sample]) -> Vec<(Flags, Option<Newton>)> {
    let estimates = run(core, samples).into_iter().filter(|(_, estimate)| estimate.region == RegionIdx::at(0));
    estimates.map(|(_, estimate)| (estimate.flags, estimate.force)).collect()
}

#[test]
fn a_source_that_repeats_its_last_sample_is_frozen_within_a_quarter_of_a_second_and_recovers() {
    for frame_clock in [FrameClock::Tactile, FrameClock::Grid] {
        let at = |k: usize| if (200..300).contains(&k) { 199 } else { k };
        let samples: Vec<Sample> = (0..400).map(|k| Sample::tactile(10.0 * k as f64, &noisy(at(k)))).collect();
        let mut core = with_noise(frame_clock);
        let index = index_of(&mut core, &samples);
        assert!(index[4..200].iter().all(|(flags, force)| flags.is_empty() && force.is_some()));
        assert!(index[225..300].iter().all(|(flags, force)| *flags == Flags::FROZEN && force.is_none()));
        assert_eq!(index[300].0, Flags::WARMUP, "what stood still is no window");
        assert!(index[304..].iter().all(|(flags, force)| flags.is_empty() && force.is_some()));
        let counters = core.counters();
        assert!(counters.tactile[0].counts.frozen >= 75 && counters.regions[0].counts.frozen >= 75);
        assert!(core.source_faults().is_empty());
    }
    // Nobody knows the noise, or it is less than a step: it may stand still.
    for noise in [0.0, 0.4] {
        let mut core = with_noise(FrameClock::Tactile);
        let baseline = Baseline { noise: vec![noise; 2], ..Baseline::from_median(vec![100.0, 200.0]) };
        core.handle_baseline(TactileSourceIdx::at(0), baseline).unwrap();
        let samples: Vec<Sample> = (0..400).map(|k| Sample::tactile(10.0 * k as f64, &noisy(k.min(200)))).collect();
        assert!(index_of(&mut core, &samples)[4..].iter().all(|(flags, force)| flags.is_empty() && force.is_some()));
    }
}

#[test]
fn a_taxel_that_sticks_while_others_go_on_is_faulty_until_it_moves() {
    let row = |k: usize| [noisy(k)[0], if (200..350).contains(&k) { 4095.0 } else { noisy(k)[1] }];
    let samples: Vec<Sample> = (0..400).map(|k| Sample::tactile(10.0 * k as f64, &row(k))).collect();
    let mut core = with_noise(FrameClock::Tactile);
    let index = index_of(&mut core, &samples[..340]);
    assert!(index[4..240].iter().all(|(flags, _)| flags.is_empty()));
    assert!(index[260..].iter().all(|(flags, force)| *flags == Flags::FAULTY_TAXEL && force.is_some()));
    let texts: Vec<String> = core.source_faults().iter().map(ToString::to_string).collect();
    assert!(texts.len() == 1 && texts[0].starts_with("tactile source glove: taxels [1] stand still"), "{texts:?}");
    let again = index_of(&mut core, &samples[340..]);
    assert!(again[10..].iter().all(|(flags, _)| flags.is_empty()));
}

#[test]
fn rows_of_two_senders_in_turn_are_told_by_readings_or_by_counts() {
    // Two gloves that agree on nothing, each at 100 Hz, for 2 s of 4.
    let both = |k: usize| (200..600).contains(&k) && k % 2 == 1;
    let row = |k: usize| if both(k) { [500.0, 100.0 + noisy(k)[1]] } else { noisy(k) };
    let at_ms = |k: usize| if k < 200 { 10.0 * k as f64 } else { 2000.0 + 5.0 * (k - 200) as f64 };
    let samples: Vec<Sample> = (0..600).map(|k| Sample::tactile(at_ms(k), &row(k))).collect();
    let mut core = with_noise(FrameClock::Tactile);
    let index = index_of(&mut core, &samples);
    assert!(index[4..200].iter().all(|(flags, _)| flags.is_empty()));
    assert!(index[240..].iter().all(|(flags, _)| flags.contains(Flags::INTERLEAVED)));
    assert!(index[500..].iter().all(|(flags, _)| flags.contains(Flags::WRONG_RATE)), "200 Hz for a model of 100");
    assert_eq!(core.source_faults().len(), 2);
    // The same sensor read by two drivers: readings don't tell, counts do. One sender with a lost message does not alternate.
    for (counts, expected) in [(true, Flags::INTERLEAVED), (false, Flags::default())] {
        let mut core = with_noise(FrameClock::Grid);
        let mut last = Flags::default();
        for k in 0..400_u32 {
            let sequence = match counts {
                true if k % 2 == 1 => 7000 + k / 2,
                true => k / 2,
                false => k + k / 50,
            };
            let values = noisy(k as usize);
            if let Event::Tactile(block) = tactile(Stamp(i64::from(k) * 5 * MS), &values) {
                core.handle(Event::Tactile(TactileBlock { sequence: Some(sequence), ..block })).unwrap();
            }
            while let Some(tick) = core.poll().unwrap() {
                last = tick.estimates[0].flags;
            }
        }
        assert_eq!(last, expected);
    }
}

#[test]
fn a_rate_that_is_not_the_models_is_flagged_where_it_is_faster_and_told_either_way() {
    for (period_ms, flag, told) in [
        (10.0, Flags::default(), false),
        (5.0, Flags::WRONG_RATE, true),
        (1.0, Flags::WRONG_RATE, true),
        (20.0, Flags::default(), true),
    ] {
        let samples: Vec<Sample> = (0..3000).map(|k| Sample::tactile(period_ms * k as f64, &noisy(k))).collect();
        let mut core = with_noise(FrameClock::Tactile);
        let index = index_of(&mut core, &samples);
        assert_eq!(index.last().unwrap().0, flag, "{period_ms} ms");
        assert_eq!(core.source_faults().len(), usize::from(told), "{:?}", core.source_faults());
        assert_eq!(core.rate_fault(TactileSourceIdx::at(0)).is_some(), told);
        let mut grid = with_noise(FrameClock::Grid);
        assert!(index_of(&mut grid, &samples).last().unwrap().0.is_empty(), "on the grid every rate is right");
        assert!(grid.source_faults().is_empty());
    }
    // A tenth of the samples lost is no other rate.
    let lossy = (0..3000).filter(|k| k % 10 != 3).map(|k| Sample::tactile(10.0 * k as f64, &noisy(k)));
    let mut core = with_noise(FrameClock::Tactile);
    assert!(index_of(&mut core, &lossy.collect::<Vec<_>>()).last().unwrap().0.is_empty());
    assert!(core.source_faults().is_empty());
}

#[test]
fn a_short_gap_of_joints_is_held_and_flagged_where_nothing_else_is_set() {
    let without = |from: usize, to: usize| {
        let gap = move |sample: &Sample| matches!(sample, Sample::Joints { at_ns, .. } if (from as i64..to as i64).contains(&(at_ns / MS / 10)));
        steady(300, 0, 300).into_iter().filter(move |sample| !gap(sample)).collect::<Vec<_>>()
    };
    let core = || {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
        let cfg = cfg.with_timing(Timing { max_pose_age: None, ..timing() });
        fusion(cfg, vec![Sum::boxed(4, 2, 1)])
    };
    let whole = run(&mut core(), &steady(300, 0, 300));
    // 150 ms without joint angles: the last one is held from 50 ms on, and no correction is lost.
    let mut short = core();
    let estimates = run(&mut short, &without(100, 115));
    let flags = |k: usize| estimates[k].1.flags;
    assert!((105..117).all(|k| flags(k) == Flags::HELD_POSE || flags(k).is_empty()));
    assert!((106..114).all(|k| flags(k) == Flags::HELD_POSE), "{:?}", (100..120).map(flags).collect::<Vec<_>>());
    assert!(
        estimates[4..]
            .iter()
            .all(|(_, estimate)| estimate.force.is_some() && !estimate.flags.contains(Flags::STALE_POSE))
    );
    assert!((120..300).all(|k| estimates[k] == whole[k]), "and nothing of it is left once it has passed the window");
    let counts = short.counters().regions[0].counts;
    assert!(counts.held_pose > 8 && counts.base_only == 1, "{counts:?}");
    // 400 ms: past 200 ms nobody knows where the finger is.
    let long = run(&mut core(), &without(100, 140));
    assert!((122..139).all(|k| long[k].1.flags == Flags::STALE_POSE));
    assert!((146..300).all(|k| long[k] == whole[k]));
}

#[test]
fn joints_at_thirty_hertz_with_jitter_are_no_reason_for_a_stale_pose() {
    for (period_ms, jitter_ms) in [(33.3, 15.0), (50.0, 10.0), (50.0, 20.0), (66.0, 20.0), (100.0, 20.0)] {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
        let cfg = cfg.with_timing(Timing { max_pose_age: None, ..timing() });
        let mut core = fusion(cfg, vec![Sum::boxed(64, 2, 1)]);
        let mut samples: Vec<Sample> = (0..3000).map(|k| Sample::tactile(10.0 * k as f64, &noisy(k))).collect();
        let n_joints = (30_000.0 / period_ms) as usize;
        samples.extend((0..n_joints).map(|k| {
            let jitter = jitter_ms * ((k * 7919 % 200) as f64 / 100.0 - 1.0);
            Sample::joints((period_ms * k as f64 + jitter).max(0.1 * k as f64), &[("dip", 0.1)])
        }));
        samples.sort_by_key(Sample::at_ns);
        let estimates = run(&mut core, &samples);
        let settled = &estimates[200..];
        let stale = settled.iter().filter(|(_, estimate)| estimate.flags.contains(Flags::STALE_POSE)).count();
        assert_eq!(stale, 0, "{period_ms} ms +- {jitter_ms} ms: {stale} of {}", settled.len());
    }
}

#[test]
fn short_gaps_are_filled_and_long_ones_start_over() {
    let mut samples = steady(40, 0, 40);
    samples.retain(|sample| !matches!(sample, Sample::Tactile { at_ns, .. } if [100, 110].contains(&(at_ns / MS))));
    samples.retain(|sample| !matches!(sample, Sample::Tactile { at_ns, .. } if (200..260).contains(&(at_ns / MS))));
    let mut core = one_region();
    let estimates = run(&mut core, &samples);
    let at = |ms: i64| estimates.iter().find(|(stamp, _)| stamp.0 == ms * MS).map(|(_, estimate)| *estimate);
    // The frame at 130 ms has the filled one of 100 ms as its oldest: 13 + 1e-3 * 10.
    assert_eq!(at(130).unwrap().force_base, Some(Newton(f64::from(13.0f32 + 1e-3 * 10.0))));
    assert!(at(100).is_none(), "a filled frame is no estimate");
    assert_eq!(at(260).unwrap().flags, Flags::WARMUP);
    let counters = core.counters();
    assert_eq!((counters.tactile[0].counts.missing_frames, counters.tactile[0].counts.gaps), (2, 1));
    assert_eq!((counters.regions[0].counts.filled_frames, counters.regions[0].counts.window_resets), (2, 1));
}

#[test]
fn a_contact_does_not_survive_a_gap() {
    let mut samples = steady(20, 0, 20);
    samples.extend(steady(60, 40, 60).into_iter().filter(|sample| sample.at_ns() >= 400 * MS));
    let estimates = run(&mut one_region(), &samples);
    assert!(estimates[19].1.contact.state);
    let after = estimates[20].1;
    assert_eq!((after.flags, after.contact.state, after.contact.event), (Flags::WARMUP, false, ContactEvent::Offset));
}

#[test]
fn a_nan_taxel_costs_its_region_one_frame_and_no_other_region_any() {
    let regions = vec![region("index", &[0], &["dip"]), region("thumb", &[1], &["dip"])];
    let mut core = fusion(config(2, regions), vec![Sum::boxed(4, 1, 1)]);
    let mut samples = steady(30, 0, 30);
    let Sample::Tactile { values, .. } = samples.iter_mut().find(|s| s.at_ns() == 100 * MS).unwrap() else { panic!() };
    values[0] = f32::NAN;
    let estimates = run(&mut core, &samples);
    let index: Vec<_> = estimates.iter().filter(|(_, e)| e.region == RegionIdx::at(0)).collect();
    let thumb: Vec<_> = estimates.iter().filter(|(_, e)| e.region == RegionIdx::at(1)).collect();
    assert_eq!((index[10].1.force, index[10].1.flags), (None, Flags::NON_FINITE));
    assert!(index[11].1.force.is_some() && thumb.iter().skip(4).all(|(_, e)| e.force.is_some()));
    assert_eq!(index[13].1.force_base, Some(Newton(f64::from(13.0f32 + 1e-3 * 10.0))), "the hole is interpolated");
}

#[test]
fn a_looped_stream_resets_and_is_counted() {
    let mut samples = steady(50, 0, 50);
    samples.extend(steady(50, 0, 50));
    let mut core = one_region();
    let estimates = run(&mut core, &samples);
    assert_eq!(estimates.len(), 100);
    let (first, second) = estimates.split_at(50);
    // The loop starts from nothing but for the joints, whose old states are in the future by then.
    for k in 5..49 {
        assert_eq!(first[k].1.force, second[k].1.force, "frame {k}");
    }
    assert_eq!(second[0].1.flags, Flags::WARMUP);
    let counters = core.counters();
    assert_eq!((counters.tactile[0].counts.time_jumps, counters.joints[0].counts.time_jumps), (1, 1));
}

#[test]
fn a_pose_outside_of_the_training_range_is_flagged() {
    let mut contract = contract(4, 2, 1);
    contract.pose_range = Some(vec![PoseRange { min: 0.0, max: 2.0 }]);
    let mut core = fusion(config(2, vec![region("index", &[0, 1], &["dip"])]), vec![Box::new(Sum { contract })]);
    let estimates = run(&mut core, &steady(20, 0, 20));
    for (k, (_, estimate)) in estimates.iter().enumerate().take(19).skip(4) {
        assert_eq!(estimate.flags.contains(Flags::POSE_OUT_OF_RANGE), 0.25 * (k as f64 - 0.3) > 2.0, "frame {k}");
    }
}

#[test]
fn regions_and_models_that_do_not_fit_are_refused() {
    let refused = |cfg, models| Fusion::new(cfg, models).unwrap_err().to_string();
    let text = refused(config(2, vec![region("index", &[0], &["dip"])]), vec![Sum::boxed(4, 2, 1)]);
    assert_eq!(text, "region.index.taxels has 1 taxels, its model takes 2; list the 2 that it was trained on");
    let text = refused(config(2, vec![region("index", &[0, 1], &[])]), vec![Sum::boxed(4, 2, 1)]);
    assert_eq!(text, "region.index.joints has 0 joints, its model takes 1; list the 1 that it was trained on");
    let mut named = contract(4, 2, 1);
    named.joints = Some(vec!["pip".into()]);
    let text = refused(config(2, vec![region("index", &[0, 1], &["dip"])]), vec![Box::new(Sum { contract: named })]);
    assert!(text.starts_with("region.index.joints is [\"dip\"], its model was trained on [\"pip\"]"), "{text}");
    let text = refused(config(2, vec![region("index", &[0, 1], &["dip"])]), vec![Sum::boxed(4, 2, 0)]);
    assert!(text.starts_with("region.index: its model has no pose input"), "{text}");
}

#[test]
fn a_core_and_its_models_can_be_moved_to_another_thread() {
    fn moves<T: Send>() {}
    moves::<Fusion>();
    moves::<Box<dyn Regressor>>();
    let mut core = one_region();
    let elsewhere = std::thread::spawn(move || run(&mut core, &steady(20, 0, 20)));
    assert_eq!(elsewhere.join().unwrap(), run(&mut one_region(), &steady(20, 0, 20)));
}

#[test]
fn the_batch_size_changes_when_estimates_come_and_not_what_they_are() {
    let samples = steady(200, 0, 150);
    let single = run(&mut one_region(), &samples);
    for batch in [2, 7, 64, 1000] {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
        let cfg = cfg.with_batch(batch_of(batch));
        assert_eq!(run(&mut fusion(cfg, vec![Sum::boxed(4, 2, 1)]), &samples), single, "batch {batch}");
    }
}

#[test]
fn a_gap_while_something_is_touched_ends_the_contact_after_it_in_batches_of_any_size() {
    let touched = |from_ms: f64| {
        let at = move |k: i32| from_ms + 10.0 * f64::from(k);
        (0..30).flat_map(move |k| [Sample::tactile(at(k), &[1.0, 1.0]), Sample::joints(at(k) + 3.0, &[("dip", 0.1)])])
    };
    let samples: Vec<Sample> = touched(0.0).chain(touched(600.0)).collect();
    let estimates = |batch: usize| {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
        let cfg = cfg.with_batch(batch_of(batch));
        run(&mut fusion(cfg, vec![Sum::boxed(4, 2, 1)]), &samples)
    };
    let single = estimates(1);
    let events = |event: ContactEvent| -> Vec<i64> {
        let with = single.iter().filter(|(_, estimate)| estimate.contact.event == event);
        with.map(|(stamp, _)| stamp.0 / MS).collect()
    };
    assert_eq!((events(ContactEvent::Onset), events(ContactEvent::Offset)), (vec![30, 630], vec![600]));
    for batch in [2, 7, 40, 1000] {
        assert_eq!(estimates(batch), single, "batch {batch}");
    }
}

#[test]
fn regions_with_models_of_their_own_get_what_each_would_get_alone() {
    let samples = steady(120, 0, 90);
    let second = || RegionConfig { model: ModelIdx::at(1), ..region("thumb", &[0], &[]) };
    let models = || -> Vec<Box<dyn Regressor>> { vec![Sum::boxed(4, 2, 1), Sum::boxed(9, 1, 0)] };
    let alone = |region: RegionConfig, model: Box<dyn Regressor>| {
        let cfg = config(2, vec![RegionConfig { model: ModelIdx::at(0), ..region }]);
        run(&mut fusion(cfg, vec![model]), &samples)
    };
    let index = alone(region("index", &[0, 1], &["dip"]), Sum::boxed(4, 2, 1));
    let thumb = alone(second(), Sum::boxed(9, 1, 0));
    for batch in [1, 16] {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"]), second()]);
        let cfg = cfg.with_batch(batch_of(batch));
        let both = run(&mut fusion(cfg, models()), &samples);
        let of = |idx: usize| both.iter().filter(move |(_, estimate)| estimate.region == RegionIdx::at(idx));
        assert!(of(0).eq(&index), "batch {batch}");
        let forces = |estimates: &mut dyn Iterator<Item = &(Stamp, Estimate)>| -> Vec<_> {
            estimates.map(|(stamp, e)| (*stamp, e.force, e.flags, e.contact)).collect()
        };
        assert_eq!(forces(&mut of(1)), forces(&mut thumb.iter()), "batch {batch}");
    }
}

#[test]
fn zero_slack_never_waits() {
    let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
    let cfg = cfg.with_timing(Timing { joint_slack: std::time::Duration::ZERO, ..timing() });
    let mut core = fusion(cfg, vec![Sum::boxed(4, 2, 1)]);
    for sample in steady(30, 0, 30) {
        core.handle(sample.event()).unwrap();
        let at = sample.at_ns();
        if matches!(sample, Sample::Tactile { .. }) {
            assert_eq!(core.poll().unwrap().map(|tick| tick.stamp), Some(Stamp(at)));
        }
        assert_eq!(core.n_pending(), 0);
    }
}

/// Streams with random rates, jitter and holes, and an arrival order in which each stream keeps its own order and a
/// joint state comes at any time while the first frame that needs it still waits.
fn streams() -> impl Strategy<Value = (Vec<Sample>, Vec<Sample>)> {
    let tactile = prop::collection::vec((6.0f64..14.0, prop::bool::weighted(0.05)), 20..80);
    let joints = prop::collection::vec((2.0f64..16.0, prop::bool::weighted(0.1)), 10..120);
    (tactile, joints, prop::collection::vec(0.0f64..1.0, 200)).prop_map(|(tactile_steps, joint_steps, picks)| {
        let mut at_ms = 0.0;
        let mut tactile = Vec::new();
        for (k, (step, hole)) in tactile_steps.iter().enumerate() {
            at_ms += step * if *hole { 7.0 } else { 1.0 };
            tactile.push(Sample::tactile(at_ms, &[k as f32, (k * k % 17) as f32]));
        }
        at_ms = 0.0;
        let mut joints = Vec::new();
        for (k, (step, hole)) in joint_steps.iter().enumerate() {
            at_ms += step * if *hole { 9.0 } else { 1.0 };
            joints.push(Sample::joints(at_ms, &[("dip", (k as f64 * 0.37).sin())]));
        }
        let mut in_order: Vec<Sample> = tactile.iter().chain(&joints).cloned().collect();
        in_order.sort_by_key(Sample::at_ns);
        // Each joint state may come anywhere between its predecessor and its deadline: the first tactile sample that
        // lies a slack or more after the first frame the state could serve.
        let mut shuffled = Vec::new();
        let mut next = 0;
        for (k, joint) in joints.iter().enumerate() {
            let previous_ns = if k == 0 { i64::MIN } else { joints[k - 1].at_ns() };
            let serves = tactile.iter().position(|frame| frame.at_ns() > previous_ns).unwrap_or(tactile.len());
            let deadline = tactile.get(serves).map_or(tactile.len(), |first| {
                let over = |frame: &Sample| frame.at_ns() - first.at_ns() >= 10 * MS;
                tactile.iter().position(over).unwrap_or(tactile.len())
            });
            let latest = deadline.max(next);
            let at = next + ((latest - next) as f64 * picks[k % picks.len()]).round() as usize;
            shuffled.extend(tactile[next..at].iter().cloned());
            shuffled.push(joint.clone());
            next = at;
        }
        shuffled.extend(tactile[next..].iter().cloned());
        (in_order, shuffled)
    })
}

proptest! {
    #[test]
    fn arrival_order_inside_the_slack_changes_nothing((in_order, shuffled) in streams()) {
        let expected = run(&mut one_region(), &in_order);
        prop_assert_eq!(run(&mut one_region(), &shuffled), expected);
    }

    #[test]
    fn whatever_comes_is_counted_and_nothing_non_finite_comes_out(
        picks in prop::collection::vec((0u8..8, -300i64..600, prop::num::f32::ANY, prop::num::f64::ANY), 1..200),
        batch in 1usize..5,
    ) {
        let cfg = config(2, vec![region("index", &[0, 1], &["dip"])]);
        let cfg = cfg.with_batch(batch_of(batch));
        let mut core = fusion(cfg, vec![Sum::boxed(4, 2, 1)]);
        let mut at_ms = 0;
        let samples: Vec<Sample> = picks.iter().map(|&(kind, step, value, angle)| {
            at_ms += if kind < 6 { step.rem_euclid(20) } else { step };
            match kind {
                0..=2 | 6 => Sample::tactile(at_ms as f64, &[value, 1.0][..1 + usize::from(step % 9 != 0)]),
                _ => Sample::joints(at_ms as f64, &[(if step % 5 == 0 { "pip" } else { "dip" }, angle)]),
            }
        }).collect();
        let estimates = run(&mut core, &samples);
        for (_, estimate) in &estimates {
            prop_assert!(estimate.force.is_none_or(|force| force.0.is_finite()));
            prop_assert!(estimate.force.is_some() || !estimate.flags.is_empty());
        }
        prop_assert_eq!(core.n_pending(), 0);
        let counters = core.counters();
        let t = counters.tactile[0].counts;
        prop_assert_eq!(t.rows, t.used + t.duplicate + t.out_of_order + t.wrong_length + t.no_row_period);
        prop_assert_eq!(t.used, t.frames);
        prop_assert_eq!(t.frames, estimates.len() as u64);
        let j = counters.joints[0].counts;
        prop_assert_eq!(j.messages, j.used + j.unknown + j.duplicate + j.out_of_order + j.nothing_finite + j.malformed);
        let r = counters.regions[0].counts;
        prop_assert_eq!(r.frames, r.estimates + r.warmup + r.uncalibrated + r.stale_pose + r.non_finite + r.frozen);
    }
}

/// A model whose force is what its only taxel reads, and whose probability of touch is a tenth of it.
#[derive(Debug)]
struct Toucher(Contract);

impl Regressor for Toucher {
    fn contract(&self) -> &Contract {
        &self.0
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        out.clear();
        let last = windows.starts.iter().map(|start| windows.tactile[start + self.0.window.get() - 1]);
        out.force.extend(last);
        let (force, touch) = (&out.force, &mut out.touch);
        touch.extend(force.iter().map(|force| force / 10.0));
        Ok(())
    }
}

#[test]
fn contact_is_decided_on_the_touch_output_of_a_model_that_has_one() {
    let run = |by: ContactBy, touch: Option<TouchLevels>, readings: &[f32]| {
        let output = TouchOutput { levels: TouchLevels { on: 0.8, off: 0.4 }, false_per_min: None };
        let contract = Contract { has_base: false, touch: Some(output), ..contract(1, 1, 0) };
        let mut one = region("tip", &[0], &[]);
        (one.contact.by, one.contact.touch) = (by, touch);
        let mut core = fusion(config(1, vec![one]), vec![Box::new(Toucher(contract))]);
        let samples: Vec<Sample> =
            readings.iter().enumerate().map(|(k, reading)| Sample::tactile(10.0 * k as f64, &[*reading])).collect();
        estimates(&mut core, &samples)
    };
    let states =
        |estimates: &[Estimate]| estimates.iter().map(|one| (one.contact.raw, one.contact.state)).collect::<Vec<_>>();
    let readings = [0.0, 7.0, 8.0, 5.0, 3.0];
    let on_touch = run(ContactBy::Model, None, &readings);
    assert_eq!(states(&on_touch), [(false, false), (false, false), (true, true), (false, true), (false, false)]);
    assert!((on_touch[2].touch.unwrap() - 0.8).abs() < 1e-6 && on_touch[2].contact.by_touch);
    let other = run(ContactBy::Model, Some(TouchLevels { on: 0.65, off: 0.4 }), &readings);
    assert_eq!(states(&other)[1], (true, true), "the parameters' levels come before the model's");
    // The thresholds on force are 0.5 and 0.25 N.
    let on_force = run(ContactBy::Force, None, &readings);
    assert_eq!(states(&on_force), [(false, false), (true, true), (true, true), (true, true), (true, true)]);
    assert!(on_force[2].touch.is_some() && !on_force[2].contact.by_touch, "it is told all the same");
    let broken = run(ContactBy::Model, None, &[8.0, f32::NAN, 8.0]);
    assert_eq!((broken[1].touch, broken[1].contact.raw, broken[1].contact.state), (None, false, true));
}

#[test]
fn a_probability_that_is_no_number_is_no_estimate() {
    #[derive(Debug)]
    struct Broken(Contract);
    impl Regressor for Broken {
        fn contract(&self) -> &Contract {
            &self.0
        }
        fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
            out.clear();
            out.force.resize(windows.starts.len(), 1.0);
            out.touch.resize(windows.starts.len(), f32::NAN);
            Ok(())
        }
    }
    let contract = Contract { has_base: false, touch: Some(TouchOutput::default()), ..contract(1, 1, 0) };
    let mut core = fusion(config(1, vec![region("tip", &[0], &[])]), vec![Box::new(Broken(contract))]);
    let only = estimates(&mut core, &[Sample::tactile(0.0, &[1.0])])[0];
    assert_eq!((only.force, only.touch), (None, None));
    assert!(only.flags.contains(Flags::NON_FINITE) && !only.contact.raw);
}

/// Gives the taxels of the last frame as x, y and z of the force, and of the base.
#[derive(Debug)]
struct Three(Contract);

impl Three {
    fn boxed(n_joints: usize) -> Box<dyn Regressor> {
        Box::new(Three(Contract { axes: ForceAxes::Patch, ..contract(1, 3, n_joints) }))
    }
}

impl Regressor for Three {
    fn contract(&self) -> &Contract {
        &self.0
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        out.clear();
        for &start in windows.starts {
            out.base.extend_from_slice(&windows.tactile[3 * start..3 * start + 3]);
            out.force.extend(windows.tactile[3 * start..3 * start + 3].iter().map(|taxel| 2.0 * taxel));
        }
        Ok(())
    }
}

#[test]
fn a_force_of_three_axes_is_split_at_the_normal_and_contact_stays_on_the_normal_force() {
    let mut one = region("tip", &[0, 1, 2], &[]);
    one.patch.normal_in_patch = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(0.0, -1.0, 0.0));
    // Turned by 90 degrees about z: its -y looks along the frame's +x, its +x along the frame's +y.
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    one.patch.frame_from_patch = nalgebra::Isometry3::from_parts(nalgebra::Translation3::identity(), turn);
    let cfg = config(3, vec![one]);
    let mut core = fusion(cfg.clone(), vec![Three::boxed(0)]);
    let samples = [
        Sample::tactile(0.0, &[1.0, -0.5, 0.25]),
        Sample::tactile(10.0, &[5.0, 0.0, 0.0]),
        Sample::tactile(20.0, &[1.0, -1.0, f32::MAX]),
    ];
    let found = estimates(&mut core, &samples);
    let newtons = |force: Option<[Newton; 3]>| force.map(|force| force.map(|force| force.0));
    assert_eq!((found[0].force, newtons(found[0].tangential)), (Some(Newton(1.0)), Some([2.0, 0.0, 0.5])));
    assert_eq!(found[0].force_base, Some(Newton(0.5)));
    assert!(found[0].contact.raw, "the threshold is 0.5 N");
    assert_eq!((found[1].force, newtons(found[1].tangential)), (Some(Newton(0.0)), Some([10.0, 0.0, 0.0])));
    assert!(!found[1].contact.raw, "a tangential force is no contact by itself");
    // An infinite number along an axis on which the normal has no part: no estimate.
    assert_eq!((found[2].force, found[2].tangential, found[2].flags), (None, None, Flags::NON_FINITE));

    let contract = Contract { axes: ForceAxes::Patch, ..contract(1, 3, 0) };
    let mut outgoing = tactile_pose_fusion::msg::Outgoing::new(&cfg, &[&contract]);
    let wrench = outgoing.wrench(Stamp(0), &found[0]).unwrap().wrench.force;
    let off = [(wrench.x, 1.0), (wrench.y, 2.0), (wrench.z, 0.5)].map(|(got, expected)| (got - expected).abs());
    assert!(off.iter().all(|off| *off < 1e-12), "{wrench:?}"); // rounding of one rotation
    assert!(outgoing.wrench(Stamp(0), &found[2]).is_none());
}

#[test]
fn the_gain_of_known_touches_is_that_of_all_axes_and_a_stale_pose_leaves_the_base_of_all() {
    let mut core = fusion(config(3, vec![region("tip", &[0, 1, 2], &["dip"])]), vec![Three::boxed(1)]);
    core.handle_force_gain(RegionIdx::at(0), &ForceGain { gain: 1.5, low: 1.4, high: 1.6, touches: 3 }).unwrap();
    let mut samples = vec![Sample::tactile(0.0, &[3.0, 4.0, 12.0]), Sample::joints(3.0, &[("dip", 0.0)])];
    samples.extend((1..20).map(|k| Sample::tactile(10.0 * f64::from(k), &[3.0, 4.0, 12.0])));
    let found = run(&mut core, &samples);
    let stale = &found.last().unwrap().1;
    assert_eq!(stale.flags, Flags::STALE_POSE);
    assert_eq!((stale.force, stale.tangential), (Some(Newton(18.0)), Some([4.5, 6.0, 0.0].map(Newton))));
    let fresh = found.iter().find(|(_, estimate)| estimate.flags.is_empty()).unwrap().1;
    assert_eq!((fresh.force, fresh.tangential), (Some(Newton(36.0)), Some([9.0, 12.0, 0.0].map(Newton))));
}

/// One taxel that reads 100 for each rad of its joint, and 10 for a gF.
fn artifact() -> std::sync::Arc<ArtifactModel> {
    std::sync::Arc::new(ArtifactModel {
        n_taxels: 1,
        n_joints: 1,
        shapes: vec![100.0, 0.0, 0.0, 0.0],
        gain_variance: vec![0.1],
        slip: 0.3,
        slip_common: 0.3,
        slip_time_s: 90.0,
        touch: vec![10.0],
        residual: vec![25.0], // 0.5 gF; of less, the curve of a quick bend counts as noise of its angle
        drift: Vec::new(),
        noise: Vec::new(),
        misfit: Vec::new(),
        uncertain_offsets: false,
        trust_inputs: false,
    })
}

/// A core of that taxel, on a network that takes no pose.
fn core_with_artifact(following: Following) -> Fusion {
    let contract = Contract { has_base: false, artifact: Some(artifact()), ..contract(4, 1, 0) };
    let cfg = config(1, vec![region("tip", &[0], &["dip"])]).with_following(following);
    fusion(cfg, vec![Box::new(Sum { contract })])
}

fn fit(gain: f64) -> ArtifactFit {
    ArtifactFit { gains: vec![gain], offset: vec![0.0], covariance: vec![1e-4], offset_covariance: vec![] }
}

/// Frames of a joint that bends, with a taxel whose gain is 1.2.
fn bending(from: i64, n: i64) -> Vec<Sample> {
    let angle = |k: i64| 0.5 + 0.4 * (k as f64 * 0.03).sin();
    let frames = (from..from + n).flat_map(|k| {
        let at_ms = 10.0 * k as f64;
        [Sample::joints(at_ms, &[("dip", angle(k))]), Sample::tactile(at_ms, &[(120.0 * angle(k)) as f32])]
    });
    frames.collect()
}

fn estimates(core: &mut Fusion, samples: &[Sample]) -> Vec<Estimate> {
    let mut estimates = Vec::new();
    for sample in samples {
        core.handle(sample.event()).unwrap();
        while let Some(tick) = core.poll().unwrap() {
            estimates.extend(tick.estimates.iter().copied());
        }
    }
    estimates
}

/// Keeps the newest frame of the window that it gets last.
#[derive(Debug)]
struct Keeper {
    contract: Contract,
    newest: std::sync::Arc<std::sync::Mutex<Vec<f32>>>,
}

impl Regressor for Keeper {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        let width = self.contract.n_columns();
        let end = windows.starts.last().map_or(0, |start| start + self.contract.window.get());
        *self.newest.lock().unwrap() = windows.tactile[(end - 1) * width..end * width].to_vec();
        out.clear();
        out.force.resize(windows.starts.len(), 0.0);
        Ok(())
    }
}

#[test]
fn a_network_that_gets_trust_has_it_beside_the_taxels() {
    let told = ArtifactModel { trust_inputs: true, ..ArtifactModel::clone(&artifact()) };
    let contract = Contract { has_base: false, artifact: Some(told.into()), ..contract(4, 1, 0) };
    assert_eq!((contract.n_taxels, contract.n_columns(), contract.n_region_joints()), (1, 1 + TRUST_INPUTS, 1));
    let newest = std::sync::Arc::default();
    let keeper = || Box::new(Keeper { contract: contract.clone(), newest: std::sync::Arc::clone(&newest) });
    let cfg = config(1, vec![region("tip", &[0], &["dip"])]);
    let mut core = fusion(cfg.clone(), vec![keeper()]);
    core.handle_artifact(RegionIdx::at(0), fit(1.2)).unwrap();
    estimates(&mut core, &bending(0, 1000));
    let in_air = newest.lock().unwrap().clone();
    // What noise of the angles adds, and what gains leave of the artifact.
    assert!(in_air.iter().all(|value| value.abs() < 30.0) && in_air[2] > 0.0, "{in_air:?}");
    let touching = bending(1000, 300).into_iter().map(|sample| match sample {
        Sample::Tactile { at_ns, mut values } => {
            values[0] += 200.0;
            Sample::Tactile { at_ns, values }
        }
        joints => joints,
    });
    estimates(&mut core, &touching.collect::<Vec<_>>());
    let touched = newest.lock().unwrap().clone();
    assert!((touched[0] - 200.0).abs() < 30.0 && touched[1..].iter().all(|value| value.abs() < 30.0), "{touched:?}");
    // Two taxels more are no trust, and a model of as many columns without it is of three taxels.
    let three = config(3, vec![region("tip", &[0, 1, 2], &["dip"])]);
    let refused = Fusion::new(three, vec![keeper()]).unwrap_err();
    assert!(matches!(refused, SetupError::Taxels { expected: 1, got: 3, .. }), "{refused}");
}

#[test]
fn an_artifact_is_taken_out_of_the_taxels_followed_frozen_or_left() {
    let last = |following, with_fit: bool| {
        let mut core = core_with_artifact(following);
        if with_fit {
            core.handle_artifact(RegionIdx::at(0), fit(1.0)).unwrap();
        }
        *estimates(&mut core, &bending(0, 3000)).last().unwrap()
    };
    let off = last(Following::Off, true);
    assert!(off.force.unwrap().0 > 20.0 && off.adaptation == Adaptation::Off && off.artifact_change.is_none());
    let frozen = last(Following::Frozen, true);
    assert!((4.0..20.0).contains(&frozen.force.unwrap().0), "{frozen:?}");
    assert_eq!((frozen.adaptation, frozen.artifact_change), (Adaptation::Frozen, Some(0.0)));
    let on = last(Following::On, true);
    assert!(on.force.unwrap().0.abs() < 1.0, "{on:?}");
    assert_eq!(on.adaptation, Adaptation::Learning);
    assert!((on.artifact_change.unwrap() - 0.2).abs() < 0.02, "{on:?}");
    let uncalibrated = last(Following::On, false);
    assert_eq!((uncalibrated.force, uncalibrated.adaptation), (frozen.force, Adaptation::Frozen));
}

#[test]
fn without_joint_angles_the_artifact_of_the_last_ones_is_taken_out_and_said() {
    let mut core = core_with_artifact(Following::On);
    core.handle_artifact(RegionIdx::at(0), fit(1.2)).unwrap();
    estimates(&mut core, &bending(0, 200));
    let blind: Vec<Sample> = (200..300).map(|k| Sample::tactile(10.0 * k as f64, &[60.0])).collect();
    let blind = *estimates(&mut core, &blind).last().unwrap();
    assert!(blind.flags.contains(Flags::STALE_POSE) && blind.force.is_some(), "{blind:?}");
    assert_eq!(blind.adaptation, Adaptation::Waiting);
    let mut never = core_with_artifact(Following::On);
    let blind: Vec<Sample> = (0..100).map(|k| Sample::tactile(10.0 * k as f64, &[60.0])).collect();
    let never = *estimates(&mut never, &blind).last().unwrap();
    assert!(never.flags.contains(Flags::STALE_POSE) && never.force.is_some_and(|force| force.0 > 59.0), "{never:?}");
}

#[test]
fn a_new_zero_a_gap_and_another_order_of_arrival_have_a_defined_effect_on_an_artifact() {
    let mut core = core_with_artifact(Following::On);
    core.handle_artifact(RegionIdx::at(0), fit(1.0)).unwrap();
    estimates(&mut core, &bending(0, 2000));
    let learned = core.artifact(RegionIdx::at(0)).unwrap().fit().unwrap();
    // A gap of a minute: what was learned is kept, leaning back to the calibration.
    estimates(&mut core, &bending(8000, 10));
    let kept = core.artifact(RegionIdx::at(0)).unwrap().fit().unwrap();
    assert!((1.05..1.25).contains(&kept.gains[0]), "{learned:?} {kept:?}");
    // A jump of time backwards keeps it too.
    estimates(&mut core, &bending(0, 10));
    assert!(core.artifact(RegionIdx::at(0)).unwrap().fit().unwrap().gains[0] > 1.05);
    // A new zero is one of another donning, as far as anyone knows.
    core.handle_baseline(TactileSourceIdx::at(0), Baseline::from_median(vec![0.0])).unwrap();
    assert_eq!(core.artifact(RegionIdx::at(0)).unwrap().fit(), None);
    assert!(core.handle_artifact(RegionIdx::at(0), ArtifactFit { offset: vec![], ..fit(1.0) }).is_err());

    let forward = estimates(&mut core_with_artifact(Following::On), &bending(0, 400));
    let mut late = bending(0, 400);
    late.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
    let late = estimates(&mut core_with_artifact(Following::On), &late);
    assert_eq!(forward[..late.len()], late[..]);
}

#[test]
fn an_artifact_asks_for_the_joints_of_its_region() {
    let contract = Contract { has_base: false, artifact: Some(artifact()), ..contract(4, 1, 0) };
    let refused = Fusion::new(config(1, vec![region("tip", &[0], &[])]), vec![Box::new(Sum { contract })]).unwrap_err();
    assert!(refused.to_string().contains("region.tip.joints has 0 joints, its model takes 1"), "{refused}");
}

use super::*;
use crate::fusion::TactileSourceIdx;
use std::time::Duration;

const MS: i64 = 1_000_000;

fn cutter(frame_clock: FrameClock, n_taxels: usize) -> FrameCutter {
    let timing = Timing {
        max_gap: Duration::from_millis(50),
        joint_slack: Duration::from_millis(10),
        max_pose_age: None,
        time_jump: Duration::from_millis(200),
        max_age: None,
    };
    let source = TactileSource { name: "glove".into(), n_taxels, stamp_offset_ns: 0, inverted: false, frame_clock };
    FrameCutter::new(source, 100.0, &timing)
}

struct Cut {
    stamp_us: i64,
    epoch: u64,
    number: i64,
    value: f32,
}

fn send_block(cutter: &mut FrameCutter, at_us: i64, rows: usize, period_us: i64, values: &[f32]) -> Vec<Cut> {
    let block = TactileBlock {
        source: TactileSourceIdx::at(0),
        stamp: Stamp(at_us * 1000),
        rows,
        row_period_ns: period_us * 1000,
        sequence: None,
        values,
        received: Stamp(0),
    };
    let mut frames = Vec::new();
    cutter.handle_header(&block);
    cutter.cut(&block, |frame, _| {
        frames.push(Cut {
            stamp_us: frame.stamp.0 / 1000,
            epoch: frame.epoch,
            number: frame.number,
            value: frame.values[0],
        });
    });
    frames
}

fn send(cutter: &mut FrameCutter, at_ms: f64, value: f32) -> Vec<Cut> {
    send_block(cutter, (at_ms * 1000.0).round() as i64, 1, 0, &[value])
}

fn conserved(counters: &TactileCounters) -> bool {
    counters.rows
        == counters.used + counters.duplicate + counters.out_of_order + counters.wrong_length + counters.no_row_period
}

#[test]
fn jitter_and_a_slightly_wrong_rate_leave_no_holes() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    let mut stamp_ms = 0.0;
    for k in 0..2000 {
        stamp_ms += if k % 2 == 0 { 7.0 } else { 13.4 }; // 98 Hz with 3 ms of jitter
        send(&mut cutter, stamp_ms, 0.0);
    }
    assert_eq!(cutter.counters().missing_frames, 0);
    assert_eq!(cutter.counters().frames, 2000);
    let expected_hz = 1999.0 / (stamp_ms - 7.0) * 1e3;
    assert!((cutter.measured_rate_hz().unwrap() / expected_hz - 1.0).abs() < 1e-9); // stamps are whole microseconds
}

#[test]
fn a_lost_sample_is_a_missing_frame_and_a_long_gap_a_new_epoch() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    for k in 0..10 {
        send(&mut cutter, f64::from(k) * 10.0, 0.0);
    }
    let after_loss = send(&mut cutter, 120.0, 0.0);
    assert_eq!((after_loss[0].number, after_loss[0].epoch), (13, 0), "two frames are missing");
    let after_gap = send(&mut cutter, 171.0, 0.0);
    assert_eq!(after_gap[0].epoch, 1);
    let counters = cutter.counters();
    assert_eq!((counters.missing_frames, counters.gaps), (2, 1));
}

#[test]
fn duplicates_late_samples_and_wrong_lengths_are_dropped_and_counted() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    send(&mut cutter, 100.0, 0.0);
    assert!(send(&mut cutter, 100.0, 0.0).is_empty());
    assert!(send(&mut cutter, 90.0, 0.0).is_empty());
    assert!(send_block(&mut cutter, 110_000, 1, 0, &[0.0, 0.0]).is_empty());
    assert!(send_block(&mut cutter, 110_000, 0, 0, &[]).is_empty());
    assert!(send_block(&mut cutter, 110_000, 2, 0, &[0.0, 0.0]).is_empty());
    let c = *cutter.counters();
    assert_eq!((c.used, c.duplicate, c.out_of_order, c.wrong_length, c.empty, c.no_row_period), (1, 1, 1, 1, 1, 2));
    assert!(conserved(&c));
}

#[test]
fn a_jump_back_in_time_starts_over() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    send(&mut cutter, 5000.0, 0.0);
    let looped = send(&mut cutter, 0.0, 1.0);
    assert_eq!((looped.len(), looped[0].epoch), (1, 1));
    assert_eq!(cutter.counters().time_jumps, 1);
}

#[test]
fn rows_of_a_block_lie_one_period_apart_and_the_last_has_the_stamp() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    let frames = send_block(&mut cutter, 30_000, 3, 10_000, &[1.0, 2.0, 3.0]);
    assert_eq!(frames.iter().map(|f| f.stamp_us).collect::<Vec<_>>(), [10_000, 20_000, 30_000]);
    assert_eq!(frames.iter().map(|f| f.value).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
}

#[test]
fn a_burst_keeps_every_row_and_is_counted() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    send_block(&mut cutter, 20_000, 2, 10_000, &[0.0, 0.0]);
    let frames = send_block(&mut cutter, 24_000, 4, 10_000, &[1.0, 2.0, 3.0, 4.0]);
    assert_eq!(frames.iter().map(|f| f.stamp_us).collect::<Vec<_>>(), [21_000, 22_000, 23_000, 24_000]);
    assert_eq!(cutter.counters().bursts, 1);
    assert!(conserved(cutter.counters()));
}

#[test]
fn the_senders_count_shows_what_was_lost() {
    let mut cutter = cutter(FrameClock::Tactile, 1);
    for (at_ms, sequence) in [(0, u32::MAX - 1), (10, u32::MAX), (30, 1), (40, 2), (50, 0)] {
        let block = TactileBlock {
            source: TactileSourceIdx::at(0),
            stamp: Stamp(at_ms * MS),
            rows: 1,
            row_period_ns: 0,
            sequence: Some(sequence),
            values: &[0.0],
            received: Stamp(0),
        };
        cutter.handle_header(&block);
        cutter.cut(&block, |_, _| ());
    }
    assert_eq!(cutter.counters().lost_messages, 1); // 0 is missing after the wrap; going back to 0 is a restart
}

#[test]
fn a_dense_source_is_averaged_over_each_frame_interval() {
    let mut cutter = cutter(FrameClock::Grid, 1);
    let mut frames = Vec::new();
    for k in 0..=30 {
        frames.extend(send(&mut cutter, f64::from(k), k as f32));
    }
    assert_eq!(frames.iter().map(|f| f.stamp_us).collect::<Vec<_>>(), [0, 10_000, 20_000, 30_000]);
    assert_eq!(frames.iter().map(|f| f.value).collect::<Vec<_>>(), [0.0, 5.5, 15.5, 25.5]); // mean of 1..=10, ...
    assert_eq!(cutter.counters().missing_frames, 0);
}

#[test]
fn a_sparse_source_is_interpolated_at_each_frame() {
    let mut cutter = cutter(FrameClock::Grid, 1);
    let mut frames = send(&mut cutter, 0.0, 0.0);
    frames.extend(send(&mut cutter, 25.0, 25.0));
    frames.extend(send(&mut cutter, 50.0, 50.0));
    assert_eq!(frames.iter().map(|f| f.value).collect::<Vec<_>>(), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]);
}

#[test]
fn a_nan_reading_is_left_out_of_the_mean_and_an_all_nan_interval_stays_nan() {
    let mut cutter = cutter(FrameClock::Grid, 1);
    let mut frames = Vec::new();
    for k in 0..=20 {
        let value = if k == 5 || k > 10 { f32::NAN } else { 2.0 };
        frames.extend(send(&mut cutter, f64::from(k), value));
    }
    assert_eq!(frames[1].value, 2.0);
    assert!(frames[2].value.is_nan());
}

#[test]
fn the_grid_starts_again_after_a_gap() {
    let mut cutter = cutter(FrameClock::Grid, 1);
    for k in 0..5 {
        send(&mut cutter, f64::from(k) * 4.0, 1.0);
    }
    let frames = send(&mut cutter, 103.0, 7.0);
    assert_eq!((frames.len(), frames[0].stamp_us, frames[0].epoch, frames[0].value), (1, 103_000, 1, 7.0));
}

#[test]
fn a_grid_stands_still_at_the_end_of_time() {
    let mut cutter = cutter(FrameClock::Grid, 1);
    let mut n_frames = 0;
    for stamp in [i64::MAX - 15 * MS, i64::MAX - 5 * MS, i64::MAX] {
        let (source, received) = (TactileSourceIdx::at(0), Stamp(0));
        let (stamp, values) = (Stamp(stamp), &[1.0][..]);
        let block = TactileBlock { source, stamp, rows: 1, row_period_ns: 0, sequence: None, values, received };
        cutter.handle_header(&block);
        cutter.cut(&block, |_, _| n_frames += 1);
    }
    assert!((2..=3).contains(&n_frames), "{n_frames} frames");
    assert!(conserved(cutter.counters()));
}

//! What training reads of a recording is what a model is given while it runs.

use crate::common;

use std::num::NonZeroUsize;
use std::sync::mpsc::{Sender, channel};

use common::fake::{MS, config, contract, region};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::recording::RowCollector;
use tactile_pose_fusion::units::Stamp;

const WINDOW: usize = 16;

/// Sends every window that it is asked to run.
#[derive(Debug)]
struct Spy(Contract, Sender<(Vec<f32>, Vec<f32>)>);

impl Regressor for Spy {
    fn contract(&self) -> &Contract {
        &self.0
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        assert_eq!(windows.starts, [0]);
        self.1.send((windows.tactile.to_vec(), windows.pose.to_vec())).unwrap();
        *out = Forces { force: vec![0.0], ..Forces::default() };
        Ok(())
    }
}

/// Taxels and joints at 100 Hz, with a sample missing here and there, a NaN, a gap, and joints that stop for a while.
fn feed(fusion: &mut Fusion, mut on_tick: impl FnMut(&Tick)) {
    let names = ["dip".to_owned(), "pip".to_owned()];
    fusion.handle_baseline(TactileSourceIdx::at(0), Baseline::from_median(vec![10.0, 20.0])).unwrap();
    for k in 0..600i64 {
        let received = Stamp(k * 10 * MS);
        if !(200..215).contains(&k) {
            let positions = [(k as f64 * 0.05).sin(), (k as f64 * 0.03).cos()];
            let sample = JointSample {
                source: JointSourceIdx::at(0),
                stamp: Stamp(k * 10 * MS - 3 * MS),
                names: &names,
                positions: &positions,
                received,
            };
            fusion.handle(Event::Joints(sample)).unwrap();
        }
        if k % 37 != 5 && !(400..430).contains(&k) {
            let first = if k == 300 { f32::NAN } else { 10.0 + (k % 17) as f32 };
            let values = [first, 20.0 - (k % 5) as f32];
            let block = TactileBlock {
                source: TactileSourceIdx::at(0),
                stamp: received,
                rows: 1,
                row_period_ns: 0,
                sequence: None,
                values: &values,
                received,
            };
            fusion.handle(Event::Tactile(block)).unwrap();
        }
        while let Some(tick) = fusion.poll().unwrap() {
            on_tick(tick);
        }
    }
    fusion.handle_end();
    while let Some(tick) = fusion.poll().unwrap() {
        on_tick(tick);
    }
}

#[test]
fn rows_are_what_a_model_is_given_frame_by_frame() {
    let cfg = config(2, vec![region("tip", &[1, 0], &["dip", "pip"])]);
    let (sender, windows) = channel();
    let spy = Spy(Contract { has_base: false, ..contract(WINDOW, 2, 2) }, sender);
    let mut ends = Vec::new();
    feed(&mut Fusion::new(cfg.clone(), vec![Box::new(spy)]).unwrap(), |tick| {
        if tick.estimates[0].force.is_some() {
            ends.push(tick.stamp);
        }
    });
    let windows: Vec<_> = windows.try_iter().collect();
    assert!(ends.len() == windows.len() && ends.len() > 300, "{}", ends.len());

    let (mut collector, mut fusion) = RowCollector::new(cfg, NonZeroUsize::new(WINDOW).unwrap(), 100.0, None).unwrap();
    feed(&mut fusion, |tick| collector.handle_tick(tick));
    let rows = collector.finish();
    assert_eq!((rows.tactile.len(), rows.pose.len()), (2 * rows.stamp.len(), 2 * rows.stamp.len()));
    assert!(rows.stamp.is_sorted() && rows.stamp.windows(2).all(|pair| pair[0] < pair[1]));
    for (end, (tactile, pose)) in ends.iter().zip(&windows) {
        let last = rows.stamp.binary_search(end).unwrap();
        let first = last + 1 - WINDOW;
        assert_eq!(rows.stretch[first], rows.stretch[last], "no window crosses from one stretch into another");
        assert_eq!(rows.tactile[2 * first..2 * (last + 1)], tactile[..], "{end}");
        assert_eq!(rows.pose[2 * first..2 * (last + 1)], pose[..], "{end}");
    }
    // The start, the joints' silence and the gap: each begins a stretch. Missing samples and the NaN do not.
    assert_eq!(rows.stretch.last(), Some(&3));
}

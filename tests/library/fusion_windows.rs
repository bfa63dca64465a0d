//! The fusion core says which frames of a window are new, and says it truly.

use crate::common;

use std::sync::{Arc, Mutex};

use common::fake::*;
use proptest::prelude::*;
use tactile_pose_fusion::fusion::*;

const WINDOW: usize = 4;

/// A window that a model was given: where it belongs, and the bits of its frames.
struct Given {
    id: WindowId,
    frames: Vec<[u32; 3]>,
}

/// Keeps the windows that it is given.
#[derive(Debug, Clone)]
struct Keeper {
    contract: Contract,
    given: Arc<Mutex<Vec<Given>>>,
}

impl std::fmt::Debug for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} {:?}", self.id, self.frames)
    }
}

impl Regressor for Keeper {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        assert_eq!(windows.ids.len(), windows.starts.len());
        let mut given = self.given.lock().unwrap();
        for (&start, id) in windows.starts.iter().zip(windows.ids) {
            let frame = |idx: usize| {
                let taxels = &windows.tactile[2 * idx..2 * idx + 2];
                [taxels[0].to_bits(), taxels[1].to_bits(), windows.pose[idx].to_bits()]
            };
            given.push(Given { id: id.clone(), frames: (start..start + WINDOW).map(frame).collect() });
        }
        out.clear();
        out.force.resize(windows.starts.len(), 0.0);
        Ok(())
    }
}

impl Keeper {
    fn new() -> Self {
        let contract = Contract { has_base: false, ..contract(WINDOW, 2, 1) };
        Keeper { contract, given: Arc::default() }
    }

    /// Two regions of one source that share this model.
    fn core(&self, batch: usize) -> Fusion {
        let regions = vec![region("index", &[0, 1], &["dip"]), region("thumb", &[2, 0], &["pip"])];
        let cfg = config(3, regions);
        let cfg = cfg.with_batch(batch_of(batch));
        fusion(cfg, vec![Box::new(self.clone())])
    }
}

fn drain(core: &mut Fusion) {
    while core.poll().unwrap().is_some() {}
}

#[test]
fn in_a_steady_stream_every_window_follows_the_one_before_it_of_its_region() {
    let keeper = Keeper::new();
    let mut core = keeper.core(1);
    for k in 0..20 {
        core.handle(Sample::joints(10.0 * k as f64, &[("dip", 0.1), ("pip", 0.2)]).event()).unwrap();
        core.handle(Sample::tactile(10.0 * k as f64, &[1.0, 2.0, 3.0]).event()).unwrap();
        drain(&mut core);
    }
    let given = keeper.given.lock().unwrap();
    assert_eq!(given.len(), 2 * (20 - WINDOW + 1));
    for pair in given.chunks_exact(2).collect::<Vec<_>>().windows(2) {
        assert!(pair[1][0].id.follows(&pair[0][0].id) && pair[1][1].id.follows(&pair[0][1].id));
        assert!(!pair[1][0].id.follows(&pair[0][1].id) && !pair[1][1].id.follows(&pair[0][0].id));
        assert!(!pair[0][0].id.follows(&pair[0][0].id) && !pair[0][0].id.follows(&pair[1][0].id));
    }
}

#[test]
fn no_window_follows_one_of_another_core() {
    let keeper = Keeper::new();
    for _ in 0..2 {
        let mut core = keeper.core(1);
        for k in 0..WINDOW {
            core.handle(Sample::joints(10.0 * k as f64, &[("dip", 0.1), ("pip", 0.2)]).event()).unwrap();
            core.handle(Sample::tactile(10.0 * k as f64, &[1.0, 2.0, 3.0]).event()).unwrap();
            drain(&mut core);
        }
    }
    let given = keeper.given.lock().unwrap();
    assert_eq!(given.len(), 4);
    assert!((0..4).all(|idx| (0..idx).all(|earlier| given[idx].id != given[earlier].id)));
}

proptest! {
    #[test]
    fn a_window_follows_another_only_if_all_its_frames_but_one_are_the_same(
        picks in prop::collection::vec((0u8..40, 0i64..14, 0u8..4), 1..300),
        batch in 1usize..5,
    ) {
        let keeper = Keeper::new();
        let mut core = keeper.core(batch);
        let mut at_ms = 0;
        for (k, &(kind, step, value)) in picks.iter().enumerate() {
            at_ms += match kind {
                0 => 300,  // a gap
                1 => -400, // a jump of time
                2 => 30,   // frames that are filled in
                _ => step,
            };
            let reading = if kind == 3 { f32::NAN } else { f32::from(value) };
            match kind {
                4 => {
                    let zero = Baseline::from_median(vec![f32::from(value); 3]);
                    core.handle_baseline(TactileSourceIdx::at(0), zero).unwrap();
                }
                5..14 => {
                    let angles = [("dip", f64::from(value)), ("pip", k as f64)];
                    core.handle(Sample::joints(at_ms as f64, &angles[..1 + usize::from(value > 0)]).event()).unwrap();
                }
                _ => core.handle(Sample::tactile(at_ms as f64, &[reading, k as f32, 1.0]).event()).unwrap(),
            }
            drain(&mut core);
        }
        core.handle_end();
        drain(&mut core);
        let given = keeper.given.lock().unwrap();
        for (idx, window) in given.iter().enumerate() {
            for earlier in &given[..idx] {
                if window.id.follows(&earlier.id) {
                    prop_assert_eq!(&window.frames[..WINDOW - 1], &earlier.frames[1..]);
                }
                prop_assert_ne!(&window.id, &earlier.id);
            }
        }
    }
}

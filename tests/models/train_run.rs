//! A run is a function of data, settings and seed: threads, stops and resumes change nothing.

use crate::train_common;

use std::sync::atomic::{AtomicBool, Ordering};

use tactile_pose_fusion::eval::Part;
use tactile_pose_fusion::train::*;
use train_common::{WINDOW, all_of_it, config, dataset, split_session};

fn run(trainer: &mut Trainer<'_>) -> Outcome {
    trainer.run(&AtomicBool::new(false), None, &mut |_| {}).unwrap()
}

/// A dataset with a validation part.
fn split_dataset() -> Dataset {
    let session = split_session("a", &[(Part::Train, 150), (Part::Validation, 45), (Part::Test, 45)]);
    Dataset::new(vec![session], all_of_it(Kind::PoseAware)).unwrap()
}

#[test]
fn every_kind_learns_a_small_set_by_heart() {
    for kind in [Kind::PoseAware, Kind::TactileOnly, Kind::EarlyFusion, Kind::Adaptive] {
        let dataset = dataset(kind, if kind == Kind::Adaptive { 400 } else { 80 });
        let mut trainer = Trainer::new(config(kind, 250), &dataset, 2).unwrap();
        let mut first = None;
        let mut last = LossTerms::default();
        let outcome = trainer
            .run(&AtomicBool::new(false), None, &mut |progress| {
                first.get_or_insert(progress.loss);
                last = progress.loss;
            })
            .unwrap();
        let learned = validate(&outcome.last, &dataset, Part::Train, &LossConfig::default(), 1).unwrap();
        let first = first.unwrap();
        assert!(last.force < 0.3 * first.force, "{kind:?}: {first:?} to {last:?}");
        assert!(learned.mae_gf < 10.0, "{kind:?}: {learned:?}"); // of forces up to 100 gF
        assert!(learned.balanced_accuracy.unwrap() > 0.85, "{kind:?}: {learned:?}");
        if kind == Kind::PoseAware {
            assert!(last.artifact < 0.7 * first.artifact, "{first:?} to {last:?}");
            assert!(learned.base_mae_gf.is_some());
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let dataset = split_dataset();
    let cfg = TrainConfig { shards: 3, ..config(Kind::PoseAware, 8) };
    let one = run(&mut Trainer::new(cfg.clone(), &dataset, 1).unwrap());
    for threads in [1, 2, 5] {
        assert_eq!(run(&mut Trainer::new(cfg.clone(), &dataset, threads).unwrap()), one);
    }
    let other = run(&mut Trainer::new(TrainConfig { seed: 1, ..cfg }, &dataset, 1).unwrap());
    assert_ne!(other.last.values, one.last.values);
}

#[test]
fn a_resumed_run_is_the_uninterrupted_one() {
    let dataset = split_dataset();
    let cfg = config(Kind::PoseAware, 13);
    let whole = run(&mut Trainer::new(cfg.clone(), &dataset, 2).unwrap());

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.checkpoint");
    let stop = AtomicBool::new(false);
    let mut trainer = Trainer::new(cfg, &dataset, 2).unwrap();
    let stopped =
        trainer.run(&stop, Some(&path), &mut |progress| stop.store(progress.step == 6, Ordering::Relaxed)).unwrap();
    assert!(stopped.stopped);
    assert_eq!(stopped.steps, 6);

    let checkpoint = Checkpoint::load(&path).unwrap();
    assert_eq!(checkpoint.step(), 6);
    assert_eq!(*checkpoint.last(), stopped.last);
    assert_eq!(checkpoint, trainer.checkpoint());
    let resumed = run(&mut Trainer::resume(checkpoint, &dataset, 1).unwrap());
    assert_eq!(resumed, whole);
    assert!(!resumed.stopped);
}

#[test]
fn progress_tells_of_every_step_and_the_best_is_the_smallest_validation_loss() {
    let dataset = split_dataset();
    let mut all = Vec::new();
    let mut trainer = Trainer::new(config(Kind::PoseAware, 14), &dataset, 2).unwrap();
    let outcome = trainer.run(&AtomicBool::new(false), None, &mut |progress| all.push(progress.clone())).unwrap();
    assert_eq!(all.iter().map(|progress| progress.step).collect::<Vec<_>>(), (1..=14).collect::<Vec<_>>());
    let looked: Vec<u64> = all.iter().filter(|p| p.validation.is_some()).map(|p| p.step).collect();
    assert_eq!(looked, [4, 8, 12, 14]);
    let best = all.iter().filter_map(|p| Some((p.step, p.validation.clone()?)));
    let best = best.min_by(|a, b| a.1.loss.total_cmp(&b.1.loss)).unwrap();
    assert_eq!((outcome.best_step, outcome.best_validation.clone()), (best.0, Some(best.1)));
    let again = validate(&outcome.best, &dataset, Part::Validation, &LossConfig::default(), 1).unwrap();
    assert_eq!(Some(again), outcome.best_validation);
    assert!(all.iter().all(|p| p.gradient_norm > 0.0 && p.loss.total.is_finite()));
}

#[test]
fn without_a_validation_part_the_last_network_is_the_best() {
    let dataset = dataset(Kind::TactileOnly, 80);
    let outcome = run(&mut Trainer::new(config(Kind::TactileOnly, 3), &dataset, 1).unwrap());
    assert_eq!(outcome.best, outcome.last);
    assert_eq!((outcome.best_step, outcome.best_validation), (3, None));
}

#[test]
fn a_checkpoint_of_other_data_is_refused() {
    let (one, other) = (dataset(Kind::TactileOnly, 80), dataset(Kind::TactileOnly, 81));
    let trainer = Trainer::new(config(Kind::TactileOnly, 3), &one, 1).unwrap();
    let refused = Trainer::resume(trainer.checkpoint(), &other, 1).unwrap_err().to_string();
    assert!(refused.starts_with("the checkpoint was made on other recordings"), "{refused}");
}

#[test]
fn a_file_that_is_no_checkpoint_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.checkpoint");
    assert!(matches!(Checkpoint::load(&path), Err(TrainError::File { .. })));
    let dataset = dataset(Kind::TactileOnly, 80);
    Trainer::new(config(Kind::TactileOnly, 3), &dataset, 1).unwrap().checkpoint().save(&path).unwrap();
    let whole = std::fs::read_to_string(&path).unwrap();
    let spoiled = [
        whole[..whole.len() / 2].to_string(),
        whole.replace("\"format\":1", "\"format\":2"),
        whole.replacen("\"values\":\"", "\"values\":\"00000000", 1),
        whole.replacen("\"values\":\"", "\"values\":\"x", 1),
        whole.replace("\"n_taxels\":3", "\"n_taxels\":99999999999"),
        String::new(),
    ];
    for text in spoiled {
        std::fs::write(&path, text).unwrap();
        let refused = Checkpoint::load(&path).unwrap_err();
        assert!(matches!(refused, TrainError::Checkpoint { .. }), "{refused}");
        assert_eq!(refused.to_string().lines().count(), 1);
    }
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let dataset = dataset(Kind::TactileOnly, 80);
    let good = config(Kind::TactileOnly, 3);
    type Change = fn(&mut TrainConfig);
    let cases: [(Change, &str); 8] = [
        (|c| c.batch = 0, "batch is 0"),
        (|c| c.shards = 17, "shards is 17, expected at most the batch"),
        (|c| c.schedule.steps = 0, "steps is 0"),
        (|c| c.schedule.learning_rate = f64::NAN, "learning_rate is NaN"),
        (|c| c.clip_norm = 0.0, "clip_norm is 0"),
        (|c| c.loss.lambda = -1.0, "lambda is -1"),
        (|c| c.smoothing_frames = f32::INFINITY, "smoothing_frames is inf"),
        (|c| c.weight_decay = -0.5, "weight_decay is -0.5"),
    ];
    for (change, expected) in cases {
        let mut cfg = good.clone();
        change(&mut cfg);
        let refused = Trainer::new(cfg, &dataset, 1).unwrap_err().to_string();
        assert!(refused.starts_with(&format!("training setting {expected}")), "{refused}");
    }
    let mut cfg = good;
    cfg.force_scale = 0.0;
    assert!(matches!(Trainer::new(cfg, &dataset, 1), Err(TrainError::Architecture { .. })));
    assert!(matches!(Trainer::new(config(Kind::PoseAware, 3), &dataset, 1), Err(TrainError::Architecture { .. })));
}

#[test]
fn a_loss_that_is_no_number_stops_the_run() {
    let dataset = dataset(Kind::TactileOnly, 80);
    let mut cfg = config(Kind::TactileOnly, 50);
    cfg.schedule.learning_rate = 1e38;
    cfg.schedule.warmup_steps = 0;
    let mut trainer = Trainer::new(cfg, &dataset, 1).unwrap();
    let refused = trainer.run(&AtomicBool::new(false), None, &mut |_| {}).unwrap_err();
    assert!(matches!(refused, TrainError::Diverged { .. }), "{refused}");
}

#[test]
fn a_batch_larger_than_the_data_is_all_of_it() {
    let dataset = dataset(Kind::TactileOnly, 60);
    let cfg = TrainConfig { batch: 4096, ..config(Kind::TactileOnly, 2) };
    let mut epochs = Vec::new();
    let mut trainer = Trainer::new(cfg, &dataset, 2).unwrap();
    trainer.run(&AtomicBool::new(false), None, &mut |progress| epochs.push(progress.epochs)).unwrap();
    assert_eq!(epochs, [1.0, 2.0]);
    assert_eq!(dataset.n_windows(Part::Train), 60 - WINDOW + 1);
}

#[test]
fn the_learning_rate_rises_then_falls() {
    let schedule = Schedule { steps: 100, warmup_steps: 10, learning_rate: 1.0, final_learning_rate: 0.1 };
    assert_eq!(schedule.learning_rate(0), 0.1);
    assert_eq!(schedule.learning_rate(9), 1.0);
    assert_eq!(schedule.learning_rate(10), 1.0);
    assert!((schedule.learning_rate(55) - 0.55).abs() < 1e-12); // half of the cosine, exact but for rounding
    assert!((schedule.learning_rate(100) - 0.1).abs() < 1e-12);
}

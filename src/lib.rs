//! Pose-aware tactile force for ROS 2: taxels and joint angles in, wrench and contact out.
//!
//! Soft tactile gloves read force when the wearer only bends a finger. This crate corrects that error in software: a
//! tactile-only force estimate minus a residual that a network predicts from pose and touch together.
//!
//! [`fusion`] is the pure core. All other modules bring it events, models and parameters, or use its estimates. There
//! are three ways to use the crate.
//!
//! # Samples of your own
//!
//! A parameter file describes taxels, joints and models ([`glove`]). The core takes samples as they arrive, and gives
//! estimates as soon as their joint angles are final.
//!
//! ```
//! use tactile_pose_fusion::fusion::{Baseline, Event, JointSample, TactileBlock};
//! use tactile_pose_fusion::glove::Glove;
//! use tactile_pose_fusion::units::Stamp;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut core = Glove::load("params/glove3.yaml")?.into_core()?;
//! let glove = core.config().tactile_source_named("glove").ok_or("no source named glove")?;
//! let hand = core.config().joint_source_named("hand").ok_or("no source named hand")?;
//! core.handle_baseline(glove, Baseline::from_median(vec![300.0; 6]))?; // readings at rest
//! let names = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"].map(String::from);
//! let mut newest = None;
//! for number in 0..100_i64 {
//!     let stamp = Stamp(number * 10_000_000); // ns: 100 Hz
//!     let (positions, values) = ([0.2, 0.4, 0.3, 0.0], [310.0 + (number % 3) as f32; 6]);
//!     core.handle(Event::Joints(JointSample { source: hand, stamp, names: &names, positions: &positions, received: stamp }))?;
//!     let (rows, row_period_ns, sequence) = (1, 0, None);
//!     let block =
//!         TactileBlock { source: glove, stamp, rows, row_period_ns, sequence, values: &values, received: stamp };
//!     core.handle(Event::Tactile(block))?;
//!     while let Some(tick) = core.poll()? {
//!         newest = tick.estimates[0].force; // N; `None` until the model's window is full
//!     }
//! }
//! assert!(newest.is_some());
//! # Ok(())
//! # }
//! ```
//!
//! After the last sample, call [`Fusion::handle_end`](fusion::Fusion::handle_end). Then `poll` gives the frames that
//! still wait. An adaptive model also needs the artifact of this donning (one wearing of the glove).
//! [`zero::Zero::install`] gives it. Without it, the core removes the mean artifact of the training donnings, and does
//! not follow changes.
//!
//! # A recording
//!
//! [`replay`] runs a bag through the same core, and passes on the estimates frame by frame or writes them to another
//! bag. An [`Observer`](observer::Observer) receives notes and progress, and can cancel.
//!
//! ```
//! use tactile_pose_fusion::config::{self, DEFAULT_NODE};
//! use tactile_pose_fusion::observer::Unobserved;
//! use tactile_pose_fusion::replay::{self, Options, Recording};
//! use tactile_pose_fusion::zero::Wanted;
//! # use tactile_pose_fusion::{sim, synthetic};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let (bag, output) = (folder.path().join("session"), folder.path().join("forces.mcap"));
//! # let (activity, tracking, conditions) = Default::default();
//! # let spec = sim::SessionSpec { glove: 3, user: 1, session: 3, seed: 1, minutes: 2.5, activity, tracking, conditions };
//! # synthetic::write(&spec, &bag, false, &Unobserved)?;
//! let cfg = config::load("params/glove3.yaml".as_ref(), DEFAULT_NODE)?;
//! let bags = [bag];
//! let recording = Recording { bags: &bags, zero: Wanted::Any }; // annotations, else `calibration.file`, else the first seconds
//! let mut largest = 0.0_f64;
//! let seen = replay::for_each(cfg.clone(), recording, &Unobserved, |tick| {
//!     largest = tick.estimates[0].force.map_or(largest, |force| largest.max(force.0));
//! })?;
//! assert!(largest > 1.0 && seen.warnings.is_empty());
//!
//! let replayed = replay::run(cfg, recording, &Options::new(output), &Unobserved)?;
//! assert!(replayed.is_complete());
//! println!("{}", replayed.summary());
//! # Ok(())
//! # }
//! ```
//!
//! # Scores
//!
//! [`evaluate`] compares models, or the estimates in bags, with the true force.
//!
//! ```
//! use tactile_pose_fusion::config::{self, DEFAULT_NODE};
//! use tactile_pose_fusion::evaluate::{self, Request};
//! use tactile_pose_fusion::observer::Unobserved;
//! # use tactile_pose_fusion::{sim, synthetic};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let bag = folder.path().join("session");
//! # let (activity, tracking, conditions) = Default::default();
//! # let spec = sim::SessionSpec { glove: 3, user: 1, session: 3, seed: 1, minutes: 2.5, activity, tracking, conditions };
//! # synthetic::write(&spec, &bag, false, &Unobserved)?;
//! let cfg = config::load("params/glove3.yaml".as_ref(), DEFAULT_NODE)?;
//! let found = evaluate::run(cfg, &Request::new(&[bag]), &Unobserved)?;
//! let judged = found.models.last().ok_or("nothing was scored")?;
//! let score = &judged.by["all"][0].score;
//! assert!(score.ba.value().is_some_and(|ba| ba > 0.8)); // balanced accuracy of touch
//! # Ok(())
//! # }
//! ```
//!
//! # Where to find things
//!
//! - [`zero`] decides the zero of the forces of a recording. The live node judges its zero by the same rules. The
//!   parameters `calibration.*` tell it what to use, and when to refuse a zero.
//! - The estimate of a region is a [`fusion::Estimate`]. Its [`fusion::Flags`] give the reasons not to trust it. A
//!   [`fusion::Tick`] has the estimates of one frame of one tactile source. [`msg::Outgoing`] turns it into ROS
//!   messages.
//! - `tpf replay` calls [`replay::run`], `tpf train` `training::run`, and `tpf run` `ros::run`. `tpf eval` calls
//!   [`evaluate::run_with`], which does what [`evaluate::run`] does and also passes on the frames of each session.
//!   `tpf eval --partial` calls [`evaluate::run_partial`], and `tpf merge` [`evaluate::merge`]. `tpf eval` scores only
//!   the test part unless `--whole` or `--held-out` is given; a request from [`evaluate::Request::new`] scores every
//!   frame. The program `tpf` is in a crate of its own, `tactile_pose_fusion_commands`, which uses the library like any
//!   other program.
//! - Parameters and their defaults are in [`config::keys`], wire types in [`msg`], bags in [`bag`], models in
//!   [`model`], metrics in [`eval`], and labels and annotations of recordings in [`recording`] and [`sessions`].
//! - The networks for training are in `train`. `training` makes a model file from bags. The live node is in `ros`.
//!
//! ARCHITECTURE.md has the complete map of the modules, their dependencies, and answers to more first questions.

pub mod bag;
pub mod calibrate;
pub mod calibration;
pub mod characterization;
pub mod characterize;
pub mod collect;
pub mod columns;
pub mod config;
pub mod eval;
pub mod evaluate;
pub mod export;
pub mod files;
pub mod fusion;
pub mod glove;
pub mod hand;
mod histogram;
pub mod init;
pub mod inspect;
pub mod leave;
pub mod location;
pub mod model;
pub mod msg;
pub mod observer;
pub mod protocol;
mod random;
pub mod recording;
pub mod replay;
#[cfg(feature = "ros")]
pub mod ros;
pub mod sessions;
pub mod sim;
pub mod synthetic;
#[cfg(feature = "train")]
pub mod train;
#[cfg(feature = "train")]
pub mod training;
pub mod units;
pub mod zero;

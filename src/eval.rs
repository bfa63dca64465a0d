//! Evaluation of estimates: the paper's metrics and statistics, ours on top, and how two runs differ. Pure: no I/O.
//!
//! Forces here are grams-force, as in the paper, unless a name says otherwise. Nothing here answers with NaN: a measure
//! that a set of frames can't give says why in [`Undefined`].

mod class;
mod contact;
mod curve;
mod density;
mod diff;
mod evaluation;
mod gates;
mod groups;
mod held;
mod in_air;
mod metric;
mod metrics;
mod pose_age;
mod preservation;
mod rows;
mod scored_frames;
mod scoring;
mod split;
mod statistics;
mod table;
mod tangential;
mod timing;
mod truth;

pub use contact::{AirTouches, ContactError, Detection, DetectionTally, Touch, Touches, Touching};
pub use curve::{ForceBin, ForceCurve, Mdf, NoTouchFrames};
pub use density::ForceDensity;
pub use diff::{
    Diff, DiffConfig, DiffError, Difference, EstimateRecord, Field, FieldDiff, FieldValue, Moment, OnlyIn, RegionDiff,
    diff,
};
pub use evaluation::{ContactReport, Evaluation, EvaluationError, FREE_MOVEMENT, GroupScore, group_scores};
pub use gates::{Check, Gate, GateError, GateMetric, Gates, Only, Scored, Verdict};
pub use groups::{Group, GroupBy, Origin, PairedTest, Tallies, UserPair, paired_by_user};
pub use held::HeldTouches;
pub use in_air::{InAir, InAirReport, InAirTally};
pub use metric::{Metric, Undefined};
pub use metrics::{Confusion, Coverage, Measure, MetricError, Score, Tally};
pub use pose_age::{PoseAge, PoseAgeBin, PoseAgeError, PoseAgeTally};
pub use preservation::{Fate, Preservation, PreservationTally, TouchFate};
pub use rows::{RowError, StatRow};
pub use scored_frames::{Asked, ScoredFrames};
pub use scoring::{BIN_WIDTH, MDF_BALANCED_ACCURACY, MissingEstimate, Scoring, ScoringError, TOUCH};
pub use split::{Cuts, Part, Split, SplitBy, SplitError, StageSpan};
pub use statistics::{Distribution, StatisticsError, Wilcoxon, cohens_dz, wilcoxon_greater};
pub use table::{Cell, Improvement, ModelRow, ResultTable};
pub use tangential::TangentialScore;
pub use timing::Timing;
pub use truth::{TareBuilder, TareCurve, TareKnot, TruthError, ZeroLoad, ZeroLoadCheck};

//! Observation 2: how the response to force changes with pose.

use serde::Serialize;

use super::curve::{EDGES_GF, ForceCurve, bin_of};
use super::pose_model::Posed;
use super::spread::{Spread, quantile};
use crate::units::{GramForce, Newton};

/// Minimum force of a touch frame; the paper's threshold.
pub(super) const TOUCH_GF: f64 = 2.5;
/// Minimum number of frames for a point of a curve.
const MIN_FRAMES: usize = 20;
/// Minimum force when comparing gains, gF. Below it, a touch adds little more than a pose does.
const MIN_GAIN_GF: f64 = 35.0;
/// Minimum number of bins of force for a comparison of gains.
const MIN_GAIN_BINS: usize = 3;
/// Minimum number of touches each of the straight and of the bent hand, because touches differ by a tenth or more.
const MIN_GAIN_TOUCHES: usize = 5;
/// Thirds of the bend score.
const STRAIGHT: Class = ("low", f64::NEG_INFINITY, 1.0 / 3.0);
const HALF_BENT: Class = ("middle", 1.0 / 3.0, 2.0 / 3.0);
const BENT: Class = ("high", 2.0 / 3.0, f64::INFINITY);
const ALL: &str = "all";

/// Name, and lower and upper bend score.
type Class = (&'static str, f64, f64);

/// Response to force, for all poses and by bend of the hand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseReport {
    /// All loaded frames.
    pub all: ClassCurve,
    /// Thirds of the bend score; empty if there is no score.
    pub by_bend: Vec<ClassCurve>,
    /// Gain of the bent hand in each session: reading that a touch adds at a high bend score, divided by the one at a
    /// low bend score, at equal force.
    pub gain_by_session: Vec<SessionGain>,
    /// The same over all sessions; `None` if no session has it.
    pub gain: Option<Spread>,
}

/// Response to force of one class of poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassCurve {
    /// `all`, or the third of the bend score: `low`, `middle`, `high`.
    pub class: &'static str,
    /// Number of touches with frames in it. A few touches are not enough for a curve, because touches differ.
    pub n_touches: usize,
    /// Number of loaded frames with a known force.
    pub n_frames: usize,
    /// By increasing force; bins with too few frames are left out.
    pub points: Vec<CurvePoint>,
}

/// Readings in one bin of force.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Lower edge of the bin of force, gF.
    pub from_gf: f64,
    /// Mean true force of the frames, gF.
    pub force_gf: f64,
    /// The same, N.
    pub force_n: f64,
    /// Number of frames.
    pub n_frames: usize,
    /// Median of the sum of all taxels.
    pub sum: f64,
    /// Lower and upper quartile of the sum of all taxels.
    pub sum_quartiles: [f64; 2],
    /// Median of the reading that the touch adds: the reading minus the expected reading of the pose in the air.
    pub rise: f64,
    /// `[T]`: median reading.
    pub by_taxel: Vec<f64>,
}

/// Difference of a session's gain between the bent and the straight hand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionGain {
    /// The session.
    pub session: String,
    /// Ratio of the readings that a touch adds at equal force, bent over straight; `None` if there are too few touches
    /// or their forces overlap too little.
    pub at_equal_force: Option<f64>,
    /// Ratio of the slopes over force, bent over straight.
    pub of_slopes: Option<f64>,
    /// Number of bins of force that were compared.
    pub n_bins: usize,
    /// Number of touches of the straight and of the bent hand.
    pub n_touches: [usize; 2],
}

/// Frames of one bin.
#[derive(Debug, Clone, Default)]
struct Bin {
    forces: Vec<f64>,
    sums: Vec<f64>,
    rises: Vec<f64>,
    by_taxel: Vec<Vec<f64>>,
}

/// Frames of one class by bin of force.
#[derive(Debug, Clone)]
struct Gathered {
    class: &'static str,
    n_touches: usize,
    bins: Vec<Bin>,
}

impl Gathered {
    /// The loaded frames of a class of poses; of all poses if no class is given.
    fn of<'p>(class: Option<Class>, sessions: impl IntoIterator<Item = &'p Posed<'p>>) -> Self {
        let (mut bins, mut n_touches) = (vec![Bin::default(); EDGES_GF.len() - 1], 0);
        for posed in sessions {
            let session = &posed.session;
            let is_of_class = |idx: &usize| match (class, &posed.score) {
                (None, _) => true,
                (Some((_, from, to)), Some(score)) => (from..to).contains(&score[*idx]),
                (Some(_), None) => false,
            };
            let (mut touched, mut is_counted) = (None, false); // last frame of the current touch
            for idx in (0..session.sum.len()).filter(|idx| !session.frames.in_air[*idx]) {
                let Some(force) = session.truth_gf(idx).filter(|force| *force >= TOUCH_GF) else { continue };
                if touched.replace(idx).is_none_or(|before| before + 1 != idx) {
                    is_counted = false;
                }
                let Some(bin) = bin_of(force).filter(|_| is_of_class(&idx)).map(|bin| &mut bins[bin]) else { continue };
                n_touches += usize::from(!std::mem::replace(&mut is_counted, true));
                bin.forces.push(force);
                bin.sums.push(session.sum[idx]);
                bin.rises.push(posed.rise(idx));
                bin.by_taxel.resize(session.n_taxels, Vec::new());
                bin.by_taxel.iter_mut().enumerate().for_each(|(taxel, of)| of.push(session.reading(idx, taxel)));
            }
        }
        Gathered { class: class.map_or(ALL, |class| class.0), n_touches, bins }
    }

    fn finish(mut self) -> ClassCurve {
        ClassCurve {
            class: self.class,
            n_touches: self.n_touches,
            n_frames: self.bins.iter().map(|bin| bin.forces.len()).sum(),
            points: self.bins.iter_mut().enumerate().filter_map(|(bin, frames)| frames.point(bin)).collect(),
        }
    }
}

impl Bin {
    fn point(&mut self, bin: usize) -> Option<CurvePoint> {
        let n_frames = self.forces.len();
        if n_frames < MIN_FRAMES {
            return None;
        }
        let force_gf = self.forces.iter().sum::<f64>() / n_frames as f64;
        Some(CurvePoint {
            from_gf: EDGES_GF[bin],
            force_gf,
            force_n: Newton::from(GramForce(force_gf)).0,
            n_frames,
            sum: quantile(&mut self.sums, 0.5)?,
            sum_quartiles: [quantile(&mut self.sums, 0.25)?, quantile(&mut self.sums, 0.75)?],
            rise: quantile(&mut self.rises, 0.5)?,
            by_taxel: self.by_taxel.iter_mut().map(|of| quantile(of, 0.5)).collect::<Option<_>>()?,
        })
    }
}

impl ClassCurve {
    /// The curve that converts a reading of all taxels to the force of a tap that adds this reading.
    pub(super) fn to_force(&self) -> Option<ForceCurve> {
        ForceCurve::through(self.points.iter().map(|point| (point.force_gf, point.rise)))
    }
}

/// Force curve of one session's straight hand, or of its hand in all poses if there are too few data.
pub(super) fn session_curve(posed: &Posed<'_>) -> Option<ForceCurve> {
    let curve = |class| Gathered::of(class, [posed]).finish().to_force();
    curve(Some(STRAIGHT)).or_else(|| curve(None))
}

impl ResponseReport {
    /// The response of all sessions; `None` if no loaded frame has a known force.
    pub(super) fn of(sessions: &[Posed<'_>]) -> Option<Self> {
        let all = Gathered::of(None, sessions).finish();
        if all.n_frames == 0 {
            return None;
        }
        let has_score = sessions.iter().any(|posed| posed.score.is_some());
        let gain_by_session: Vec<SessionGain> = sessions.iter().map(SessionGain::of).collect();
        Some(ResponseReport {
            all,
            by_bend: [STRAIGHT, HALF_BENT, BENT]
                .into_iter()
                .filter(|_| has_score)
                .map(|class| Gathered::of(Some(class), sessions).finish())
                .collect(),
            gain: Spread::of(gain_by_session.iter().map(|gain| gain.at_equal_force)),
            gain_by_session,
        })
    }
}

impl SessionGain {
    fn of(posed: &Posed<'_>) -> Self {
        let [mut straight, mut bent] = [STRAIGHT, BENT].map(|class| Gathered::of(Some(class), [posed]));
        let n_touches = [straight.n_touches, bent.n_touches];
        let bins = straight.bins.iter_mut().zip(&mut bent.bins).enumerate();
        let pairs: Vec<(CurvePoint, CurvePoint)> = bins
            .filter_map(|(bin, (straight, bent))| Some((straight.point(bin)?, bent.point(bin)?)))
            .filter(|(straight, bent)| straight.force_gf.min(bent.force_gf) >= MIN_GAIN_GF)
            .collect();
        let enough = pairs.len() >= MIN_GAIN_BINS && n_touches.iter().all(|n| *n >= MIN_GAIN_TOUCHES);
        // Divided by force, because the mean force in a bin differs a little between the classes.
        let gain = |point: &CurvePoint| point.rise / point.force_gf;
        let mut ratios: Vec<f64> = pairs.iter().map(|(straight, bent)| gain(bent) / gain(straight)).collect();
        let straight = slope(pairs.iter().map(|pair| &pair.0));
        let bent = slope(pairs.iter().map(|pair| &pair.1));
        SessionGain {
            session: posed.session.frames.name.clone(),
            at_equal_force: quantile(&mut ratios, 0.5).filter(|ratio| enough && ratio.is_finite()),
            of_slopes: Some(bent / straight).filter(|ratio| enough && ratio.is_finite()),
            n_bins: pairs.len(),
            n_touches,
        }
    }
}

/// Least-squares slope of the reading that a touch adds over its force.
fn slope<'p>(points: impl Iterator<Item = &'p CurvePoint> + Clone) -> f64 {
    let n = points.clone().count() as f64;
    let mean = |of: fn(&CurvePoint) -> f64| points.clone().map(of).sum::<f64>() / n;
    let (force, rise) = (mean(|point| point.force_gf), mean(|point| point.rise));
    let product = |of: fn(&CurvePoint) -> f64, around: f64| -> f64 {
        points.clone().map(|point| (point.force_gf - force) * (of(point) - around)).sum()
    };
    product(|point| point.rise, rise) / product(|point| point.force_gf, force)
}

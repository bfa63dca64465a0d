//! Frame counters since the last report, by outcome, for the diagnostics.

use crate::fusion::{Adaptation, Estimate, Flags};

/// Frames of regions since the last report.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcomes {
    /// Frames, one per region and tick.
    pub n: u64,
    /// Beside them, frames of windows that began anew with a new zero: the node's own doing.
    pub n_renewed: u64,
    /// Those with a force.
    pub n_with_force: u64,
    /// Those with a force and without a flag.
    pub n_good: u64,
    /// Those with artifact following.
    pub n_followed: u64,
    /// Of these, those whose artifact is at its limit of distance from the calibration.
    pub n_capped: u64,
    /// Of these, those whose joint angles are too noisy to tell the artifact well.
    pub n_noisy: u64,
    /// Those with each flag, by the flag's name, in the order of the flags' bits.
    pub flags: Vec<(&'static str, u64)>,
}

impl Outcomes {
    /// Records the outcome of a frame.
    pub fn handle(&mut self, estimate: &Estimate) {
        self.n += 1;
        self.n_with_force += u64::from(estimate.force.is_some());
        self.n_good += u64::from(estimate.force.is_some() && estimate.flags.is_empty());
        let followed = [Adaptation::Learning, Adaptation::Waiting, Adaptation::Capped, Adaptation::Noisy];
        self.n_followed += u64::from(followed.contains(&estimate.adaptation));
        self.n_capped += u64::from(estimate.adaptation == Adaptation::Capped);
        self.n_noisy += u64::from(estimate.adaptation == Adaptation::Noisy);
        if estimate.flags.is_empty() {
            return;
        }
        if self.flags.is_empty() {
            self.flags = Flags::names().map(|(_, name)| (name, 0)).collect();
        }
        for ((flag, _), (_, n)) in Flags::names().zip(&mut self.flags) {
            *n += u64::from(estimate.flags.contains(flag));
        }
    }

    /// True if most followed artifacts are at their limit of distance from the calibration.
    pub fn is_capped(&self) -> bool {
        2 * self.n_capped > self.n_followed
    }

    /// True if joint angles are noisy in many of the frames with artifact following; the others may have a touch.
    pub fn is_noisy(&self) -> bool {
        4 * self.n_noisy > self.n_followed
    }

    /// Fraction of `n_expected` frames that are good, 0 to 1. Missing frames count like those without a force.
    pub fn share(&self, n_expected: f64) -> f64 {
        let n = (n_expected - self.n_renewed as f64).max(self.n as f64);
        match n < 1.0 {
            true if self.n_renewed > 0 => 1.0,
            true => 0.0,
            false => (self.n_good as f64 / n).min(1.0),
        }
    }

    /// Number of frames with each flag, the most frequent first, and number of missing frames: `STALE_POSE 100, WARMUP
    /// 3`.
    pub fn reasons(&self, n_expected: f64) -> String {
        let mut flags: Vec<(&str, u64)> = self.flags.iter().copied().filter(|(_, n)| *n > 0).collect();
        flags.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
        let mut texts: Vec<String> = flags.iter().map(|(name, n)| format!("{n} frames {name}")).collect();
        let n_missing = n_expected - (self.n + self.n_renewed) as f64;
        if n_missing > 0.1 * n_expected {
            texts.push(format!("{n_missing:.0} frames missing"));
        }
        texts.join(", ")
    }

    /// The flag of most frames, if there is one.
    pub fn worst(&self) -> Option<&'static str> {
        self.flags.iter().filter(|(_, n)| *n > 0).max_by_key(|(_, n)| *n).map(|(name, _)| *name)
    }
}

/// Advice for a flag when no input has a known problem.
pub fn advice(flag: &str) -> &'static str {
    match flag {
        "WARMUP" => "a model's window begins anew after each gap: look for gaps in the taxels",
        "UNCALIBRATED" => "calibrate (tpf call calibrate), or start with --calibration FILE",
        "STALE_POSE" => "joint angles are missing or too old: look at joint.<source>.stamp and timing.max_pose_age_ms",
        "STALE_TACTILE" => "no taxels come in time: look at their driver and tactile_timeout_ms",
        "POSE_OUT_OF_RANGE" => {
            "joint angles lie outside of what the model was trained on: look at joint.<source>.degrees and .scale, or train it on such poses"
        }
        "FAULTY_TAXEL" => "a taxel doesn't move: look at the sensor, then calibrate again",
        "NON_FINITE" => "taxels or the model's output are no finite numbers: look at the driver",
        "LATE" => "data is old when it arrives: look at the link, the clocks and timing.max_age_ms",
        "HELD_POSE" => "joint angles come late or with gaps: look at their driver and timing.max_pose_age_ms",
        "FROZEN" => "taxels repeat: look at their driver",
        "INTERLEAVED" => "taxels of two senders come in turn: stop one of them",
        "WRONG_RATE" => {
            "taxels come at another rate than the model's: if it lasts, set frame_clock of their source to grid"
        }
        _ => "~/contacts has the flags",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Newton;

    #[test]
    fn the_share_is_that_of_all_frames_that_should_have_come() {
        let mut outcomes = Outcomes::default();
        let estimate = |force: Option<f64>, flags| Estimate { force: force.map(Newton), flags, ..Estimate::default() };
        (0..80).for_each(|_| outcomes.handle(&estimate(Some(1.0), Flags::default())));
        (0..10).for_each(|_| outcomes.handle(&estimate(Some(1.0), Flags::STALE_POSE)));
        (0..10).for_each(|_| outcomes.handle(&estimate(None, Flags::WARMUP | Flags::STALE_POSE)));
        assert_eq!((outcomes.n, outcomes.n_with_force, outcomes.n_good), (100, 90, 80));
        assert_eq!((outcomes.share(100.0), outcomes.share(200.0), outcomes.share(50.0)), (0.8, 0.4, 0.8));
        assert_eq!(outcomes.reasons(200.0), "20 frames STALE_POSE, 10 frames WARMUP, 100 frames missing");
        assert_eq!(outcomes.reasons(105.0), "20 frames STALE_POSE, 10 frames WARMUP", "a tick more or less");
        assert_eq!(outcomes.worst(), Some("STALE_POSE"));
        assert_eq!((Outcomes::default().share(0.0), Outcomes::default().worst()), (0.0, None));
    }

    #[test]
    fn windows_that_begin_anew_with_a_new_zero_lower_no_share() {
        let good = Estimate { force: Some(Newton(1.0)), ..Estimate::default() };
        let mut outcomes = Outcomes { n_renewed: 63, ..Outcomes::default() };
        assert_eq!(outcomes.share(60.0), 1.0, "nothing else was to come");
        (0..36).for_each(|_| outcomes.handle(&good));
        assert_eq!((outcomes.share(100.0), outcomes.reasons(100.0)), (36.0 / 37.0, String::new()));
        assert_eq!(outcomes.share(163.0), 0.36, "what is missing beside them counts");
    }

    #[test]
    fn artifacts_are_capped_where_most_of_those_that_are_followed_are() {
        let of = |adaptations: &[Adaptation]| {
            let mut outcomes = Outcomes::default();
            let estimate = |adaptation| Estimate { adaptation, ..Estimate::default() };
            adaptations.iter().for_each(|adaptation| outcomes.handle(&estimate(*adaptation)));
            (outcomes.n_followed, outcomes.is_capped())
        };
        assert_eq!(of(&[]), (0, false));
        assert_eq!(of(&[Adaptation::Off, Adaptation::Frozen]), (0, false));
        assert_eq!(of(&[Adaptation::Capped, Adaptation::Learning]), (2, false));
        assert_eq!(of(&[Adaptation::Capped, Adaptation::Waiting, Adaptation::Capped]), (3, true));
    }

    #[test]
    fn joint_angles_are_noisy_where_many_frames_say_so() {
        let of = |n_noisy: usize, n_waiting: usize| {
            let mut outcomes = Outcomes::default();
            let estimate = |adaptation| Estimate { adaptation, ..Estimate::default() };
            (0..n_noisy).for_each(|_| outcomes.handle(&estimate(Adaptation::Noisy)));
            (0..n_waiting).for_each(|_| outcomes.handle(&estimate(Adaptation::Waiting)));
            (outcomes.n_followed, outcomes.is_noisy())
        };
        assert_eq!((of(0, 0), of(0, 3), of(1, 3), of(2, 4)), ((0, false), (3, false), (4, false), (6, true)));
    }

    #[test]
    fn every_flag_has_an_advice_of_its_own() {
        for (_, name) in Flags::names() {
            assert_ne!(advice(name), advice(""), "{name}");
        }
    }
}

//! Readings and joint angles for the trial runs of a model: of every scale, and the same at every start.

use crate::fusion::{Contract, SharedWindows};

/// Ranges of readings and angles of one scale.
pub(super) struct Scale {
    /// Description, for messages.
    pub(super) name: &'static str,
    /// Smallest and largest reading.
    taxels: [f32; 2],
    angles: Angles,
}

impl Scale {
    /// The largest reading, of either sign.
    pub(super) fn most(&self) -> f32 {
        self.taxels[0].abs().max(self.taxels[1].abs())
    }
}

/// Range of the joint angles.
enum Angles {
    /// Range of the training data, or ±0.5 rad if the model doesn't give it.
    Trained,
    /// From -x to x, in radians.
    Within(f32),
}

/// Readings that sensors send at rest and under load, readings that they can't send, and values of software errors.
/// Every model must give finite forces on the first scale.
pub(super) const SCALES: [Scale; 9] = [
    Scale { name: "small", taxels: [0.0, 1.0], angles: Angles::Trained },
    Scale { name: "tiny", taxels: [-0.01, 0.01], angles: Angles::Within(0.01) },
    Scale { name: "negative", taxels: [-50.0, 0.0], angles: Angles::Within(3.2) },
    Scale { name: "light", taxels: [-5.0, 50.0], angles: Angles::Trained },
    Scale { name: "loaded", taxels: [0.0, 2000.0], angles: Angles::Trained },
    Scale { name: "12-bit", taxels: [-4095.0, 4095.0], angles: Angles::Within(3.2) },
    Scale { name: "a pose beyond any hand with small", taxels: [0.0, 10.0], angles: Angles::Within(100.0) },
    Scale { name: "16-bit", taxels: [-65_535.0, 65_535.0], angles: Angles::Within(10.0) },
    Scale { name: "impossibly large", taxels: [-1e6, 1e6], angles: Angles::Within(30.0) },
];

/// Generated frames of one scale.
pub(super) struct Frames {
    pub(super) tactile: Vec<f32>,
    pub(super) pose: Vec<f32>,
}

impl Frames {
    pub(super) fn new(contract: &Contract, scale: &Scale, n_frames: usize) -> Self {
        let mut random = Lcg::new();
        let mut within = |[min, max]: [f32; 2]| min + (max - min) * random.next_unit();
        let tactile = (0..n_frames * contract.n_columns()).map(|_| within(scale.taxels)).collect();
        let ranges = contract.pose_range.as_deref().unwrap_or_default();
        let span = |joint: usize| match scale.angles {
            Angles::Trained => ranges.get(joint).map_or([-0.5, 0.5], |range| [range.min as f32, range.max as f32]),
            Angles::Within(limit) => [-limit, limit],
        };
        let pose = (0..n_frames * contract.n_joints).map(|at| within(span(at % contract.n_joints))).collect();
        Frames { tactile, pose }
    }

    pub(super) fn windows<'f>(&'f self, starts: &'f [usize]) -> SharedWindows<'f> {
        SharedWindows { starts, ids: &[], tactile: &self.tactile, pose: &self.pose }
    }
}

/// Knuth's 64-bit linear congruential generator: good enough for trial windows, and the same on every machine.
struct Lcg(u64);

impl Lcg {
    /// Always starts from the same state.
    fn new() -> Self {
        Lcg(0x7470_665f_7472_6961)
    }

    /// The next number in `[0, 1)`.
    fn next_unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u32 << 24) as f32 // the top 24 bits, exact in f32
    }
}

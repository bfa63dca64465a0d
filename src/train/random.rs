//! Seeded random numbers, the same on every machine and in every version of the generator's crate.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

/// Purpose of a random stream: streams of one seed don't overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    /// The initial weights.
    Weights,
    /// The order of the windows of an epoch.
    Epoch(u64),
    /// The light touches that are added in a step.
    LightTouch(u64),
    /// The held touches of a copy of a session.
    HeldTouch(u64),
}

/// The half of the streams that light touches have, and the quarter of held touches.
const LIGHT_TOUCH: u64 = 1 << 63;
const HELD_TOUCH: u64 = 1 << 62;

/// A stream of random numbers.
pub(super) struct Random(ChaCha8Rng);

impl Random {
    pub(super) fn new(seed: u64, stream: Stream) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        let mut rng = ChaCha8Rng::from_seed(key);
        rng.set_stream(match stream {
            Stream::Weights => 0,
            Stream::Epoch(epoch) => epoch.wrapping_add(1) & (HELD_TOUCH - 1),
            Stream::LightTouch(step) => LIGHT_TOUCH | step,
            Stream::HeldTouch(copy) => HELD_TOUCH | (copy & (HELD_TOUCH - 1)),
        });
        Random(rng)
    }

    /// A number in `[0, 1)`.
    pub(super) fn unit(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / (1u32 << 24) as f32 // 24 bits, exact in f32
    }

    /// A number in `[-bound, bound)`.
    pub(super) fn symmetric(&mut self, bound: f32) -> f32 {
        bound * (2.0 * self.unit() - 1.0)
    }

    /// Fisher and Yates' shuffle.
    pub(super) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            // The modulo favours low numbers by less than 2^-32 for any list that fits in memory.
            let other = (self.0.next_u64() % (last as u64 + 1)) as usize;
            items.swap(last, other);
        }
    }
}

//! Seeded random numbers: the same on every machine and in every version, because they use nothing but the ChaCha
//! stream.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

/// An independent stream of random numbers, identified by its name.
#[derive(Debug)]
pub(crate) struct Noise {
    rng: ChaCha8Rng,
    spare: Option<f64>,
}

impl Noise {
    /// The stream with this name. Streams with different names are independent, so drawing more numbers from one
    /// doesn't change the others.
    pub(crate) fn named(name: &str) -> Self {
        Noise { rng: ChaCha8Rng::from_seed(Sha256::digest(name).into()), spare: None }
    }

    /// Uniform in `[low, high)`.
    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// Normal with mean zero, by Marsaglia's polar method.
    pub(crate) fn normal(&mut self, sd: f64) -> f64 {
        if let Some(spare) = self.spare.take() {
            return sd * spare;
        }
        loop {
            let (u, v) = (self.uniform(-1.0, 1.0), self.uniform(-1.0, 1.0));
            let square = u * u + v * v;
            if square > 0.0 && square < 1.0 {
                let scale = (-2.0 * libm::log(square) / square).sqrt();
                self.spare = Some(v * scale);
                return sd * u * scale;
            }
        }
    }

    /// Log-normal with median 1.
    pub(crate) fn log_normal(&mut self, sd: f64) -> f64 {
        libm::exp(self.normal(sd))
    }

    /// Log-uniform in `[low, high)`. Both must be positive.
    pub(crate) fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * libm::exp(self.uniform(0.0, libm::log(high / low)))
    }

    /// Exponential with this mean.
    pub(crate) fn exponential(&mut self, mean: f64) -> f64 {
        -mean * libm::log(1.0 - self.uniform(0.0, 1.0))
    }

    /// Shuffles a slice.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let other = self.uniform(0.0, (last + 1) as f64) as usize;
            items.swap(last, other.min(last));
        }
    }
}

/// A random process around zero with correlation time `tau_s` (Ornstein-Uhlenbeck).
#[derive(Debug, Clone)]
pub(crate) struct Wander {
    sd: f64,
    tau_s: f64,
    value: f64,
}

impl Wander {
    /// A process that starts with a value from its stationary distribution.
    pub(crate) fn new(sd: f64, tau_s: f64, noise: &mut Noise) -> Self {
        Wander { sd, tau_s, value: noise.normal(sd) }
    }

    /// Adds a step, which decays with `tau_s`.
    pub(crate) fn push(&mut self, by: f64) {
        self.value += by;
    }

    /// Value after `dt_s`.
    pub(crate) fn advance(&mut self, dt_s: f64, noise: &mut Noise) -> f64 {
        let kept = libm::exp(-dt_s / self.tau_s);
        self.value = self.value * kept + noise.normal(self.sd * (1.0 - kept * kept).sqrt());
        self.value
    }
}

/// A first-order lag. It is exact for an input that is constant over a step, for any step size.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lag {
    tau_s: f64,
    value: Option<f64>,
}

impl Lag {
    /// A lag whose initial value is its first input.
    pub(crate) fn new(tau_s: f64) -> Self {
        Lag { tau_s, value: None }
    }

    /// Lagged value after `dt_s`.
    pub(crate) fn advance(&mut self, dt_s: f64, input: f64) -> f64 {
        let before = self.value.unwrap_or(input);
        let value = input + (before - input) * libm::exp(-dt_s / self.tau_s);
        self.value = Some(value);
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_told_apart_by_name_and_never_change() {
        let mut noise = Noise::named("a");
        let (first, second) = (noise.uniform(0.0, 1.0), noise.normal(1.0));
        let mut again = Noise::named("a");
        assert_eq!((again.uniform(0.0, 1.0), again.normal(1.0)), (first, second));
        assert_ne!(Noise::named("b").uniform(0.0, 1.0), first);
        let frozen = Noise::named("tpf").rng.next_u64();
        assert_eq!(frozen, 17_075_203_823_109_943_775); // first 8 bytes of ChaCha8 keyed with SHA-256 of the name
    }

    #[test]
    fn wanderers_keep_their_spread() {
        let mut noise = Noise::named("wander");
        let mut wander = Wander::new(2.0, 0.1, &mut noise);
        let squares: f64 = (0..20_000).map(|_| wander.advance(0.05, &mut noise).powi(2)).sum();
        assert!(((squares / 20_000.0).sqrt() - 2.0).abs() < 0.1); // 10 standard errors
    }
}

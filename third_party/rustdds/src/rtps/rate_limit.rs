use std::time::{Duration, Instant};

/// Lets so many things a second happen, with as many at once. What is over is
/// refused. Bounds what others can make us do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RateLimit {
  per_second: u32,
  // When all that happened would have happened, had it come evenly.
  used_until: Option<Instant>,
}

impl RateLimit {
  pub const fn new(per_second: u32) -> Self {
    Self {
      per_second,
      used_until: None,
    }
  }

  pub fn allows(&mut self, now: Instant) -> bool {
    let used_until = self.used_until.map_or(now, |until| until.max(now));
    if used_until.duration_since(now) >= Duration::from_secs(1) {
      return false;
    }
    self.used_until = Some(used_until + Duration::from_secs(1) / self.per_second);
    true
  }
}

#[cfg(test)]
mod tests {
  use super::*;

  #[test]
  fn lets_as_many_a_second_happen() {
    let mut limit = RateLimit::new(100);
    let start = Instant::now();
    let allowed_at = |limit: &mut RateLimit, after: Duration| {
      (0..10_000).filter(|_| limit.allows(start + after)).count()
    };
    assert_eq!(allowed_at(&mut limit, Duration::ZERO), 100);
    assert_eq!(allowed_at(&mut limit, Duration::from_millis(500)), 50);
    assert_eq!(allowed_at(&mut limit, Duration::from_secs(100)), 100);
  }
}

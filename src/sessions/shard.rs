//! Selects every N-th bag of a list, the share of one of several processes.

use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Share of one of several processes: the bags at `index`, `index + of`, `index + 2 of`, ... of a list. The index
/// starts at 0, as in array jobs of Slurm and indexed jobs of Kubernetes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Shard {
    index: usize,
    of: usize,
}

/// Text that is not a shard.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected I/N with 0 <= I < N, such as 0/12 for the first of 12 shards, got {0:?}")]
pub struct ShardError(String);

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let shard = text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        let shard = shard.and_then(|(index, of)| Shard::new(index, of));
        shard.ok_or_else(|| ShardError(text.to_owned()))
    }
}

impl TryFrom<String> for Shard {
    type Error = ShardError;

    fn try_from(text: String) -> Result<Self, ShardError> {
        text.parse()
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.to_string()
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

impl Shard {
    /// The only shard: all bags.
    pub const WHOLE: Shard = Shard { index: 0, of: 1 };

    /// Shard `index` of `of`. `None` if `index` is too large.
    pub fn new(index: usize, of: usize) -> Option<Self> {
        (index < of).then_some(Shard { index, of })
    }

    /// Index, from 0.
    pub fn index(self) -> usize {
        self.index
    }

    /// Number of shards.
    pub fn of(self) -> usize {
        self.of
    }

    /// The bags of this shard, in the order of the list. Empty if there are more shards than bags.
    pub fn bags(self, all: &[PathBuf]) -> Vec<PathBuf> {
        all.iter().skip(self.index).step_by(self.of).cloned().collect()
    }

    /// Number of bags of this shard, out of `n`.
    pub fn n_of(self, n: usize) -> usize {
        n.saturating_sub(self.index).div_ceil(self.of)
    }

    /// Position of its `nth` bag in the list.
    pub fn place(self, nth: usize) -> usize {
        self.index.saturating_add(nth.saturating_mul(self.of))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_hold_every_bag_once_and_know_its_place() {
        let all: Vec<PathBuf> = (0..7).map(|idx| PathBuf::from(idx.to_string())).collect();
        for of in [1, 3, 7, 9] {
            let mut places = vec![0; all.len()];
            for index in 0..of {
                let shard: Shard = format!("{index}/{of}").parse().unwrap();
                let bags = shard.bags(&all);
                assert_eq!(bags.len(), shard.n_of(all.len()), "{shard}");
                bags.iter().enumerate().for_each(|(nth, bag)| {
                    assert_eq!(*bag, all[shard.place(nth)]);
                    places[shard.place(nth)] += 1;
                });
            }
            assert_eq!(places, vec![1; all.len()], "{of}");
        }
        for wrong in ["", "3", "3/3", "-1/3", "1/0", "a/b", "1/2/3", "99999999999999999999/2"] {
            assert!(wrong.parse::<Shard>().unwrap_err().to_string().contains("0 <= I < N"), "{wrong}");
        }
    }
}

//! Indices of the parts of a configuration, each a type of its own, so that none is taken for one of another kind.
//!
//! An index is a position, counted from 0. A [`FusionConfig`](super::FusionConfig) gives those that it has. Whoever takes
//! one checks it: an index that a configuration or a core doesn't have is an error or `None` there, never another part.

/// Index of a tactile source in [`FusionConfig::tactile_sources`](super::FusionConfig::tactile_sources).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TactileSourceIdx(usize);

impl TactileSourceIdx {
    /// The source at a position.
    pub const fn at(position: usize) -> Self {
        TactileSourceIdx(position)
    }

    /// Position of the source.
    pub const fn position(self) -> usize {
        self.0
    }
}

/// Index of a joint source in [`FusionConfig::joint_sources`](super::FusionConfig::joint_sources).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JointSourceIdx(usize);

impl JointSourceIdx {
    /// The source at a position.
    pub const fn at(position: usize) -> Self {
        JointSourceIdx(position)
    }

    /// Position of the source.
    pub const fn position(self) -> usize {
        self.0
    }
}

/// Index of a region in [`FusionConfig::regions`](super::FusionConfig::regions). The default is the first region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct RegionIdx(usize);

impl RegionIdx {
    /// The region at a position.
    pub const fn at(position: usize) -> Self {
        RegionIdx(position)
    }

    /// Position of the region.
    pub const fn position(self) -> usize {
        self.0
    }
}

/// Index of a model among the regressors given to [`Fusion::new`](super::Fusion::new).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ModelIdx(usize);

impl ModelIdx {
    /// The model at a position.
    pub const fn at(position: usize) -> Self {
        ModelIdx(position)
    }

    /// Position of the model.
    pub const fn position(self) -> usize {
        self.0
    }
}

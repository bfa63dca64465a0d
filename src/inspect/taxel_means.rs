//! Means of taxels, which forces are held against.

/// The newest mean of an array that is named as taxels are: by topic and array, and what people call it.
#[derive(Debug)]
pub(super) struct Skin {
    pub(super) key: (usize, usize),
    pub(super) name: String,
    pub(super) mean: f64,
}

/// Most arrays of taxels that forces are held against.
pub(super) const MAX_SKINS: usize = 4;

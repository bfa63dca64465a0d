//! Ring buffer of values per frame. New frames replace the oldest ones.

/// Values of consecutive frames, the same number for each frame.
#[derive(Debug, Default)]
pub(super) struct Frames {
    values: Vec<f32>,
    /// Values per frame.
    width: usize,
    /// Capacity, frames.
    room: usize,
    /// Position of the oldest frame.
    oldest: usize,
    len: usize,
}

impl Frames {
    /// Forgets all frames and sets width and capacity.
    pub(super) fn reset(&mut self, width: usize, room: usize) {
        self.values.resize(width * room, 0.0);
        (self.width, self.room, self.oldest, self.len) = (width, room, 0, 0);
    }

    /// Values per frame.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Adds `n` frames and returns their values to write to: up to the capacity at first, then one frame at a time.
    pub(super) fn push(&mut self, n: usize) -> &mut [f32] {
        let place = (self.oldest + self.len) % self.room;
        let n_gone = (self.len + n).saturating_sub(self.room);
        self.oldest = (self.oldest + n_gone) % self.room;
        self.len += n - n_gone;
        &mut self.values[place * self.width..(place + n) * self.width]
    }

    /// `n` values from frame `frame` on, counted from the oldest. They may span several frames only until the first
    /// frame is replaced.
    pub(super) fn from(&self, frame: usize, n: usize) -> &[f32] {
        let place = (self.oldest + frame) % self.room;
        &self.values[place * self.width..][..n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_frames_give_way() {
        let mut frames = Frames::default();
        for _ in 0..2 {
            frames.reset(2, 3);
            frames.push(3).copy_from_slice(&[0.0, 0.5, 1.0, 1.5, 2.0, 2.5]);
            assert_eq!(
                (frames.from(0, 6), frames.from(1, 4)),
                (&[0.0, 0.5, 1.0, 1.5, 2.0, 2.5][..], &[1.0, 1.5, 2.0, 2.5][..])
            );
            for newest in 3..10 {
                frames.push(1).fill(newest as f32);
            }
            assert_eq!(frames.len(), 3);
            assert_eq!([0, 1, 2].map(|frame| frames.from(frame, 2)[1]), [7.0, 8.0, 9.0]);
        }
    }
}

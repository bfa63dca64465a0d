//! Numbers by frame, of which the oldest give way to new ones.

/// What a run of frames gave, as many numbers each.
#[derive(Debug, Default)]
pub(super) struct Frames {
    values: Vec<f32>,
    /// Numbers of a frame.
    width: usize,
    /// Frames that there is room for.
    room: usize,
    /// Place of the oldest frame.
    oldest: usize,
    len: usize,
}

impl Frames {
    /// Forgets all frames and makes room for others.
    pub(super) fn reset(&mut self, width: usize, room: usize) {
        self.values.resize(width * room, 0.0);
        (self.width, self.room, self.oldest, self.len) = (width, room, 0, 0);
    }

    /// Numbers of a frame.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// The place of `n` new frames: as many as there is room for at the begin, one at a time from then on.
    pub(super) fn push(&mut self, n: usize) -> &mut [f32] {
        let place = (self.oldest + self.len) % self.room;
        let n_gone = (self.len + n).saturating_sub(self.room);
        self.oldest = (self.oldest + n_gone) % self.room;
        self.len += n - n_gone;
        &mut self.values[place * self.width..(place + n) * self.width]
    }

    /// The first `n` numbers from a frame on, counted from the oldest: those of this frame, or, while none has given way,
    /// of any number of frames.
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

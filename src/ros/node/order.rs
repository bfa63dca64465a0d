//! Keeps the published stamps from going backwards. Pure: time is an argument.

use crate::units::Stamp;

/// The stamps published for each tactile source, and which stamps may follow.
#[derive(Debug, Clone)]
pub struct Order {
    sources: Vec<Source>,
    /// Largest step back allowed from a source's stale report to its first frame, ns.
    max_step_back_ns: i64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Source {
    /// Newest published stamp.
    published: Option<Stamp>,
    /// Stamp of the last frame, and the node's time when it was handled.
    frame: Option<(Stamp, Stamp)>,
    n_outdated: u64,
}

impl Order {
    /// Nothing was published yet for `n_sources`. A first frame `max_step_back_ns` or more behind the stale reports
    /// sent before it means that the source has another clock; its frames are accepted.
    pub fn new(n_sources: usize, max_step_back_ns: i64) -> Self {
        Order { sources: vec![Source::default(); n_sources], max_step_back_ns }
    }

    /// True if a frame may be published: nothing newer was published for its source. A refused frame is counted.
    ///
    /// Frames of a source come in the order of their stamps. If they don't, time itself has jumped back: the order
    /// starts again, or the node would publish nothing until time catches up.
    pub fn admits(&mut self, source_idx: usize, stamp: Stamp, now: Stamp) -> bool {
        let source = &mut self.sources[source_idx];
        let starts_anew = match (source.frame, source.published) {
            (Some((last, _)), _) => stamp < last,
            (None, Some(published)) => published.nanos_since(stamp) >= self.max_step_back_ns,
            (None, None) => false,
        };
        if starts_anew {
            source.published = None;
        }
        source.frame = Some((stamp, now));
        if source.published.is_some_and(|published| stamp < published) {
            source.n_outdated += 1;
            return false;
        }
        source.published = Some(stamp);
        true
    }

    /// The stamp for a report at `now` that a source is silent: the source's own time plus the time since its last
    /// frame. So a source with a clock behind the node's is not taken for old data when it comes back.
    pub fn silent(&mut self, source_idx: usize, now: Stamp) -> Stamp {
        let source = &mut self.sources[source_idx];
        let stamp = source.frame.map_or(now, |(last, handled)| last.offset(now.nanos_since(handled).max(0)));
        let stamp = source.published.map_or(stamp, |published| stamp.max(published));
        source.published = Some(stamp);
        stamp
    }

    /// Frames of a source that were not published because something newer was.
    pub fn n_outdated(&self, source_idx: usize) -> u64 {
        self.sources[source_idx].n_outdated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn ms(at: i64) -> Stamp {
        Stamp(at * MS)
    }

    #[test]
    fn what_a_stalled_link_delivers_late_does_not_follow_what_was_said_meanwhile() {
        let mut order = Order::new(1, 100 * MS);
        assert!((0..10).all(|k| order.admits(0, ms(10 * k), ms(10 * k + 1))));
        assert_eq!(order.silent(0, ms(191)), ms(190));
        assert_eq!(order.silent(0, ms(1091)), ms(1090));
        // The frames from 100 to 1090 ms come at once, and later ones at the usual rate.
        let late = (10..110).filter(|k| order.admits(0, ms(10 * k), ms(1092))).count();
        assert_eq!((late, order.n_outdated(0)), (1, 99), "the one at 1090 ms is as new as what was said");
        assert!(order.admits(0, ms(1100), ms(1101)));
    }

    #[test]
    fn a_source_whose_clock_is_apart_is_heard_at_once_when_it_comes_back() {
        for apart in [-3_600_000, 3_600_000] {
            let mut order = Order::new(1, 100 * MS);
            assert!(order.admits(0, ms(apart), ms(0)));
            assert_eq!(order.silent(0, ms(100)), ms(apart + 100));
            assert!(order.admits(0, ms(apart + 110), ms(110)));
            let mut unheard = Order::new(1, 100 * MS);
            assert_eq!(unheard.silent(0, ms(0)), ms(0));
            assert!(unheard.admits(0, ms(apart), ms(10)));
        }
    }

    #[test]
    fn time_that_jumps_back_starts_anew_and_a_clock_that_is_set_back_leads_nowhere() {
        let mut order = Order::new(2, 100 * MS);
        assert!(order.admits(0, ms(5000), ms(5000)) && order.admits(1, ms(9000), ms(5000)));
        assert!(order.admits(0, ms(100), ms(5010)), "a looped bag");
        assert_eq!(order.silent(0, ms(4000)), ms(100), "the node's clock was set back");
        assert!(order.admits(0, ms(110), ms(4010)));
        assert_eq!(order.n_outdated(0) + order.n_outdated(1), 0);
    }
}

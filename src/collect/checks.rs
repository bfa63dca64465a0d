//! Checks before a session begins, so that no time is lost to a broken wire or a wrong name.

use super::senses::{Layout, Stream, Window};
use crate::protocol::{Annotation, CheckMovement, Checks, Protocol};
use crate::units::{NANOS_PER_SEC, Stamp};

/// Substage in the annotations during the checks.
const SUBSTAGE: &str = "checks";

/// Time limit for the first message of every stream, ns.
const LATE_NS: i64 = 3 * NANOS_PER_SEC;

/// Time for the user to let go of objects and come to rest, ns.
const SETTLE_NS: i64 = 3 * NANOS_PER_SEC / 2;

/// Factor by which another joint must move more before the name of a joint is doubted, because hands differ.
const CLEARLY: f64 = 1.1;

/// A problem, on one line: what was expected, what was received, and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem(pub String);

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The checks, one after the other.
#[derive(Debug, Clone)]
pub struct Preflight {
    checks: Checks,
    layout: Layout,
    /// The current check: 0 is to keep still, the others are the movements.
    at: usize,
    first: Option<Stamp>,
    began: Option<Stamp>,
    /// True while the user has time to let go of objects and come to rest.
    settling: bool,
    all: Window,
    problems: Vec<Problem>,
    annotations: Vec<Annotation>,
}

impl Preflight {
    /// The checks before they begin.
    pub fn new(protocol: &Protocol, layout: &Layout) -> Self {
        Preflight {
            checks: protocol.checks.clone(),
            layout: layout.clone(),
            at: 0,
            first: None,
            began: None,
            settling: true,
            all: Window::default(),
            problems: Vec::new(),
            annotations: Vec::new(),
        }
    }

    /// Advances to the time `now`, and reads the sensor data of a check that is over. True if there is more to check.
    ///
    /// Checks begin when every stream has sent data, or when the time limit for that is over.
    pub fn handle_time(&mut self, now: Stamp, all_heard: bool, take_window: &mut dyn FnMut() -> Window) -> bool {
        if self.at > self.checks.movements.len() {
            return false;
        }
        let first = *self.first.get_or_insert(now);
        let Some(began) = self.began else {
            if all_heard || now.nanos_since(first) >= LATE_NS {
                take_window(); // discard earlier data
                self.begin(now);
            }
            return true;
        };
        if self.settling && now.nanos_since(began) >= SETTLE_NS {
            self.settling = false;
            take_window(); // discard data from before the hand came to rest
        }
        if now < self.end(began) {
            return true;
        }
        let window = take_window();
        self.all.merge(&window);
        match self.at.checked_sub(1).map(|movement| &self.checks.movements[movement]) {
            None => self.problems.extend(still(&window, &self.layout, &self.checks)),
            Some(movement) => self.problems.extend(moved(&window, &self.layout, movement, self.checks.min_movement)),
        }
        self.at += 1;
        // The user need not move as long as a driver isn't running.
        if self.at == 1 && !self.problems.is_empty() {
            self.at = self.checks.movements.len() + 1;
            self.annotations.push(Annotation::outside(now));
            return false;
        }
        if self.at > self.checks.movements.len() {
            self.problems.extend(dead_taxels(&self.all, &self.layout));
            self.annotations.push(Annotation::outside(now));
            return false;
        }
        self.begin(now);
        true
    }

    /// The current instruction to the user.
    pub fn prompt(&self) -> &str {
        match self.at.checked_sub(1).and_then(|movement| self.checks.movements.get(movement)) {
            None => "In the air, away from the load cell: keep the hand still",
            Some(movement) => &movement.ask,
        }
    }

    /// Start and end of the current check.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        let began = self.began?;
        Some((began, self.end(began)))
    }

    /// Number of the current check, from 1, and the number of checks.
    pub fn progress(&self) -> (usize, usize) {
        let n = 1 + self.checks.movements.len();
        ((self.at + 1).min(n), n)
    }

    /// The next annotation to publish.
    pub fn poll(&mut self) -> Option<Annotation> {
        (!self.annotations.is_empty()).then(|| self.annotations.remove(0))
    }

    /// Problems found so far.
    pub fn problems(&self) -> &[Problem] {
        &self.problems
    }

    fn end(&self, began: Stamp) -> Stamp {
        let settle_ns = if self.at == 0 { SETTLE_NS } else { 0 };
        began.offset(settle_ns + (self.seconds() * NANOS_PER_SEC as f64) as i64)
    }

    fn begin(&mut self, now: Stamp) {
        self.began = Some(now);
        let pose = self.at.checked_sub(1).map_or("still", |movement| &*self.checks.movements[movement].pose);
        let annotation = Annotation {
            substage: SUBSTAGE.to_owned(),
            pose: pose.to_owned(),
            zero_load: true,
            ..Annotation::outside(now)
        };
        self.annotations.push(annotation);
    }

    fn seconds(&self) -> f64 {
        match self.at.checked_sub(1).and_then(|movement| self.checks.movements.get(movement)) {
            None => self.checks.still_s,
            Some(movement) => movement.seconds,
        }
    }
}

/// Problems with streams that are silent, slow or have gaps, with joints that no source sends, and with a load cell
/// that is not at zero.
fn still(window: &Window, layout: &Layout, checks: &Checks) -> Vec<Problem> {
    let mut problems = Vec::new();
    for stream in layout.streams() {
        let (n, gap_s) = window.streams.get(&stream).copied().unwrap_or_default();
        let (what, at_least) = match stream {
            Stream::Taxels(_) => ("tactile source", checks.rates_hz[0]),
            Stream::Joints(_) => ("joint source", checks.rates_hz[1]),
            Stream::Force(_) => ("force sensor", checks.rates_hz[2]),
        };
        let name = layout.name(stream);
        let rate = n as f64 / window.seconds.max(f64::MIN_POSITIVE);
        problems.extend(if n == 0 {
            Some(format!(
                "{what} {name}: nothing came for {:.1} s; start its driver, or correct its topic",
                window.seconds
            ))
        } else if rate < at_least {
            Some(format!("{what} {name}: expected {at_least} a second at least, got {rate:.1}; see to its driver"))
        } else if gap_s > checks.max_gap_s {
            let most = checks.max_gap_s;
            Some(format!(
                "{what} {name}: nothing came for {gap_s:.2} s, expected at most {most} s; see to its connection"
            ))
        } else {
            None
        });
    }
    let heard: Vec<&str> = window.joints.keys().map(String::as_str).collect();
    if !heard.is_empty() {
        let missing = layout.joints.iter().filter(|joint| !window.joints.contains_key(*joint));
        problems.extend(missing.map(|joint| {
            format!("joint {joint} is in no message, which name {heard:?}; correct region.*.joints or the driver")
        }));
    }
    for (name, force) in layout.force.iter().zip(&window.force) {
        if let Some(mean) = force.mean().filter(|mean| mean.abs() > checks.load_cell_zero) {
            let most = checks.load_cell_zero;
            problems.push(format!(
                "force sensor {name} reads {mean:.2} N with nothing on it, expected at most {most} N; tare it, or take away what presses it"
            ));
        }
    }
    problems.into_iter().map(Problem).collect()
}

/// Problems with joints that did not move, or not in the order of this movement.
fn moved(window: &Window, layout: &Layout, movement: &CheckMovement, at_least: f64) -> Vec<Problem> {
    // With several regions, each has its own finger; the finger that moved most is taken as the instructed one.
    let spans = |part: &str| {
        let of_part = layout.joints.iter().filter(|joint| is_part(joint, part));
        let spans = of_part.filter_map(|joint| window.joints.get(joint).map(|spread| (joint.as_str(), spread.span())));
        spans.max_by(|a, b| a.1.total_cmp(&b.1))
    };
    let found: Vec<(&str, f64)> = movement.most_first.iter().filter_map(|part| spans(part)).collect();
    let mut problems = Vec::new();
    if let Some((joint, span)) = found.first().filter(|(_, span)| *span < at_least) {
        problems.push(format!(
            "joint {joint} moved by {span:.2} rad in the movement \"{}\", expected {at_least} at least; look at the tracker",
            movement.pose
        ));
        return problems.into_iter().map(Problem).collect();
    }
    for pair in found.windows(2) {
        let [(more, more_span), (less, less_span)] = [pair[0], pair[1]];
        if less_span > CLEARLY * more_span {
            problems.push(format!(
                "joint {more} moved by {more_span:.2} rad and {less} by {less_span:.2} in the movement \"{}\", in which \
                 {more} moves more; their names may be swapped",
                movement.pose
            ));
        }
    }
    problems.into_iter().map(Problem).collect()
}

/// True if a joint's name contains a part: `index_mcp_flex` contains `mcp_flex`.
fn is_part(joint: &str, part: &str) -> bool {
    joint == part || joint.ends_with(&format!("_{part}")) || joint.contains(&format!("_{part}_"))
}

/// Taxels whose reading never changed, or is at the end of their range.
fn dead_taxels(all: &Window, layout: &Layout) -> Vec<Problem> {
    let mut problems = Vec::new();
    for ((name, _), spreads) in layout.taxels.iter().zip(&all.taxels) {
        let heard = spreads.iter().any(|spread| spread.n > 0);
        let dead: Vec<String> = (0..spreads.len())
            .filter(|taxel_idx| heard && spreads[*taxel_idx].span() <= 0.0)
            .map(|taxel_idx| taxel_idx.to_string())
            .collect();
        if !dead.is_empty() {
            problems.push(format!(
                "tactile source {name}: taxels {} never changed while the hand moved; see to their lines, or leave them \
                 out of region.*.taxels",
                dead.join(", ")
            ));
        }
    }
    problems.into_iter().map(Problem).collect()
}

#[cfg(test)]
mod tests {
    use super::super::senses::Senses;
    use super::*;
    use crate::units::Newton;

    struct Bench {
        /// Names of DIP, PIP and MCP, which move in a bend and in a fold.
        names: [&'static str; 3],
        dead: Option<usize>,
        force: f64,
        joints: bool,
    }

    const GOOD: Bench =
        Bench { names: ["index_dip", "index_pip", "index_mcp_flex"], dead: None, force: 0.03, joints: true };

    fn problems(bench: &Bench) -> Vec<String> {
        let layout = Layout {
            taxels: vec![("glove".to_owned(), 3)],
            joint_sources: vec!["hand".to_owned()],
            joints: GOOD.names.map(str::to_owned).to_vec(),
            force: vec!["cell".to_owned()],
        };
        let mut senses = Senses::new(layout.clone());
        let mut preflight = Preflight::new(&Protocol::paper(), &layout);
        let names = bench.names.map(str::to_owned);
        let mut pose = String::new();
        for k in 0..2000_i64 {
            let now = Stamp(k * 10_000_000);
            let phase = (k as f64 * 0.03).sin().abs();
            let angles = match pose.as_str() {
                "bend" => [1.1, 1.5, 0.15],
                "fold" => [0.1, 0.18, 1.3],
                _ => [0.0; 3],
            };
            let mut taxels = [100.0, 200.0, 300.0].map(|rest: f32| rest + phase as f32);
            if let Some(dead) = bench.dead {
                taxels[dead] = 512.0;
            }
            senses.handle_taxels(0, &taxels, now);
            if bench.joints {
                senses.handle_joints(0, &names, &angles.map(|angle| angle * phase), now);
            }
            senses.handle_force(0, Newton(bench.force), now);
            let more = preflight.handle_time(now, k > 100, &mut || senses.take_window(now));
            while let Some(mark) = preflight.poll() {
                assert_eq!(mark.stage, 0, "nobody trains on checks");
                pose = mark.pose;
            }
            if !more {
                return preflight.problems().iter().map(ToString::to_string).collect();
            }
        }
        panic!("the checks never end");
    }

    #[test]
    fn nothing_is_found_where_nothing_is_wrong() {
        assert_eq!(problems(&GOOD), [""; 0]);
    }

    #[test]
    fn a_dead_taxel_a_swapped_name_an_untared_cell_and_a_silent_source_are_told() {
        let dead = problems(&Bench { dead: Some(1), ..GOOD });
        assert_eq!(dead.len(), 1);
        assert!(dead[0].starts_with("tactile source glove: taxels 1 never changed"), "{dead:?}");
        let swapped = problems(&Bench { names: ["index_pip", "index_dip", "index_mcp_flex"], ..GOOD });
        assert_eq!(swapped.len(), 1, "{swapped:?}");
        assert!(swapped[0].ends_with("their names may be swapped"), "{swapped:?}");
        let untared = problems(&Bench { force: 1.5, ..GOOD });
        assert_eq!(
            untared,
            [
                "force sensor cell reads 1.50 N with nothing on it, expected at most 0.25 N; tare it, or take away what presses it"
            ]
        );
        let silent = problems(&Bench { joints: false, ..GOOD });
        assert!(silent[0].starts_with("joint source hand: nothing came for 2.0 s"), "{silent:?}");
        let renamed = problems(&Bench { names: ["index_dip", "pip_joint", "index_mcp_flex"], ..GOOD });
        assert!(renamed[0].starts_with("joint index_pip is in no message, which name"), "{renamed:?}");
    }
}

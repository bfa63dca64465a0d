//! A session of a protocol in progress: the current item, and the commands to pause, repeat and skip.

use std::collections::{BTreeSet, VecDeque};

use crate::protocol::{Annotation, Plan, Protocol, Step, Trial};
use crate::units::{NANOS_PER_SEC, Stamp};

/// A command from the user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Continue: begin with the first item, after a pause, or with the next stage.
    Go,
    /// Pause. Afterwards the current item starts again.
    Pause,
    /// Repeat the last item, and drop its result.
    Repeat,
    /// Skip this item.
    Skip,
}

/// An event caused by time or a command.
#[derive(Debug, Clone, PartialEq)]
pub enum Happened {
    /// Publish and record an annotation.
    Marked(Annotation),
    /// An item begins.
    Began(usize),
    /// An item was completed.
    Did(usize),
    /// An item no longer counts as done, because it was interrupted or will be repeated.
    Undid(usize),
    /// Every item of a stage was done or skipped.
    StageOver(u8),
    /// Every item of the session was done or skipped.
    Over,
}

/// State of a session.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Waiting for the user.
    Waiting,
    /// Waiting for the start of the next item.
    Getting {
        /// Start of the item.
        until: Stamp,
        /// The item.
        item: usize,
        /// True if the user should let go of the object meanwhile.
        letting_go: bool,
    },
    /// An item is in progress.
    Doing {
        /// The item.
        item: usize,
        /// Its current step.
        step: usize,
        /// Start of the item.
        began: Stamp,
    },
    /// All items are finished.
    Over,
}

/// A session in progress.
#[derive(Debug, Clone)]
pub struct LedSession {
    protocol: Protocol,
    plan: Plan,
    steps: Vec<Vec<Step>>,
    done: BTreeSet<usize>,
    skipped: BTreeSet<usize>,
    state: State,
    /// Items done in this run with the stamps of their annotations, in order.
    history: Vec<(usize, Vec<Stamp>)>,
    /// Stamps of the annotations of the current item.
    marked: Vec<Stamp>,
    happened: VecDeque<Happened>,
}

impl LedSession {
    /// A session of which some items are already done. It waits for [`Command::Go`].
    pub fn new(protocol: Protocol, plan: Plan, done: BTreeSet<usize>) -> Self {
        let steps = plan.trials().iter().map(|trial| trial.steps(&protocol)).collect();
        let state = if done.len() == plan.trials().len() { State::Over } else { State::Waiting };
        LedSession {
            protocol,
            plan,
            steps,
            done,
            skipped: BTreeSet::new(),
            state,
            history: Vec::new(),
            marked: Vec::new(),
            happened: VecDeque::new(),
        }
    }

    /// Advances to the current time.
    pub fn handle_time(&mut self, now: Stamp) {
        // If the caller is late, several steps may be due.
        loop {
            match self.state {
                State::Getting { until, item, .. } if now >= until => self.begin(item, now),
                State::Doing { item, step, began } => {
                    let next_s = self.steps[item].get(step + 1).map(|step| step.at_s);
                    match next_s {
                        Some(at_s) if now >= after(began, at_s) => {
                            self.state = State::Doing { item, step: step + 1, began };
                            self.mark_step(item, step + 1, after(began, at_s));
                        }
                        None if now >= after(began, self.trial(item).duration_s) => self.end(item, now),
                        _ => return,
                    }
                }
                _ => return,
            }
        }
    }

    /// Handles a command from the user.
    pub fn handle_command(&mut self, command: Command, now: Stamp) {
        match (command, &self.state) {
            (Command::Go, State::Waiting) => self.get_ready(now, false, self.protocol.lead_s),
            (Command::Pause, State::Doing { .. } | State::Getting { .. }) => {
                self.break_off(now);
                self.state = State::Waiting;
            }
            (Command::Repeat, _) => {
                self.break_off(now);
                if let Some((item, stamps)) = self.history.pop() {
                    self.forget(item, &stamps);
                }
                self.get_ready(now, false, self.protocol.lead_s);
            }
            (Command::Skip, State::Doing { item, .. } | State::Getting { item, .. }) => {
                let item = *item;
                self.break_off(now);
                self.skipped.insert(item);
                self.go_on(item, now, false);
            }
            _ => {}
        }
    }

    /// Marks items that were done or skipped to be done again. Their results no longer count.
    pub fn handle_redo(&mut self, items: &[usize], now: Stamp) {
        self.break_off(now);
        for item in items {
            while let Some(at) = self.history.iter().position(|(done, _)| done == item) {
                let (item, stamps) = self.history.remove(at);
                self.forget(item, &stamps);
            }
        }
        self.state = State::Waiting;
    }

    /// The pending events, one after the other.
    pub fn poll(&mut self) -> Option<Happened> {
        self.happened.pop_front()
    }

    /// The state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The protocol.
    pub fn protocol(&self) -> &Protocol {
        &self.protocol
    }

    /// All items in order.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// True if an item was done.
    pub fn is_done(&self, item: usize) -> bool {
        self.done.contains(&item)
    }

    /// True if an item was skipped.
    pub fn is_skipped(&self, item: usize) -> bool {
        self.skipped.contains(&item)
    }

    /// The current or next item; `None` if none is left.
    pub fn current(&self) -> Option<usize> {
        match self.state {
            State::Doing { item, .. } | State::Getting { item, .. } => Some(item),
            _ => self.first_open(),
        }
    }

    /// The item after the current one.
    pub fn following(&self) -> Option<usize> {
        let current = self.current()?;
        (0..self.plan.trials().len()).find(|item| *item > current && self.is_open(*item))
    }

    /// A step of an item.
    pub fn step(&self, item: usize, step: usize) -> &Step {
        &self.steps[item][step]
    }

    /// Start and end of the current step or wait.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        match self.state {
            State::Getting { until, letting_go, .. } => {
                let length_s = if letting_go { self.protocol.let_go_s } else { self.protocol.lead_s };
                Some((after(until, -length_s), until))
            }
            State::Doing { item, step, began } => {
                let to_s = self.steps[item].get(step + 1).map_or(self.trial(item).duration_s, |next| next.at_s);
                Some((after(began, self.steps[item][step].at_s), after(began, to_s)))
            }
            State::Waiting | State::Over => None,
        }
    }

    /// Time for the open items, without pauses, s.
    pub fn left_s(&self) -> f64 {
        let open = (0..self.plan.trials().len()).filter(|item| self.is_open(*item));
        open.map(|item| self.trial(item).duration_s + self.let_go_s(item)).sum()
    }

    fn trial(&self, item: usize) -> &Trial {
        &self.plan.trials()[item]
    }

    fn is_open(&self, item: usize) -> bool {
        !self.done.contains(&item) && !self.skipped.contains(&item)
    }

    fn first_open(&self) -> Option<usize> {
        (0..self.plan.trials().len()).find(|item| self.is_open(*item))
    }

    /// Time for a user to let go of the load cell after an item, s.
    fn let_go_s(&self, item: usize) -> f64 {
        match self.steps[item].iter().any(|step| !step.zero_load) {
            true => self.protocol.let_go_s,
            false => 0.0,
        }
    }

    fn get_ready(&mut self, now: Stamp, letting_go: bool, wait_s: f64) {
        self.state = match self.first_open() {
            Some(item) => State::Getting { until: after(now, wait_s), item, letting_go },
            None => State::Over,
        };
    }

    fn begin(&mut self, item: usize, now: Stamp) {
        self.state = State::Doing { item, step: 0, began: now };
        self.marked.clear();
        self.happened.push_back(Happened::Began(item));
        self.mark_step(item, 0, now);
    }

    fn mark_step(&mut self, item: usize, step: usize, from: Stamp) {
        let (trial, step) = (self.trial(item), &self.steps[item][step]);
        let annotation = Annotation {
            from,
            stage: trial.stage,
            substage: trial.substage.to_string(),
            pose: step.pose.to_string(),
            repetition: trial.repetition,
            zero_load: step.zero_load,
        };
        self.marked.push(from);
        self.happened.push_back(Happened::Marked(annotation));
    }

    fn end(&mut self, item: usize, now: Stamp) {
        self.done.insert(item);
        self.history.push((item, std::mem::take(&mut self.marked)));
        self.happened.push_back(Happened::Did(item));
        self.go_on(item, now, self.let_go_s(item) > 0.0);
    }

    /// Moves on to the next item, or to the end of a stage.
    fn go_on(&mut self, item: usize, now: Stamp, letting_go: bool) {
        let stage = self.trial(item).stage;
        let next = self.first_open();
        let same_stage = next.is_some_and(|next| self.trial(next).stage == stage);
        if letting_go || !same_stage {
            self.happened.push_back(Happened::Marked(Annotation::outside(now)));
        }
        if same_stage {
            let wait_s = if letting_go { self.protocol.let_go_s } else { 0.0 };
            self.get_ready(now, letting_go, wait_s);
            return;
        }
        self.happened.push_back(Happened::StageOver(stage));
        self.state = State::Waiting;
        if next.is_none() {
            self.happened.push_back(Happened::Over);
            self.state = State::Over;
        }
    }

    /// Cancels the current item or wait, as if it had not begun.
    fn break_off(&mut self, now: Stamp) {
        if let State::Doing { item, .. } = self.state {
            let stamps = std::mem::take(&mut self.marked);
            self.forget(item, &stamps);
            self.happened.push_back(Happened::Marked(Annotation::outside(now)));
        }
    }

    fn forget(&mut self, item: usize, stamps: &[Stamp]) {
        self.done.remove(&item);
        stamps.iter().for_each(|stamp| self.happened.push_back(Happened::Marked(Annotation::outside(*stamp))));
        self.happened.push_back(Happened::Undid(item));
    }
}

/// A stamp this many seconds later.
fn after(stamp: Stamp, seconds: f64) -> Stamp {
    stamp.offset((seconds * NANOS_PER_SEC as f64).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::super::done::done;
    use super::*;
    use crate::protocol::Annotations;

    fn session() -> LedSession {
        let protocol = Protocol::paper();
        let plan = Plan::new(&protocol, Some(2.0), "tests");
        LedSession::new(protocol, plan, BTreeSet::new())
    }

    fn at(seconds: f64) -> Stamp {
        after(Stamp(0), seconds)
    }

    /// Runs the session for a time span, with 20 calls per second.
    fn go(session: &mut LedSession, from_s: f64, to_s: f64) -> Vec<Happened> {
        let mut all = Vec::new();
        for k in 0..=((to_s - from_s) * 20.0) as u32 {
            session.handle_time(at(from_s + f64::from(k) * 0.05));
            all.extend(std::iter::from_fn(|| session.poll()));
        }
        all
    }

    fn annotated(happened: &[Happened]) -> Annotations {
        let mut annotations = Annotations::default();
        for happened in happened {
            if let Happened::Marked(annotation) = happened {
                annotations.handle(annotation.clone());
            }
        }
        annotations
    }

    #[test]
    fn a_session_asks_for_every_item_once_and_annotations_say_that_all_were_done() {
        let mut session = session();
        let mut all = Vec::new();
        for stage in 0..3 {
            session.handle_command(Command::Go, at(f64::from(stage) * 1000.0));
            all.extend(go(&mut session, f64::from(stage) * 1000.0, f64::from(stage) * 1000.0 + 300.0));
        }
        let did: Vec<usize> = all
            .iter()
            .filter_map(|happened| if let Happened::Did(item) = happened { Some(*item) } else { None })
            .collect();
        let n_items = session.plan().trials().len();
        assert_eq!(did, (0..n_items).collect::<Vec<_>>());
        let stages: Vec<&Happened> = all.iter().filter(|happened| matches!(happened, Happened::StageOver(_))).collect();
        assert_eq!(stages, [&Happened::StageOver(1), &Happened::StageOver(2), &Happened::StageOver(3)]);
        assert_eq!(all.last(), Some(&Happened::Over));
        assert_eq!(*session.state(), State::Over);
        let (done, broken) = done(&annotated(&all), session.protocol(), session.plan());
        assert_eq!((done.len(), broken), (n_items, vec![]));
    }

    #[test]
    fn nothing_is_zero_load_while_a_touch_is_let_go_of() {
        let mut session = session();
        session.handle_command(Command::Go, at(0.0));
        let mut all = go(&mut session, 0.0, 300.0);
        session.handle_command(Command::Go, at(300.0));
        all.extend(go(&mut session, 300.0, 600.0));
        let annotations = annotated(&all);
        let let_go_ns = (session.protocol().let_go_s * 1e9) as i64;
        let mut n_touches = 0;
        for pair in annotations.all().windows(2).filter(|pair| pair[0].stage == 2 && !pair[0].zero_load) {
            n_touches += 1;
            assert_eq!(pair[1].stage, 0, "{pair:?}");
            let after = annotations.all().iter().find(|annotation| annotation.from > pair[1].from);
            assert!(after.is_none_or(|after| after.from.nanos_since(pair[1].from) >= let_go_ns), "{pair:?}");
        }
        assert!(n_touches > 5);
    }

    #[test]
    fn what_is_repeated_or_broken_off_is_no_longer_annotated() {
        let mut session = session();
        session.handle_command(Command::Go, at(0.0));
        let lead_s = session.protocol().lead_s;
        let mut all = go(&mut session, 0.0, lead_s + 5.0); // two items of 2 s are done, the third is being done
        assert!(session.is_done(0) && session.is_done(1) && matches!(session.state(), State::Doing { item: 2, .. }));
        session.handle_command(Command::Repeat, at(lead_s + 5.0));
        all.extend(std::iter::from_fn(|| session.poll()));
        assert!(session.is_done(0) && !session.is_done(1));
        let (whole, broken) = done(&annotated(&all), session.protocol(), session.plan());
        assert_eq!((whole, broken), (BTreeSet::from([0]), vec![]));
        all.extend(go(&mut session, lead_s + 5.0, 2.0 * lead_s + 8.0));
        assert!(session.is_done(1), "it was done again");
        session.handle_command(Command::Pause, at(2.0 * lead_s + 8.0));
        assert_eq!(*session.state(), State::Waiting);
        all.extend(std::iter::from_fn(|| session.poll()));
        let (whole, broken) = done(&annotated(&all), session.protocol(), session.plan());
        assert_eq!((whole, broken), (BTreeSet::from([0, 1]), vec![]));
    }

    #[test]
    fn what_is_skipped_is_not_done_and_not_asked_for_again() {
        let mut session = session();
        let lead_s = session.protocol().lead_s;
        session.handle_command(Command::Go, at(0.0));
        go(&mut session, 0.0, lead_s + 0.5);
        session.handle_command(Command::Skip, at(lead_s + 0.5));
        let all = go(&mut session, 0.0, 300.0);
        assert!(session.is_skipped(0) && !session.is_done(0));
        assert!(!all.contains(&Happened::Began(0)));
    }

    #[test]
    fn a_run_that_was_killed_is_gone_on_with_where_it_was() {
        let mut session = session();
        let lead_s = session.protocol().lead_s;
        session.handle_command(Command::Go, at(0.0));
        let all = go(&mut session, 0.0, lead_s + 5.0);
        let (done, broken) = done(&annotated(&all), session.protocol(), session.plan());
        assert_eq!(done, BTreeSet::from([0, 1]));
        assert_eq!(broken.len(), 1, "the third item was begun");
        let again = LedSession::new(session.protocol().clone(), session.plan().clone(), done);
        assert_eq!(again.current(), Some(2));
    }
}

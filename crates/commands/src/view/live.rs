//! A running node, as it comes: what it publishes, at the rate at which a page can show it.

use std::collections::{BTreeSet, VecDeque};
use std::time::{Duration, Instant};

use tactile_pose_fusion::config::{Config, ParamTree};
use tactile_pose_fusion::fusion::{Event, TactileBlock};
use tactile_pose_fusion::leave;
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::msg::{ContactArray, EstimateTopics, WireType};
use tactile_pose_fusion::observer::Observer;
use tactile_pose_fusion::ros::environment::Environment;
use tactile_pose_fusion::ros::{
    DIAGNOSTICS_TYPE, Delivery, Incoming, Inputs, Listener, Listening, Monitored, Names, NodeError, SubscribedTopic,
    TopicType, Watched, input_bindings, system_now, wanted,
};
use tactile_pose_fusion::units::Stamp;
use tactile_pose_fusion::zero::{KnownModels, Wanted, from_file};

use super::error::ViewError;
use super::feed::{Feed, RegionUpdate, State, Update};
use super::scalars::Scalars;
use super::server::{Content, Server};
use super::setup::{Kind, RegionSetup, Setup};

/// Time between updates of a page.
const UPDATE: Duration = Duration::from_millis(33);

/// Frames of a region in an update, at most: a node that is faster is shown with frames left out, and the page says so.
const MOST_FRAMES: usize = 256;

/// Taxels that are older than this are no longer shown, ns.
const OLD_NS: i64 = 500_000_000;

/// Without contacts for longer than the node needs to say that no taxels come, and this, it is silent, s.
const SILENT_S: f64 = 0.5;

/// While a node is silent, it is looked so often whether it is there.
const LOOK_AROUND: Duration = Duration::from_secs(2);

/// A node that is followed.
pub struct Followed {
    cfg: Config,
    listener: Listener,
    inputs: Inputs,
    contacts: SubscribedTopic,
    watched: Monitored,
    feed: Feed,
    /// `[regions]`: the frames since the last update.
    frames: Vec<VecDeque<(Stamp, Scalars)>>,
    /// `[tactile sources]`: the newest row, and when it came.
    rows: Vec<Option<(Vec<f32>, Stamp)>>,
    /// Frames that were left out.
    skipped: u64,
    /// Regions that the node has and the parameters lack.
    unknown: BTreeSet<String>,
    /// When the graph was looked at, and whether the node was in it, where the middleware tells.
    seen: Option<(Instant, Option<bool>)>,
}

impl Followed {
    /// Starts to follow the node of a configuration. The zero only decides how taxels are drawn, because the node has its
    /// own; it is from a file.
    ///
    /// # Errors
    /// [`ViewError`] if the middleware refuses a topic.
    pub fn start(
        mut cfg: Config,
        zero: Wanted<'_>,
        mut listening: Listening,
        environment: &Environment,
        observer: &dyn Observer,
    ) -> Result<Self, ViewError> {
        if let Wanted::File(file) = zero {
            cfg.calibration.file = Some(file.to_path_buf());
        }
        let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &environment.prefixes);
        let names = Names::new(&cfg, &[]).map_err(NodeError::from)?; // the graph remaps
        let bindings = input_bindings(&cfg, &names, &definitions)?;
        let wanted = wanted(&cfg, &ParamTree::empty(&cfg.node.to_string()), &names, &bindings)?;
        for (input, (tree, _)) in names.inputs.iter().zip(&bindings) {
            listening.subscribe(&input.topic, TopicType::Defined(tree), Delivery::of(input))?;
        }
        let topic = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion()).contacts;
        let contacts = listening.subscribe(&topic, TopicType::Known(ContactArray::TYPE_NAME), Delivery::Data)?;
        listening.subscribe("/diagnostics", TopicType::Known(DIAGNOSTICS_TYPE), Delivery::Data)?;
        let inputs = Inputs::new(bindings, Watched::new(&cfg, wanted.into_iter().flatten()));
        let (n_regions, n_sources) = (cfg.fusion().regions().len(), cfg.fusion().tactile_sources().len());
        Ok(Followed {
            listener: listening.start()?,
            inputs,
            contacts,
            watched: Monitored::new(&topic, cfg.node.to_string()),
            feed: Feed::new(setup(&cfg, &topic, observer)),
            frames: vec![VecDeque::new(); n_regions],
            rows: vec![None; n_sources],
            skipped: 0,
            unknown: BTreeSet::new(),
            seen: None,
            cfg,
        })
    }

    /// Serves pages of the node until the process is asked to end, and leaves the graph.
    ///
    /// # Errors
    /// [`ViewError`] if pages can't be served.
    pub fn serve(mut self, server: Server) -> Result<(), ViewError> {
        let content = Content::Live(self.feed.clone());
        let serve = move || {
            let served = server.serve(content);
            served.map_err(|error| leave::fail(error.to_string()))
        };
        std::thread::Builder::new().name("pages".into()).spawn(serve).map_err(ViewError::Serve)?;
        self.follow();
        self.listener.leave();
        Ok(())
    }

    fn follow(&mut self) {
        let mut due = Instant::now() + UPDATE;
        while !leave::asked() {
            let mut next = self.listener.next(due.saturating_duration_since(Instant::now()));
            while let Some(incoming) = next {
                self.handle(&incoming);
                next = if Instant::now() < due { self.listener.poll() } else { None };
            }
            if Instant::now() >= due {
                self.update();
                due = Instant::now() + UPDATE;
            }
        }
    }

    fn handle(&mut self, incoming: &Incoming) {
        if incoming.topic < self.contacts {
            let (sources, rows) = (self.cfg.fusion().tactile_sources(), &mut self.rows);
            self.inputs.handle(incoming, &mut |event| {
                if let Event::Tactile(TactileBlock { source, values, .. }) = event
                    && let Some(last) = values.rchunks_exact(sources[source.position()].n_taxels).next()
                {
                    rows[source.position()] = Some((last.to_vec(), incoming.received));
                }
            });
            return;
        }
        match &incoming.cdr {
            Ok(cdr) if incoming.topic == self.contacts => self.handle_contacts(cdr, incoming.received),
            Ok(cdr) => self.watched.handle_diagnostics(cdr, incoming.received),
            Err(text) => self.watched.unreadable = Some(text.clone()),
        }
    }

    fn handle_contacts(&mut self, cdr: &[u8], received: Stamp) {
        self.watched.handle_contacts(cdr, received);
        for (name, told) in self.watched.regions.iter().filter(|(_, told)| told.received == received) {
            let Some(idx) = self.cfg.fusion().regions().iter().position(|region| region.name == *name) else {
                self.unknown.insert(name.clone());
                continue;
            };
            let frames = &mut self.frames[idx];
            // Several messages may have come at once.
            if frames.back().is_some_and(|(newest, _)| told.stamp <= *newest) {
                continue;
            }
            if frames.len() == MOST_FRAMES {
                frames.pop_front();
                self.skipped += 1;
            }
            frames.push_back((told.stamp, Scalars::of_state(&told.state, None)));
        }
    }

    fn update(&mut self) {
        let now = system_now();
        let age_s = self.watched.age_s(now);
        let state = match age_s {
            // Where no taxels come, the node says so once in that time.
            Some(age_s) if age_s <= SILENT_S + self.cfg.live.tactile_timeout.as_secs_f64() => {
                self.seen = None;
                State::Present
            }
            _ => self.absent(age_s.is_some()),
        };
        let regions = self.cfg.fusion().regions().iter().zip(&mut self.frames).map(|(region, frames)| {
            let mut update = RegionUpdate::default();
            for (stamp, Scalars { values, contact, flags, adaptation }) in frames.drain(..) {
                let [force, force_base, _, artifact, touch, pose_age, artifact_change] = values;
                update.t.push(stamp.0 as f64 * 1e-9);
                update.force.push(force);
                update.force_base.push(force_base);
                update.artifact.push(artifact);
                update.touch.push(touch);
                update.pose_age.push(pose_age);
                update.artifact_change.push(artifact_change);
                update.contact.push(contact);
                update.flags.push(flags);
                update.adaptation.push(adaptation);
            }
            let row = self.rows[region.source.position()].as_ref().filter(|(_, came)| now.nanos_since(*came) <= OLD_NS);
            update.reading = row.map(|(row, _)| region.taxels.iter().map(|&taxel_idx| row[taxel_idx]).collect());
            update
        });
        let regions = regions.collect();
        let unknown = self.unknown.iter().map(|name| format!("the node has a region {name}, the parameters have none"));
        let unreadable = self.watched.unreadable.iter().map(|text| format!("some messages can't be read: {text}"));
        let health = self.watched.diagnostics.iter();
        let update = Update {
            state,
            age_s,
            rate_hz: self.watched.rate_hz(now),
            latency_ms: self.watched.latency_ms(),
            regions,
            diagnostics: health.map(|one| (one.level, one.name.as_str(), one.message.as_str())).collect(),
            diagnostics_late_s: self.watched.diagnostics_late_s(now),
            skipped: self.skipped + self.listener.missed(),
            notes: unknown.chain(unreadable).collect(),
        };
        self.feed.tell(&update);
    }

    /// How a node is that sends nothing.
    fn absent(&mut self, was_present: bool) -> State {
        if self.seen.is_none_or(|(at, _)| at.elapsed() >= LOOK_AROUND) {
            let here = self.listener.around().ok().map(|around| {
                let node = self.cfg.node.to_string();
                around.fusion_nodes().contains(&node.as_str())
            });
            self.seen = Some((Instant::now(), here));
        }
        match (was_present, self.seen.and_then(|(_, here)| here)) {
            (true, Some(false)) => State::Gone,
            (true, _) => State::Silent,
            (false, _) => State::Waiting,
        }
    }
}

fn setup(cfg: &Config, topic: &str, observer: &dyn Observer) -> Setup {
    let mut notes = Vec::new();
    let zero = cfg.calibration.file.as_deref().map(|file| from_file(file, cfg, &KnownModels::default()));
    let baselines = match zero {
        Some(Ok(zero)) => zero.donning.baselines,
        Some(Err(error)) => {
            notes.push(format!("taxels are shown as sent, without their zero: {error}"));
            Vec::new()
        }
        None => Vec::new(),
    };
    notes.iter().for_each(|note| observer.note(note));
    let regions = cfg.fusion().regions().iter().enumerate().map(|(region_idx, region)| {
        RegionSetup::new(cfg, region_idx, region.taxels.len(), baselines.get(region.source.position()))
    });
    let from = format!("Forces as the node publishes them on {topic}.");
    Setup { notes, ..Setup::new(cfg.node.to_string(), Kind::Live, from, regions.collect()) }
}

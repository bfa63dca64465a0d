//! A collection before it is gone on with: a new one, or one that was broken off.

use std::path::PathBuf;

use tactile_pose_fusion::bag::BagWriter;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::protocol::{Annotations, Protocol};

use super::super::{Failure, Outcome, print, protocol, say};
use super::folder::{About, Folder};
use super::{Args, SHORT_MINUTES};

/// A collection: on the disk, or not yet.
pub(super) struct Begun {
    pub(super) about: About,
    pub(super) protocol: Protocol,
    /// Annotations of earlier runs.
    pub(super) annotations: Annotations,
    output: PathBuf,
    /// It is made when something is to be put into it.
    folder: Option<Folder>,
    parts: Vec<PathBuf>,
}

impl Begun {
    pub(super) fn anew(args: &Args, cfg: &Config) -> Result<Self, Failure> {
        Folder::check_new(&args.output)?; // before anyone puts on a glove
        let protocol = protocol(args.protocol.as_deref())?;
        let minutes = args.minutes.or(args.short.then_some(SHORT_MINUTES));
        Ok(Begun {
            about: About::new(&protocol, minutes, args.seed, cfg, args.donning),
            protocol,
            annotations: Annotations::default(),
            output: args.output.clone(),
            folder: None,
            parts: Vec::new(),
        })
    }

    pub(super) fn again(args: &Args, cfg: &Config) -> Result<Self, Failure> {
        let folder = Folder::open(&args.output)?;
        folder.check_same(cfg)?;
        let parts = folder.parts()?;
        Ok(Begun {
            about: folder.about.clone(),
            protocol: folder.protocol.clone(),
            annotations: folder.annotations(&parts, &cfg.stage_topic)?,
            output: args.output.clone(),
            folder: Some(folder),
            parts,
        })
    }

    /// Begins what this run records.
    pub(super) fn begin_part(&mut self) -> Result<BagWriter, Failure> {
        let folder = match self.folder.take() {
            Some(folder) => folder,
            None => Folder::create(&self.output, self.about.clone(), self.protocol.clone())?,
        };
        self.folder.insert(folder).begin_part(&self.parts)
    }

    /// Makes the bag of what all runs recorded.
    pub(super) fn complete(&self, cfg: &Config) -> Result<Outcome, Failure> {
        let nothing = || Failure(format!("{}: nothing has been recorded yet", self.output.display()));
        let folder = self.folder.as_ref().ok_or_else(nothing)?;
        let parts = folder.parts()?;
        if parts.is_empty() {
            return Err(nothing());
        }
        let finished = folder.complete(&parts, &cfg.stage_topic)?;
        finished.notes.iter().for_each(|note| say(note));
        print(&format!("{}: {} messages\n", finished.path.display(), finished.n_messages))?;
        Ok(Outcome::Done)
    }
}

//! `tpf demo`: everything once, with nothing but this program: a synthetic glove on a user whom no model knows, the models
//! that ship, a table, a picture.

mod linear;

use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::quoted_path;
use tactile_pose_fusion::config::{self, Config};
use tactile_pose_fusion::evaluate::{self, Evaluated, Request};
use tactile_pose_fusion::files;
use tactile_pose_fusion::glove;
use tactile_pose_fusion::location;
use tactile_pose_fusion::model;
use tactile_pose_fusion::replay::{self, Options, Recording};
use tactile_pose_fusion::sessions::recorded;
use tactile_pose_fusion::sim::manipulation::{Episode, Start};
use tactile_pose_fusion::sim::{Activity, Conditions, SessionSpec, Tracking};
use tactile_pose_fusion::synthetic;
use tactile_pose_fusion::zero::Wanted;

use super::{Failure, Outcome, interrupt, print, say, tell};
use crate::report::progress::{Said, Shown};
use crate::report::{evaluation, picture};

/// Users that the shipped models were trained on are 1 to 5 of seed 1; the demo takes another one.
const UNKNOWN_USER: u32 = 6;

/// Marks a folder as made by a demo, so that the next one may write over it.
const MARKER: &str = "made_by_tpf_demo.txt";

/// Shows what pose does to force, on a synthetic glove: simulates a session of a user whom no model knows, replays it with
/// taxels times a gain, the tactile-only model, the paper's and the adaptive one, and compares all with the true force.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Which synthetic glove: 1 capacitive, 2 dull to touch, 3 sensitive with strong artifacts
    #[arg(long, value_name = "1|2|3", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=3))]
    glove: u8,
    /// Length of the session, 2 to 120
    #[arg(long, value_name = "M", default_value_t = 4.0)]
    minutes: f64,
    /// Another user, hand and donning: no model knows any of them
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    seed: u32,
    /// Folder for bags, models and picture, made if it isn't there
    #[arg(short, long, value_name = "DIR", default_value = "tpf_demo")]
    output: PathBuf,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let shipped = &synthetic::SHIPPED[usize::from(args.glove) - 1];
    let folder = Folder { path: &args.output, glove: args.glove };
    folder.prepare()?;
    interrupt::listen();
    // Whoever goes on with this file wants the best of the models.
    write(&folder.params(), shipped.params.replace("_pose_aware.onnx", "_adaptive.onnx").as_bytes())?;
    write(&folder.model(Model::TactileOnly), shipped.tactile_only)?;
    write(&folder.model(Model::PoseAware), shipped.pose_aware)?;
    write(&folder.model(Model::Adaptive), shipped.adaptive)?;
    let adaptive = model::inspect(&folder.model(Model::Adaptive))?.contract;
    let artifact = adaptive.artifact.ok_or_else(|| Failure("the adaptive model tells no artifact".to_owned()))?;
    write(&folder.model(Model::Gain), &linear::model(&artifact, adaptive.rate_hz))?;
    say(&format!("SYNTHETIC DEMO: a simulated glove {} on a simulated hand, no recording.", args.glove));
    say(&format!("No model knows the user, nor this donning of {} minutes.\n", args.minutes));

    let spec = SessionSpec {
        glove: args.glove,
        user: UNKNOWN_USER,
        session: 1,
        seed: u64::from(args.seed),
        minutes: args.minutes,
        activity: Activity::Manipulation,
        tracking: Tracking::Markers,
        conditions: Conditions {
            episodes: vec![Episode::Air, Episode::Touches],
            start: Start::InAir,
            ..Conditions::default()
        },
    };
    tell(&format!("simulate a hand that bends in the air and touches lightly: {}", folder.session().display()));
    synthetic::write(&spec, &folder.session(), true, &Shown::steps("simulate"))?;

    let mut frames = Vec::new();
    let mut cfg = config::load(&folder.params(), config::DEFAULT_NODE)?;
    // Taxels times a gain read bending as force, so no zero is good enough for them; this one is known to be in the air.
    cfg.calibration.max_loaded_fraction = 1.0;
    for model in Model::ALL {
        let replayed = folder.replayed(model);
        tell(&format!("replay it with the {} model: {}", model.name(), replayed.display()));
        folder.replay(model, cfg.clone())?;
        frames.push((model.name(), recorded(&replayed, &cfg, &Said)?));
    }
    tell(&format!("draw force over time: {}", folder.picture().display()));
    write(&folder.picture(), picture::draw(&frames, Model::TactileOnly.name(), args.glove)?.as_bytes())?;
    tell("score all against the true force\n");
    let found = folder.evaluate(cfg)?;
    print(&(evaluation::short_text(&found) + &next_steps(&folder)))?;
    Ok(Outcome::Done)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Model {
    Gain,
    TactileOnly,
    PoseAware,
    Adaptive,
}

impl Model {
    /// From the simplest to the best.
    const ALL: [Model; 4] = [Model::Gain, Model::TactileOnly, Model::PoseAware, Model::Adaptive];

    fn name(self) -> &'static str {
        match self {
            Model::Gain => "taxels-times-gain",
            Model::Adaptive => "adaptive",
            Model::TactileOnly => "tactile-only",
            Model::PoseAware => "pose-aware",
        }
    }
}

/// Where everything goes.
struct Folder<'a> {
    path: &'a Path,
    glove: u8,
}

impl Folder<'_> {
    /// Makes the folder. One that is there is used only if a demo made it.
    fn prepare(&self) -> Result<(), Failure> {
        let failed = |error: std::io::Error| Failure(format!("{}: {error}", self.path.display()));
        location::only_here(self.path).map_err(failed)?;
        let marker = self.path.join(MARKER);
        if self.path.exists() && !marker.exists() {
            return Err(Failure(format!(
                "{}: is there and was not made by a demo; choose another folder with -o",
                self.path.display()
            )));
        }
        for folder in ["params", "models"] {
            std::fs::create_dir_all(self.path.join(folder)).map_err(failed)?;
        }
        write(&marker, b"Made by `tpf demo`, which may write over it.\n")
    }

    // Parameters and models are laid out as in the source tree, so that the parameters find their model.

    fn params(&self) -> PathBuf {
        self.path.join(format!("params/glove{}.yaml", self.glove))
    }

    fn model(&self, model: Model) -> PathBuf {
        self.path.join(format!("models/glove{}_{}.onnx", self.glove, model.name().replace('-', "_")))
    }

    fn session(&self) -> PathBuf {
        self.path.join("session")
    }

    fn replayed(&self, model: Model) -> PathBuf {
        self.path.join(model.name().replace('-', "_"))
    }

    fn picture(&self) -> PathBuf {
        self.path.join("force.svg")
    }

    /// As `tpf replay SESSION --params-file … --model … -o … --merge --overwrite`.
    fn replay(&self, model: Model, mut cfg: Config) -> Result<(), Failure> {
        glove::replace_model(&mut cfg, self.model(model))?;
        let options =
            Options { merge: true, overwrite: true, drop_unused_joints: true, ..Options::new(self.replayed(model)) };
        let recording = Recording { bags: &[self.session()], zero: Wanted::Any };
        replay::run(cfg, recording, &options, &Shown::bytes("replay"))?;
        Ok(())
    }

    /// As `tpf eval SESSION --params-file … --model … --compare … --whole`.
    fn evaluate(&self, cfg: Config) -> Result<Evaluated, Failure> {
        let bags = [self.session()];
        let compare = [Model::Gain, Model::TactileOnly, Model::PoseAware].map(|model| self.model(model));
        let model = self.model(Model::Adaptive);
        let request = Request { model: Some(&model), compare: &compare, ..Request::new(&bags) };
        Ok(evaluate::run(cfg, &request, &Shown::bytes("eval"))?)
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    files::replace(path, bytes).map_err(|error| Failure(format!("{}: {error}", path.display())))
}

fn next_steps(folder: &Folder<'_>) -> String {
    let path = folder.path.display();
    let picture = folder.picture();
    format!(
        "
These are scores of one user and one donning. With another --seed they differ, also in which of tactile-only and pose-aware is better.
All of it is in {path} (synthetic). The picture is {picture}.

The same session with the adaptive model:
  tpf view {adaptive} --params-file {params}
  tpf export {adaptive} --params-file {params} -o forces.csv
  tpf eval {session} --params-file {params} --compare {tactile_only} --whole --by substage --report report.html
With your own glove:
  tpf inspect YOUR_BAG
  tpf init YOUR_BAG -o glove.yaml
  tpf train YOUR_BAGS_WITH_A_LOAD_CELL --params-file glove.yaml --kind adaptive -o model.onnx
  tpf replay YOUR_BAG --params-file glove.yaml --model model.onnx --calibrate-first 10 --merge -o forces.mcap
  tpf eval YOUR_BAGS --params-file glove.yaml --model model.onnx --report report.html
",
        picture = picture.display(),
        session = quoted_path(&folder.session()),
        params = quoted_path(&folder.params()),
        adaptive = quoted_path(&folder.replayed(Model::Adaptive)),
        tactile_only = quoted_path(&folder.model(Model::TactileOnly)),
    )
}

//! `tpf demo`: everything once, with nothing but this program: a synthetic glove on a user whom no model knows, the models
//! that ship, a table, a picture.

mod gloves;
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
use crate::report::evaluation;
use crate::report::picture::{self, Series};
use crate::report::progress::{Said, Shown};
use gloves::{Glove, Model};

/// Users that the shipped models were trained on are 1 to 5 of seed 1; the demo takes another one.
const UNKNOWN_USER: u32 = 6;

/// Marks a folder as made by a demo, so that the next one may write over it.
const MARKER: &str = "made_by_tpf_demo.txt";

/// Shows what pose does to force, on a synthetic glove: simulates a session of a user whom no model knows, replays it with
/// taxels times a gain, the tactile-only model, the paper's and the adaptive one, and compares all with the true force. With
/// hand1: taxels times a gain and one adaptive model, on each of five fingertips.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Which synthetic glove: 1 capacitive, 2 dull to touch, 3 sensitive with strong artifacts, each with taxels on the index
    /// fingertip; hand1: glove 1 with taxels on all five
    #[arg(long, value_name = "1|2|3|hand1", default_value = "3", value_parser = Glove::named)]
    glove: Glove,
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

impl Args {
    /// A session of a user whom no model knows.
    fn spec(&self) -> SessionSpec {
        SessionSpec {
            glove: self.glove.number(),
            user: UNKNOWN_USER,
            session: 1,
            seed: u64::from(self.seed),
            minutes: self.minutes,
            activity: Activity::Manipulation,
            tracking: Tracking::Markers,
            conditions: Conditions {
                fingers: self.glove.fingers(),
                episodes: vec![Episode::Air, Episode::Touches],
                start: Start::InAir,
                ..Conditions::default()
            },
        }
    }
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let (folder, spec) = (Folder { path: &args.output, glove: args.glove }, args.spec());
    folder.prepare()?;
    interrupt::listen();
    folder.write_models()?;
    say(&format!("SYNTHETIC DEMO: a simulated glove {} on a simulated hand, no recording.", spec.glove_name()));
    say(&format!("No model knows the user, nor this donning of {} minutes.\n", args.minutes));

    tell(&format!("simulate a hand that bends in the air and touches lightly: {}", folder.session().display()));
    synthetic::write(&spec, &folder.session(), true, &Shown::steps("simulate"))?;

    let mut series = Vec::new();
    let mut cfg = config::load(&folder.params(), config::DEFAULT_NODE)?;
    // Taxels times a gain read bending as force, so no zero is good enough for them; this one is known to be in the air.
    cfg.calibration.max_loaded_fraction = 1.0;
    for model in args.glove.models().iter().copied() {
        let replayed = folder.replayed(model);
        tell(&format!("replay it with the {} model: {}", model.name(), replayed.display()));
        folder.replay(model, cfg.clone())?;
        let regions = recorded(&replayed, &cfg, &Said)?;
        series.push(Series { name: model.name(), colour: model.colour(), regions });
    }
    tell(&format!("draw force over time: {}", folder.picture().display()));
    let regions: Vec<&str> = cfg.fusion().regions().iter().map(|region| region.name.as_str()).collect();
    let picture = picture::draw(&series, args.glove.baseline().name(), &spec.glove_name(), &regions)?;
    write(&folder.picture(), picture.as_bytes())?;
    tell("score all against the true force\n");
    let found = folder.evaluate(cfg)?;
    print(&(evaluation::short_text(&found) + &next_steps(&folder)))?;
    Ok(Outcome::Done)
}

/// Where everything goes.
struct Folder<'a> {
    path: &'a Path,
    glove: Glove,
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

    /// Writes the parameters and the models that ship, and taxels times a gain.
    fn write_models(&self) -> Result<(), Failure> {
        let (_, params) = self.glove.params();
        write(&self.params(), params.as_bytes())?;
        for (model, bytes) in self.glove.shipped_models() {
            write(&self.model(model), bytes)?;
        }
        let adaptive = model::inspect(&self.model(Model::Adaptive))?.contract;
        let touch = linear::touch_pattern(&adaptive);
        let touch = touch.ok_or_else(|| Failure("the adaptive model tells no artifact".to_owned()))?;
        write(&self.model(Model::Gain), &linear::model(&touch, adaptive.rate_hz))
    }

    // Parameters and models are laid out as in the source tree, so that the parameters find their model.

    fn params(&self) -> PathBuf {
        let (name, _) = self.glove.params();
        self.path.join("params").join(name)
    }

    fn model(&self, model: Model) -> PathBuf {
        self.path.join(format!("models/{}_{}.onnx", self.glove.file_stem(), model.file_stem()))
    }

    fn session(&self) -> PathBuf {
        self.path.join("session")
    }

    fn replayed(&self, model: Model) -> PathBuf {
        self.path.join(model.file_stem())
    }

    fn picture(&self) -> PathBuf {
        self.path.join("force.svg")
    }

    /// As `tpf replay SESSION --params-file … --model … -o … --merge --overwrite`.
    fn replay(&self, model: Model, mut cfg: Config) -> Result<(), Failure> {
        glove::replace_model(&mut cfg, self.model(model))?;
        let options = Options { merge: true, overwrite: true, ..Options::new(self.replayed(model)) };
        let recording = Recording { bags: &[self.session()], zero: Wanted::Any };
        replay::run(cfg, recording, &options, &Shown::bytes("replay"))?;
        Ok(())
    }

    /// As `tpf eval SESSION --params-file … --model … --compare … --whole`.
    fn evaluate(&self, cfg: Config) -> Result<Evaluated, Failure> {
        let bags = [self.session()];
        let compared = self.glove.models().iter().filter(|model| **model != Model::Adaptive);
        let compare: Vec<PathBuf> = compared.map(|model| self.model(*model)).collect();
        let model = self.model(Model::Adaptive);
        let request = Request { model: Some(&model), compare: &compare, ..Request::new(&bags) };
        Ok(evaluate::run(cfg, &request, &Shown::bytes("eval"))?)
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    files::replace(path, bytes).map_err(|error| Failure(format!("{}: {error}", path.display())))
}

fn next_steps(folder: &Folder<'_>) -> String {
    let (differs, own_glove) = match folder.glove {
        Glove::OneFinger { .. } => ("also in which of tactile-only and pose-aware is better", OWN_GLOVE),
        Glove::Hand1 => ("also in which fingers touch", OWN_HAND),
    };
    format!(
        "
These are scores of one user and one donning. With another --seed they differ, {differs}.
All of it is in {path} (synthetic). The picture is {picture}.

The same session with the adaptive model:
  tpf view {adaptive} --params-file {params}
  tpf export {adaptive} --params-file {params} -o forces.csv
  tpf eval {session} --params-file {params} --compare {baseline} --whole --by substage --report report.html
With your own glove:
{own_glove}",
        path = folder.path.display(),
        picture = folder.picture().display(),
        session = quoted_path(&folder.session()),
        params = quoted_path(&folder.params()),
        adaptive = quoted_path(&folder.replayed(Model::Adaptive)),
        baseline = quoted_path(&folder.model(folder.glove.baseline())),
    )
}

/// What to do with a glove of one region.
const OWN_GLOVE: &str = "  tpf inspect YOUR_BAG
  tpf init YOUR_BAG -o glove.yaml
  tpf train YOUR_BAGS_WITH_A_LOAD_CELL --params-file glove.yaml --kind adaptive -o model.onnx
  tpf replay YOUR_BAG --params-file glove.yaml --model model.onnx --calibrate-first 10 --merge -o forces.mcap
  tpf eval YOUR_BAGS --params-file glove.yaml --model model.onnx --report report.html
";

/// What to do with a glove of several regions, for one model of all.
const OWN_HAND: &str = "  tpf inspect YOUR_BAG
  tpf init YOUR_BAG -o glove.yaml
  tpf train YOUR_BAGS_WITH_A_LOAD_CELL --params-file glove.yaml --kind adaptive --region YOUR_REGIONS -o model.onnx
  tpf init YOUR_BAG --model model.onnx -o hand.yaml
  tpf replay YOUR_BAG --params-file hand.yaml --calibrate-first 10 --merge -o forces.mcap
  tpf eval YOUR_BAGS --params-file hand.yaml --report report.html
";

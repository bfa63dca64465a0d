//! `tpf view`: a bag, or a running node, on a page in the browser.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::setup::{ModelArgs, ParamArgs};
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print};
use crate::report::progress::{Said, Shown};
use crate::view::{BagView, Content, Request, Server};

/// Opens a page in the browser that shows taxels, forces, contacts, flags and artifact of a bag, or of a running node.
#[derive(Debug, clap::Args)]
#[command(after_help = "tpf view recording.mcap --params-file glove.yaml\ntpf view --live --params-file glove.yaml")]
pub(super) struct Args {
    /// MCAP or .db3 file or bag folder; its estimates are shown if it has some of this node, else they are computed
    #[cfg_attr(feature = "ros", arg(value_name = "BAG", required_unless_present = "live"))]
    #[cfg_attr(not(feature = "ros"), arg(value_name = "BAG", required = true))]
    bag: Option<PathBuf>,
    /// Show the running node instead of a bag, as it publishes
    #[cfg(feature = "ros")]
    #[arg(long, conflicts_with_all = ["bag", "model", "backend", "calibrate_first", "compute"])]
    live: bool,
    #[command(flatten)]
    params: ParamArgs,
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    /// Compute the estimates, even if the bag has some; with --model this is so anyway
    #[arg(long)]
    compute: bool,
    /// Port of 127.0.0.1 to serve the page on, instead of a free one
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    port: Option<u16>,
    /// Open no browser; the address is printed in any case
    #[arg(long)]
    no_open: bool,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    ros: super::live::RosArguments,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut cfg = args.params.load()?;
    let server = Server::bind(args.port)?;
    #[cfg(feature = "ros")]
    if args.live {
        let place = args.ros.place("/tpf_view")?;
        let (zero, environment) = (args.zero.wanted(), &place.environment);
        let followed = crate::view::live::Followed::start(cfg, zero, place.join()?, environment, &Said)?;
        open(args, &server)?;
        followed.serve(server)?;
        return Ok(Outcome::Done);
    }
    args.models.apply(&mut cfg)?;
    interrupt::listen();
    let replaces = args.models.replaces();
    let bag = args.bag.as_deref().unwrap_or(Path::new(""));
    let request = Request { bag, zero: args.zero.wanted(), compute: args.compute || replaces };
    let session = match BagView::read(cfg, &request, &Shown::bytes("view")) {
        Err(_) if interrupt::happened() => return Err(Failure("interrupted".to_owned())), // it would have written nothing
        read => read?,
    };
    open(args, &server)?;
    server.serve(Content::Session(Arc::new(session)))?;
    Ok(Outcome::Done)
}

/// Tells where the page is, and opens it.
fn open(args: &Args, server: &Server) -> Result<(), Failure> {
    print(&format!("{}\n", server.url()))?;
    server.tell(!args.no_open, &Said);
    Ok(())
}

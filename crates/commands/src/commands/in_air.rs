//! Options for bags without annotations. Their effect is in [`tactile_pose_fusion::sessions`].

use tactile_pose_fusion::sessions::InAir;
use tactile_pose_fusion::units::Newton;

use super::force::force;

/// What tells when nothing touches the glove.
#[derive(Debug, clap::Args)]
pub(super) struct InAirArgs {
    /// When nothing touches the glove, instead of stage annotations: in seconds from the first taxels of each bag, several
    /// with a comma between them, or `all`; the same for every bag that is named
    #[arg(long, value_name = "FROM..TO|all", allow_hyphen_values = true, conflicts_with = "zero_load_below")]
    in_air: Option<InAir>,
    /// The same by the true force, bag by bag: nothing touches the glove where it stays below this, such as 0.05N or 5gF, for
    /// 0.25 s before and after
    #[arg(long, value_name = "FORCE", value_parser = limit, allow_hyphen_values = true)]
    zero_load_below: Option<InAir>,
}

impl InAirArgs {
    /// When nothing touches the glove, if the command line tells it.
    pub(super) fn told(&self) -> Option<&InAir> {
        self.in_air.as_ref().or(self.zero_load_below.as_ref())
    }
}

fn limit(text: &str) -> Result<InAir, String> {
    let limit = force(text).filter(|Newton(limit)| *limit > 0.0);
    let limit =
        limit.ok_or_else(|| format!("expected a force in N, mN, gF or kgf, such as 0.05N or 5gF; got {text:?}"))?;
    Ok(InAir::Below(limit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_says_the_margin_that_is_kept() {
        assert_eq!(tactile_pose_fusion::sessions::MARGIN.as_secs_f64(), 0.25);
        assert_eq!(limit("0.05N"), Ok(InAir::Below(Newton(0.05))));
        for wrong in ["0N", "-1N", "5", "low"] {
            assert!(limit(wrong).unwrap_err().starts_with("expected a force in N"), "{wrong}");
        }
    }
}

//! The files of the page, which are in the program.

use crate::page::COLOURS;

/// A file of the page.
pub(super) struct Asset {
    /// Below the page's own address.
    pub(super) name: &'static str,
    pub(super) media_type: &'static str,
    pub(super) text: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// All of them; the one without a name is the page.
pub(super) const ASSETS: [Asset; 9] = [
    Asset { name: "", media_type: HTML, text: include_str!("page/index.html") },
    Asset { name: "colours.css", media_type: STYLE, text: COLOURS },
    Asset { name: "view.css", media_type: STYLE, text: include_str!("page/view.css") },
    Asset { name: "view.js", media_type: SCRIPT, text: include_str!("page/view.js") },
    Asset { name: "cards.js", media_type: SCRIPT, text: include_str!("page/cards.js") },
    Asset { name: "traces.js", media_type: SCRIPT, text: include_str!("page/traces.js") },
    Asset { name: "live.js", media_type: SCRIPT, text: include_str!("page/live.js") },
    Asset { name: "uplot.js", media_type: SCRIPT, text: include_str!("../../third_party/uplot/uPlot.iife.min.js") },
    Asset { name: "uplot.css", media_type: STYLE, text: include_str!("../../third_party/uplot/uPlot.min.css") },
];

#[cfg(test)]
mod tests {
    use sha2::{Digest, Sha256};

    use super::*;

    #[test]
    fn the_library_is_the_one_whose_hash_is_noted() {
        let sums = include_str!("../../third_party/uplot/SHA256SUMS");
        for (file, name) in [("uplot.js", "uPlot.iife.min.js"), ("uplot.css", "uPlot.min.css")] {
            let text = ASSETS.iter().find(|asset| asset.name == file).unwrap().text;
            let hash: String = Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect();
            assert!(sums.contains(&format!("{hash}  {name}")), "{hash} {name}; scripts/uplot fetches it");
        }
    }

    #[test]
    fn no_file_of_ours_names_an_address_elsewhere() {
        for asset in ASSETS.iter().filter(|asset| !asset.name.starts_with("uplot")) {
            assert!(!asset.text.contains("//www.") && !asset.text.contains("https://"), "{}", asset.name);
        }
    }
}

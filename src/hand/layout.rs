//! Where the keypoints of a hand stand in a message.

/// Indices of the keypoints that joints are computed from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// The wrist.
    pub wrist: usize,
    /// Of index, middle, ring and little finger: start of the metacarpal (the wrist, where that isn't sent), MCP, PIP, DIP, tip.
    pub fingers: [[usize; 5]; 4],
    /// Of the thumb: CMC, MCP, IP, tip.
    pub thumb: [usize; 4],
}

/// The layouts that are known here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NamedLayout {
    /// `XrHandJointEXT` of OpenXR: 26 points, the palm first.
    OpenXr,
    /// The same without the palm: 25 points, the wrist first.
    OpenXr25,
    /// 21 points, the wrist first, in the order of MediaPipe.
    Mano21,
    /// `raw_nodes` of Manus gloves: by the type of their chain and joint.
    Manus,
}

/// Why names make no layout.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// Neither of the orders that are known.
    #[error(
        "must name 21 points (wrist; thumb to little finger, base to tip) or 25 (in the order of openxr25), not {0}"
    )]
    Count(usize),
}

impl NamedLayout {
    /// Names of the points, in the order in which they are sent where there are no names.
    pub fn points(self) -> Vec<String> {
        let fingers = ["thumb", "index", "middle", "ring", "little"];
        let of = |joints: &[&str]| -> Vec<String> {
            let named = |finger: &&str| joints.iter().map(|joint| format!("{finger}_{joint}")).collect::<Vec<_>>();
            fingers[1..].iter().flat_map(named).collect()
        };
        let thumb = |joints: [&str; 4]| joints.map(|joint| format!("thumb_{joint}"));
        match self {
            NamedLayout::OpenXr => std::iter::once("palm".to_owned()).chain(NamedLayout::OpenXr25.points()).collect(),
            NamedLayout::OpenXr25 => std::iter::once("wrist".to_owned())
                .chain(thumb(["metacarpal", "proximal", "distal", "tip"]))
                .chain(of(&["metacarpal", "proximal", "intermediate", "distal", "tip"]))
                .collect(),
            NamedLayout::Mano21 => std::iter::once("wrist".to_owned())
                .chain(thumb(["cmc", "mcp", "ip", "tip"]))
                .chain(of(&["mcp", "pip", "dip", "tip"]))
                .collect(),
            NamedLayout::Manus => {
                let chains = ["Thumb", "Index", "Middle", "Ring", "Pinky"];
                let nodes = |chain: &&str| -> Vec<String> {
                    let joints: &[&str] = if *chain == "Thumb" {
                        &["MCP", "PIP", "DIP", "TIP"]
                    } else {
                        &["MCP", "PIP", "IP", "DIP", "TIP"]
                    };
                    joints.iter().map(|joint| format!("{chain}_{joint}")).collect()
                };
                std::iter::once("Hand_Invalid".to_owned()).chain(chains.iter().flat_map(nodes)).collect()
            }
        }
    }

    /// Where the keypoints stand among [`points`](Self::points).
    pub fn layout(self) -> Layout {
        match self {
            NamedLayout::OpenXr => Layout::with_metacarpals(1),
            NamedLayout::Mano21 => Layout::without_metacarpals(),
            NamedLayout::OpenXr25 | NamedLayout::Manus => Layout::with_metacarpals(0),
        }
    }
}

impl Layout {
    /// The layout of so many points: 21 in the order of MediaPipe, 25 in that of OpenXR without the palm.
    ///
    /// # Errors
    /// [`LayoutError::Count`] for any other number.
    pub fn of_count(n_points: usize) -> Result<Self, LayoutError> {
        match n_points {
            21 => Ok(Self::without_metacarpals()),
            25 => Ok(Self::with_metacarpals(0)),
            other => Err(LayoutError::Count(other)),
        }
    }

    fn with_metacarpals(wrist: usize) -> Self {
        let thumb = [1, 2, 3, 4].map(|k| wrist + k);
        let fingers = [0, 1, 2, 3].map(|finger| [5, 6, 7, 8, 9].map(|k| wrist + 5 * finger + k));
        Layout { wrist, fingers, thumb }
    }

    fn without_metacarpals() -> Self {
        let fingers = [5, 9, 13, 17].map(|mcp| [0, mcp, mcp + 1, mcp + 2, mcp + 3]);
        Layout { wrist: 0, fingers, thumb: [1, 2, 3, 4] }
    }
}

//! Which finger and which hand names speak of.

/// Fingers as regions are called, in the order of this package's own files.
pub(super) const FINGERS: [&str; 5] = ["index", "middle", "ring", "little", "thumb"];

/// Words of each finger, and of the palm, as they begin.
const WORDS: [(&str, &str); 9] = [
    ("index", "index"),
    ("middle", "middle"),
    ("ring", "ring"),
    ("little", "little"),
    ("pinky", "little"),
    ("pinkie", "little"),
    ("thumb", "thumb"),
    ("forefinger", "index"),
    ("palm", "palm"),
];

/// Joints of the thumb in the order of those of a finger: tip to base, then abduction.
const THUMB_FOR: [(&str, &str); 4] = [("dip", "ip"), ("pip", "mcp"), ("mcp_flex", "cmc_flex"), ("mcp_abd", "cmc_abd")];

/// The words of a name in small letters: `IndexPIPStretch` begins with `index`.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut after_small = false;
    for c in name.chars() {
        if !c.is_ascii_alphabetic() || (c.is_ascii_uppercase() && after_small) {
            words.push(String::new());
        }
        if let (true, Some(word)) = (c.is_ascii_alphabetic(), words.last_mut()) {
            word.push(c.to_ascii_lowercase());
        }
        after_small = c.is_ascii_lowercase();
    }
    words
}

/// The finger that a name speaks of.
pub fn finger(name: &str) -> Option<&'static str> {
    let of = |word: &String| WORDS.iter().find(|(known, _)| word.starts_with(known)).map(|(_, finger)| *finger);
    words(name).iter().find_map(of)
}

/// The hand that a name speaks of: `left` or `right`.
pub(super) fn side(name: &str) -> Option<&'static str> {
    words(name).iter().find_map(|word| ["left", "right"].into_iter().find(|side| word == side))
}

/// The joint of another finger that stands where `joint` does: `index_pip` on the ring finger is `ring_pip`.
pub(super) fn on_finger(joint: &str, finger: &str) -> Option<String> {
    let (of, rest) = joint.split_once('_')?;
    if !FINGERS.contains(&of) {
        return None;
    }
    let swapped = |from: fn(&(&'static str, &'static str)) -> (&'static str, &'static str)| {
        THUMB_FOR.iter().map(from).find(|(one, _)| *one == rest).map(|(_, other)| other)
    };
    let rest = match (of, finger) {
        ("thumb", "thumb") => rest,
        (_, "thumb") => swapped(|pair| *pair)?,
        ("thumb", _) => swapped(|(finger, thumb)| (thumb, finger))?,
        _ => rest,
    };
    Some(format!("{finger}_{rest}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_finger_and_hand() {
        assert_eq!(finger("/glove/PinkyTip"), Some("little"));
        assert_eq!(finger("IndexPIPStretch"), Some("index"));
        assert_eq!(finger("/measuring/offering"), None);
        assert_eq!((side("/left_hand/taxels"), side("/leftover")), (Some("left"), None));
        assert_eq!(on_finger("index_mcp_flex", "thumb").as_deref(), Some("thumb_cmc_flex"));
        assert_eq!(on_finger("index_pip", "ring").as_deref(), Some("ring_pip"));
        assert_eq!(on_finger("elbow", "ring"), None);
    }
}

//! Other bytes and texts out of good ones.

use proptest::prelude::RngExt as _;
use proptest::test_runner::{RngAlgorithm, TestRng};

/// Numbers where lengths, counts and stamps go wrong.
const NUMBERS: [u64; 20] = [
    0,
    1,
    2,
    3,
    7,
    8,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0xffff,
    0x1_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0xffff_ffff_ffff_ffff,
];

/// Seeded randomness.
pub struct Random(TestRng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(TestRng::from_seed(RngAlgorithm::ChaCha, &[seed.to_le_bytes(); 4].concat()))
    }

    /// Less than `n`, which is not 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.0.random_range(0..n)
    }

    /// True in `percent` of all cases.
    pub fn percent(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }

    pub fn pick<'t, T>(&mut self, choices: &'t [T]) -> &'t T {
        let idx = self.below(choices.len());
        &choices[idx]
    }

    pub fn byte(&mut self) -> u8 {
        self.0.random()
    }

    /// Most often one that is special.
    pub fn number(&mut self) -> u64 {
        if self.percent(80) { *self.pick(&NUMBERS) } else { self.0.random() }
    }

    pub fn bytes(&mut self, n: usize) -> Vec<u8> {
        (0..n).map(|_| self.byte()).collect()
    }
}

/// Changes bytes in a few places, most often just one.
pub fn bytes(random: &mut Random, data: &mut Vec<u8>, other: &[u8]) {
    let n_edits = if random.percent(60) { 1 } else { 1 + random.below(6) };
    for _ in 0..n_edits {
        if data.is_empty() {
            data.push(random.byte());
        }
        let at = random.below(data.len());
        match random.below(9) {
            0 => data[at] ^= 1 << random.below(8),
            1 => data[at] = random.byte(),
            2 | 3 => {
                let width = *random.pick(&[1, 2, 4, 8]);
                let number = random.number().to_le_bytes();
                let end = (at + width).min(data.len());
                data[at..end].copy_from_slice(&number[..end - at]);
            }
            4 => {
                let up = random.percent(50);
                data[at] = if up { data[at].wrapping_add(1) } else { data[at].wrapping_sub(1) };
            }
            5 => {
                let end = (at + 1 + random.below(16)).min(data.len());
                data.drain(at..end);
            }
            6 => {
                let end = (at + 1 + random.below(64)).min(data.len());
                let again = data[at..end].to_vec();
                data.splice(at..at, again);
            }
            7 if !other.is_empty() => {
                let from = random.below(other.len());
                let end = (from + 1 + random.below(64)).min(other.len());
                data.splice(at..at, other[from..end].iter().copied());
            }
            _ => data.truncate(at),
        }
    }
}

/// Changes a text by words and lines, so that most of it stays what it was.
pub fn text(random: &mut Random, data: &[u8], other: &[u8], words: &[&str]) -> Vec<u8> {
    if random.percent(10) {
        let mut data = data.to_vec();
        bytes(random, &mut data, other);
        return data;
    }
    let text = String::from_utf8_lossy(data);
    let mut lines: Vec<String> = text.split('\n').map(str::to_owned).collect();
    let n_edits = if random.percent(70) { 1 } else { 1 + random.below(4) };
    for _ in 0..n_edits {
        let at = random.below(lines.len());
        if random.percent(70) {
            lines[at] = other_word(random, &lines[at], words);
            continue;
        }
        match random.below(8) {
            0 if lines.len() > 1 => drop(lines.remove(at)),
            1 => lines.insert(at, lines[at].clone()),
            2 => {
                let with = random.below(lines.len());
                lines.swap(at, with);
            }
            3 => {
                let other = String::from_utf8_lossy(other);
                let others: Vec<&str> = other.split('\n').collect();
                lines.insert(at, (*random.pick(&others)).to_owned());
            }
            4 => lines[at].insert_str(0, random.pick::<&str>(&["  ", "    ", "\t", "- ", "#"])),
            5 => lines[at] = lines[at].trim_start().to_owned(),
            6 => lines.truncate(at + 1),
            _ => lines[at].push_str(random.pick::<&str>(words)),
        }
    }
    lines.join("\n").into_bytes()
}

/// A line with one of its words replaced, or a word put in; most often behind its colon, so that its key stays.
fn other_word(random: &mut Random, line: &str, words: &[&str]) -> String {
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '-' | '/');
    let (kept, line) = match line.find(": ") {
        Some(colon) if random.percent(80) => line.split_at(colon + 2),
        _ => ("", line),
    };
    let mut parts: Vec<String> = vec![kept.to_owned()];
    for (idx, c) in line.char_indices() {
        let joins = idx > 0 && is_part(c) && parts.last().is_some_and(|part| part.chars().all(is_part));
        match parts.last_mut() {
            Some(part) if joins => part.push(c),
            _ => parts.push(c.to_string()),
        }
    }
    let at = random.below(parts.len());
    let number = parts[at].parse::<f64>().ok();
    match (random.below(5), number) {
        (0 | 1, Some(number)) => {
            let other = *random.pick(&[0.0, 1.0, -number, number + 1.0, number - 1.0, number * 2.0, number * 1e6]);
            parts[at] = if parts[at].contains('.') { format!("{other:?}") } else { other.to_string() };
        }
        (0, _) => parts.insert(at + 1, (*random.pick(words)).to_owned()),
        (1, _) => parts[at].clear(),
        (2, _) => {
            let with = random.below(parts.len());
            parts.swap(at, with);
        }
        (3, _) if parts[at].chars().all(is_part) => {
            let number = random.number();
            parts[at] = number.to_string();
        }
        _ => parts[at] = (*random.pick(words)).to_owned(),
    }
    parts.concat()
}

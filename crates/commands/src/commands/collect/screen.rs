//! A collection on a terminal, and line by line where there is none.

use ratatui::crossterm::event::KeyCode;

use super::super::{Failure, say};
use crate::report::collection::{Mood, View, draw};
use crate::report::screen::Terminal;

/// A key that a person pressed, by its meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    /// Space or Enter.
    Go,
    Repeat,
    Skip,
    /// Do what was flagged again.
    Again,
    /// Go on in spite of what was found.
    Anyway,
    Quit,
}

/// Where a collection is shown.
pub(super) enum Screen {
    Terminal(Terminal),
    /// A line for each prompt that is new.
    Lines(String),
}

impl Screen {
    /// The terminal, unless there is none or lines are asked for.
    pub(super) fn open(lines: bool) -> Result<Self, Failure> {
        Ok(Terminal::open(lines)?.map_or(Screen::Lines(String::new()), Screen::Terminal))
    }

    /// Whether a person can press keys.
    pub(super) fn has_keys(&self) -> bool {
        matches!(self, Screen::Terminal(_))
    }

    pub(super) fn show(&mut self, view: &View) -> Result<(), Failure> {
        match self {
            Screen::Terminal(terminal) => terminal.draw(|frame| draw(frame, view))?,
            Screen::Lines(last) => {
                let line = match view.mood {
                    Mood::Waiting | Mood::Wrong => view.prompt.clone(),
                    _ => format!("{}: {}", view.place, view.prompt),
                };
                if line != *last {
                    say(&line);
                    *last = line;
                }
            }
        }
        Ok(())
    }

    /// The key that was pressed, if there is one.
    pub(super) fn key(&mut self) -> Result<Option<Key>, Failure> {
        let Screen::Terminal(terminal) = self else { return Ok(None) };
        Ok(match terminal.key()? {
            Some(KeyCode::Char(' ' | 'p') | KeyCode::Enter) => Some(Key::Go),
            Some(KeyCode::Char('r')) => Some(Key::Repeat),
            Some(KeyCode::Char('s')) => Some(Key::Skip),
            Some(KeyCode::Char('f')) => Some(Key::Again),
            Some(KeyCode::Char('c')) => Some(Key::Anyway),
            Some(KeyCode::Char('q')) => Some(Key::Quit),
            _ => None,
        })
    }
}

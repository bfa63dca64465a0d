//! The terminal that a screen is drawn on.

use std::io::{self, IsTerminal};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::{DefaultTerminal, Frame};
use tactile_pose_fusion::leave;

/// A terminal that is drawn on; given back when this is dropped.
pub(crate) struct Terminal(Box<DefaultTerminal>);

impl Terminal {
    /// The terminal; `None` where there is none, or `plain` asks for lines instead.
    pub(crate) fn open(plain: bool) -> io::Result<Option<Self>> {
        match plain || !io::stdout().is_terminal() {
            true => Ok(None),
            false => {
                let terminal = ratatui::try_init()?;
                leave::before_the_end(Some(ratatui::restore));
                Ok(Some(Terminal(Box::new(terminal))))
            }
        }
    }

    pub(crate) fn draw(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> io::Result<()> {
        self.0.draw(draw)?;
        Ok(())
    }

    /// The key that was pressed, if there is one. Ctrl-C is `q`.
    pub(crate) fn key(&self) -> io::Result<Option<KeyCode>> {
        if !event::poll(Duration::ZERO)? {
            return Ok(None);
        }
        let Event::Key(key) = event::read()? else { return Ok(None) };
        let interrupt = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
        let code = if interrupt { KeyCode::Char('q') } else { key.code };
        Ok((key.kind == KeyEventKind::Press).then_some(code))
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        leave::before_the_end(None);
        ratatui::restore();
    }
}

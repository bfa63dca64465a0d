//! Questions to the person at the terminal.

use std::io::BufRead;

use tactile_pose_fusion::init::{Answer, Ask, Question};

use crate::commands::say;

/// Asks on stderr and reads a line from stdin: a number, or nothing for the likeliest.
pub(super) struct Person;

impl Ask for Person {
    fn ask(&mut self, question: &Question) -> Answer {
        say(&question.words);
        for (idx, option) in question.options.iter().enumerate() {
            let mark =
                if idx == question.likeliest { format!("  (likeliest: {})", question.because) } else { String::new() };
            say(&format!("  {}: {option}{mark}", idx + 1));
        }
        let n_options = question.options.len();
        loop {
            say(&format!("1 to {n_options}, or Enter for {}:", question.likeliest + 1));
            let mut line = String::new();
            match std::io::stdin().lock().read_line(&mut line) {
                Ok(0) | Err(_) => return Answer::Nobody,
                Ok(_) => {}
            }
            match (line.trim(), line.trim().parse::<usize>()) {
                ("", _) => return Answer::Chosen(question.likeliest),
                (_, Ok(n)) if (1..=n_options).contains(&n) => return Answer::Chosen(n - 1),
                _ => {}
            }
        }
    }
}

/// Nobody at the terminal, and no leave to guess.
pub(super) struct NoOne;

impl Ask for NoOne {
    fn ask(&mut self, _: &Question) -> Answer {
        Answer::Nobody
    }
}

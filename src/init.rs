//! A complete parameter file from what is in bags: which topics are taxels, joint angles and true force, which patches they
//! make, and why. Findings of [`inspect`](crate::inspect) go in, and [`document`] makes a [`Document`] of them; [`write()`]
//! writes it as a file that loads.
//!
//! # Rules
//!
//! | what | rule |
//! |---|---|
//! | taxels | arrays whose type or name says so, else those whose form allows it; of fixed length, and some value changes |
//! | axes | x, y and z of the same taxels are one source, x first; where a model takes as many taxels as one axis, z |
//! | parts of a finger | one source: the arrays behind the same name of a finger |
//! | elements of an array | a source each, where a field tells them apart; else a patch each, by their order |
//! | several hands on a topic | that of the parameter `only`, which is asked |
//! | several such arrays | all, where each is named after another finger; else it is asked |
//! | sign | that of the correlation with the measured force from 0.3 on; else of the skewness from 0.5 on: a press is rarer than rest; else 1 |
//! | joint angles | named angles that move; those that the model names before those that name fingers; points of a hand where there are no angles |
//! | patches | one for each array; one a finger where the model, or angles of several fingers, divide the taxels |
//! | true force | a wrench or what is named as one; its axis that goes with the taxels best, else the one with the widest range |
//! | unit of force | N for a wrench; gF where the name says so, or where a reading is beyond 100 |
//! | frame clock | `tactile` within 20 % of the model's rate, else `grid` |
//!
//! Choices that no rule decides are asked by [`Ask`], with the likeliest answer.

mod ask;
mod document;
mod error;
mod fingers;
mod force;
mod groups;
mod joints;
mod model_file;
mod plan;
mod regions;
mod sides;
mod taxels;
mod write;
mod yaml;

pub use ask::{Answer, Ask, InitError, Question};
pub use document::{Document, document};
pub use error::InitFileError;
pub use fingers::finger;
pub use plan::ModelFile;
pub use write::{Request, Written, write};

/// Asks nobody: the likeliest answer is taken, and said.
#[derive(Debug, Clone, Copy, Default)]
pub struct BestGuess;

impl Ask for BestGuess {
    fn ask(&mut self, _: &Question) -> Answer {
        Answer::Likeliest
    }
}

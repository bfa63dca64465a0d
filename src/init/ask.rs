//! Questions that findings alone don't answer.

/// Something to be chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Question {
    /// The question in words.
    pub words: String,
    /// The answers, at least two.
    pub options: Vec<String>,
    /// Index of the likeliest of them.
    pub likeliest: usize,
    /// The reason why it is the likeliest.
    pub because: String,
}

/// The answer to a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// A person chose the option of this index.
    Chosen(usize),
    /// The likeliest is to be taken.
    Likeliest,
    /// Nobody is there to ask.
    Nobody,
}

/// Answers questions: a person, or a rule in place of one.
pub trait Ask {
    /// The answer to a question.
    fn ask(&mut self, question: &Question) -> Answer;
}

/// Why there is no parameter file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum InitError {
    /// No array can be taxels.
    #[error("{bags}: no taxels found: {why}")]
    NoTaxels {
        /// The bags.
        bags: String,
        /// The reason: what is there instead.
        why: String,
    },
    /// A model that the taxels don't fit.
    #[error("{model} takes {expected} taxels, and the bags have {got}; leave --model out, or give one for this glove")]
    Model {
        /// The model.
        model: String,
        /// Taxels of the model.
        expected: usize,
        /// Taxels of the arrays that were found.
        got: String,
    },
    /// A model that needs other joint angles.
    #[error(
        "{model} takes the joint angles {expected}, and for region {region} the bags have {got}; give a model that was trained on these, or none; if they are the same joints under other names, leave --model out, then write them in joints and, in the same order, those of the model in model_joints"
    )]
    ModelJoints {
        /// The model.
        model: String,
        /// Its joints.
        expected: String,
        /// The region.
        region: String,
        /// Joints that the bags have.
        got: String,
    },
    /// A model of other regions.
    #[error(
        "{model} was trained on the regions {known}, and {region} is none of them; leave --model out, then name its regions as the model does, and give the others a model of their own"
    )]
    ModelRegions {
        /// The model.
        model: String,
        /// Its regions.
        known: String,
        /// The region that it doesn't know.
        region: String,
    },
    /// A question that nobody answers.
    #[error("{question} Nobody is there to ask: --yes takes the likeliest, {likeliest}")]
    Nobody {
        /// The question in words.
        question: String,
        /// The likeliest answer.
        likeliest: String,
    },
}

/// The chosen option, and who chose it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Choice {
    pub(super) idx: usize,
    /// Whether a person chose it.
    pub(super) is_asked: bool,
}

/// Asks, and keeps what was taken without an answer.
pub(super) struct Chooser<'a> {
    ask: &'a mut dyn Ask,
    /// One line each.
    pub(super) guesses: Vec<String>,
}

impl<'a> Chooser<'a> {
    pub(super) fn new(ask: &'a mut dyn Ask) -> Self {
        Chooser { ask, guesses: Vec::new() }
    }

    /// The answer to a question.
    pub(super) fn choose(&mut self, question: Question) -> Result<Choice, InitError> {
        let likeliest = question.likeliest;
        match self.ask.ask(&question) {
            Answer::Chosen(idx) if idx < question.options.len() => Ok(Choice { idx, is_asked: true }),
            Answer::Chosen(_) | Answer::Likeliest => {
                let Question { words, options, because, .. } = question;
                self.guesses.push(format!("{words} Taken: {} ({because}); look at it in the file", options[likeliest]));
                Ok(Choice { idx: likeliest, is_asked: false })
            }
            Answer::Nobody => {
                Err(InitError::Nobody { likeliest: question.options[likeliest].clone(), question: question.words })
            }
        }
    }
}

impl Choice {
    /// How it came about, for a comment.
    pub(super) fn told(self, because: &str) -> String {
        if self.is_asked { "as answered".to_owned() } else { format!("CHECK: a guess, {because}") }
    }
}

//! Bags: recorded messages in, of MCAP and of rosbag2's sqlite3 storage, and estimates out, as MCAP.
//!
//! This layer moves messages as bytes: [`BagReader`] streams them out of one or several recordings in bounded memory,
//! [`BagWriter`] writes a bag that `ros2 bag`, Foxglove and PlotJuggler open, and [`BagStats`] sums up what is in one.
//! The bytes are read by the schema that each [`BagChannel`] carries: [`Inputs`] turns them into events for the
//! core, [`EstimateWriter`] turns its estimates into messages.

mod baseline;
mod contacts;
mod error;
mod estimates;
mod inputs;
mod layout;
mod pass_through;
mod portion;
mod qos;
mod read;
mod stats;
mod write;

pub use baseline::{BaselineError, Baselines, Rest, ZeroLoad, annotated_rest, collect_baselines};
pub use contacts::ContactReader;
pub use error::{BagError, printable, quoted, quoted_path, shown, steers};
pub use estimates::EstimateWriter;
pub use inputs::{Input, InputError, InputTopics, Inputs, TopicCounters};
pub use pass_through::PassThrough;
pub use portion::Portion;
pub use qos::BEST_EFFORT_QOS;
pub use read::{
    BagAttachment, BagChannel, BagMessage, BagMetadata, BagReader, BagRecord, BagSchema, BagSummary, Loss,
    RECORD_LIMIT, Recordings, SchemaError, recordings_at, stored_bytes,
};
pub use stats::{BagStats, GAP_FACTOR, TopicStats};
pub use write::{BagWriter, Compression, Finished, NewChannel, OutChannel, WriteOptions};

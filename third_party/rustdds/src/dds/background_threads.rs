use std::sync::{
  atomic::{AtomicBool, Ordering},
  Arc,
};

/// A background thread of a participant.
#[derive(Clone, Copy)]
pub(crate) enum BackgroundThread {
  EventLoop = 0,
  Discovery = 1,
}

const NAMES: [&str; 2] = ["event loop", "discovery"];

/// Tells whether the background threads of a
/// [`DomainParticipant`](crate::DomainParticipant) are at work.
///
/// Without them nothing is sent, received or discovered any more, while reads
/// and writes of the application still look as if they were: there is just no
/// data. They end when the participant is dropped, and otherwise only by a
/// panic or a failing poll, which is a defect. An application that must not go
/// on silently then asks now and again. Asking takes no lock.
#[derive(Clone, Debug, Default)]
pub struct BackgroundThreads {
  ended: Arc<[AtomicBool; NAMES.len()]>,
}

impl BackgroundThreads {
  /// Name of a thread that has ended, if there is one.
  pub fn ended(&self) -> Option<&'static str> {
    let mut threads = NAMES.iter().zip(self.ended.iter());
    threads
      .find(|(_, ended)| ended.load(Ordering::Acquire))
      .map(|(name, _)| *name)
  }

  /// To be held by a thread as long as it works. Also a panic lets go of it.
  pub(crate) fn working(&self, thread: BackgroundThread) -> Working {
    Working {
      threads: self.clone(),
      thread,
    }
  }
}

pub(crate) struct Working {
  threads: BackgroundThreads,
  thread: BackgroundThread,
}

impl Drop for Working {
  fn drop(&mut self) {
    self.threads.ended[self.thread as usize].store(true, Ordering::Release);
  }
}

#[cfg(test)]
mod tests {
  use super::*;

  #[test]
  fn a_thread_that_ends_or_panics_is_told() {
    let threads = BackgroundThreads::default();
    assert_eq!(threads.ended(), None);
    let working = threads.working(BackgroundThread::Discovery);
    assert_eq!(threads.ended(), None);
    let panics = std::thread::spawn(move || {
      let _working = working;
      panic!("as a defect does");
    });
    assert!(panics.join().is_err());
    assert_eq!(threads.ended(), Some("discovery"));
    drop(threads.working(BackgroundThread::EventLoop));
    assert_eq!(threads.ended(), Some("event loop"));
  }
}

//! MCAP bags: recorded messages in, estimates out.

//! Wire types: our own messages, the standard ones we read and write, and any other type by its definition.

//! A ROS 2 parameter file, parsed into what the other modules are told. The only place with defaults.

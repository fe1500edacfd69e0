//! The timeline: what is shown when, at which size.

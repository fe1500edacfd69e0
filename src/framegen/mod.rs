//! Generated frames: pictures between two anchors.

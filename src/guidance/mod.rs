//! Motion and depth for a pair of anchors.

//! Fetches and caches what the tools need.

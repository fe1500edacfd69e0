//! Reading bundles as untrusted input. The tests make the bundles.

mod archives;
mod blocks;
mod files;
mod manifest;
mod models;
mod mutations;
mod residual;
mod slices;

use cairn::bundle::Bundle;
use cairn::{Error, Result};
use std::sync::Arc;

/// The error of a refused bundle. It must name a field and a remedy.
#[track_caller]
fn refusal(case: &str, opened: Result<Arc<Bundle>>) -> Error {
    let error = match opened {
        Ok(_) => panic!("{case}: the bundle was accepted"),
        Err(error) => error,
    };
    assert!(error.offending_field().is_some_and(|field| !field.is_empty()), "{case}: no field in `{error}`");
    assert!(error.remedy_text().is_some_and(|remedy| !remedy.is_empty()), "{case}: no remedy in `{error}`");
    error
}

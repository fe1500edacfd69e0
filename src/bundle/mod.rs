//! A world on disk: reading, checking and describing a bundle. The format is `docs/bundle.md`.
//!
//! A bundle is untrusted input. [`Bundle::open`] makes every check of section 7 of that page before anything is allocated or run for
//! it. It reads each file once and keeps the checked bytes in memory; ONNX Runtime later gets these bytes and opens no file.

mod archive;
mod container;
mod cost;
mod embedded;
mod manifest;
mod manifest_check;
mod memory_need;
mod names;
mod onnx;
mod open;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

pub use cost::{GraphCost, WorldCost};
pub use manifest::*;
pub(crate) use memory_need::KEPT_LEVELS;
pub use memory_need::{MemoryNeed, Passes, Processor, available_memory};
pub(crate) use onnx::{
    ConditioningModel, ConditioningModels, DataType, ModelWithPeaks, ModelWriter, NamedTensor, SliceModel, SliceTensor,
    Slices, largest_weight, with_split_k, with_weights_inside, without_fused_products,
};
#[cfg(windows)]
pub(crate) use onnx::{Weight, weights_as_inputs};
pub use onnx::{operators, slice_transformer};
pub use open::{OpenOptions, OpenProgress};

use crate::{Error, ErrorKind, Result};
use container::Container;

/// The manifest's file name.
pub const MANIFEST_NAME: &str = "cairn-world.json";

/// A checked bundle, held in memory. Immutable; share it between threads as you like.
pub struct Bundle {
    manifest: Manifest,
    digest: String,
    files: BTreeMap<String, Cow<'static, [u8]>>,
    models: Vec<Model>,
}

/// One checked model of a bundle.
struct Model {
    kind: GraphKind,
    precision: Precision,
    path: String,
    /// Each location as written in the graph, with the bundle file that it names.
    external: Vec<(String, String)>,
}

/// One model's bytes, in the form in which ONNX Runtime loads a model from memory.
pub struct ModelSource<'a> {
    /// The serialised graph.
    pub onnx: &'a [u8],
    /// The files that contain its weights: the location as written in the graph, and all bytes of that file.
    pub external: Vec<(&'a str, &'a [u8])>,
}

impl Bundle {
    /// Opens and checks the bundle at `path`: a directory, or an archive.
    ///
    /// # Errors
    /// `Io` if `path` cannot be read; `InvalidBundle` for any violation of the format, with the offending file or manifest member;
    /// `Unsupported` for another schema version or kind of model; `OutOfMemory` if its files do not fit into memory.
    pub fn open(path: &Path) -> Result<Arc<Self>> {
        Self::open_with(path, &OpenOptions::default())
    }

    /// [`Bundle::open`] with progress reports, cancellation and a size limit.
    ///
    /// # Errors
    /// As [`Bundle::open`], and `Cancelled`.
    pub fn open_with(path: &Path, options: &OpenOptions<'_>) -> Result<Arc<Self>> {
        open::load(Container::open(path)?, options).map(Arc::new)
    }

    /// A bundle whose files, the manifest among them, are in memory already, e.g. embedded in a library. Borrowed bytes
    /// are not copied.
    ///
    /// # Errors
    /// As [`Bundle::open`]; `InvalidArgument` for an invalid file name, or one that is given twice.
    pub fn from_memory(files: Vec<(String, Cow<'static, [u8]>)>) -> Result<Arc<Self>> {
        open::load(Container::from_memory(files)?, &OpenOptions::default()).map(Arc::new)
    }

    /// An archive in memory, e.g. embedded in a library. Borrowed bytes are not copied.
    ///
    /// # Errors
    /// As [`Bundle::open`].
    pub fn from_archive(bytes: impl Into<Cow<'static, [u8]>>) -> Result<Arc<Self>> {
        open::load(Container::from_archive(bytes.into())?, &OpenOptions::default()).map(Arc::new)
    }

    /// The bundle's manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Shapes of the model.
    pub fn geometry(&self) -> &Geometry {
        &self.manifest.geometry
    }

    /// The bundle's identity: SHA-256 of the manifest's bytes, in lower-case hex. The manifest holds the checksums of all
    /// other files, so equal digests mean equal bundles.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// Whether the bundle has graphs of `precision`.
    pub fn has(&self, precision: Precision) -> bool {
        self.manifest.graphs.of(precision).is_some()
    }

    /// One model and the files of its weights.
    ///
    /// # Errors
    /// `Unsupported` where the bundle has no graphs of that precision, or no joined ones.
    pub fn model(&self, kind: GraphKind, precision: Precision) -> Result<ModelSource<'_>> {
        let model = self.models.iter().find(|m| (m.kind, m.precision) == (kind, precision)).ok_or_else(|| {
            if kind == GraphKind::Joined && self.has(precision) {
                return Error::new(ErrorKind::Unsupported, "the bundle has no joined graphs")
                    .field(format!("graphs.{precision}.joined"))
                    .remedy("Add them with `python -m cairn.build rebuild --joined`, or use another cache mode");
            }
            Error::new(ErrorKind::Unsupported, format!("the bundle has no {precision} graphs"))
                .field(format!("graphs.{precision}"))
                .remedy("Build the bundle with both precisions, or run it on a device that takes the other")
        })?;
        let external = model
            .external
            .iter()
            .map(|(location, file)| Ok((location.as_str(), self.bytes(file)?)))
            .collect::<Result<_>>()?;
        Ok(ModelSource { onnx: self.bytes(&model.path)?, external })
    }

    /// The text of the licence, if the bundle has one in UTF-8.
    pub fn licence_text(&self) -> Option<&str> {
        let file = self.manifest.licence.file.as_ref()?;
        std::str::from_utf8(self.files.get(file)?).ok()
    }

    fn bytes(&self, file: &str) -> Result<&[u8]> {
        self.files.get(file).map(AsRef::as_ref).ok_or_else(|| damaged(file, "the file is not in the bundle"))
    }
}

impl std::fmt::Debug for Bundle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bundle")
            .field("name", &self.manifest.name)
            .field("digest", &self.digest)
            .finish_non_exhaustive()
    }
}

/// Checks one model's bytes against `manifest`, as [`Bundle::open`] does for each model. For tools that make bundles.
///
/// # Errors
/// `InvalidBundle` with the file name that the manifest has for this model, and the cause.
pub fn check_model(onnx: &[u8], manifest: &Manifest, kind: GraphKind, precision: Precision) -> Result<()> {
    onnx::check(onnx, onnx::ModelContext { manifest, kind, precision }).map(drop)
}

/// A violation of the format in a manifest member, a model, or a file.
fn invalid(field: impl Into<String>, cause: impl Into<String>, remedy: &str) -> Error {
    Error::new(ErrorKind::InvalidBundle, shortened(cause.into())).field(shortened(field.into())).remedy(remedy)
}

/// A file that does not match the manifest.
fn damaged(file: &str, cause: impl Into<String>) -> Error {
    invalid(file, cause, "Copy or build the bundle again: the file is damaged, incomplete or changed")
}

/// Shortens text from an untrusted file for a message.
fn shortened(mut text: String) -> String {
    const MOST: usize = 300;
    if text.len() > MOST {
        let end = (0..=MOST).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0);
        text.truncate(end);
        text.push_str("...");
    }
    text
}

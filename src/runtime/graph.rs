//! A session: one graph, loaded from memory and checked against the expected inputs and outputs.

use std::any::Any;
use std::ffi::CString;
use std::sync::Arc;

use ort::AsPointer;
use ort::session::Session;
use ort::session::builder::SessionBuilder;
use ort::value::{Outlet, TensorElementType, ValueType};

use super::failure::{make, ort_failure};
use crate::bundle::{ModelSource, Precision};
use crate::quiet_mutex::QuietMutex;
use crate::{Error, ErrorKind, Result};

/// Element type of a graph's input or output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ElementType {
    /// float32.
    F32,
    /// float16.
    F16,
    /// Unsigned bytes: stored weights of 8 or 4 bits.
    U8,
}

impl From<Precision> for ElementType {
    fn from(precision: Precision) -> Self {
        match precision {
            Precision::F32 => Self::F32,
            Precision::F16 => Self::F16,
        }
    }
}

/// Name, element type and shape of an input or output, as in `docs/bundle.md` section 4.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TensorSpec {
    pub(crate) name: String,
    pub(crate) element: ElementType,
    pub(crate) shape: Vec<usize>,
}

impl TensorSpec {
    pub(crate) fn new(name: impl Into<String>, element: impl Into<ElementType>, shape: &[usize]) -> Self {
        Self { name: name.into(), element: element.into(), shape: shape.to_vec() }
    }

    /// Size in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let element = match self.element {
            ElementType::F32 => 4,
            ElementType::F16 => 2,
            ElementType::U8 => 1,
        };
        self.shape.iter().product::<usize>() * element
    }
}

/// Bytes of one element.
pub(crate) const fn element_size(element: Precision) -> usize {
    match element {
        Precision::F32 => 4,
        Precision::F16 => 2,
    }
}

/// A loaded graph, shared by rollouts; several may run it at the same time, each through its own bindings.
pub(crate) struct Graph {
    /// Present until it is dropped.
    session: Option<Session>,
    tensors: Vec<(CString, TensorSpec)>,
    inputs: usize,
    /// What its backend keeps with it.
    #[cfg(windows)]
    data: Box<dyn Any + Send + Sync>,
    /// Held while the session is dropped, for backends whose sessions share what is not safe to use from two threads.
    drop_lock: Option<&'static QuietMutex<()>>,
    /// An object that must outlive the session. Fields are dropped in order, so it is the last.
    _kept: Option<Arc<dyn Any + Send + Sync>>,
}

impl Graph {
    /// Makes the session from the bundle's checked bytes and compares its inputs with `inputs` followed by `weights`, and its
    /// outputs with `outputs`.
    pub(super) fn commit(
        mut builder: SessionBuilder,
        what: &str,
        model: &ModelSource<'_>,
        inputs: Vec<TensorSpec>,
        weights: &[TensorSpec],
        outputs: Vec<TensorSpec>,
    ) -> Result<Self> {
        add_external(&mut builder, model)?;
        let session = make(&format!("load the {what}"), || builder.commit_from_memory(model.onnx))?;
        compare(what, "input", session.inputs(), &[&inputs, weights].concat())?;
        compare(what, "output", session.outputs(), &outputs)?;
        let count = inputs.len();
        let tensors = inputs
            .into_iter()
            .chain(outputs)
            .map(|spec| {
                let name = CString::new(spec.name.as_str())
                    .map_err(|_| Error::new(ErrorKind::InvalidBundle, "a tensor name holds a NUL"))?;
                Ok((name, spec))
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            session: Some(session),
            tensors,
            inputs: count,
            #[cfg(windows)]
            data: Box::new(()),
            drop_lock: None,
            _kept: None,
        })
    }

    /// The same graph with data of its backend.
    #[cfg(windows)]
    pub(super) fn with_data(mut self, data: impl Any + Send + Sync) -> Self {
        self.data = Box::new(data);
        self
    }

    /// The same graph with `lock`, which is held while the session is dropped, and `kept`, which is dropped after the session.
    pub(super) fn with_drop_lock(mut self, lock: &'static QuietMutex<()>, kept: Arc<dyn Any + Send + Sync>) -> Self {
        self.drop_lock = Some(lock);
        self._kept = Some(kept);
        self
    }

    /// The data of its backend. A context is only given graphs of its own backend.
    #[cfg(windows)]
    pub(super) fn data<T: Any>(&self) -> &T {
        self.data.downcast_ref().expect("a graph of this backend")
    }

    pub(super) fn session(&self) -> &Session {
        self.session.as_ref().expect("present until it is dropped")
    }

    /// Inputs, then outputs.
    pub(crate) fn tensors(&self) -> &[(CString, TensorSpec)] {
        &self.tensors
    }

    /// Number of inputs in [`tensors`](Self::tensors).
    pub(crate) fn input_count(&self) -> usize {
        self.inputs
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        let _held = self.drop_lock.map(QuietMutex::lock);
        self.session = None;
    }
}

/// Passes the weight files' bytes to ONNX Runtime, which copies what it needs while it makes the session.
fn add_external(builder: &mut SessionBuilder, model: &ModelSource<'_>) -> Result<()> {
    for (location, bytes) in &model.external {
        if !location.is_ascii() {
            return Err(Error::new(ErrorKind::InvalidBundle, "an external location is not ASCII").field(*location));
        }
        let name: Vec<ort::sys::os_char> =
            location.bytes().map(|b| b as ort::sys::os_char).chain(std::iter::once(0)).collect();
        let add = ort::api().AddExternalInitializersFromMemory;
        // SAFETY: one file: a NUL-terminated name, and bytes that live until the session is made and are only read.
        let status =
            unsafe { add(builder.ptr_mut(), &name.as_ptr(), &bytes.as_ptr().cast_mut().cast(), &bytes.len(), 1) };
        // SAFETY: the status is what the call above returned, used once.
        unsafe { ort::Error::result_from_status(status) }.map_err(|e| ort_failure("take the weights", &e))?;
    }
    Ok(())
}

/// Checks that the session has exactly the tensors that the rollout will bind.
fn compare(what: &str, side: &str, found: &[Outlet], expected: &[TensorSpec]) -> Result<()> {
    let broken = |why: String| Err(Error::new(ErrorKind::InvalidBundle, why).field(what.to_owned()));
    if found.len() != expected.len() {
        return broken(format!("the graph has {} {side}s, the geometry asks for {}", found.len(), expected.len()));
    }
    for (found, expected) in found.iter().zip(expected) {
        let ValueType::Tensor { ty, shape, .. } = found.dtype() else {
            return broken(format!("{side} `{}` is no tensor", found.name()));
        };
        let element = match ty {
            TensorElementType::Float32 => Some(ElementType::F32),
            TensorElementType::Float16 => Some(ElementType::F16),
            TensorElementType::Uint8 => Some(ElementType::U8),
            _ => None,
        };
        let same_shape = shape.len() == expected.shape.len()
            && shape.iter().zip(&expected.shape).all(|(&f, &e)| usize::try_from(f) == Ok(e));
        if found.name() != expected.name || element != Some(expected.element) || !same_shape {
            return broken(format!(
                "{side} `{}` is {ty:?} {:?}, the geometry asks for `{}`, {:?} {:?}",
                found.name(),
                &shape[..],
                expected.name,
                expected.element,
                expected.shape
            ));
        }
    }
    Ok(())
}

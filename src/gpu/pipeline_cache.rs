//! Cache of a device's compute pipelines: each is created once, shared by all users, and can be serialised for the next run of the program.

use std::collections::HashMap;

use crate::locks::Mutex;
use sha2::{Digest, Sha256};
use windows::Win32::Graphics::Direct3D12::{ID3D12PipelineState, ID3D12RootSignature};

use super::compute::Shape;
use super::{Gpu, shader};
use crate::Result;

/// The pipelines of a device.
///
/// Threads: may be used from any thread at any time.
#[derive(Default)]
pub(crate) struct PipelineCache(Mutex<Inner>);

#[derive(Default)]
struct Inner {
    roots: HashMap<Shape, ID3D12RootSignature>,
    cached: HashMap<Key, CachedPipeline>,
    /// Compiled pipelines from `load` that are not used yet, by hash.
    loaded: HashMap<PipelineHash, Vec<u8>>,
    /// Whether the host was asked for stored pipelines.
    was_requested: bool,
}

/// Cache key: a shader's code and its bindings.
type Key = (&'static [u8], Shape);

struct CachedPipeline {
    state: ID3D12PipelineState,
    /// Whether the host's stored data contains it.
    is_stored: bool,
}

/// SHA-256 of a shader's code and bindings.
type PipelineHash = [u8; 32];

/// First bytes of serialised pipelines: the version of the format.
const MAGIC: [u8; 8] = *b"CairnPS1";

impl PipelineCache {
    /// Root signature and pipeline of a shader.
    ///
    /// # Errors
    /// `DeviceRemoved`, `OutOfMemory`, or `Device` when the driver cannot take it.
    pub(crate) fn of(
        &self,
        gpu: &Gpu,
        code: &'static [u8],
        shape: Shape,
        root_signature: impl FnOnce() -> Result<ID3D12RootSignature>,
    ) -> Result<(ID3D12RootSignature, ID3D12PipelineState)> {
        // Locked during creation, so that no pipeline is created twice. Only loading threads come here, which may wait.
        let mut inner = self.0.lock();
        let root = match inner.roots.get(&shape) {
            Some(root) => root.clone(),
            None => {
                let root = root_signature()?;
                inner.roots.insert(shape, root.clone());
                root
            }
        };
        if let Some(cached) = inner.cached.get(&(code, shape)) {
            return Ok((root, cached.state.clone()));
        }
        let compiled = if inner.loaded.is_empty() { None } else { inner.loaded.remove(&pipeline_hash(code, shape)) };
        // The driver rejects pipelines that another version of it compiled; they are then compiled again.
        let loaded = compiled.and_then(|compiled| shader::pipeline_state(gpu, &root, code, Some(&compiled)).ok());
        let is_stored = loaded.is_some();
        let state = loaded.map_or_else(|| shader::pipeline_state(gpu, &root, code, None), Ok)?;
        inner.cached.insert((code, shape), CachedPipeline { state: state.clone(), is_stored });
        Ok((root, state))
    }

    /// Whether this is the first call. The caller then asks the host for stored pipelines.
    pub(crate) fn take_first_request(&self) -> bool {
        !std::mem::replace(&mut self.0.lock().was_requested, true)
    }

    /// Loads the result of [`serialised`](Self::serialised) of an earlier run; `false`, and nothing is loaded, if the bytes are damaged or from
    /// another adapter, driver or version of this library.
    pub(crate) fn load(&self, gpu: &Gpu, bytes: &[u8]) -> bool {
        let Some(mut loaded) = parse(bytes, &origin(gpu)) else { return false };
        let mut inner = self.0.lock();
        for ((code, shape), cached) in &mut inner.cached {
            cached.is_stored |= loaded.remove(&pipeline_hash(code, *shape)).is_some();
        }
        inner.loaded = loaded;
        true
    }

    /// All pipelines, for [`load`](Self::load) in a later run; `None` if the loaded data contains them all, or the driver does not return any.
    pub(crate) fn serialised(&self, gpu: &Gpu) -> Option<Vec<u8>> {
        let mut inner = self.0.lock();
        if inner.cached.values().all(|cached| cached.is_stored) {
            return None;
        }
        let mut entries: Vec<(PipelineHash, Vec<u8>)> = inner
            .cached
            .iter()
            .filter_map(|((code, shape), cached)| Some((pipeline_hash(code, *shape), blob(&cached.state)?)))
            .collect();
        if entries.is_empty() {
            return None;
        }
        inner.cached.values_mut().for_each(|cached| cached.is_stored = true);
        entries.extend(inner.loaded.iter().map(|(name, code)| (*name, code.clone())));
        drop(inner);
        entries.sort_unstable();
        Some(serialise(&origin(gpu), &entries))
    }
}

/// Hash of a shader's code and bindings, stable across runs.
fn pipeline_hash(code: &[u8], shape: Shape) -> PipelineHash {
    let mut hash = Sha256::new();
    [shape.constants, shape.inputs, shape.outputs].iter().for_each(|count| hash.update(count.to_le_bytes()));
    hash.update(code);
    hash.finalize().into()
}

/// Identifies this version of the library, the adapter and its driver.
fn origin(gpu: &Gpu) -> PipelineHash {
    let mut hash = Sha256::new();
    hash.update(env!("CARGO_PKG_VERSION"));
    match gpu.adapter() {
        Ok(adapter) => {
            [adapter.vendor, adapter.device].iter().for_each(|id| hash.update(id.to_le_bytes()));
            hash.update(adapter.description);
            hash.update(adapter.driver.unwrap_or_default());
        }
        Err(_) => hash.update(gpu.luid().to_le_bytes()),
    }
    hash.finalize().into()
}

/// The driver's compiled pipeline; `None` if it does not return one.
fn blob(state: &ID3D12PipelineState) -> Option<Vec<u8>> {
    // SAFETY: a live pipeline.
    let blob = unsafe { state.GetCachedBlob() }.ok()?;
    Some(shader::bytes(&blob).to_vec()).filter(|bytes| !bytes.is_empty())
}

/// Magic, origin, then name, length and bytes of each pipeline, then the SHA-256 of everything before.
fn serialise(origin: &PipelineHash, entries: &[(PipelineHash, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = [MAGIC.as_slice(), origin].concat();
    for (name, code) in entries {
        bytes.extend_from_slice(name);
        bytes.extend_from_slice(&(code.len() as u64).to_le_bytes());
        bytes.extend_from_slice(code);
    }
    let hash: PipelineHash = Sha256::digest(&bytes).into();
    bytes.extend_from_slice(&hash);
    bytes
}

/// Parses serialised pipelines; `None` if they are damaged or of another origin.
fn parse(bytes: &[u8], origin: &PipelineHash) -> Option<HashMap<PipelineHash, Vec<u8>>> {
    let (rest, hash) = bytes.split_last_chunk::<32>()?;
    if Sha256::digest(rest)[..] != hash[..] {
        return None;
    }
    let rest = rest.strip_prefix(&MAGIC)?;
    let mut rest = rest.strip_prefix(origin)?;
    let mut found = HashMap::new();
    while !rest.is_empty() {
        let (name, after) = rest.split_first_chunk::<32>()?;
        let (length, after) = after.split_first_chunk::<8>()?;
        let (code, after) = after.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        found.insert(*name, code.to_vec());
        rest = after;
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn serialised_pipelines_are_read_back_unless_damaged_or_of_another_driver() {
        let entries = [([1; 32], vec![1, 2, 3]), ([2; 32], Vec::new()), ([3; 32], vec![9; 1000])];
        let bytes = serialise(&[7; 32], &entries);
        assert_eq!(parse(&bytes, &[7; 32]), Some(entries.clone().into()));
        assert_eq!(parse(&bytes, &[8; 32]), None, "of another driver");
        for i in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[i] ^= 1;
            assert_eq!(parse(&damaged, &[7; 32]), None, "byte {i}");
            assert_eq!(parse(&bytes[..i], &[7; 32]), None, "cut at byte {i}");
        }
        // With a correct checksum: lengths beyond the end.
        for length in [1001, u64::MAX] {
            let mut wrong = serialise(&[7; 32], &entries[2..]);
            wrong.truncate(wrong.len() - 32);
            wrong[72..80].copy_from_slice(&length.to_le_bytes());
            let hash = Sha256::digest(&wrong);
            wrong.extend_from_slice(&hash);
            assert_eq!(parse(&wrong, &[7; 32]), None, "{length} bytes");
        }
    }
}

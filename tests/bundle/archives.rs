//! Bundles in archives: valid and invalid ones.

use cairn::bundle::Bundle;
use test_support::bundles::toy_bundle::{Files, ToyBundle};
use test_support::bundles::zip_writer::{Zip, ZipEntry};

use crate::refusal;

fn zip(files: &Files) -> Zip {
    Zip::of(files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_ref())))
}

#[test]
fn archives_with_32_and_64_bit_sizes_open_from_memory_and_from_a_file() {
    let files = ToyBundle::new().files();
    let expected = Bundle::from_memory(files.clone()).unwrap();
    let mut wide = zip(&files);
    wide.wide = true;
    wide.entries.iter_mut().for_each(|entry| entry.wide = true);
    let mut beside = zip(&files);
    beside.entries.push(ZipEntry::new("notes/", b""));
    beside.entries.push(ZipEntry::new("../../never read", b"x"));
    let folder = std::env::temp_dir().join(format!("cairn-archives-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for (case, zip) in [("plain", zip(&files)), ("wide", wide), ("beside", beside)] {
        let bytes = zip.encode();
        let path = folder.join(case);
        std::fs::write(&path, &bytes).unwrap();
        for bundle in [Bundle::from_archive(bytes.clone()), Bundle::from_archive(&*bytes.leak()), Bundle::open(&path)] {
            assert_eq!(bundle.unwrap().digest(), expected.digest(), "{case}");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Name of a case, a change of an archive, and a part of the error's text.
type Case = (&'static str, fn(&mut Zip), &'static str);

#[test]
fn hostile_archives_are_refused() {
    let cases: &[Case] = &[
        ("deflated", |z| z.entries[0].method = 8, "compressed"),
        ("encrypted", |z| z.entries[1].flags = 1, "encrypted"),
        ("strongly encrypted", |z| z.entries[1].flags = 0x41, "encrypted"),
        ("data descriptor", |z| z.entries[1].flags = 8, "data descriptor"),
        ("repeated", |z| z.entries.push(z.entries[2].clone()), "twice"),
        ("overlapping", |z| z.entries[1].offset = Some(0), "local header"),
        (
            "same bytes twice",
            |z| {
                let mut other = z.entries[0].clone();
                other.name = b"other".to_vec();
                other.local_name = Some(b"other".to_vec());
                other.offset = Some(0);
                z.entries.push(other);
            },
            "local header",
        ),
        (
            "nested in another's data",
            |z| {
                let inner = Zip::of([("inner", &b"data"[..])]).encode();
                let mut outer = ZipEntry::new("outer", &inner);
                outer.name = b"outer".to_vec();
                let at: usize = z.entries.iter().map(|e| 30 + e.name.len() + e.data.len()).sum();
                let start = at + 30 + outer.name.len();
                z.entries.push(outer);
                let mut entry = ZipEntry::new("inner", b"data");
                entry.offset = Some(start as u64);
                z.entries.push(entry);
            },
            "overlap",
        ),
        ("size beyond the file", |z| z.entries.last_mut().unwrap().claimed = Some(1 << 31), "overlap"),
        (
            "size of almost 2^64",
            |z| {
                let last = z.entries.last_mut().unwrap();
                last.wide = true;
                last.claimed = Some(u64::MAX - 8);
            },
            "local header",
        ),
        (
            "position of almost 2^64",
            |z| {
                z.entries[0].wide = true;
                z.entries[0].offset = Some(u64::MAX - 8);
            },
            "local header",
        ),
        ("another name in the local header", |z| z.entries[0].local_name = Some(b"x".to_vec()), "local header"),
        ("comment", |z| z.comment = b"hello".to_vec(), "end record"),
        ("count too small", |z| z.count = Some(2), "more bytes"),
        ("count too large", |z| z.count = Some(4000), "cut short"),
        (
            "count of 2^40",
            |z| {
                z.wide = true;
                z.count = Some(1 << 40);
            },
            "too large",
        ),
        ("no entries", |z| z.entries.clear(), "not in the bundle"),
    ];
    for (case, change, part) in cases {
        let mut zip = zip(&ToyBundle::new().files());
        change(&mut zip);
        let error = refusal(case, Bundle::from_archive(zip.encode())).to_string();
        assert!(error.contains(part), "{case}: `{error}` does not say `{part}`");
    }
}

#[test]
fn every_truncated_central_directory_is_refused() {
    let bytes = zip(&ToyBundle::new().files()).encode();
    let directory = bytes.len() - 22 - 1000;
    for len in (0..200).chain(directory..bytes.len()) {
        refusal(&format!("cut to {len}"), Bundle::from_archive(bytes[..len].to_vec()));
    }
}

#[test]
fn a_changed_manifest_in_an_archive_is_noticed() {
    let mut bytes = zip(&ToyBundle::new().files()).encode();
    let at = bytes.windows(5).position(|w| w == b"\"Toy\"").unwrap();
    bytes[at + 1] = b'B';
    assert!(refusal("manifest", Bundle::from_archive(bytes)).to_string().contains("CRC-32"));
}

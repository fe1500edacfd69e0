//! Folders with copies of the double, and the logs that the copies write there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use cairn::ffx::{Library, LibraryKind, LoadOptions, allow_unsigned_in_host};

/// AMD's provider 3.1.5, as a line of the double's configuration.
pub const ANALYTIC_20: &str = "offers 0xf600000000c01005 3.1.5";
/// AMD's provider 3.1.6.
pub const ANALYTIC: &str = "offers 0xf600000000c01006 3.1.6";
/// AMD's provider 4.0.1, with machine learning.
pub const ML: &str = "offers 0xf600000001000001 4.0.1";

/// A test's own folder with libraries under AMD's names. It is not deleted, because the libraries stay loaded.
pub struct DoubleFolder(pub PathBuf);

impl DoubleFolder {
    /// A new folder.
    pub fn empty() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let place = std::env::temp_dir().join(format!("cairn-ffx-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&place).expect("a folder");
        Self(place)
    }

    /// Adds a copy of the double, configured by these lines.
    pub fn with(self, part: LibraryKind, lines: &[&str]) -> Self {
        // The C interface loads only files signed by AMD otherwise.
        allow_unsigned_in_host();
        std::fs::copy(double_library(), self.0.join(part.file_name())).expect("the double");
        let role = self.0.join(format!("{}.txt", part.file_name()));
        std::fs::write(role, lines.join("\n")).expect("its role");
        self
    }

    /// Adds another file under AMD's name.
    pub fn with_file(self, part: LibraryKind, file: &Path) -> Self {
        std::fs::copy(file, self.0.join(part.file_name())).expect("the file");
        self
    }

    /// Loads the libraries of the folder.
    pub fn load(&self) -> cairn::Result<Library> {
        Library::load(&LoadOptions { directory: Some(self.0.clone()), signed: false })
    }

    /// The logged calls, one line each.
    pub fn calls(&self) -> Vec<String> {
        self.lines("calls.txt")
    }

    /// The logged rule violations.
    pub fn violations(&self) -> Vec<String> {
        self.lines("judgement.txt")
    }

    /// The logged parameters of structs with that id: for each struct, a map from field to value.
    pub fn parameters(&self, id: u64) -> Vec<BTreeMap<String, String>> {
        let id = format!("{id:x}");
        let fields = |line: &str| {
            let pairs = line.split(' ').filter_map(|word| word.split_once('='));
            pairs.map(|(field, value)| (field.to_owned(), value.to_owned())).collect()
        };
        let lines = self.lines("parameters.txt");
        lines.iter().filter(|line| line.split(' ').next() == Some(&*id)).map(|line| fields(line)).collect()
    }

    /// Makes calls whose first struct has that id return `code`. Needs a copy configured as `refusing`.
    pub fn reject_calls(&self, id: u64, code: u32) {
        std::fs::write(self.0.join("refuses.txt"), format!("{id:x} {code} so there")).expect("what is refused");
    }

    /// Ends the rejection that `reject_calls` started.
    pub fn accept_calls(&self) {
        std::fs::remove_file(self.0.join("refuses.txt")).expect("it was refused");
    }

    fn lines(&self, file: &str) -> Vec<String> {
        let text = std::fs::read_to_string(self.0.join(file)).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }
}

/// Path of the double, which the build puts beside the test programs.
pub fn double_library() -> PathBuf {
    let own = std::env::current_exe().expect("our own path");
    let found = own.ancestors().skip(1).take(2).map(|place| place.join("ffx_double.dll")).find(|path| path.is_file());
    found.expect("ffx_double.dll is not there: cargo build --package ffx-double, for the same target")
}

/// Path of a library of the system.
pub fn system(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os("SystemRoot").expect("Windows says where it is")).join("System32").join(name)
}

/// Runs `act` in a new process, in which no library with AMD's names is loaded yet.
pub fn in_new_process(test: &str, act: impl FnOnce()) {
    const VARIABLE: &str = "CAIRN_FFX_TEST_ALONE";
    if std::env::var_os(VARIABLE).is_some_and(|name| name == test) {
        return act();
    }
    let own = std::env::current_exe().expect("our own path");
    let ended =
        Command::new(own).args(["--exact", test, "--nocapture"]).env(VARIABLE, test).output().expect("a process");
    let (out, err) = (String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    assert!(ended.status.success() && out.contains("1 passed"), "{}: {out}\n{err}", ended.status);
}

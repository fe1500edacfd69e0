//! Published reports: a folder of files that users sent, and the page that is made of them.

mod page;
mod validate;

use std::path::Path;

pub use page::page;
pub use validate::validate;

use crate::report::Report;

/// A report in the folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Published {
    /// Name of its file.
    pub file: String,
    /// The report.
    pub report: Report,
}

/// Reads all reports of a folder, by file name. Files that do not end in `.json` are not read.
///
/// # Errors
/// One line for each file that cannot be published, with cause and remedy.
pub fn read(folder: &Path) -> Result<Vec<Published>, String> {
    let failed = |e: std::io::Error| format!("{}: {e}; name the folder of the reports", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        files.push(entry.map_err(failed)?.path());
    }
    files.retain(|path| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json")));
    files.sort();
    let (mut reports, mut wrong) = (Vec::new(), Vec::new());
    for path in files {
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{e}; send report.json as cairn-check wrote it"));
        match text.and_then(|text| validate(&file, &text)) {
            Ok(report) => reports.push(Published { file, report }),
            Err(why) => wrong.push(format!("{}: {why}", path.display())),
        }
    }
    if wrong.is_empty() { Ok(reports) } else { Err(wrong.join("\n")) }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    fn root() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
    }

    #[test]
    fn the_page_is_made_of_the_repositorys_reports() {
        let reports = read(&root().join("hardware")).unwrap();
        let shown = std::fs::read_to_string(root().join("docs/hardware.md")).unwrap();
        assert_eq!(page(&reports), shown, "make it again: {}", page::COMMAND);
    }

    #[test]
    fn every_file_that_cannot_be_published_is_named() {
        let folder = std::env::temp_dir().join(format!("cairn-hardware-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for (name, text) in [("a.json", "{}"), ("b.json", "no"), ("c.txt", "no")] {
            std::fs::write(folder.join(name), text).unwrap();
        }
        let wrong = read(&folder).unwrap_err();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(wrong.lines().count(), 2, "{wrong}");
        assert!(wrong.contains("a.json: ") && wrong.contains("b.json: it is not JSON"), "{wrong}");
        assert!(read(&folder).unwrap_err().contains("name the folder of the reports"));
    }
}

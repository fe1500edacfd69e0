//! Writes the files of a report into the output folder and into the repository's docs.

use std::path::{Path, PathBuf};

use cairn::{Picture, Result};

use super::provenance::stamped;
use media::{JpegQuality, RealDisk, describe_io, encode_jpeg, write_whole};

/// Folder of the pages' pictures, within the docs.
const IMAGES: &str = "images";

/// Files of a report.
#[derive(Default)]
pub(crate) struct Files(Vec<File>);

struct File {
    name: String,
    content: Vec<u8>,
    /// A picture's path in the docs, and its content there.
    published: Option<(String, Vec<u8>)>,
}

impl Files {
    /// Adds a text.
    pub(crate) fn add(&mut self, name: &str, text: impl Into<Vec<u8>>) {
        self.0.push(File { name: name.to_owned(), content: text.into(), published: None });
    }

    /// Adds the picture `name`.png, whose content is `png`. The docs get a JPEG, which is several times smaller.
    ///
    /// # Errors
    /// As [`encode_jpeg`].
    pub(crate) fn add_picture(&mut self, name: &str, png: Vec<u8>, picture: &Picture) -> Result<()> {
        let jpeg = encode_jpeg(picture, JpegQuality::Repository)?;
        let published = Some((format!("{IMAGES}/{name}.jpg"), jpeg));
        self.0.push(File { name: format!("{name}.png"), content: png, published });
        Ok(())
    }

    /// Writes all files into `folder`, in the order in which they were added. Returns their paths.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn write(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        write_all(self.0.iter().map(|file| (folder.join(&file.name), file.content.clone())).collect())
    }

    /// Writes those of `names` that exist into the repository's docs, in that order; pages state their [commit](stamped) and the digest
    /// of the bundle that their figures depend on. Returns their paths.
    ///
    /// # Errors
    /// `Io`.
    pub(crate) fn publish(&self, names: &[&str], world: Option<&str>) -> Result<Vec<PathBuf>> {
        let docs = docs();
        let mut files = Vec::new();
        for (name, content) in self.published(names) {
            let is_page = name.ends_with(".md");
            let content =
                if is_page { stamped(&String::from_utf8_lossy(&content), world).into_bytes() } else { content };
            files.push((docs.join(name), content));
        }
        write_all(files)
    }

    /// Paths within the docs, and contents. The pages link the published pictures.
    fn published(&self, names: &[&str]) -> Vec<(String, Vec<u8>)> {
        let publish = |file: &File| match &file.published {
            Some(published) => published.clone(),
            None if file.name.ends_with(".md") => (file.name.clone(), self.with_published_links(&file.content)),
            None => (file.name.clone(), file.content.clone()),
        };
        names.iter().filter_map(|name| self.0.iter().find(|file| file.name == *name).map(publish)).collect()
    }

    fn with_published_links(&self, page: &[u8]) -> Vec<u8> {
        let mut text = String::from_utf8_lossy(page).into_owned();
        for File { name, published, .. } in &self.0 {
            if let Some((path, _)) = published {
                text = text.replace(&format!("]({name})"), &format!("]({path})"));
            }
        }
        text.into_bytes()
    }
}

/// The repository's docs.
pub(crate) fn docs() -> PathBuf {
    provision::repository().join("docs")
}

/// Writes files, and makes their folders. Returns their paths.
///
/// # Errors
/// `Io`.
pub(crate) fn write_all(files: Vec<(PathBuf, Vec<u8>)>) -> Result<Vec<PathBuf>> {
    for (path, bytes) in &files {
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(|e| describe_io("it cannot be made", folder, &e))?;
        write_whole(&RealDisk, path, bytes)?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_pages_link_the_folder_of_pictures() {
        let mut files = Files::default();
        files.add("motion.md", "![a](motion.png) motion.png");
        files.add("motion.csv", "](motion.png)");
        files.add_picture("motion", vec![1, 2], &Picture::new(16, 16).unwrap()).unwrap();
        let published = files.published(&["motion.png", "motion.md", "motion.csv", "other.md"]);
        let of = |name: &str| published.iter().find(|(path, _)| path == name).map(|(_, content)| content.as_slice());
        assert_eq!(published.len(), 3);
        assert!(of("images/motion.jpg").unwrap().starts_with(&[0xff, 0xd8]));
        assert_eq!(of("motion.md"), Some(&b"![a](images/motion.jpg) motion.png"[..]));
        assert_eq!(of("motion.csv"), Some(&b"](motion.png)"[..]));
    }
}

//! The scenes that the miniature world was never trained on.

use cairn::{Error, ErrorKind, Result};

/// The trainer's list of excluded seeds.
const LIST: &str = include_str!("../../../../samples/worlds/miniature/held-out.txt");

/// Ranges of the list, both ends included.
fn ranges() -> impl Iterator<Item = (u64, u64)> {
    LIST.lines().filter_map(|line| {
        let entry = line.split('#').next().unwrap_or_default().trim();
        let (first, last) = entry.split_once("..").unwrap_or((entry, entry));
        Some((first.parse().ok()?, last.parse().ok()?))
    })
}

/// Fails for scene seeds that are not held out: a world may have been trained on them.
pub(crate) fn require(seeds: &[u64]) -> Result<()> {
    match seeds.iter().find(|seed| !ranges().any(|(first, last)| (first..=last).contains(*seed))) {
        None => Ok(()),
        Some(seed) => Err(Error::new(
            ErrorKind::InvalidArgument,
            format!("scene seed {seed} is not held out: a world may have been trained on it"),
        )
        .field("--seeds")
        .remedy("Use seeds of samples/worlds/miniature/held-out.txt, such as 41")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_seeds_of_the_list_are_taken() {
        assert!(ranges().count() >= 1);
        require(&[0, 41, 999]).unwrap();
        let error = require(&[41, 1000]).unwrap_err().to_string();
        assert!(error.contains("1000") && error.contains("held-out.txt"), "{error}");
    }
}

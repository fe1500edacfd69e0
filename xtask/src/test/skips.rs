//! `xtask/skips.toml`: the tests that may be skipped in continuous integration, where every other skip is a failure.

use serde::Deserialize;

use super::tally::Skip;

/// The things that a test may need and a machine may lack.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AllowedSkips {
    #[serde(default, rename = "need")]
    needs: Vec<MissingRequirement>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MissingRequirement {
    /// The word in the skip's reason, which starts with `needs <id>`.
    id: String,
    /// Why not every machine of ours can have it.
    reason: String,
}

impl AllowedSkips {
    pub(super) fn read(text: &str) -> Result<Self, String> {
        let allowed: Self = toml::from_str(text).map_err(|e| format!("xtask/skips.toml: {e}"))?;
        match allowed.needs.iter().find(|need| need.id.trim().is_empty() || need.reason.trim().is_empty()) {
            Some(need) => Err(format!("xtask/skips.toml: the entry \"{}\" needs an id and a reason", need.id)),
            None => Ok(allowed),
        }
    }

    /// Whether the skip gives one of the listed needs as its reason.
    pub(super) fn covers(&self, skip: &Skip) -> bool {
        let Some(need) = skip.reason.strip_prefix("needs ") else { return false };
        let id = need.split([':', ' ', ',']).next().unwrap_or_default();
        self.needs.iter().any(|need| need.id == id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skip(reason: &str) -> Skip {
        Skip { name: "a test".to_owned(), reason: reason.to_owned() }
    }

    #[test]
    fn the_committed_list_is_readable_and_covers_by_need() {
        let allowed = AllowedSkips::read(include_str!("../../skips.toml")).unwrap();
        assert!(allowed.covers(&skip("needs real-gpu")));
        assert!(allowed.covers(&skip("needs amd-dlls: amd_fidelityfx_dx12.dll is not beside the library")));
        assert!(!allowed.covers(&skip("needs time")));
        assert!(!allowed.covers(&skip("real-gpu")));
        assert!(!allowed.covers(&skip("")));
    }

    #[test]
    fn an_entry_without_a_reason_is_refused() {
        assert!(AllowedSkips::read("[[need]]\nid = \"x\"\nreason = \" \"").is_err());
        assert!(AllowedSkips::read("[[need]]\nid = \"x\"").is_err());
        assert!(AllowedSkips::read("[[nede]]\nid = \"x\"").is_err());
    }
}

//! Selects one of the providers in AMD's libraries and drivers.

use std::ffi::{CStr, c_char, c_void};
use std::fmt;
use std::ptr::{null, null_mut};
use std::str::FromStr;

use super::bindings::{EffectId, QueryVersions, StructId};
use super::{Api, Chain, Effect};
use crate::{Error, ErrorKind, Result};

/// A family of providers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Family {
    /// A trained network: releases 4.0 and 4.1, on AMD's newest hardware only.
    Ml,
    /// Hand-written algorithms: releases up to 3.1, on any hardware.
    Analytic,
}

/// The wanted provider.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Choice {
    /// The default of libraries and driver: the newest that the device can run.
    #[default]
    Any,
    /// The newest of a family, or the default if there is none.
    Prefer(Family),
    /// The newest of a family, or an error.
    Require(Family),
}

impl FromStr for Choice {
    type Err = Error;

    /// Reads `any`, `ml`, `analytic` (preferred), `require-ml` or `require-analytic`.
    fn from_str(text: &str) -> Result<Self> {
        Ok(match text {
            "any" => Self::Any,
            "ml" => Self::Prefer(Family::Ml),
            "analytic" => Self::Prefer(Family::Analytic),
            "require-ml" => Self::Require(Family::Ml),
            "require-analytic" => Self::Require(Family::Analytic),
            _ => {
                let cause = format!("\"{text}\" names no provider");
                return Err(Error::new(ErrorKind::InvalidArgument, cause)
                    .remedy("Use any, ml, analytic, require-ml or require-analytic"));
            }
        })
    }
}

/// A provider's id and name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Version {
    /// The id that requests it; valid in this process only.
    pub id: u64,
    /// Its name, such as 3.1.5.
    pub name: String,
}

impl Version {
    /// The first three numbers of its name; missing ones are 0. None for a name without a digit.
    pub fn number(&self) -> Option<[u32; 3]> {
        let start = self.name.find(|c: char| c.is_ascii_digit())?;
        let mut number = [0; 3];
        for (part, text) in number.iter_mut().zip(self.name[start..].split('.')) {
            let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
            *part = text[..end].parse().unwrap_or(0);
            if end < text.len() {
                break;
            }
        }
        Some(number)
    }

    /// The family of the releases for which AMD's documentation names it: ffx-api has no query for it, and a number alone does not
    /// tell for future releases. None for all others, which no preference or requirement selects.
    pub fn family(&self) -> Option<Family> {
        match self.number()? {
            // Frame interpolation of SDK 1.1, FSR 2.3, and FSR 3 as of SDK 1.1 to 2.4.
            [1, 0..=1, _] | [2, 3, _] | [3, 0..=1, _] => Some(Family::Analytic),
            // FSR 4 and frame generation 4 of SDK 2.0 to 2.4.
            [4, 0..=1, _] => Some(Family::Ml),
            _ => None,
        }
    }

    /// The structs that it accepts.
    pub fn dialect(&self, effect: Effect) -> Dialect {
        let first = match effect {
            Effect::FrameGeneration => [3, 1, 6],
            Effect::Upscaling => [4, 0, 3],
        };
        // A name without a number is taken for a later release.
        if self.number().is_none_or(|number| number >= first) { Dialect::Sdk21 } else { Dialect::Sdk11 }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = if self.name.is_empty() { "a provider without a name" } else { &self.name };
        match self.family() {
            Some(Family::Ml) => write!(f, "{name} (ml)"),
            Some(Family::Analytic) => write!(f, "{name} (analytic)"),
            None => f.write_str(name),
        }
    }
}

/// The set of structs that a provider accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Dialect {
    /// SDK 1.1 to 2.0: motion and depth, and the camera in a struct of its own.
    Sdk11,
    /// SDK 2.1 and later: motion, depth and camera in one struct, and a struct with the release that the host was written for.
    Sdk21,
}

/// Maximum number of listed providers.
const MAX_PROVIDERS: usize = 256;

/// Lists a library's providers of `effect` on `device`, newest first.
///
/// Libraries return 0 when only the count is queried, so the query always provides space for the list.
///
/// # Errors
/// `Unsupported` when there is none; the library's own errors.
///
/// # Safety
/// `device` is an `ID3D12Device`, or null.
pub unsafe fn versions(api: &Api, effect: Effect, device: *mut c_void) -> Result<Vec<Version>> {
    // SAFETY: the caller's promise.
    unsafe { versions_of(api, effect.create(), device) }
}

/// As [`versions`], for the contexts that the struct `create` makes.
///
/// # Safety
/// As [`versions`].
pub(super) unsafe fn versions_of(api: &Api, create: StructId, device: *mut c_void) -> Result<Vec<Version>> {
    let mut capacity = 8;
    let (ids, names) = loop {
        let (mut ids, mut names) = (vec![0; capacity], vec![null::<c_char>(); capacity]);
        let mut count = capacity as u64;
        let mut query = Chain::new(QueryVersions {
            create,
            device,
            count: &mut count,
            ids: ids.as_mut_ptr(),
            names: names.as_mut_ptr(),
            ..Default::default()
        });
        // SAFETY: no context; both lists have the stated capacity, and the device is as the caller promises.
        unsafe { api.query(null_mut(), &mut query) }.map_err(|failure| failure.error())?;
        let count = usize::try_from(count).unwrap_or(capacity);
        // A full list may mean that there are more.
        if count < capacity || capacity == MAX_PROVIDERS {
            ids.truncate(count);
            break (ids, names);
        }
        capacity *= 2;
    };
    let mut found: Vec<_> = ids
        .iter()
        .zip(&names)
        .map(|(&id, &name)| {
            // SAFETY: null, or a string that the library keeps until the next call.
            let name = if name.is_null() { "".into() } else { unsafe { CStr::from_ptr(name) }.to_string_lossy() };
            Version { id, name: name.into_owned() }
        })
        .collect();
    if found.is_empty() {
        return Err(Error::new(
            ErrorKind::Unsupported,
            format!("AMD's libraries have no provider of {} for this device", effect_name(create)),
        )
        .remedy("Put the effect's own library beside the loader, or use another adapter or a newer driver"));
    }
    found.sort_by_key(|version| std::cmp::Reverse((version.number(), version.id & 0x7fff_ffff)));
    Ok(found)
}

/// A name for the effect of the contexts that a struct creates.
pub(super) fn effect_name(create: StructId) -> String {
    match Effect::of(create) {
        Some(_) if create.effect() == EffectId::SWAPCHAIN => "paced swap chains".to_owned(),
        Some(effect) => effect.to_string(),
        None => format!("{create:?}"),
    }
}

/// Selects from `offered`, the providers of `effect` (newest first), the provider to request by its id; None to leave the choice to the
/// library.
///
/// # Errors
/// `Unsupported` when a required family is missing.
pub fn choose(offered: &[Version], choice: Choice, effect: Effect) -> Result<Option<&Version>> {
    let newest = |family| offered.iter().find(|version| version.family() == Some(family));
    match choice {
        Choice::Any => Ok(None),
        Choice::Prefer(family) => Ok(newest(family)),
        Choice::Require(family) => {
            newest(family).map(Some).ok_or_else(|| unavailable(family, effect, &names_of(offered)))
        }
    }
}

/// The error for a required family that is not available.
pub(super) fn unavailable(family: Family, effect: Effect, instead: &str) -> Error {
    let (what, needs) = match (family, effect) {
        (Family::Ml, Effect::FrameGeneration) => {
            ("ml (4.0 and 4.1)", "Use an RDNA 4 adapter on Windows 11 with SDK 2.1 or later, or choose analytic")
        }
        (Family::Ml, Effect::Upscaling) => {
            ("ml (4.0 and 4.1)", "Use an adapter that FSR 4 supports, with SDK 2.0 or later, or choose analytic")
        }
        (Family::Analytic, _) => ("analytic (3.1)", "Use AMD's libraries of SDK 1.1 to 2.4 that hold it, or choose ml"),
    };
    let cause = format!("a provider of the family {what} is required, and there is {instead}");
    Error::new(ErrorKind::Unsupported, cause).field("provider").remedy(needs)
}

/// The providers' names, separated by commas.
pub(super) fn names_of(versions: &[Version]) -> String {
    versions.iter().map(Version::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn version(name: &str) -> Version {
        Version { id: name.len() as u64, name: name.to_owned() }
    }

    #[test]
    fn names_determine_number_family_and_dialect() {
        use Dialect::{Sdk11, Sdk21};
        use Family::{Analytic, Ml};
        for (name, number, family, dialect) in [
            ("3.1.5", Some([3, 1, 5]), Some(Analytic), Sdk11),
            ("3.1.6", Some([3, 1, 6]), Some(Analytic), Sdk21),
            ("3.1", Some([3, 1, 0]), Some(Analytic), Sdk11),
            ("3.1.10-beta", Some([3, 1, 10]), Some(Analytic), Sdk21),
            ("FSR 4.0.2", Some([4, 0, 2]), Some(Ml), Sdk21),
            ("4.1.0.99", Some([4, 1, 0]), Some(Ml), Sdk21),
            ("1.1.3", Some([1, 1, 3]), Some(Analytic), Sdk11),
            ("2.3.4", Some([2, 3, 4]), Some(Analytic), Sdk11),
            ("3.2.0", Some([3, 2, 0]), None, Sdk21),
            ("4.2.0", Some([4, 2, 0]), None, Sdk21),
            ("5.0.0", Some([5, 0, 0]), None, Sdk21),
            ("10", Some([10, 0, 0]), None, Sdk21),
            ("99999999999.1", Some([0, 1, 0]), None, Sdk11),
            ("preview", None, None, Sdk21),
            ("", None, None, Sdk21),
        ] {
            let version = version(name);
            assert_eq!(version.number(), number, "{name}");
            assert_eq!(version.family(), family, "{name}");
            assert_eq!(version.dialect(Effect::FrameGeneration), dialect, "{name}");
        }
        assert_eq!(version("4.0.2").dialect(Effect::Upscaling), Sdk11);
        assert_eq!(version("4.0.3").dialect(Effect::Upscaling), Sdk21);
    }

    #[test]
    fn a_family_is_preferred_or_required() {
        let both = [version("4.0.1"), version("3.1.6")];
        let analytic = [version("3.1.6"), version("3.1.5")];
        let name = |offered, choice: &str| {
            choose(offered, choice.parse().expect("a choice"), Effect::FrameGeneration)
                .map(|found| found.map(|v| v.name.clone()))
        };
        assert_eq!(name(&both, "any").expect("any"), None);
        assert_eq!(name(&both, "ml").expect("ml").as_deref(), Some("4.0.1"));
        assert_eq!(name(&both, "require-ml").expect("ml").as_deref(), Some("4.0.1"));
        assert_eq!(name(&both, "analytic").expect("analytic").as_deref(), Some("3.1.6"));
        assert_eq!(name(&analytic, "ml").expect("preferred only"), None);
        assert_eq!(name(&analytic, "require-analytic").expect("there").as_deref(), Some("3.1.6"));
        let refused = name(&analytic, "require-ml").expect_err("required");
        assert_eq!(refused.kind(), ErrorKind::Unsupported);
        assert!(refused.cause().contains("3.1.6 (analytic), 3.1.5 (analytic)"), "{refused}");
        let remedy = |effect| {
            let refused = choose(&analytic, Choice::Require(Family::Ml), effect).expect_err("required");
            refused.remedy_text().unwrap_or_default().to_owned()
        };
        assert!(remedy(Effect::FrameGeneration).contains("SDK 2.1"), "{}", remedy(Effect::FrameGeneration));
        assert!(remedy(Effect::Upscaling).contains("SDK 2.0"), "{}", remedy(Effect::Upscaling));
        let refused = "best".parse::<Choice>().expect_err("no choice");
        assert_eq!(refused.kind(), ErrorKind::InvalidArgument);
    }
}

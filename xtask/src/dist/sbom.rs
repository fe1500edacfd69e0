//! The bill of materials, as CycloneDX 1.5 <https://cyclonedx.org/docs/1.5/json/>.

use cyclonedx_bom::external_models::uri::Uri as Address;
pub(super) use cyclonedx_bom::models::component::Classification;
use cyclonedx_bom::models::dependency::{Dependencies, Dependency};
use cyclonedx_bom::models::external_reference::{ExternalReference, ExternalReferenceType, ExternalReferences, Uri};
use cyclonedx_bom::models::hash::{Hash, HashAlgorithm, HashValue, Hashes};
use cyclonedx_bom::models::license::{LicenseChoice, Licenses};
use cyclonedx_bom::prelude::{
    Bom, Component, Components, DateTime, Metadata, NormalizedString, Purl, SpdxExpression, SpecVersion, UrnUuid,
    Validate,
};
use jiff::Timestamp;
use sha2::{Digest, Sha256};

use super::dependencies::Part;

/// File name in an archive of the library's bill.
pub(super) const NAME: &str = "cairn.cdx.json";
/// The same for `cairn-check`.
pub(super) const NAME_OF_CHECK: &str = "cairn-check.cdx.json";

const VERSION: SpecVersion = SpecVersion::V1_5;

/// The bill of `parts`, the first of which is the library or program itself, of class `own_class`. The serial number is computed from the
/// parts, so the same parts make the same bill.
pub(super) fn write(parts: &[Part], own_class: Classification, build_time: Timestamp) -> Result<Vec<u8>, String> {
    let failed = |e: &dyn std::fmt::Display| format!("the bill of materials: {e}");
    let (own, others) = parts.split_first().ok_or("a bill of no parts")?;
    let mut bom = Bom {
        serial_number: Some(UrnUuid::new(number(parts)).map_err(|e| format!("{NAME}: {e:?}"))?),
        metadata: Some(Metadata {
            timestamp: Some(DateTime::try_from(build_time.to_string()).map_err(|e| failed(&e))?),
            component: Some(component(own, own_class)?),
            ..Metadata::default()
        }),
        components: Some(Components(
            others.iter().map(|part| component(part, Classification::Library)).collect::<Result<_, _>>()?,
        )),
        ..Bom::default()
    };
    bom.spec_version = VERSION;
    bom.dependencies = Some(Dependencies(
        parts
            .iter()
            .map(|part| Dependency { dependency_ref: part.reference(), dependencies: part.uses.clone() })
            .collect(),
    ));
    let checked = bom.validate_version(VERSION);
    if checked.has_errors() {
        return Err(failed(&format!("{checked:?}")));
    }
    let mut bytes = Vec::new();
    bom.output_as_json(&mut bytes, VERSION).map_err(|e| failed(&e))?;
    Ok(bytes)
}

fn component(part: &Part, class: Classification) -> Result<Component, String> {
    let failed = |e: &dyn std::fmt::Display| format!("the bill of materials, {} {}: {e}", part.name, part.version);
    let mut component = Component::new(class, &part.name, &part.version, Some(part.reference()));
    let url = Purl::new(part.kind.package_type(), &part.name, &part.version);
    component.purl = Some(url.map_err(|e| failed(&e))?);
    component.description = part.description.as_deref().map(NormalizedString::new);
    let licence = SpdxExpression::try_from(part.licence.clone()).map_err(|e| failed(&e))?;
    component.licenses = Some(Licenses(vec![LicenseChoice::Expression(licence)]));
    component.hashes = part
        .sha256
        .as_ref()
        .map(|sum| Hashes(vec![Hash { alg: HashAlgorithm::SHA_256, content: HashValue(sum.clone()) }]));
    // An address that is not a URL is left out.
    let repository = part.repository.clone().and_then(|repository| Address::try_from(repository).ok());
    component.external_references = repository.map(|repository| {
        ExternalReferences(vec![ExternalReference::new(ExternalReferenceType::Vcs, Uri::Url(repository))])
    });
    Ok(component)
}

/// A UUID of version 8, whose content RFC 9562 leaves to the implementer: here a digest of names and versions.
fn number(parts: &[Part]) -> String {
    let mut digest = Sha256::new();
    for part in parts {
        digest.update(part.reference());
        digest.update(b"\n");
    }
    let digest = digest.finalize();
    let mut bytes: [u8; 16] = std::array::from_fn(|i| digest[i]);
    bytes[6] = bytes[6] & 0x0f | 0x80;
    bytes[8] = bytes[8] & 0x3f | 0x80;
    let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("urn:uuid:{}-{}-{}-{}-{}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::dist::dependencies::Kind;

    fn part(kind: Kind, name: &str, licence: &str, uses: &[&str]) -> Part {
        Part {
            kind,
            name: name.to_owned(),
            version: "1.2.3".to_owned(),
            licence: licence.to_owned(),
            description: Some("a part".to_owned()),
            repository: Some("https://example.org/part".to_owned()),
            sha256: Some("ab".repeat(32)),
            uses: uses.iter().map(|used| (*used).to_owned()).collect(),
            texts: BTreeMap::new(),
        }
    }

    #[test]
    fn a_bill_has_parts_licences_checksums_and_dependencies() {
        let uses = ["pkg:cargo/a@1.2.3", "pkg:generic/b@1.2.3"];
        let parts = [
            part(Kind::Crate, "own", "MIT OR Apache-2.0", &uses),
            part(Kind::Crate, "a", "Zlib", &[]),
            part(Kind::Runtime, "b", "Apache-2.0 WITH LLVM-exception", &[]),
        ];
        let build_time: Timestamp = "2024-02-29T12:00:00Z".parse().unwrap();
        let write = |parts: &[Part]| super::write(parts, Classification::Application, build_time);
        let bytes = write(&parts).unwrap();
        assert_eq!(bytes, write(&parts).unwrap());
        let bill: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!((&bill["bomFormat"], &bill["specVersion"]), (&"CycloneDX".into(), &"1.5".into()));
        assert_eq!(bill["metadata"]["component"]["name"], "own");
        assert_eq!(bill["metadata"]["component"]["type"], "application");
        assert_eq!(bill["metadata"]["timestamp"], "2024-02-29T12:00:00Z");
        let only = &bill["components"][0];
        assert_eq!((&only["purl"], &only["type"]), (&"pkg:cargo/a@1.2.3".into(), &"library".into()));
        assert_eq!(only["licenses"][0]["expression"], "Zlib");
        assert_eq!(only["hashes"][0]["content"], "ab".repeat(32));
        assert_eq!(bill["components"].as_array().map(Vec::len), Some(2));
        assert_eq!(bill["components"][1]["purl"], "pkg:generic/b@1.2.3");
        assert_eq!(bill["components"][1]["licenses"][0]["expression"], "Apache-2.0 WITH LLVM-exception");
        let [first, second] = uses.map(serde_json::Value::from);
        assert_eq!(bill["dependencies"][0]["dependsOn"], serde_json::Value::from([first, second].to_vec()));
        let refused = write(&parts[..1]).unwrap_err();
        assert!(refused.contains("pkg:cargo/a@1.2.3"), "who is used must be there: {refused}");
    }

    #[test]
    fn an_invalid_licence_expression_is_refused() {
        let refused =
            write(&[part(Kind::Crate, "own", "free for all", &[])], Classification::Library, Timestamp::UNIX_EPOCH)
                .unwrap_err();
        assert!(refused.contains("own 1.2.3"), "{refused}");
    }
}

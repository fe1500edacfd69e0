//! Parses the manifest and checks its consistency: `docs/bundle.md` sections 2 and 3.
//!
//! The upper limits keep every later product far below 2^64. They are at least a hundred times what any released model needs.

use std::collections::BTreeSet;

use serde::Deserialize;

use super::manifest::{Geometry, Manifest, Quantisation, SCHEMA_VERSION};
use super::{MANIFEST_NAME, invalid, names};
use crate::error::printable;
use crate::picture::MAX_SIDE;
use crate::{Error, ErrorKind, Result};

/// The largest manifest, in bytes.
pub(super) const MAX_MANIFEST: u64 = 1 << 20;
/// Maximum number of files that a bundle lists.
pub(super) const MAX_FILES: usize = 4096;
/// The only model type this library runs.
const MODEL_TYPE: &str = "waypoint-1.5";
/// Number of decoder memories of that type, and of encoder memories if its encoder has any.
const MEMORIES: usize = 9;
/// The largest side of anything in latent cells, and the largest channel count.
const MAX_CELLS: u64 = 4096;
/// How many times as large as a decoded picture its square-pixel form may be, on each side: a rollout allocates pictures of that size.
const MAX_RENDER_SCALE: u64 = 8;

const CONVERT: &str = "Build the bundle again, or correct the manifest as docs/bundle.md says";

/// Reads `bytes` as a manifest and makes all checks that need no other file.
///
/// # Errors
/// `InvalidBundle` with the offending member, or `Unsupported` for a newer or older schema or another kind of model.
pub(super) fn read_manifest(bytes: &[u8]) -> Result<Manifest> {
    if bytes.len() as u64 > MAX_MANIFEST {
        return Err(invalid(
            MANIFEST_NAME,
            format!("the manifest has {} bytes, at most {MAX_MANIFEST} are read", bytes.len()),
            CONVERT,
        ));
    }
    check_version(bytes)?;
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let manifest: Manifest = serde_path_to_error::deserialize(&mut json).map_err(|error| json_fault(&error))?;
    json.end().map_err(|error| invalid(MANIFEST_NAME, error.to_string(), CONVERT))?;
    check(&manifest)?;
    Ok(manifest)
}

/// Checks the schema version first: a newer manifest may have unknown members.
fn check_version(bytes: &[u8]) -> Result<()> {
    #[derive(Deserialize)]
    struct Version {
        schema_version: u64,
    }
    let version = serde_json::from_slice::<Version>(bytes).map_err(|error| {
        let field = if error.is_data() { "schema_version" } else { MANIFEST_NAME };
        invalid(field, error.to_string(), CONVERT)
    })?;
    let found = version.schema_version;
    let known = u64::from(SCHEMA_VERSION);
    let refuse = |age: &str, remedy: &str| {
        Err(Error::new(
            ErrorKind::Unsupported,
            format!("the bundle has the {age} schema version {found}, this library reads {known}"),
        )
        .field("schema_version")
        .remedy(remedy))
    };
    match found.cmp(&known) {
        std::cmp::Ordering::Equal => Ok(()),
        std::cmp::Ordering::Greater => refuse("newer", "Update Cairn, or build the bundle for this version"),
        std::cmp::Ordering::Less => refuse("older", "Build the bundle again with the current builder"),
    }
}

/// Field name for a JSON error: serde reports a missing or unknown member under its parent's path.
fn json_fault(error: &serde_path_to_error::Error<serde_json::Error>) -> Error {
    // Names of members are the file's, and may hold anything.
    let message = printable(&error.inner().to_string());
    let path = printable(&error.path().to_string());
    let mut field = if path == "." { String::new() } else { path };
    if let Some(member) = message.strip_prefix("missing field `").and_then(|rest| rest.split('`').next()) {
        if !field.is_empty() {
            field.push('.');
        }
        field.push_str(member);
    }
    if field.is_empty() {
        field.push_str(MANIFEST_NAME);
    }
    invalid(field, message, CONVERT)
}

fn bad<T>(field: &str, cause: impl Into<String>) -> Result<T> {
    Err(invalid(field, cause, CONVERT))
}

fn within(field: &str, value: u32, low: u64, high: u64) -> Result<()> {
    if (low..=high).contains(&u64::from(value)) {
        return Ok(());
    }
    bad(field, format!("{value} is outside {low} to {high}"))
}

fn multiple(field: &str, value: u32, of_name: &str, of: u32) -> Result<()> {
    if of != 0 && value.is_multiple_of(of) {
        return Ok(());
    }
    bad(field, format!("{value} is not a multiple of {of_name}, {of}"))
}

fn equal(field: &str, found: u64, meaning: &str, expected: u64) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    bad(field, format!("{found} is not {meaning}, {expected}"))
}

fn check(m: &Manifest) -> Result<()> {
    let letters = m.name.chars().count();
    if !(1..=100).contains(&letters) || m.name.chars().any(char::is_control) {
        return bad("name", format!("a name has 1 to 100 characters and no control character, this one has {letters}"));
    }
    if m.model_type != MODEL_TYPE {
        return Err(Error::new(
            ErrorKind::Unsupported,
            format!("`{}` is not `{MODEL_TYPE}`", m.model_type.escape_debug()),
        )
        .field("model_type")
        .remedy("Use a bundle of that kind of model, or a Cairn that runs this kind"));
    }
    check_geometry(&m.geometry)?;
    check_schedule(&m.sampler.schedule)?;
    within("rates.latents_per_second", m.rates.latents_per_second, 1, 1000)?;
    within("rates.time_multiplier", m.rates.time_multiplier, 1, 1000)?;
    equal("controls.mouse", m.controls.mouse.into(), "the count of mouse numbers", 2)?;
    equal("controls.buttons", m.controls.buttons.into(), "the count of virtual keys", 256)?;
    equal("controls.scroll", m.controls.scroll.into(), "the count of scroll numbers", 1)?;
    check_picture(m)?;
    if m.residual.is_some() && m.graphs.f16.is_none() {
        return bad(
            "residual",
            "only f16 graphs have a residual stream of another type than theirs, and there are none",
        );
    }
    m.quantisation.as_ref().map_or(Ok(()), check_quantisation)?;
    check_files(m)
}

fn check_geometry(g: &Geometry) -> Result<()> {
    within("geometry.layers", g.layers, 1, 512)?;
    within("geometry.width", g.width, 8, 65_536)?;
    within("geometry.heads", g.heads, 1, 4096)?;
    within("geometry.kv_heads", g.kv_heads, 1, 4096)?;
    within("geometry.head_width", g.head_width, 8, 1024)?;
    within("geometry.mlp_ratio", g.mlp_ratio, 1, 64)?;
    multiple("geometry.heads", g.heads, "geometry.kv_heads", g.kv_heads)?;
    multiple("geometry.head_width", g.head_width, "the smallest unit", 8)?;
    equal("geometry.width", g.width.into(), "heads * head_width", u64::from(g.heads) * u64::from(g.head_width))?;

    within("geometry.latent.channels", g.latent.channels, 1, MAX_CELLS)?;
    within("geometry.latent.height", g.latent.height, 1, MAX_CELLS)?;
    within("geometry.latent.width", g.latent.width, 1, MAX_CELLS)?;
    for (side, latent) in [g.latent.height, g.latent.width].into_iter().enumerate() {
        within(&format!("geometry.patch[{side}]"), g.patch[side], 1, 64)?;
        let name = ["geometry.latent.height", "geometry.latent.width"][side];
        multiple(name, latent, &format!("geometry.patch[{side}]"), g.patch[side])?;
    }
    let (rows, columns) = g.token_grid();
    let tokens = u64::from(rows) * u64::from(columns);
    equal("geometry.tokens", g.tokens.into(), "the token grid's rows * columns", tokens)?;
    within("geometry.tokens", g.tokens, 1, 65_536)?;

    within("geometry.local.window", g.local.window, 1, 65_536)?;
    within("geometry.global.dilation", g.global.dilation, 1, 4096)?;
    within("geometry.global.max_window", g.global.max_window, 1, 65_536)?;
    within("geometry.global.window", g.global.window, 1, g.global.max_window.into())?;
    multiple("geometry.global.window", g.global.window, "geometry.global.dilation", g.global.dilation)?;
    multiple("geometry.global.max_window", g.global.max_window, "geometry.global.dilation", g.global.dilation)?;
    within("geometry.global.period", g.global.period, 1, 4096)?;
    if !(-4096..=4096).contains(&g.global.offset) {
        return bad("geometry.global.offset", format!("{} is outside -4096 to 4096", g.global.offset));
    }
    within("geometry.control_period", g.control_period, 1, 4096)?;

    real("geometry.rope.nyquist_fraction", g.rope.nyquist_fraction, 0.0, 1.0)?;
    real("geometry.rope.time_base", g.rope.time_base, 1.0, 1e9)?;
    equal("geometry.autoencoder.temporal", g.autoencoder.temporal.into(), "the count of pictures per latent", 4)?;
    equal("geometry.autoencoder.spatial", g.autoencoder.spatial.into(), "the count of pixels per latent cell", 16)?;
    equal(
        "geometry.autoencoder.memories",
        g.autoencoder.memories.len() as u64,
        "the count of memories",
        MEMORIES as u64,
    )?;
    if !g.autoencoder.encoder_memories.is_empty() {
        equal(
            "geometry.autoencoder.encoder_memories",
            g.autoencoder.encoder_memories.len() as u64,
            "the count of memories",
            MEMORIES as u64,
        )?;
    }
    for (name, shapes) in [("memories", &g.autoencoder.memories), ("encoder_memories", &g.autoencoder.encoder_memories)]
    {
        for (i, shape) in shapes.iter().enumerate() {
            for (axis, &n) in shape.iter().enumerate() {
                within(&format!("geometry.autoencoder.{name}[{i}][{axis}]"), n, 1, MAX_SIDE.into())?;
            }
        }
    }
    Ok(())
}

/// `low < value <= high`, and finite.
fn real(field: &str, value: f64, low: f64, high: f64) -> Result<()> {
    if value > low && value <= high {
        return Ok(());
    }
    bad(field, format!("{value} is not above {low} and at most {high}"))
}

fn check_schedule(schedule: &[f64]) -> Result<()> {
    const FIELD: &str = "sampler.schedule";
    if !(2..=64).contains(&schedule.len()) {
        return bad(FIELD, format!("a schedule has 2 to 64 levels, this one has {}", schedule.len()));
    }
    if schedule.iter().any(|s| !(0.0..=1.0).contains(s)) || schedule.last() != Some(&0.0) {
        return bad(FIELD, "a schedule starts at 1 or below and ends at exactly 0");
    }
    if !schedule.is_sorted_by(|a, b| a > b) {
        return bad(FIELD, "a schedule falls strictly");
    }
    Ok(())
}

fn check_picture(m: &Manifest) -> Result<()> {
    let g = &m.geometry;
    let cells = [g.latent.width, g.latent.height];
    for (side, count) in cells.into_iter().enumerate() {
        let field = format!("picture.decoded[{side}]");
        let made = u64::from(count) * u64::from(g.autoencoder.spatial);
        equal(&field, m.picture.decoded[side].into(), "the latent's side * geometry.autoencoder.spatial", made)?;
        within(&field, m.picture.decoded[side], 1, MAX_SIDE.into())?;
        let largest = u64::from(MAX_SIDE).min(MAX_RENDER_SCALE * u64::from(m.picture.decoded[side]));
        within(&format!("picture.render[{side}]"), m.picture.render[side], 1, largest)?;
    }
    if m.picture.range != [0.0, 1.0] {
        return bad("picture.range", format!("{:?} is not [0, 1]", m.picture.range));
    }
    Ok(())
}

fn check_quantisation(q: &Quantisation) -> Result<()> {
    let one_of = |member: &str, value: u32, allowed: &[u32]| {
        if allowed.contains(&value) {
            return Ok(());
        }
        bad(&format!("quantisation.{member}"), format!("{value} is none of {allowed:?}"))
    };
    one_of("bits", q.bits, &[4, 8])?;
    one_of("block", q.block, &[16, 32, 64, 128, 256])?;
    one_of("activation_bits", q.activation_bits, &[8, 16])?;
    let is_name = |name: &String| (1..=200).contains(&name.len()) && name.bytes().all(|b| b.is_ascii_graphic());
    if q.kept_in_16_bits.len() > MAX_FILES || !q.kept_in_16_bits.iter().all(is_name) {
        return bad("quantisation.kept_in_16_bits", "a name has 1 to 200 printable ASCII characters without spaces");
    }
    Ok(())
}

fn check_files(m: &Manifest) -> Result<()> {
    if m.files.is_empty() || m.files.len() > MAX_FILES {
        return bad("files", format!("a bundle lists 1 to {MAX_FILES} files, this one {}", m.files.len()));
    }
    let mut seen = BTreeSet::new();
    for (i, entry) in m.files.iter().enumerate() {
        let field = |member: &str| format!("files[{i}].{member}");
        if let Some(fault) = names::violation(&entry.path) {
            return bad(&field("path"), fault);
        }
        // Two names that differ only in case are one file on some systems.
        let folded = entry.path.to_ascii_lowercase();
        if folded == MANIFEST_NAME || !seen.insert(folded) {
            return bad(&field("path"), format!("`{}` is listed twice, or is the manifest", entry.path));
        }
        if entry.sha256.len() != 64 || !entry.sha256.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')) {
            return bad(&field("sha256"), "a SHA-256 is 64 lower-case hex digits");
        }
    }
    let mut graphs = BTreeSet::new();
    for (precision, kind, path) in m.graphs.paths() {
        let field = format!("graphs.{precision}.{kind}");
        if m.file(path).is_none() {
            return bad(&field, format!("`{}` is not listed under `files`", path.escape_debug()));
        }
        if !graphs.insert(path) {
            return bad(&field, format!("`{path}` is named for two graphs"));
        }
    }
    if let Some(f16) = &m.graphs.f16
        && f16.joined.is_some() != m.graphs.f32.joined.is_some()
    {
        return bad("graphs.f16.joined", "one precision has a joined graph, and the other not");
    }
    let spdx = m.licence.spdx.chars().count();
    if !(1..=200).contains(&spdx) || !m.licence.spdx.bytes().all(|b| matches!(b, b' '..=b'~')) {
        return bad("licence.spdx", "a licence expression has 1 to 200 printable ASCII characters");
    }
    if let Some(path) = &m.licence.file
        && m.file(path).is_none()
    {
        return bad("licence.file", format!("`{}` is not listed under `files`", path.escape_debug()));
    }
    Ok(())
}

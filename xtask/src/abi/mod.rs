//! The C interface as files: the header made from `src/abi`, and `abi.txt`, the record of what it promises.

pub(crate) mod declarations;
pub(crate) mod header;
pub(crate) mod record;

use crate::clone::Clone;

/// Writes header and record anew.
pub(crate) fn fix(clone: &Clone) -> Result<(), String> {
    let header = header::generate(&clone.root)?;
    let layout = crate::shell::output(&mut record::rust_layout(clone))?;
    let record = record::compose(&layout, &declarations::read(&header)?);
    for (name, text) in [(header::HEADER, header), (record::RECORD, record)] {
        std::fs::write(clone.root.join(name), text).map_err(|e| format!("{name}: {e}"))?;
    }
    Ok(())
}

//! Generated files of the C interface: the header from `src/abi`, the function lists of the loader's header, the C# declarations, and
//! `abi.txt`, the record of what hosts rely on.

pub(crate) mod csharp;
pub(crate) mod declarations;
pub(crate) mod header;
pub(crate) mod loader;
pub(crate) mod record;

use crate::workspace::Workspace;

/// Rewrites the header, the loader's lists, the C# declarations and the record.
pub(crate) fn fix(workspace: &Workspace) -> Result<(), String> {
    let header = header::generate(&workspace.root)?;
    let layout = record::rust_layout(workspace)?;
    let declared = declarations::read(&header)?;
    let record = record::compose(&layout, &declared);
    let loader = loader::with_lists(&workspace.read(loader::LOADER)?, &declared)?;
    let native = csharp::generate(&declared)?;
    let files =
        [(header::HEADER, header), (record::RECORD, record), (loader::LOADER, loader), (csharp::NATIVE, native)];
    for (name, text) in files {
        std::fs::write(workspace.root.join(name), text).map_err(|e| format!("{name}: {e}"))?;
    }
    Ok(())
}

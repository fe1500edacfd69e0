//! The C interface as files: the header made from `src/abi`, the functions that the loader's header lists, what C# calls them by, and
//! `abi.txt`, the record of what it promises.

pub(crate) mod csharp;
pub(crate) mod declarations;
pub(crate) mod header;
pub(crate) mod loader;
pub(crate) mod record;

use crate::workspace::Workspace;

/// Writes header, loader's list, C#'s declarations and record anew.
pub(crate) fn fix(workspace: &Workspace) -> Result<(), String> {
    let header = header::generate(&workspace.root)?;
    let layout = crate::shell::output(&mut record::rust_layout(workspace))?;
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

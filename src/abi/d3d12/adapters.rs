//! Adapters for Direct3D 12, missing requirements, and pipelines saved by an earlier run.

use super::*;

/// Pipelines that the host saved in an earlier run; `None` if it has none or they cannot be loaded.
pub(super) fn loaded_pipelines(
    load: unsafe extern "C" fn(*mut c_void, u64, *mut c_void) -> u64,
    user: *mut c_void,
) -> Option<Vec<u8>> {
    /// Upper limit, larger than all pipelines together.
    const MOST: u64 = 1 << 30;
    // SAFETY: a function of the host's, asked for the size as its documentation says.
    let size = unsafe { load(std::ptr::null_mut(), 0, user) };
    if size == 0 {
        return None;
    }
    let mut bytes = Vec::new();
    let has_room = size <= MOST && bytes.try_reserve_exact(size as usize).is_ok();
    if !has_room {
        log::warn!("{size} bytes of pipelines are not loaded: they are too many");
        return None;
    }
    bytes.resize(size as usize, 0);
    // SAFETY: as above, with so many bytes that may be written.
    let given = unsafe { load(bytes.as_mut_ptr().cast(), size, user) };
    if given != size {
        log::info!("pipelines are made anew: {given} of {size} bytes were loaded");
        return None;
    }
    Some(bytes)
}

/// The adapters, in the system's order.
pub(in crate::abi) fn adapters() -> Vec<cairn_adapter> {
    let found = crate::gpu::adapters().unwrap_or_else(|e| {
        log::warn!("the adapters of Direct3D 12 cannot be listed: {e}");
        Vec::new()
    });
    let row = |(index, adapter): (u32, crate::gpu::Adapter)| cairn_adapter {
        struct_size: 0,
        kind: CAIRN_DEVICE_D3D12,
        index,
        reserved: 0,
        luid: adapter.luid,
        memory: adapter.memory,
        name: fixed_text(&adapter.description),
    };
    (0..).zip(found).map(row).collect()
}

/// Requirements of a device on the first adapter, and the AMD providers that could run on it.
pub(in crate::abi) fn requirements(options: DeviceOptions) -> Vec<cairn_requirement> {
    let needed = "a Direct3D 12 adapter";
    let gpu = match Gpu::on_adapter(None) {
        Ok(gpu) => gpu,
        Err(error) => {
            let found = format!("{}: {error}", platform());
            return vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_NOT_MET, needed, &found)];
        }
    };
    let found = format!("{}, adapter {:#x}", platform(), gpu.luid());
    let amd = ffx::LoadOptions::of_host(&options.libraries);
    let tried = directml_device(&gpu, options).map(|(_, ort)| ort);
    let mut rows =
        vec![row(CAIRN_REQUIREMENT_PLATFORM, CAIRN_REQUIREMENT_MET, needed, &found), onnxruntime(tried), memory()];
    // A small size: support does not depend on it.
    let (status, found) = match ShaderGenerator::new(&gpu, (64, 64)) {
        Ok(_) => (CAIRN_REQUIREMENT_MET, "they run".to_owned()),
        Err(error) => (CAIRN_REQUIREMENT_OPTIONAL, error.to_string()),
    };
    let needed = "compute shaders, for frames that the device makes; else the processor makes them";
    rows.push(row(CAIRN_REQUIREMENT_SHADERS, status, needed, &found));
    rows.extend(ffx::requirements(&amd, &gpu).iter().map(|of_amd| {
        let what = match of_amd.what {
            RequirementKind::Libraries => CAIRN_REQUIREMENT_FSR_LIBRARIES,
            RequirementKind::Provider => CAIRN_REQUIREMENT_FSR_PROVIDER,
            RequirementKind::System => CAIRN_REQUIREMENT_FSR_SYSTEM,
            RequirementKind::Direct3d => CAIRN_REQUIREMENT_FSR_DIRECT3D,
            RequirementKind::ShaderModel => CAIRN_REQUIREMENT_FSR_SHADER_MODEL,
        };
        let status = if of_amd.met { CAIRN_REQUIREMENT_MET } else { CAIRN_REQUIREMENT_OPTIONAL };
        row(what, status, of_amd.needed, &of_amd.found)
    }));
    rows
}

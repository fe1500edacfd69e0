//! The effect of AMD's libraries, or a test double of them, in the folder `CAIRN_FFX_DIR`: they generate the frames half way between two
//! anchors.

use cairn::ffx::bindings::CreateFrameGeneration;
use cairn::ffx::{Effect, Library, LibraryKind, LoadOptions, allow_unsigned_in_host, versions};
use cairn::gpu::windows::Win32::Graphics::Direct3D12::ID3D12Device;
use cairn::gpu::windows::core::Interface;

/// The folder of AMD's libraries, if there is one. A double is not signed by AMD; it is recognised by the text file with
/// its role.
fn folder() -> Option<std::path::PathBuf> {
    let folder = std::env::var_os("CAIRN_FFX_DIR").filter(|folder| !folder.is_empty())?;
    let folder = std::path::PathBuf::from(folder);
    if folder.join(format!("{}.txt", LibraryKind::FrameGeneration.file_name())).is_file() {
        allow_unsigned_in_host();
    }
    Some(folder)
}

/// Allows the library to load a double, which is not signed. To be called before a device draws.
pub fn allow_double() {
    _ = folder();
}

/// Whether AMD's libraries generate the frames half way between anchors of that size.
pub fn generates_frames(size: (u32, u32)) -> bool {
    folder().is_some() && size.0.min(size.1) >= CreateFrameGeneration::SHORTEST_SIDE
}

/// The name of the generator of those frames in a presenter's statistics: AMD's newest provider, or the library's shaders.
pub fn generator_name(size: (u32, u32), device: &ID3D12Device) -> String {
    if !generates_frames(size) {
        return "shader".to_owned();
    }
    let library = Library::load(&LoadOptions::of_host(&cairn::LibrarySearch::for_tools()))
        .expect("CAIRN_FFX_DIR names AMD's libraries");
    let api = library.api(Effect::FrameGeneration).expect("the library of frame generation");
    // SAFETY: a live device.
    let offered = unsafe { versions(api, Effect::FrameGeneration, device.as_raw()) }.expect("a provider");
    format!("fsr {}", offered[0].name)
}

/// Whether the picture is not uniform: most pixels differ from the one before them.
pub fn has_detail(pixels: &[u8]) -> bool {
    let pixels = pixels.as_chunks::<4>().0;
    2 * pixels.windows(2).filter(|pair| pair[0] != pair[1]).count() > pixels.len()
}

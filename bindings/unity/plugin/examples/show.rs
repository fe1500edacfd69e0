//! The tests' stand-in for Unity with the plugin as a DLL, as a project has it. Shows a generated frame of the embedded world in a texture.
//!
//! ```text
//! show PLUGIN PICTURE    loads cairn_unity.dll from the file PLUGIN and writes the texture's content to PICTURE (PPM)
//! ```

#[cfg(windows)]
#[path = "../tests/host/unity.rs"]
#[allow(dead_code, reason = "each program uses its part")]
mod unity;

/// The DLL's functions, under the names by which the stand-in for Unity calls them.
#[cfg(windows)]
mod plugin {
    use std::ffi::{CString, c_void};
    use std::sync::OnceLock;

    use cairn::gpu::windows::Win32::Foundation::{FreeLibrary, HMODULE};
    use cairn::gpu::windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryW};
    use cairn::gpu::windows::core::{PCSTR, PCWSTR};
    use cairn_unity::interfaces::RenderEvent;

    static MODULE: OnceLock<usize> = OnceLock::new();

    /// Loads the DLL.
    pub(crate) fn load(file: &std::path::Path) {
        use std::os::windows::ffi::OsStrExt;
        let path: Vec<u16> = file.as_os_str().encode_wide().chain([0]).collect();
        // SAFETY: a NUL-terminated path of the plugin.
        let module = unsafe { LoadLibraryW(PCWSTR(path.as_ptr())) }.expect("the plugin loads");
        MODULE.set(module.0.expose_provenance()).expect("one plugin");
    }

    /// Unloads the DLL. UnityPluginUnload must have been called before.
    pub(crate) fn unload() {
        // SAFETY: a loaded module; none of its functions is called any more.
        unsafe { FreeLibrary(module()) }.expect("the plugin is unloaded");
    }

    fn module() -> HMODULE {
        HMODULE(std::ptr::with_exposed_provenance_mut(*MODULE.get().expect("the plugin is loaded")))
    }

    /// Address of a function of the DLL. `like` is the same function of this program and gives its type.
    pub(crate) fn function<F: Copy>(name: &str, _like: F) -> F {
        let name = CString::new(name).expect("no NUL");
        // SAFETY: a loaded module and a NUL-terminated name.
        let found = unsafe { GetProcAddress(module(), PCSTR(name.as_ptr().cast())) };
        let found = found.unwrap_or_else(|| panic!("the plugin does not export {}", name.to_string_lossy()));
        assert_eq!(size_of::<F>(), size_of_val(&found));
        // SAFETY: both are function pointers, and the function of that name has this type.
        unsafe { std::mem::transmute_copy(&found) }
    }

    #[allow(non_snake_case, reason = "Unity's name")]
    pub(crate) unsafe fn UnityPluginLoad(registry: *const c_void) {
        type Load = unsafe extern "system" fn(*const c_void);
        // SAFETY: the caller's promise.
        unsafe { function("UnityPluginLoad", cairn_unity::UnityPluginLoad as Load)(registry) }
    }

    #[allow(non_snake_case, reason = "Unity's name")]
    pub(crate) unsafe fn UnityPluginUnload() {
        // SAFETY: the caller's promise.
        unsafe { function("UnityPluginUnload", cairn_unity::UnityPluginUnload as unsafe extern "system" fn())() }
    }

    pub(crate) fn cairn_unity_get_event_function() -> RenderEvent {
        let name = "cairn_unity_get_event_function";
        function(name, cairn_unity::cairn_unity_get_event_function as extern "C" fn() -> RenderEvent)()
    }
}

#[cfg(windows)]
fn main() {
    let words: Vec<std::path::PathBuf> = std::env::args_os().skip(1).map(Into::into).collect();
    let [file, picture] = words.as_slice() else {
        eprintln!("show PLUGIN PICTURE");
        std::process::exit(2);
    };
    plugin::load(file);
    // Calls UnityPluginUnload at the end.
    show::run(picture);
    plugin::unload();
    println!("unloaded");
}

#[cfg(not(windows))]
fn main() {
    eprintln!("show: it needs Windows, or the lab: cargo xtask lab run");
}

#[cfg(windows)]
mod show {
    use std::io::Write;
    use std::path::Path;
    use std::ptr::{null, null_mut};

    use cairn::abi::anchor::cairn_anchor_destroy;
    use cairn::abi::controls::cairn_controls;
    use cairn::abi::device::{cairn_device_create_cpu, cairn_device_destroy};
    use cairn::abi::images::cairn_picture;
    use cairn::abi::presenter::{
        CAIRN_FRAME_GENERATED, cairn_frame, cairn_presenter_create, cairn_presenter_destroy, cairn_presenter_options,
        cairn_presenter_push,
    };
    use cairn::abi::results::{CAIRN_OK, cairn_last_error};
    use cairn::abi::rollout::{
        cairn_rollout_append, cairn_rollout_create, cairn_rollout_destroy, cairn_rollout_get_anchor, cairn_rollout_step,
    };
    use cairn::abi::statistics::{cairn_presenter_get_statistics, cairn_presenter_statistics};
    use cairn::abi::world::{
        cairn_world_destroy, cairn_world_get_info, cairn_world_info, cairn_world_load, cairn_world_options,
    };
    use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
    use cairn::gpu::windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_R8G8B8A8_TYPELESS;
    use cairn::gpu::windows::core::Interface;
    use cairn_unity::{
        cairn_unity_create_device, cairn_unity_get_make_event, cairn_unity_get_show_event, cairn_unity_prepare,
        cairn_unity_state, cairn_unity_view, cairn_unity_view_create, cairn_unity_view_destroy, cairn_unity_view_get,
        cairn_unity_view_set,
    };

    use super::unity::UnityHandle;
    use test_support::c_interface::with_struct_size;
    use test_support::d3d12::textures::{self, TextureDesc};

    /// Nanoseconds between anchors.
    const INTERVAL: u64 = 100_000_000;
    /// Time of the frame halfway between the two anchors. The first anchor is due one interval after it was pushed.
    const HALF_WAY: u64 = INTERVAL * 3 / 2;

    /// Calls a function of the DLL with as many arguments as its type has parameters. Ends the program on failure.
    macro_rules! call {
        ($name:ident as $type:ty, $($argument:expr),*) => {{
            let like: $type = $name;
            let function = super::plugin::function(stringify!($name), like);
            // SAFETY: live handles and objects, structs with their size, and writable outputs.
            let result = unsafe { function($($argument),*) };
            assert_eq!(result, CAIRN_OK, "{}: {}", stringify!($name), message());
        }};
    }

    fn message() -> String {
        let mut text = [0_u8; 2048];
        let mut length = 0;
        let like: unsafe extern "C" fn(_, _, _) -> _ = cairn_last_error;
        let last = super::plugin::function("cairn_last_error", like);
        // SAFETY: the buffer has the stated capacity, and `length` can be written.
        unsafe { last(text.as_mut_ptr().cast::<std::ffi::c_char>(), text.len(), &raw mut length) };
        String::from_utf8_lossy(&text[..length.min(text.len())]).into_owned()
    }

    /// Sky above a meadow.
    fn seed(width: u32, height: u32) -> Vec<u8> {
        let colour = |i: u32| if i / width < height / 2 { [110, 160, 220, 255] } else { [70, 110, 50, 255] };
        (0..width * height).flat_map(colour).collect()
    }

    pub(super) fn run(to: &Path) {
        let unity = UnityHandle::start(8);
        unity.load();
        let mut text = [0_u8; 512];
        let mut length = 0;
        call!(
            cairn_unity_state as unsafe extern "C" fn(_, _, _) -> _,
            text.as_mut_ptr().cast(),
            text.len(),
            &raw mut length
        );

        let (mut frames, mut processor, mut world, mut rollout) = (null_mut(), null_mut(), null_mut(), null_mut());
        call!(cairn_unity_create_device as unsafe extern "C" fn(_) -> _, &raw mut frames);
        call!(cairn_device_create_cpu as unsafe extern "C" fn(_, _) -> _, null(), &raw mut processor);
        let mut options: cairn_world_options =
            with_struct_size(|options: &mut cairn_world_options| &mut options.struct_size);
        options.operating_point = c"stock,pictures:1".as_ptr();
        call!(cairn_world_load as unsafe extern "C" fn(_, _, _) -> _, processor, &raw const options, &raw mut world);
        let mut info: cairn_world_info = with_struct_size(|info: &mut cairn_world_info| &mut info.struct_size);
        call!(cairn_world_get_info as unsafe extern "C" fn(_, _) -> _, world, &raw mut info);
        let size = (info.render_width, info.render_height);
        call!(cairn_rollout_create as unsafe extern "C" fn(_, _, _) -> _, world, null(), &raw mut rollout);
        let pixels = seed(size.0, size.1);
        let mut picture: cairn_picture = with_struct_size(|picture: &mut cairn_picture| &mut picture.struct_size);
        (picture.width, picture.height) = size;
        (picture.pixels, picture.size) = (pixels.as_ptr().cast(), pixels.len() as u64);
        call!(cairn_rollout_append as unsafe extern "C" fn(_, _, _) -> _, rollout, &raw const picture, null_mut());

        let (mut presenter, mut view) = (null_mut(), null_mut::<cairn_unity_view>());
        let mut options: cairn_presenter_options =
            with_struct_size(|o: &mut cairn_presenter_options| &mut o.struct_size);
        (options.multiplier, options.interval_ns) = (2, INTERVAL);
        call!(cairn_presenter_create as unsafe extern "C" fn(_, _) -> _, &raw const options, &raw mut presenter);
        for number in 0..2 {
            if number > 0 {
                let still: cairn_controls = with_struct_size(|still: &mut cairn_controls| &mut still.struct_size);
                call!(cairn_rollout_step as unsafe extern "C" fn(_, _, _) -> _, rollout, &raw const still, null_mut());
            }
            let mut anchor = null_mut();
            call!(cairn_rollout_get_anchor as unsafe extern "C" fn(_, _) -> _, rollout, &raw mut anchor);
            let at = number * INTERVAL;
            call!(cairn_presenter_push as unsafe extern "C" fn(_, _, _, _) -> _, presenter, anchor, null(), at);
            call!(cairn_anchor_destroy as unsafe extern "C" fn(_) -> _, anchor);
        }
        let (width, height, nowhere) = (size.0, size.1, null::<std::ffi::c_char>());
        call!(
            cairn_unity_prepare as unsafe extern "C" fn(_, _, _, _, _, _, _) -> _,
            frames,
            presenter,
            width,
            height,
            0,
            0,
            nowhere
        );
        call!(cairn_unity_view_create as unsafe extern "C" fn(_, _, _) -> _, frames, presenter, &raw mut view);

        let state = D3D12_RESOURCE_STATE_PIXEL_SHADER_RESOURCE;
        let wanted = TextureDesc {
            size,
            format: DXGI_FORMAT_R8G8B8A8_TYPELESS,
            flags: D3D12_RESOURCE_FLAG_ALLOW_RENDER_TARGET,
            state,
            ..TextureDesc::default()
        };
        let target = wanted.create(&unity.device());
        unity.own(&target, state);
        call!(cairn_unity_view_set as unsafe extern "C" fn(_, _, _) -> _, view, HALF_WAY, target.as_raw());
        let [make, show]: [extern "C" fn() -> _; 2] = [cairn_unity_get_make_event, cairn_unity_get_show_event];
        let names = ["cairn_unity_get_make_event", "cairn_unity_get_show_event"];
        let events = [super::plugin::function(names[0], make), super::plugin::function(names[1], show)];
        for event in events {
            unity.event(event(), view.cast());
        }
        unity.end_frame();
        let mut shown = 0;
        let mut frame: cairn_frame = with_struct_size(|frame: &mut cairn_frame| &mut frame.struct_size);
        let room = text.as_mut_ptr().cast::<std::ffi::c_char>();
        call!(
            cairn_unity_view_get as unsafe extern "C" fn(_, _, _, _, _, _) -> _,
            view,
            &raw mut shown,
            &raw mut frame,
            room,
            text.len(),
            &raw mut length
        );
        assert_eq!((shown, frame.source), (1, CAIRN_FRAME_GENERATED), "a frame between two anchors is shown");
        let mut statistics: cairn_presenter_statistics =
            with_struct_size(|s: &mut cairn_presenter_statistics| &mut s.struct_size);
        call!(cairn_presenter_get_statistics as unsafe extern "C" fn(_, _) -> _, presenter, &raw mut statistics);
        // SAFETY: NUL-terminated text.
        let generator = unsafe { std::ffi::CStr::from_ptr(statistics.generator.as_ptr()) };
        println!("generator {}", generator.to_string_lossy());
        let pixels = textures::read(&unity.device(), &unity.queue(), &target, unity.state_of(&target));
        let rgb: Vec<u8> = pixels.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        let mut file = std::fs::File::create(to).expect("a file");
        write!(file, "P6\n{} {}\n255\n", size.0, size.1).and_then(|()| file.write_all(&rgb)).expect("it is written");

        call!(cairn_unity_view_destroy as unsafe extern "C" fn(_) -> _, view);
        call!(cairn_presenter_destroy as unsafe extern "C" fn(_) -> _, presenter);
        call!(cairn_rollout_destroy as unsafe extern "C" fn(_) -> _, rollout);
        call!(cairn_world_destroy as unsafe extern "C" fn(_) -> _, world);
        call!(cairn_device_destroy as unsafe extern "C" fn(_) -> _, processor);
        call!(cairn_device_destroy as unsafe extern "C" fn(_) -> _, frames);
        assert_eq!(unity.take_violations(), Vec::<String>::new());
    }
}

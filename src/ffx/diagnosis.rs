//! Guesses which field made a call fail, as the return code does not say.

use std::any::Any;
use std::borrow::Cow;

use super::bindings::{
    ConfigureDistortion, ConfigureFrameGeneration, CreateBackendDx12, OverrideVersion, ReturnCode, StructId,
};
use super::{Chain, FfxStruct};

/// The field that most likely caused a failure, by its public name, and the suspected fault.
#[derive(Debug, Clone)]
pub(super) struct Diagnosis {
    pub(super) field: &'static str,
    pub(super) why: Cow<'static, str>,
}

impl Diagnosis {
    const fn new(field: &'static str, why: &'static str) -> Self {
        Self { field, why: Cow::Borrowed(why) }
    }

    /// The likely cause of a failed `ffxDestroyContext`, which has no struct.
    pub(super) const OF_DESTROY: Self = Self::new("context", "frames may be under way, or it was ended before");

    /// The likely cause of a call with `chain` that returned `code`.
    pub(super) fn of<Head: FfxStruct>(chain: &Chain<Head>, code: ReturnCode) -> Self {
        let makes_context = chain.ids().any(|id| id == CreateBackendDx12::ID);
        match code {
            ReturnCode::UNKNOWN_STRUCT | ReturnCode::STRUCT_TOO_NEW => {
                let old = [CreateBackendDx12::ID, OverrideVersion::ID];
                let newest = chain.ids().filter(|id| !old.contains(id)).last().unwrap_or(Head::ID);
                Self { field: "provider", why: format!("its release may not know {newest:?}").into() }
            }
            ReturnCode::NO_PROVIDER if chain.ids().any(|id| id == OverrideVersion::ID) => {
                Self::new("version_id", "it was offered before, and now there is no such provider")
            }
            ReturnCode::NO_PROVIDER if makes_context => Self::new("device", "no provider may take it"),
            ReturnCode::NO_PROVIDER => Self::new("provider", "the library of its effect may be missing"),
            ReturnCode::MEMORY => match Head::ID {
                StructId::FRAME_GENERATION => Self::new("display_size", "memory for frames of that size may be short"),
                StructId::UPSCALE => Self::new("max_upscale_size", "memory for frames of that size may be short"),
                _ => Self::new("device", "its memory, or that of the process, may be short"),
            },
            ReturnCode::PARAMETER => Self::of_parameter(chain),
            _ => Self::of_execution(chain, makes_context),
        }
    }

    /// The likely cause of a `PARAMETER` error.
    fn of_parameter<Head: FfxStruct>(chain: &Chain<Head>) -> Self {
        const OTHERWISE: &str = "it, or another of the pictures, may not be what is said of it";
        match Head::ID {
            StructId::FRAME_GENERATION | StructId::UPSCALE => {
                Self::new("flags", "flags, sizes and formats may not fit together")
            }
            StructId::SWAPCHAIN_WRAP => Self::new("swapchain", "it may be of another queue, or of no window"),
            StructId::SWAPCHAIN_NEW | StructId::SWAPCHAIN_FOR_WINDOW => {
                Self::new("description", "sizes, format, buffers and window may not fit together")
            }
            StructId::GET_VERSIONS => Self::new("device", "it may be none of Direct3D 12"),
            StructId::FRAME_GENERATION_CONFIGURE => Self::of_settings(chain.head())
                .or_else(|| {
                    let has_lens = chain.ids().any(|id| id == ConfigureDistortion::ID);
                    has_lens.then_some(Self::new("distortion", OTHERWISE))
                })
                .unwrap_or(Self::new("flags", "its release may not do without a swap chain of AMD's")),
            StructId::FRAME_GENERATION_PREPARE => Self::new("depth", OTHERWISE),
            StructId::FRAME_GENERATION_PREPARE_V2 => Self::new(
                "depth",
                "it, or motion, may not be what is said of it; releases before 2.1 do not know the struct",
            ),
            StructId::FRAME_GENERATION_DISPATCH | StructId::UPSCALE_DISPATCH | StructId::UPSCALE_REACTIVE_MASK => {
                Self::new("color", OTHERWISE)
            }
            StructId::SWAPCHAIN_INTERFACE => {
                Self::new("interface", "its size, format or state may not be that of the buffers")
            }
            StructId::SWAPCHAIN_KEY_VALUE => Self::new("key", "its release may not have the setting"),
            StructId::UPSCALE_RENDER_SIZE => Self::new("mode", "there may be no such mode"),
            StructId::UPSCALE_JITTER_PHASES => Self::new("render_width", "it may be out of range"),
            StructId::UPSCALE_JITTER_OFFSET => Self::new("phases", "there may be no such sequence"),
            _ => Self::new("provider", "it may answer so to what it does not know"),
        }
    }

    /// The likely cause when the arguments were accepted but the work failed.
    fn of_execution<Head: FfxStruct>(chain: &Chain<Head>, makes_context: bool) -> Self {
        match Head::ID {
            StructId::SWAPCHAIN_WRAP => {
                Self::new("swapchain", "somebody may still hold it or one of its buffers, or it is full screen")
            }
            StructId::SWAPCHAIN_NEW | StructId::SWAPCHAIN_FOR_WINDOW => {
                Self::new("window", "it may have a swap chain already, or be gone")
            }
            _ if makes_context => {
                Self::new("device", "it may lack a feature that the provider's shaders use, or memory")
            }
            StructId::FRAME_GENERATION_PREPARE
            | StructId::FRAME_GENERATION_PREPARE_V2
            | StructId::FRAME_GENERATION_DISPATCH
            | StructId::UPSCALE_DISPATCH
            | StructId::UPSCALE_REACTIVE_MASK => {
                Self::new("command_list", "it may be closed, of another type or device, or the device was removed")
            }
            StructId::FRAME_GENERATION_CONFIGURE => {
                Self::of_settings(chain.head()).unwrap_or(Self::new("device", "it may have been removed"))
            }
            StructId::SWAPCHAIN_INTERFACE => Self::new("interface", "it may be gone, or of another device"),
            _ => Self::new("device", "it may have been removed"),
        }
    }

    /// The likely cause among the optional settings: swap chain or HUD-less frame; `None` if neither is set.
    fn of_settings(head: &dyn Any) -> Option<Self> {
        let settings = head.downcast_ref::<ConfigureFrameGeneration>()?;
        if !settings.swapchain.is_null() {
            return Some(Self::new("swapchain", "it may be none of AMD's, or gone"));
        }
        let has_world = !settings.hudless.resource.is_null();
        has_world
            .then_some(Self::new("hudless", "its size, format or state may not be what the generator was made for"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::bindings::*;
    use super::*;

    /// The diagnosed fields of codes 1 to 8.
    fn of<Head: FfxStruct>(chain: &Chain<Head>) -> [&'static str; 8] {
        [1, 2, 3, 4, 5, 6, 7, 8].map(|code| {
            let Diagnosis { field, why } = Diagnosis::of(chain, ReturnCode(code));
            assert!(!why.is_empty());
            field
        })
    }

    fn made<Head: Creates + Default>(asks_for_a_provider: bool) -> Chain<Head> {
        let chain = Chain::new(Head::default());
        let chain = if asks_for_a_provider { chain.with(OverrideVersion::default()) } else { chain };
        chain.with(CreateBackendDx12::default())
    }

    #[test]
    fn every_code_at_every_creation_call_has_a_diagnosis() {
        let [p, d, w] = ["provider", "device", "window"];
        for asks in [false, true] {
            let version = if asks { "version_id" } else { d };
            let generator = of(&made::<CreateFrameGeneration>(asks));
            assert_eq!(generator, [d, p, d, version, "display_size", "flags", p, d]);
            let upscaler = of(&made::<CreateUpscale>(asks));
            assert_eq!(upscaler, [d, p, d, version, "max_upscale_size", "flags", p, d]);
            let wrapped = of(&made::<CreateSwapchainWrap>(asks));
            let s = "swapchain";
            assert_eq!(wrapped, [s, p, s, version, d, s, p, s]);
            for made in [of(&made::<CreateSwapchainNew>(asks)), of(&made::<CreateSwapchainForWindow>(asks))] {
                assert_eq!(made, [w, p, w, version, d, "description", p, w]);
            }
        }
        assert_eq!(Diagnosis::OF_DESTROY.field, "context");
    }

    #[test]
    fn an_unknown_struct_is_the_newest_of_the_chain() {
        let chain = made::<CreateFrameGeneration>(true).with(CreateFrameGenerationHudless::default());
        assert!(Diagnosis::of(&chain, ReturnCode::UNKNOWN_STRUCT).why.contains("FRAME_GENERATION_HUDLESS"));
        let chain = Chain::new(DispatchPrepareV2::default());
        assert!(Diagnosis::of(&chain, ReturnCode::STRUCT_TOO_NEW).why.contains("FRAME_GENERATION_PREPARE_V2"));
    }

    #[test]
    fn every_code_at_every_other_call_has_a_diagnosis() {
        let [p, d, list] = ["provider", "device", "command_list"];
        let expected = |value, work| [work, p, work, p, d, value, p, work];
        assert_eq!(of(&Chain::new(QueryVersions::default())), expected(d, d));
        assert_eq!(of(&Chain::new(QueryProviderVersion::default())), expected(p, d));
        assert_eq!(of(&Chain::new(DispatchPrepare::default())), expected("depth", list));
        assert_eq!(of(&Chain::new(DispatchPrepareV2::default())), expected("depth", list));
        assert_eq!(of(&Chain::new(DispatchFrameGeneration::default())), expected("color", list));
        assert_eq!(of(&Chain::new(DispatchUpscale::default())), expected("color", list));
        assert_eq!(of(&Chain::new(DispatchReactiveMask::default())), expected("color", list));
        assert_eq!(of(&Chain::new(ConfigureFrameGeneration::default())), expected("flags", d));
        let swapchain = 0x10 as *mut std::ffi::c_void;
        let presented = Chain::new(ConfigureFrameGeneration { swapchain, ..Default::default() });
        assert_eq!(of(&presented), expected("swapchain", "swapchain"));
        assert_eq!(of(&Chain::new(ConfigureInterface::default())), expected("interface", "interface"));
        assert_eq!(of(&Chain::new(ConfigureSwapchainKeyValue::default())), expected("key", d));
        assert_eq!(of(&Chain::new(DispatchWait::default())), expected(p, d));
    }
}

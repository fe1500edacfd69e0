//! Preparation of a renderer, and the choice among AMD's libraries, the shaders and the CPU.

use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_UNKNOWN;

use super::{
    CpuPath, CpuRenderer, PipelineCallbacks, Preference, PrepareOptions, Prepared, RenderPath, RendererOptions,
};
use crate::ffx;
use crate::gpu::Gpu;
use crate::gpu::compute::picture_formats::PictureFormat;
use crate::present::device::{DeviceDrawer, LISTS, Preparation};
use crate::present::presenter::Presenter;
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// Arguments of a preparation.
pub(super) struct PrepareRequest<'a, 'b> {
    pub(super) preferences: &'a RendererOptions,
    pub(super) presenter: &'a Presenter,
    pub(super) gpu: &'a Gpu,
    pub(super) options: &'a PrepareOptions,
    pub(super) amd: &'a mut Amd,
    pub(super) pipelines: PipelineCallbacks<'b>,
}

impl PrepareRequest<'_, '_> {
    /// Creates the resources; `None` if the size of the anchors is unknown.
    pub(super) fn prepare(&mut self) -> Result<Option<Prepared>> {
        let Self { preferences, presenter, gpu, options, .. } = *self;
        let Some(anchors) = options.anchor_size.or_else(|| presenter.anchor_size()) else { return Ok(None) };
        let size = options.size.or_else(|| presenter.custom_size()).unwrap_or(anchors);
        let pixel_bytes = match options.format {
            DXGI_FORMAT_UNKNOWN => 8,
            format => PictureFormat::of(format).map(|format| format.bytes).ok_or_else(|| {
                let cause = format!("frames are not written in DXGI_FORMAT {}", format.0);
                Error::new(ErrorKind::InvalidArgument, cause)
                    .field("preparation.format")
                    .remedy("Use RGBA8, BGRA8, RGB10A2, R11G11B10F or RGBA16F")
            })?,
        };
        let PrepareOptions { lists, pictures, latent, .. } = *options;
        let preparation = Preparation { size, pixel_bytes, lists, pictures: pictures.max(1), latent };
        if let Some(load) = &mut self.pipelines.load
            && gpu.pipelines().take_first_request()
            && let Some(bytes) = load()
            && !gpu.pipelines().load(gpu, &bytes)
        {
            log::info!("pipelines are made anew: those that were loaded are damaged, or of another driver or version");
        }
        let mut unused = UnusedReasons::default();
        let is_required = [preferences.fsr, preferences.shader, preferences.upscaler].contains(&Preference::Require);
        let drawer = match preferences.shader {
            Preference::Never => Err("shader: it is not to be used, and fsr cannot be without it".to_owned()),
            _ => match self.drawer(&mut unused, anchors, &preparation) {
                Ok(drawer) => Ok(drawer),
                Err(error)
                    if is_required || [ErrorKind::DeviceRemoved, ErrorKind::OutOfMemory].contains(&error.kind()) =>
                {
                    return Err(error);
                }
                Err(error) => Err(format!("shader: {error}")),
            },
        };
        let path = match drawer {
            Ok(drawer) => RenderPath::Shaders(Box::new(drawer)),
            Err(reason) => {
                let mut renderer = CpuRenderer::new(gpu)?;
                // Submitted frames need slots as well.
                renderer.uploads.prepare(lists.max(LISTS), size, pixel_bytes)?;
                RenderPath::Cpu(Box::new(CpuPath { renderer, size, pixel_bytes, reason }))
            }
        };
        if let Some(store) = &mut self.pipelines.store
            && let Some(bytes) = gpu.pipelines().serialised(gpu)
        {
            store(&bytes);
        }
        Ok(Some(Prepared { gpu: gpu.clone(), path, unused }))
    }

    /// Creates a drawer with shaders, and with AMD's generator and upscaler if they can be used.
    fn drawer(
        &mut self,
        unused: &mut UnusedReasons,
        anchors: (u32, u32),
        preparation: &Preparation,
    ) -> Result<DeviceDrawer> {
        let mut drawer = DeviceDrawer::new(self.gpu, anchors, self.preferences.colours)?;
        unused.fsr = self.use_fsr(&mut drawer)?;
        unused.upscaler = self.use_upscaler(&mut drawer)?;
        self.presenter.prepare(&mut drawer, preparation)?;
        Ok(drawer)
    }

    /// Sets AMD's generator; returns why it cannot be used, or an empty text.
    fn use_fsr(&mut self, drawer: &mut DeviceDrawer) -> Result<String> {
        let is_required = match self.preferences.fsr {
            Preference::Never => return Ok("fsr: it is not to be used".to_owned()),
            preference => preference == Preference::Require,
        };
        let api = self.amd.api(ffx::Effect::FrameGeneration);
        match api.and_then(|api| drawer.use_fsr(&api, ffx::Choice::Any, is_required)) {
            Ok(()) => Ok(String::new()),
            Err(error) if is_required || error.kind() == ErrorKind::DeviceRemoved => Err(error),
            Err(error) => Ok(format!("fsr: {error}")),
        }
    }

    /// Sets AMD's upscaler; returns why it cannot be used, or an empty text.
    fn use_upscaler(&mut self, drawer: &mut DeviceDrawer) -> Result<String> {
        let is_required = match self.preferences.upscaler {
            Preference::Never => return Ok("fsr: it is not to be used".to_owned()),
            preference => preference == Preference::Require,
        };
        match self.amd.api(ffx::Effect::Upscaling) {
            Ok(api) => {
                drawer.use_fsr_upscaler(&api, ffx::Choice::Any, is_required);
                Ok(String::new())
            }
            Err(error) if is_required => Err(error),
            Err(error) => Ok(format!("fsr: {error}")),
        }
    }
}

/// AMD's libraries, loaded on first use.
#[derive(Default)]
pub(super) struct Amd {
    search: LibrarySearch,
    library: Option<ffx::Library>,
}

impl Amd {
    /// Sets where to search; libraries found by another search are released.
    pub(super) fn set_search(&mut self, search: &LibrarySearch) {
        if self.search != *search {
            *self = Self { search: search.clone(), library: None };
        }
    }

    /// AMD's functions for an effect.
    fn api(&mut self, effect: ffx::Effect) -> Result<ffx::Api> {
        let library = match &mut self.library {
            Some(library) => library,
            none => none.insert(ffx::Library::load(&ffx::LoadOptions::of_host(&self.search))?),
        };
        library.api(effect).copied()
    }
}

/// Why AMD's generator and upscaler are not used; empty if they are.
#[derive(Default)]
pub(super) struct UnusedReasons {
    pub(super) fsr: String,
    pub(super) upscaler: String,
}

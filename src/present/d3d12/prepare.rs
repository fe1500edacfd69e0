//! Preparation of a renderer, and the choice among AMD's libraries, the shaders and the CPU.

use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT_UNKNOWN;

use super::{MadeBy, OnProcessor, PipelineCallbacks, Preference, PrepareOptions, Prepared, RendererOptions, Upload};
use crate::ffx;
use crate::gpu::Gpu;
use crate::gpu::compute::pictures::Format;
use crate::present::device::{DeviceDrawer, LISTS, Preparation};
use crate::present::presenter::Presenter;
use crate::{Error, ErrorKind, LibrarySearch, Result};

/// Arguments of a preparation.
pub(super) struct Request<'a, 'b> {
    pub(super) renderer: &'a RendererOptions,
    pub(super) presenter: &'a Presenter,
    pub(super) gpu: &'a Gpu,
    pub(super) options: &'a PrepareOptions,
    pub(super) amd: &'a mut Amd,
    pub(super) pipelines: PipelineCallbacks<'b>,
}

impl Request<'_, '_> {
    pub(super) fn prepare(&mut self) -> Result<Option<Prepared>> {
        let Self { renderer, presenter, gpu, options, .. } = *self;
        let Some(anchors) = options.anchor_size.or_else(|| presenter.anchor_size()) else { return Ok(None) };
        let size = options.size.or_else(|| presenter.wanted_size()).unwrap_or(anchors);
        let pixel_bytes = match options.format {
            DXGI_FORMAT_UNKNOWN => 8,
            format => Format::of(format).map(|format| format.bytes).ok_or_else(|| {
                let why = format!("frames are not written in DXGI_FORMAT {}", format.0);
                Error::new(ErrorKind::InvalidArgument, why)
                    .field("preparation.format")
                    .remedy("Use RGBA8, BGRA8, RGB10A2 or RGBA16F")
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
        let mut without = Without::default();
        let is_required = [renderer.fsr, renderer.shader, renderer.upscaler].contains(&Preference::Require);
        let drawer = match renderer.shader {
            Preference::Never => Err("shader: it is not to be used, and fsr cannot be without it".to_owned()),
            _ => match self.drawer(&mut without, anchors, &preparation) {
                Ok(drawer) => Ok(drawer),
                Err(why) if is_required || [ErrorKind::DeviceRemoved, ErrorKind::OutOfMemory].contains(&why.kind()) => {
                    return Err(why);
                }
                Err(why) => Err(format!("shader: {why}")),
            },
        };
        let made_by = match drawer {
            Ok(drawer) => MadeBy::Shaders(Box::new(drawer)),
            Err(why) => {
                let mut upload = Upload::new(gpu)?;
                // Submitted frames need slots as well.
                upload.uploads.prepare(lists.max(LISTS), size, pixel_bytes)?;
                MadeBy::Processor(Box::new(OnProcessor { upload, size, pixel_bytes, why }))
            }
        };
        if let Some(store) = &mut self.pipelines.store
            && let Some(bytes) = gpu.pipelines().serialised(gpu)
        {
            store(&bytes);
        }
        Ok(Some(Prepared { gpu: gpu.clone(), made_by, without }))
    }

    /// Creates a drawer with shaders, and with AMD's generator and upscaler if they can be used.
    fn drawer(&mut self, without: &mut Without, anchors: (u32, u32), wanted: &Preparation) -> Result<DeviceDrawer> {
        let mut drawer = DeviceDrawer::new(self.gpu, anchors, self.renderer.colours)?;
        without.fsr = self.use_fsr(&mut drawer)?;
        without.upscaler = self.use_upscaler(&mut drawer)?;
        drawer.prepare(self.presenter, wanted)?;
        Ok(drawer)
    }

    /// Sets AMD's generator; returns why it cannot be used, or an empty text.
    fn use_fsr(&mut self, drawer: &mut DeviceDrawer) -> Result<String> {
        let is_required = match self.renderer.fsr {
            Preference::Never => return Ok("fsr: it is not to be used".to_owned()),
            preference => preference == Preference::Require,
        };
        let api = self.amd.api(ffx::Effect::FrameGeneration);
        match api.and_then(|api| drawer.use_fsr(&api, ffx::Choice::Any, is_required)) {
            Ok(()) => Ok(String::new()),
            Err(why) if is_required || why.kind() == ErrorKind::DeviceRemoved => Err(why),
            Err(why) => Ok(format!("fsr: {why}")),
        }
    }

    /// Sets AMD's upscaler; returns why it cannot be used, or an empty text.
    fn use_upscaler(&mut self, drawer: &mut DeviceDrawer) -> Result<String> {
        let is_required = match self.renderer.upscaler {
            Preference::Never => return Ok("fsr: it is not to be used".to_owned()),
            preference => preference == Preference::Require,
        };
        match self.amd.api(ffx::Effect::Upscaling) {
            Ok(api) => {
                drawer.use_fsr_upscaler(&api, ffx::Choice::Any, is_required);
                Ok(String::new())
            }
            Err(why) if is_required => Err(why),
            Err(why) => Ok(format!("fsr: {why}")),
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
pub(super) struct Without {
    pub(super) fsr: String,
    pub(super) upscaler: String,
}

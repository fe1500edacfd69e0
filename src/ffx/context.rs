//! A context: one effect of one provider, on one device.

use std::ffi::{CStr, c_void};
use std::mem::ManuallyDrop;
use std::ptr::null_mut;

use super::api::Failure;
use super::bindings::{
    ConfigureGlobalDebug, ConfigureGlobalDebug1, CreateBackendDx12, Creates, OverrideVersion, QueryProviderVersion,
    RawContext,
};
use super::provider::{Choice, Dialect, Version, choose, effect_name, names_of, unavailable, versions_of};
use super::{Api, Chain, Effect, Extends, FfxStruct, message};
use crate::{Error, ErrorKind, Result};

/// The provider of a context, and how that is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provider {
    /// Its version.
    pub version: Version,
    /// The context itself reported it. SDK 1.1.3 and earlier cannot; `version` is then the requested one.
    pub verified: bool,
    /// The structs that it accepts.
    pub dialect: Dialect,
    /// All available providers, newest first.
    pub offered: Vec<Version>,
}

/// An ffx-api context and its creation chain, which the provider may read as long as the context lives.
///
/// Threads: may be sent to another thread between calls; one call at a time.
pub struct Context<Head: Creates> {
    api: Api,
    raw: RawContext,
    chain: ManuallyDrop<Chain<Head>>,
    provider: Provider,
}

// SAFETY: ffx-api ties no context to a thread, and allows one call at a time, which `&mut` ensures. The chain points to a device,
// which is free-threaded.
unsafe impl<Head: Creates> Send for Context<Head> {}

impl<Head: Creates> Context<Head> {
    /// Creates a context on `device` with the provider that `choice` selects, and asks it for its provider: drivers may substitute
    /// a newer one for the library's. `extend` appends further links behind `head`.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for input that no provider accepts; `Unsupported` when there is no provider, or none of a
    /// required family; else the library's own errors.
    ///
    /// # Safety
    /// `device` is a live `ID3D12Device` and outlives the context; the chain's pointers are valid, as its fields describe.
    pub unsafe fn create(
        api: &Api,
        device: *mut c_void,
        choice: Choice,
        head: Head,
        extend: impl Fn(Chain<Head>) -> Chain<Head>,
    ) -> Result<Self> {
        let effect = Effect::of(Head::ID).unwrap_or(Effect::FrameGeneration);
        if let Some((field, why)) = Head::fault(&extend(Chain::new(head))) {
            return Err(Error::new(ErrorKind::InvalidArgument, why).field(field));
        }
        // SAFETY: the caller's promise about the device.
        let offered = unsafe { versions_of(api, Head::ID, device) }?;
        let wanted = choose(&offered, choice, effect)?;
        if let (Choice::Prefer(family), None) = (choice, wanted) {
            let what = effect_name(Head::ID);
            log::warn!(target: "cairn::ffx", "no provider of {what} is {family:?}; there is {}", names_of(&offered));
        }
        let expected = wanted.unwrap_or(&offered[0]).clone();
        let chain = |dialect| {
            let mut chain = extend(Chain::new(head));
            if dialect == Dialect::Sdk21 {
                chain = chain.with(Head::Version::from(Head::WRITTEN_FOR));
            }
            if let Some(version) = wanted {
                chain = chain.with(OverrideVersion { version_id: version.id, ..Default::default() });
            }
            chain.with(CreateBackendDx12 { device, ..Default::default() })
        };
        register_message_callback(api, null_mut(), effect);
        let mut dialect = expected.dialect(effect);
        let mut links = chain(dialect);
        // SAFETY: the chain lives as long as the context; its pointers are as the caller promises.
        let mut made = unsafe { api.create(&mut links) };
        if dialect == Dialect::Sdk21 && made.as_ref().is_err_and(Failure::is_unknown_struct) {
            dialect = Dialect::Sdk11;
            links = chain(dialect);
            // SAFETY: as above.
            made = unsafe { api.create(&mut links) };
        }
        let raw = made.map_err(|failure| failure.error())?;
        crate::object_count::count_object();
        let provider = Provider { version: expected, verified: false, dialect, offered: Vec::new() };
        let mut context = Self { api: *api, raw, chain: ManuallyDrop::new(links), provider };
        register_message_callback(api, raw, effect);
        context.query_provider(effect, dialect)?;
        if let Choice::Require(family) = choice
            && context.provider.version.family() != Some(family)
        {
            return Err(unavailable(family, effect, &format!("{} in its place", context.provider.version)));
        }
        context.provider.offered = offered;
        log::info!(target: "cairn::ffx", "{}: {}", effect_name(Head::ID), context.provider.version);
        Ok(context)
    }

    /// Queries the context's provider.
    fn query_provider(&mut self, effect: Effect, creation_dialect: Dialect) -> Result<()> {
        let mut query = Chain::new(QueryProviderVersion::default());
        // SAFETY: our own context; the answer is written into the chain.
        match unsafe { self.api.query(self.raw, &mut query) } {
            Ok(()) => {
                let QueryProviderVersion { version_id, version_name, .. } = *query.head();
                if version_id == 0 {
                    return Err(Error::new(ErrorKind::Device, "a context says that it has no provider"));
                }
                let name = if version_name.is_null() {
                    String::new()
                } else {
                    // SAFETY: a string that the library keeps until the next call.
                    unsafe { CStr::from_ptr(version_name) }.to_string_lossy().into_owned()
                };
                let version = Version { id: version_id, name };
                // A provider that rejected the structs of SDK 2.1 does not accept them, whatever its name.
                let dialect =
                    if creation_dialect == Dialect::Sdk11 && self.provider.version.dialect(effect) == Dialect::Sdk21 {
                        Dialect::Sdk11
                    } else {
                        version.dialect(effect)
                    };
                self.provider = Provider { version, verified: true, dialect, offered: Vec::new() };
            }
            Err(failure) => log::debug!(target: "cairn::ffx", "a context does not say what it is: {failure}"),
        }
        Ok(())
    }

    /// The provider in use.
    pub fn provider(&self) -> &Provider {
        &self.provider
    }

    /// The struct it was created with.
    pub fn creation(&self) -> &Head {
        self.chain.head()
    }

    /// A link of the creation chain, behind [`Self::creation`].
    pub fn creation_link<T: Extends<Head>>(&self) -> Option<&T> {
        self.chain.link()
    }

    /// The library's handle of the context.
    #[cfg(windows)]
    pub(super) fn raw(&self) -> RawContext {
        self.raw
    }

    /// The library's functions.
    #[cfg(windows)]
    pub(super) fn api(&self) -> &Api {
        &self.api
    }

    /// Calls `ffxConfigure` with the chain.
    ///
    /// # Errors
    /// The library's own errors.
    ///
    /// # Safety
    /// The chain's pointers are valid, as its fields describe.
    pub unsafe fn configure<T: FfxStruct>(&mut self, chain: &mut Chain<T>) -> Result<()> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.configure(self.raw, chain) }.map_err(|failure| failure.error())
    }

    /// Calls `ffxQuery`; the answers are written into the chain's structs or where they point.
    ///
    /// # Errors
    /// The library's own errors.
    ///
    /// # Safety
    /// As [`Self::configure`].
    pub unsafe fn query<T: FfxStruct>(&mut self, chain: &mut Chain<T>) -> Result<()> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.query(self.raw, chain) }.map_err(|failure| failure.error())
    }

    /// As [`Self::query`], but returns the library's failure unconverted.
    ///
    /// # Safety
    /// As [`Self::query`].
    pub(super) unsafe fn try_query<T: FfxStruct>(&mut self, chain: &mut Chain<T>) -> Result<(), Failure> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.query(self.raw, chain) }
    }

    /// Calls `ffxDispatch`, which records work into the command list that the chain names.
    ///
    /// # Errors
    /// The library's own errors; the list may then hold part of the work.
    ///
    /// # Safety
    /// As [`Self::configure`]; the list is open, and it, its resources and this context live until it has run.
    pub unsafe fn dispatch<T: FfxStruct>(&mut self, chain: &mut Chain<T>) -> Result<()> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.dispatch(self.raw, chain) }.map_err(|failure| failure.error())
    }
}

impl<Head: Creates> Drop for Context<Head> {
    fn drop(&mut self) {
        // SAFETY: our own context, used for the last time; by the contract of `dispatch` the device no longer uses it.
        if let Err(failure) = unsafe { self.api.destroy(self.raw) } {
            log::error!(target: "cairn::ffx", "a context is lost, with its memory: {failure}");
            return;
        }
        // SAFETY: dropped once, here. A context that is lost keeps it.
        unsafe { ManuallyDrop::drop(&mut self.chain) };
    }
}

impl<Head: Creates> std::fmt::Debug for Context<Head> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Context({:?}, {})", Head::ID, self.provider.version)
    }
}

/// Registers the message callback, with the struct of SDK 2.3 or else the earlier one. A library that accepts neither sends no
/// messages, which is not an error: that of SDK 2.0 accepts none before there is a context.
fn register_message_callback(api: &Api, context: RawContext, effect: Effect) {
    /// Errors and warnings.
    const LEVEL: u32 = 2;
    let message = Some(message::receive as _);
    let effect = effect.create().effect();
    let mut one = Chain::new(ConfigureGlobalDebug { effect, message, level: LEVEL, ..Default::default() });
    // SAFETY: null or a live context; the callback is a static function of this library.
    if unsafe { api.configure(context, &mut one) }.is_ok() {
        return;
    }
    let mut all = Chain::new(ConfigureGlobalDebug1 { message, level: LEVEL, ..Default::default() });
    // SAFETY: as above.
    if let Err(failure) = unsafe { api.configure(context, &mut all) } {
        log::debug!(target: "cairn::ffx", "a library keeps its messages: {failure}");
    }
}

#[cfg(test)]
mod tests;

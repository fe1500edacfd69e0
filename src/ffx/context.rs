//! A context: one effect of one provider, on one device.

use std::ffi::{CStr, c_void};
use std::ptr::null_mut;

use super::api::Failure;
use super::bindings::{
    ConfigureGlobalDebug, ConfigureGlobalDebug1, CreateBackendDx12, Creates, OverrideVersion, QueryProviderVersion,
    RawContext,
};
use super::provider::{Choice, Dialect, Version, called, choose, listed, unavailable, versions_of};
use super::{Api, Chain, Described, Effect, Extends, message};
use crate::{Error, ErrorKind, Result};

/// What runs, and how that is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provider {
    /// What runs.
    pub version: Version,
    /// The context itself said so; SDK 1.1.3 and earlier cannot, and then it is what was asked for.
    pub verified: bool,
    /// The structs it understands.
    pub dialect: Dialect,
    /// All that could be chosen from, the newest first.
    pub offered: Vec<Version>,
}

/// A context, with the chain that it was made with, which its provider may read while it lives.
///
/// Threads: may be sent to another thread between calls; calls take turns.
pub struct Context<Head: Creates> {
    api: Api,
    raw: RawContext,
    chain: Chain<Head>,
    provider: Provider,
}

// SAFETY: ffx-api ties no context to a thread, and asks for one call at a time, which `&mut` gives. What the chain points to is
// a device, which is free-threaded.
unsafe impl<Head: Creates> Send for Context<Head> {}

impl<Head: Creates> Context<Head> {
    /// Makes a context on `device` of the provider that `choice` says, and asks it which it is: drivers put a newer one in the
    /// place of what a library holds. `extend` appends what is to stand in the chain behind `head`.
    ///
    /// # Errors
    /// `InvalidArgument` with the field for what no provider takes; `Unsupported` when there is no provider, or not of a family
    /// that is required; else what the library answers.
    ///
    /// # Safety
    /// `device` is a live `ID3D12Device` and outlives the context; what the chain points to is what its fields say.
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
        let wanted = choose(&offered, choice)?;
        if let (Choice::Prefer(family), None) = (choice, wanted) {
            let what = called(Head::ID);
            log::warn!(target: "cairn::ffx", "no provider of {what} is {family:?}; there is {}", listed(&offered));
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
        listen(api, null_mut(), effect);
        let mut dialect = expected.dialect(effect);
        let mut links = chain(dialect);
        // SAFETY: the chain stays with the context, and the caller's promises about what it points to.
        let mut made = unsafe { api.create(&mut links) };
        if dialect == Dialect::Sdk21 && made.as_ref().is_err_and(Failure::is_unknown_struct) {
            dialect = Dialect::Sdk11;
            links = chain(dialect);
            // SAFETY: as above.
            made = unsafe { api.create(&mut links) };
        }
        let raw = made.map_err(|failure| failure.error())?;
        #[cfg(windows)]
        crate::gpu::count_object();
        let provider = Provider { version: expected, verified: false, dialect, offered: Vec::new() };
        let mut context = Self { api: *api, raw, chain: links, provider };
        listen(api, raw, effect);
        context.verify(effect, dialect)?;
        if let Choice::Require(family) = choice
            && context.provider.version.family() != Some(family)
        {
            return Err(unavailable(family, &format!("{} in its place", context.provider.version)));
        }
        context.provider.offered = offered;
        log::info!(target: "cairn::ffx", "{}: {}", called(Head::ID), context.provider.version);
        Ok(context)
    }

    /// Asks the context which provider it has.
    fn verify(&mut self, effect: Effect, made_with: Dialect) -> Result<()> {
        let mut query = Chain::new(QueryProviderVersion::default());
        // SAFETY: our own context, and an answer that is written into the chain.
        match unsafe { self.api.query(self.raw, &mut query) } {
            Ok(()) => {
                let QueryProviderVersion { version_id, version_name, .. } = *query.head();
                if version_id == 0 {
                    return Err(Error::new(ErrorKind::Device, "a context says that it has no provider"));
                }
                let name = if version_name.is_null() {
                    String::new()
                } else {
                    // SAFETY: a name that the library keeps until the next call.
                    unsafe { CStr::from_ptr(version_name) }.to_string_lossy().into_owned()
                };
                let version = Version { id: version_id, name };
                // What refused the structs of 2.1 does not know them, whatever it is called.
                let dialect = if made_with == Dialect::Sdk11 && self.provider.version.dialect(effect) == Dialect::Sdk21
                {
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

    /// What runs.
    pub fn provider(&self) -> &Provider {
        &self.provider
    }

    /// What it was made with.
    pub fn made_with(&self) -> &Head {
        self.chain.head()
    }

    /// A link that it was made with, behind [`Self::made_with`].
    pub fn made_with_link<T: Extends<Head>>(&self) -> Option<&T> {
        self.chain.link()
    }

    /// What the library calls it.
    #[cfg(windows)]
    pub(super) fn raw(&self) -> RawContext {
        self.raw
    }

    /// Whose it is.
    #[cfg(windows)]
    pub(super) fn api(&self) -> &Api {
        &self.api
    }

    /// Sets what the chain says.
    ///
    /// # Errors
    /// What the library answers.
    ///
    /// # Safety
    /// What the chain points to is what its fields say.
    pub unsafe fn configure<T: Described>(&mut self, chain: &mut Chain<T>) -> Result<()> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.configure(self.raw, chain) }.map_err(|failure| failure.error())
    }

    /// Asks; answers are written where the chain's fields point to, or into them.
    ///
    /// # Errors
    /// What the library answers.
    ///
    /// # Safety
    /// As of [`Self::configure`].
    pub unsafe fn query<T: Described>(&mut self, chain: &mut Chain<T>) -> Result<()> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.query(self.raw, chain) }.map_err(|failure| failure.error())
    }

    /// As [`Self::query`], with what went wrong as it was answered.
    ///
    /// # Safety
    /// As of [`Self::query`].
    pub(super) unsafe fn ask<T: Described>(&mut self, chain: &mut Chain<T>) -> Result<(), Failure> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.query(self.raw, chain) }
    }

    /// Records work into the command list that the chain names.
    ///
    /// # Errors
    /// What the library answers; the list may then hold a part of the work.
    ///
    /// # Safety
    /// As of [`Self::configure`]; the list is open, and it, its resources and this context live until it has run.
    pub unsafe fn dispatch<T: Described>(&mut self, chain: &mut Chain<T>) -> Result<()> {
        // SAFETY: our own context, and the caller's promise.
        unsafe { self.api.dispatch(self.raw, chain) }.map_err(|failure| failure.error())
    }
}

impl<Head: Creates> Drop for Context<Head> {
    fn drop(&mut self) {
        // SAFETY: our own context, used for the last time; that nothing on the device uses it, `dispatch` had promised.
        if let Err(failure) = unsafe { self.api.destroy(self.raw) } {
            log::error!(target: "cairn::ffx", "a context is lost: {failure}");
        }
    }
}

impl<Head: Creates> std::fmt::Debug for Context<Head> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Context({:?}, {})", Head::ID, self.provider.version)
    }
}

/// Has messages sent to our log, by the struct of SDK 2.1 or else the earlier one. A library that takes neither stays silent,
/// which is no failure: that of SDK 2.0 takes none before there is a context.
fn listen(api: &Api, context: RawContext, effect: Effect) {
    /// Errors and warnings.
    const LEVEL: u32 = 2;
    let message = Some(message::receive as _);
    let effect = effect.create().effect();
    let mut one = Chain::new(ConfigureGlobalDebug { effect, message, level: LEVEL, ..Default::default() });
    // SAFETY: null or a live context; the callback is of this library, which stays.
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

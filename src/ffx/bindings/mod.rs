//! The structs of ffx-api, written by hand from its published layout for x64; sizes and offsets are checked by the compiler, field
//! by field. They hold pointers and numbers only, so they are the same on every 64-bit system.
//!
//! "SDK 1.1.2 and later" in a struct's doc comment is the SDK release that introduced it: providers of earlier releases do not know
//! it.

mod enums;
mod formats;
mod frame_generation;
mod general;
mod swapchain;
mod upscale;

use super::{Chain, Extends, FfxStruct};

pub use enums::*;
pub use formats::*;
pub use frame_generation::*;
pub use general::*;
pub use swapchain::*;
pub use upscale::*;

/// Defines a struct of the interface: each field with its offset, size and type, which the compiler checks.
macro_rules! plain {
    ($(#[$doc:meta])* $name:ident, $size:literal align $align:literal: {
        $( $(#[$about:meta])* $offset:literal $length:literal $field:ident: $type:ty, )*
    }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, Default)]
        pub struct $name {
            $( $(#[$about])* pub $field: $type, )*
        }

        const _: () = {
            assert!(size_of::<$name>() == $size && align_of::<$name>() == $align);
            $( assert!(std::mem::offset_of!($name, $field) == $offset && size_of::<$type>() == $length); )*
        };
    };
}

/// Defines a struct that starts with a header: its id, and the structs that it may follow in a chain.
macro_rules! ffx_struct {
    ($(#[$doc:meta])* $name:ident = $id:ident $(extends [$($head:ty),*])?, $size:literal: {
        $( $(#[$about:meta])* $offset:literal $length:literal $field:ident: $type:ty, )*
    }) => {
        $crate::ffx::bindings::plain! {
            $(#[$doc])*
            $name, $size align 8: {
                /// Id and next struct, written by the chain.
                0 16 header: $crate::ffx::Header,
                $( $(#[$about])* $offset $length $field: $type, )*
            }
        }

        // SAFETY: the layout, header first, is checked above.
        unsafe impl $crate::ffx::FfxStruct for $name {
            const ID: $crate::ffx::bindings::StructId = $crate::ffx::bindings::StructId::$id;
        }
        $($( impl $crate::ffx::Extends<$head> for $name {} )*)?
    };
}

pub(crate) use {ffx_struct, plain};

/// A struct that heads the creation chain of `ffxCreateContext`.
pub trait Creates: FfxStruct + Copy {
    /// The struct that states the host's release to providers of SDK 2.1 or later.
    type Version: Extends<Self> + From<u32>;
    /// The oldest release with everything used here, in the numbering of its headers.
    const WRITTEN_FOR: u32;

    /// A field value that no provider accepts, with the reason: some providers fail without a message, or crash.
    fn fault(_chain: &Chain<Self>) -> Option<(&'static str, &'static str)> {
        None
    }
}

impl<Head: Creates> Extends<Head> for CreateBackendDx12 {}
impl<Head: Creates> Extends<Head> for OverrideVersion {}

/// Named constants of an open set: later releases may add others, so any number is valid.
macro_rules! open_set {
    ($(#[$doc:meta])* $name:ident: $number:ty { $( $(#[$about:meta])* $word:ident = $value:expr, )* }) => {
        $(#[$doc])*
        #[repr(transparent)]
        #[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub $number);

        impl $name {
            $( $(#[$about])* pub const $word: Self = Self($value); )*

            /// The constant's name; None for an unknown number.
            pub fn name(self) -> Option<&'static str> {
                [$( (Self::$word, stringify!($word)) ),*].into_iter().find(|(known, _)| *known == self).map(|(_, name)| name)
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match self.name() {
                    Some(name) => f.write_str(name),
                    None => write!(f, "{:#x}", self.0),
                }
            }
        }
    };
}

pub(crate) use open_set;

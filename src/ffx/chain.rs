//! ffx-api's linked structs, as chains that own all of their links.

use std::fmt;
use std::marker::PhantomData;
use std::ptr::{NonNull, null_mut};

use super::bindings::StructId;

/// The header of every ffx-api struct: its id and the next struct. Only a [`Chain`] writes it.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Header {
    id: StructId,
    next: *mut Header,
}

const _: () = {
    assert!(size_of::<Header>() == 16 && align_of::<Header>() == 8);
    assert!(std::mem::offset_of!(Header, id) == 0 && std::mem::offset_of!(Header, next) == 8);
};

impl Default for Header {
    fn default() -> Self {
        Self { id: StructId(0), next: null_mut() }
    }
}

impl Header {
    /// The id of the struct.
    pub fn id(&self) -> StructId {
        self.id
    }

    /// The next struct, or null.
    pub fn next(&self) -> *const Header {
        self.next
    }
}

/// Prints the id only; the next link's address is of no use to a reader.
impl fmt::Debug for Header {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.id)
    }
}

/// A struct that may be a link of a [`Chain`].
///
/// # Safety
/// It is `repr(C)`, starts with a [`Header`], and has the layout that ffx-api defines for [`Self::ID`].
pub unsafe trait FfxStruct: fmt::Debug + Sized + 'static {
    /// Its ffx-api id.
    const ID: StructId;
}

/// A struct that may follow `Head` in its chain.
pub trait Extends<Head>: FfxStruct {}

/// A struct with the structs that extend it, linked as ffx-api reads them. It owns all links, so none can dangle, and their
/// addresses stay the same while it lives. A chain that is used every frame is created once and changed.
pub struct Chain<Head: FfxStruct> {
    /// The head first.
    links: Vec<Link>,
    head: PhantomData<Head>,
}

/// A leaked box. A raw pointer, as ffx-api reads and writes through its own pointers while the chain lives.
struct Link {
    id: StructId,
    pointer: NonNull<dyn fmt::Debug>,
}

impl Link {
    fn free(self) {
        // SAFETY: `Chain::push` leaked this box, and nothing but this frees it; it takes the link.
        drop(unsafe { Box::from_raw(self.pointer.as_ptr()) });
    }
}

impl<Head: FfxStruct> Chain<Head> {
    /// A chain of `head` alone.
    pub fn new(head: Head) -> Self {
        let mut chain = Self { links: Vec::with_capacity(4), head: PhantomData };
        chain.push(head);
        chain
    }

    /// Appends a link, or replaces the one of the same type.
    #[must_use]
    pub fn with<T: Extends<Head>>(mut self, link: T) -> Self {
        self.set(link);
        self
    }

    /// Appends a link, or replaces the one of its type.
    pub fn set<T: Extends<Head>>(&mut self, link: T) {
        match self.find::<T>() {
            Some(mut pointer) => {
                // SAFETY: a live link of this type, which nobody else refers to while we hold the chain.
                let there = unsafe { pointer.as_mut() };
                *there = link;
            }
            None => self.push(link),
        }
        self.write_headers();
    }

    /// Removes the link of type `T`, if there is one.
    pub fn remove<T: Extends<Head>>(&mut self) {
        if let Some(index) = self.links.iter().skip(1).position(|link| link.id == T::ID) {
            self.links.remove(index + 1).free();
            self.write_headers();
        }
    }

    /// The first struct.
    pub fn head(&self) -> &Head {
        // SAFETY: the first link is a live `Head`, borrowed as the chain is.
        unsafe { self.links[0].pointer.cast().as_ref() }
    }

    /// The first struct, mutable.
    pub fn head_mut(&mut self) -> &mut Head {
        // SAFETY: as in `head`; the chain is borrowed for writing.
        unsafe { self.links[0].pointer.cast().as_mut() }
    }

    /// The link of type `T`.
    pub fn link<T: Extends<Head>>(&self) -> Option<&T> {
        // SAFETY: a live link of this type, borrowed as the chain is.
        self.find::<T>().map(|pointer| unsafe { pointer.as_ref() })
    }

    /// The link of type `T`, mutable.
    pub fn link_mut<T: Extends<Head>>(&mut self) -> Option<&mut T> {
        // SAFETY: a live link of this type; the chain is borrowed for writing.
        self.find::<T>().map(|mut pointer| unsafe { pointer.as_mut() })
    }

    /// The pointer for ffx-api: the first link's header. Valid, with all links set, until the next use of the chain.
    pub fn as_ptr(&mut self) -> *mut Header {
        self.write_headers();
        self.links[0].pointer.as_ptr().cast()
    }

    /// The ids of its links, in order.
    pub(super) fn ids(&self) -> impl Iterator<Item = StructId> {
        self.links.iter().map(|link| link.id)
    }

    fn push<T: FfxStruct>(&mut self, link: T) {
        let link: Box<dyn fmt::Debug> = Box::new(link);
        self.links.push(Link { id: T::ID, pointer: NonNull::from(Box::leak(link)) });
        self.write_headers();
    }

    fn find<T: FfxStruct>(&self) -> Option<NonNull<T>> {
        self.links.iter().find(|link| link.id == T::ID).map(|link| link.pointer.cast())
    }

    /// Rewrites all headers: assigning a whole struct also overwrites its header.
    fn write_headers(&mut self) {
        for (index, link) in self.links.iter().enumerate() {
            let next = self.links.get(index + 1).map_or(null_mut(), |next| next.pointer.as_ptr().cast());
            // SAFETY: every link is live and starts with a header, by the contract of `FfxStruct`.
            unsafe { link.pointer.cast::<Header>().write(Header { id: link.id, next }) };
        }
    }
}

impl<Head: FfxStruct> Drop for Chain<Head> {
    fn drop(&mut self) {
        self.links.drain(..).for_each(Link::free);
    }
}

/// Prints all structs with their fields.
impl<Head: FfxStruct> fmt::Debug for Chain<Head> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, link) in self.links.iter().enumerate() {
            let between = if index == 0 { "" } else { " -> " };
            // SAFETY: a live link, borrowed as the chain is.
            write!(f, "{between}{:?}", unsafe { link.pointer.as_ref() })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::bindings::*;
    use super::*;

    /// The ids of a chain, read through raw pointers as ffx-api does.
    fn walk(first: *const Header) -> Vec<u64> {
        let mut ids = Vec::new();
        let mut at = first;
        while !at.is_null() {
            // SAFETY: links of a live chain.
            let header = unsafe { &*at };
            ids.push(header.id().0);
            at = header.next();
        }
        ids
    }

    fn chain() -> Chain<CreateFrameGeneration> {
        Chain::new(CreateFrameGeneration { flags: CreateFlags::DEPTH_INFINITE, ..Default::default() })
            .with(OverrideVersion { version_id: 7, ..Default::default() })
            .with(CreateBackendDx12 { device: 0x1234 as *mut _, ..Default::default() })
    }

    #[test]
    fn links_are_in_order_after_the_head() {
        let mut chain = chain();
        assert_eq!(walk(chain.as_ptr()), [0x2_0001, 5, 2]);
        // Moving the chain leaves the links' addresses unchanged.
        let before = chain.as_ptr();
        let mut moved = Box::new(chain);
        assert_eq!(moved.as_ptr(), before);
        assert_eq!(walk(moved.as_ptr()), [0x2_0001, 5, 2]);
    }

    #[test]
    fn links_can_be_changed_and_removed_and_a_chain_has_one_link_of_a_type() {
        let mut chain = chain().with(OverrideVersion { version_id: 8, ..Default::default() });
        assert_eq!(walk(chain.as_ptr()), [0x2_0001, 5, 2]);
        assert_eq!(chain.link_mut::<OverrideVersion>().expect("it is there").version_id, 8);
        assert!(chain.link_mut::<CreateFrameGenerationHudless>().is_none());
        chain.head_mut().display_size = Dimensions { width: 640, height: 360 };
        assert_eq!(chain.head().display_size.width, 640);
        assert_eq!(chain.head().flags, CreateFlags::DEPTH_INFINITE);
        chain.remove::<CreateFrameGenerationHudless>();
        chain.remove::<OverrideVersion>();
        assert_eq!(walk(chain.as_ptr()), [0x2_0001, 2]);
        chain.set(OverrideVersion { version_id: 9, ..Default::default() });
        assert_eq!(walk(chain.as_ptr()), [0x2_0001, 2, 5]);
    }

    #[test]
    fn a_header_copied_from_another_struct_is_corrected() {
        let mut other = Chain::new(QueryProviderVersion::default());
        let mut chain = chain();
        chain.head_mut().header = other.head().header;
        *chain.link_mut::<OverrideVersion>().expect("it is there") = OverrideVersion::default();
        assert_eq!(walk(chain.as_ptr()), [0x2_0001, 5, 2]);
        assert_eq!(walk(other.as_ptr()), [6]);
    }

    #[test]
    fn a_chain_s_debug_text_has_all_fields() {
        let text = format!("{:?}", chain());
        assert!(text.contains("DEPTH_INFINITE") && text.contains("version_id: 7") && text.contains("0x1234"), "{text}");
    }
}

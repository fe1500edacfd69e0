//! Reads and writes structs whose first field is their size, so that hosts and libraries of different versions work together.

use super::results::{AbiResult, CAIRN_ERROR_STRUCT_SIZE, Failure};

/// Upper limit of a struct's size in bytes. It bounds what is read if the host has left struct_size uninitialised.
const MAX_SIZE: usize = 4_096;

/// A struct of the header.
///
/// # Safety
/// It is `repr(C)`, its first field is `struct_size: u32`, every bit pattern is valid in every field, and `SIZES` ends with its own
/// size.
pub(super) unsafe trait Struct: Copy + 'static {
    const NAME: &'static str;
    /// Every size that it has had, ascending; the last is the current one. Fields are only ever added, at the end.
    const SIZES: &'static [usize];
    const FIELDS: &'static [Field];
}

/// Name, offset and size of a field, for the list that `record` makes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    pub(super) name: &'static str,
    pub(super) offset: usize,
    pub(super) size: usize,
}

/// Describes a struct of the header: the sizes it had in earlier releases, and all of its fields. A missing field does not compile.
macro_rules! describe {
    ($name:ident, [$($earlier:literal),*], { $($field:ident),* $(,)? }) => {
        const _: fn($name) = |$name { $($field: _),* }| {};
        // SAFETY: a `repr(C)` struct of integers, floats and pointers; the tests compare it with what a C compiler makes.
        unsafe impl $crate::abi::structs::Struct for $name {
            const NAME: &'static str = stringify!($name);
            const SIZES: &'static [usize] = &[$($earlier,)* size_of::<$name>()];
            const FIELDS: &'static [$crate::abi::structs::Field] = &[$($crate::abi::structs::Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                size: $crate::abi::structs::size_of_field(|s: &$name| &s.$field),
            }),*];
        }
    };
}
pub(super) use describe;

pub(super) const fn size_of_field<S, F>(_: fn(&S) -> &F) -> usize {
    size_of::<F>()
}

/// Reads a struct that the host filled. Fields that an older host's struct lacks are zero, which is every field's default.
///
/// # Safety
/// `from` is null or points to as many readable bytes as its first four say.
pub(super) unsafe fn read<T: Struct>(from: *const T, name: &str) -> AbiResult<T> {
    // SAFETY: the caller's promise is the same.
    let size = unsafe { struct_size(from, name) }?;
    let mut own = std::mem::MaybeUninit::<T>::zeroed();
    let known = size.min(size_of::<T>());
    // SAFETY: `size` bytes can be read by the caller's promise, and `own` is at least as long as `known`.
    let unknown = unsafe {
        from.cast::<u8>().copy_to_nonoverlapping(own.as_mut_ptr().cast(), known);
        std::slice::from_raw_parts(from.cast::<u8>().add(known), size - known)
    };
    if unknown.iter().any(|byte| *byte != 0) {
        return Err(Failure::new(
            CAIRN_ERROR_STRUCT_SIZE,
            format!("{} of {size} bytes sets something this library does not know", T::NAME),
        )
        .field(name)
        .remedy("Load a newer library"));
    }
    // SAFETY: zeroes and any bytes are valid in every field, by the trait's promise.
    Ok(unsafe { own.assume_init() })
}

/// As [`read`]; a null pointer means a struct of zeroes.
///
/// # Safety
/// As [`read`].
pub(super) unsafe fn read_or_default<T: Struct>(from: *const T, name: &str) -> AbiResult<T> {
    if from.is_null() {
        // SAFETY: zeroes are valid in every field, by the trait's promise.
        return Ok(unsafe { std::mem::zeroed() });
    }
    // SAFETY: the caller's promise is the same.
    unsafe { read(from, name) }
}

/// A host's struct that the library fills; checked before the work that produces its contents.
#[derive(Debug)]
pub(super) struct Out<T> {
    to: *mut T,
    size: usize,
}

impl<T: Struct> Out<T> {
    /// # Safety
    /// `to` is null or points to as many bytes as its first four say, readable and writable as long as `Out` lives.
    pub(super) unsafe fn new(to: *mut T, name: &str) -> AbiResult<Self> {
        // SAFETY: the caller's promise is the same.
        let size = unsafe { struct_size(to, name) }?;
        Ok(Self { to, size })
    }

    /// As [`new`](Self::new); a null pointer means that the host does not want the result.
    ///
    /// # Safety
    /// As [`new`](Self::new).
    pub(super) unsafe fn optional(to: *mut T, name: &str) -> AbiResult<Option<Self>> {
        if to.is_null() {
            return Ok(None);
        }
        // SAFETY: the caller's promise is the same.
        unsafe { Self::new(to, name) }.map(Some)
    }

    /// Fills the struct up to the host's size. Bytes that only a newer host's struct has become zero. The size itself is not changed.
    pub(super) fn write(self, value: &T) {
        const FIRST: usize = size_of::<u32>();
        let known = self.size.min(size_of::<T>());
        // SAFETY: `size` bytes can be written by the promise of `new`, and cannot overlap a value of our own.
        unsafe {
            let to = self.to.cast::<u8>();
            to.add(FIRST).copy_from_nonoverlapping(std::ptr::from_ref(value).cast::<u8>().add(FIRST), known - FIRST);
            to.add(known).write_bytes(0, self.size - known);
        }
    }
}

/// Writes `values` to a host's array of structs, `stride` bytes apart, up to `capacity` of them. `count` gets the number of values.
/// `name` is the array's argument, for messages.
///
/// # Safety
/// `to` is null or has `capacity * stride` writable bytes; `count` is null or can be written.
pub(super) unsafe fn write_array<T: Struct>(
    values: &[T],
    to: *mut T,
    name: &str,
    stride: usize,
    capacity: u32,
    count: *mut u32,
) -> AbiResult<()> {
    if count.is_null() || !count.is_aligned() {
        return Err(Failure::argument("count", "a null or misaligned pointer"));
    }
    if to.is_null() && capacity > 0 {
        return Err(Failure::argument(name, "a null pointer with a capacity"));
    }
    if !to.is_null() {
        check_alignment(to, name)?;
        check_size::<T>(stride, "stride")?;
    }
    for (i, value) in values.iter().take(capacity as usize).enumerate() {
        // SAFETY: element `i` lies within the capacity, by the caller's promise.
        unsafe {
            let element = to.cast::<u8>().add(i * stride);
            element.cast::<u32>().write(stride as u32);
            Out { to: element.cast::<T>(), size: stride }.write(value);
        }
    }
    // SAFETY: not null, aligned, and writable by the caller's promise.
    unsafe { count.write(u32::try_from(values.len()).unwrap_or(u32::MAX)) };
    Ok(())
}

/// Checks a pointer to which a call writes one value on success.
pub(super) fn check_out<T>(to: *mut T, name: &str) -> AbiResult<()> {
    if to.is_null() {
        return Err(Failure::argument(name, "a null pointer where the result goes"));
    }
    check_alignment(to, name)
}

/// A host's array of `count` values.
///
/// # Safety
/// `from` is null or points to `count` readable values that nobody changes while `'a` lasts.
pub(super) unsafe fn slice<'a, T>(from: *const T, count: usize, name: &str) -> AbiResult<&'a [T]> {
    check_array(from, count, name)?;
    // SAFETY: not null, aligned, of a possible size, and readable by the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(from, count) })
}

/// A host's array of `count` values to be written.
///
/// # Safety
/// `to` is null or points to `count` initialised values that nobody else uses while `'a` lasts.
pub(super) unsafe fn slice_mut<'a, T>(to: *mut T, count: usize, name: &str) -> AbiResult<&'a mut [T]> {
    check_array(to, count, name)?;
    // SAFETY: not null, aligned, of a possible size, and writable by the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(to, count) })
}

fn check_array<T>(pointer: *const T, count: usize, name: &str) -> AbiResult<()> {
    if pointer.is_null() {
        return Err(Failure::argument(name, "a null pointer where an array must be"));
    }
    check_alignment(pointer, name)?;
    match count.checked_mul(size_of::<T>()).filter(|bytes| *bytes <= isize::MAX as usize) {
        Some(_) => Ok(()),
        None => Err(Failure::argument(name, format!("an array of {count} cannot be in memory"))),
    }
}

fn check_alignment<T>(pointer: *const T, name: &str) -> AbiResult<()> {
    if pointer.is_aligned() {
        return Ok(());
    }
    Err(Failure::argument(name, format!("the pointer is not aligned to {} bytes", align_of::<T>())))
}

/// # Safety
/// `from` is null or its first four bytes can be read.
unsafe fn struct_size<T: Struct>(from: *const T, name: &str) -> AbiResult<usize> {
    if from.is_null() {
        return Err(Failure::argument(name, format!("a null pointer where a {} must be", T::NAME)));
    }
    check_alignment(from, name)?;
    // SAFETY: not null and aligned; readable by the caller's promise.
    let size = unsafe { from.cast::<u32>().read() } as usize;
    check_size::<T>(size, name)?;
    Ok(size)
}

fn check_size<T: Struct>(size: usize, name: &str) -> AbiResult<()> {
    let own = size_of::<T>();
    // A newer struct's size is still a multiple of its alignment.
    let newer = size > own && size <= MAX_SIZE && size.is_multiple_of(align_of::<T>());
    if newer || T::SIZES.contains(&size) {
        return Ok(());
    }
    Err(Failure::new(CAIRN_ERROR_STRUCT_SIZE, format!("{size} is no size of {}", T::NAME))
        .field(name)
        .remedy(format!("Set struct_size to its sizeof, {own} in this version")))
}

/// Checks that flags have no other bits than `known`.
pub(super) fn check_flags(flags: u32, known: u32, name: &str) -> AbiResult<()> {
    if flags & !known == 0 {
        return Ok(());
    }
    Err(Failure::argument(name, format!("{flags:#x} has an unknown bit")))
}

/// Checks a field that is not used yet.
pub(super) fn check_zero(value: u32, name: &str) -> AbiResult<()> {
    if value == 0 { Ok(()) } else { Err(Failure::argument(name, "it must be 0")) }
}

#[cfg(test)]
mod tests {
    use super::super::results::CAIRN_ERROR_INVALID_ARGUMENT;
    use super::*;

    /// A struct that got a field in each of two later versions.
    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Grown {
        struct_size: u32,
        first: u32,
        second: u64,
        third: u64,
    }
    describe!(Grown, [8, 16], { struct_size, first, second, third });

    fn grown(struct_size: u32) -> Grown {
        Grown { struct_size, first: 1, second: 2, third: 3 }
    }

    #[test]
    fn reads_the_fields_that_an_older_host_has() {
        // SAFETY: every struct has the bytes its size names.
        let read = |size| unsafe { read(&grown(size), "g") }.map(|g| (g.first, g.second, g.third));
        assert_eq!(read(8).unwrap(), (1, 0, 0));
        assert_eq!(read(16).unwrap(), (1, 2, 0));
        assert_eq!(read(24).unwrap(), (1, 2, 3));
        for size in (0..24).filter(|size| ![8, 16].contains(size)) {
            assert_eq!(read(size).unwrap_err().code, CAIRN_ERROR_STRUCT_SIZE, "{size}");
        }
    }

    #[test]
    fn accepts_a_newer_struct_only_if_its_unknown_bytes_are_zero() {
        #[repr(C, align(8))]
        struct Newer([u32; 1026]);
        let mut newer = Newer([0; 1026]);
        // Miri is slow, so under it only some sizes; 101 steps through every remainder of 8.
        for size in (25..4_104_usize).step_by(if cfg!(miri) { 101 } else { 1 }) {
            newer.0[0] = size as u32;
            // SAFETY: there are more bytes than the size names.
            let result = unsafe { read(newer.0.as_ptr().cast::<Grown>(), "g") };
            assert_eq!(result.is_ok(), size.is_multiple_of(8) && size <= MAX_SIZE, "{size}");
        }
        for at in 6..8 {
            newer.0[0] = 32;
            newer.0[at] = 1 << 31;
            // SAFETY: as above.
            let error = unsafe { read(newer.0.as_ptr().cast::<Grown>(), "g") }.unwrap_err();
            assert_eq!(error.code, CAIRN_ERROR_STRUCT_SIZE);
            newer.0[at] = 0;
        }
    }

    #[test]
    fn writes_no_more_than_the_hosts_struct_size() {
        for size in [8_usize, 16, 24, 32] {
            let mut memory = [u64::MAX; 6];
            memory[0] = size as u64;
            // SAFETY: there are more bytes than the size names.
            unsafe { Out::new(memory.as_mut_ptr().cast::<Grown>(), "g") }.unwrap().write(&grown(99));
            let expected = [1 << 32 | size as u64, 2, 3, 0];
            let written = size / 8;
            assert_eq!(memory[..written], expected[..written]);
            assert!(memory[written..].iter().all(|word| *word == u64::MAX), "{size}");
        }
    }

    #[test]
    fn arrays_are_written_with_the_hosts_stride() {
        let mut memory = [u64::MAX; 8];
        let mut count = 0;
        // SAFETY: two elements of four words.
        unsafe { write_array(&[grown(0); 3], memory.as_mut_ptr().cast(), "g", 32, 2, &mut count) }.unwrap();
        assert_eq!((count, memory), (3, [1 << 32 | 32, 2, 3, 0, 1 << 32 | 32, 2, 3, 0]));
        // SAFETY: nothing is written without a capacity.
        unsafe { write_array(&[grown(0); 3], std::ptr::null_mut(), "g", 0, 0, &mut count) }.unwrap();
        // SAFETY: refused before anything is written.
        let refused = unsafe { write_array(&[grown(0)], memory.as_mut_ptr().cast(), "g", 12, 2, &mut count) };
        assert_eq!(refused.unwrap_err().code, CAIRN_ERROR_STRUCT_SIZE);
        // SAFETY: refused before anything is written.
        let refused = unsafe { write_array(&[grown(0)], std::ptr::null_mut(), "g", 32, 2, &mut count) };
        assert!(refused.unwrap_err().to_string().starts_with("g: "));
    }

    #[test]
    fn null_and_misaligned_pointers_are_refused() {
        let words = [24_u64; 8];
        let odd = words.as_ptr().cast::<u8>().wrapping_add(4).cast::<Grown>();
        for pointer in [std::ptr::null(), odd] {
            // SAFETY: null, or refused before it is read.
            assert_eq!(unsafe { read(pointer, "g") }.unwrap_err().code, CAIRN_ERROR_INVALID_ARGUMENT);
            assert!(check_out(pointer.cast_mut(), "g").is_err());
            // SAFETY: as above.
            assert!(unsafe { slice(pointer, 1, "g") }.is_err());
        }
        // SAFETY: refused before it is read.
        assert!(unsafe { slice(words.as_ptr(), usize::MAX / 8, "g") }.is_err());
        // SAFETY: null means zeroes.
        assert_eq!(unsafe { read_or_default::<Grown>(std::ptr::null(), "g") }.unwrap().second, 0);
    }
}

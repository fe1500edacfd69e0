//! Vectors whose memory may run out: their lengths come from a host or a bundle, so that they must not end the process.

use crate::{Error, ErrorKind, Result};

/// `len` zeroes.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn zeroed<T: Clone + Default>(len: usize) -> Result<Vec<T>> {
    filled(len, T::default())
}

/// `len` copies of `value`.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn filled<T: Clone>(len: usize, value: T) -> Result<Vec<T>> {
    let mut values = Vec::new();
    reserve(&mut values, len)?;
    values.resize(len, value);
    Ok(values)
}

/// A copy of `values`.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn copy_of<T: Clone>(values: &[T]) -> Result<Vec<T>> {
    let mut copy = Vec::new();
    reserve(&mut copy, values.len())?;
    copy.extend_from_slice(values);
    Ok(copy)
}

/// Makes room for `len` values in all.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn reserve<T>(values: &mut Vec<T>, len: usize) -> Result<()> {
    values.try_reserve_exact(len.saturating_sub(values.len())).map_err(|_| {
        Error::new(ErrorKind::OutOfMemory, format!("{len} values of {} bytes cannot be allocated", size_of::<T>()))
    })
}

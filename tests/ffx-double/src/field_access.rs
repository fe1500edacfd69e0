//! Access to struct fields by offset.

/// Reads a field.
///
/// # Safety
/// The struct has a field of this type at that offset.
pub(crate) unsafe fn get<T: Copy>(pointer: *const u8, offset: usize) -> T {
    // SAFETY: the caller's promise.
    unsafe { pointer.add(offset).cast::<T>().read_unaligned() }
}

/// Writes a field.
///
/// # Safety
/// The struct may be written, and has a field of this type at that offset.
pub(crate) unsafe fn put<T>(pointer: *mut u8, offset: usize, value: T) {
    // SAFETY: the caller's promise.
    unsafe { pointer.add(offset).cast::<T>().write_unaligned(value) }
}

/// The links of a chain: the id is at offset 0, the next link's address at 8. Fails for a cycle, two links with the same id, more than 16 links, and a
/// misaligned address.
///
/// # Safety
/// A linked chain, or null.
pub(crate) unsafe fn links(head: *const u8) -> Result<Vec<(u64, *const u8)>, &'static str> {
    const LONGEST: usize = 16;
    let mut found: Vec<(u64, *const u8)> = Vec::new();
    let mut at = head;
    while !at.is_null() {
        if found.iter().any(|(_, before)| *before == at) {
            return Err("the chain has a cycle");
        }
        if found.len() == LONGEST || !at.addr().is_multiple_of(8) {
            return Err("the chain leads nowhere");
        }
        // SAFETY: a link of the caller's chain.
        let id = unsafe { get::<u64>(at, 0) };
        if found.iter().any(|(before, _)| *before == id) {
            return Err("two links of the chain are of one kind");
        }
        found.push((id, at));
        // SAFETY: as above.
        at = unsafe { get(at, 8) };
    }
    Ok(found)
}

//! Parallel iterators over slices: each item is accessed by its index, and threads claim ranges of indices.

use std::marker::PhantomData;

use super::{for_each_in_slot, for_each_range};

/// Items that threads access by index.
///
/// # Safety
/// Items of different indices below `len` do not overlap, so that threads may access them concurrently.
pub(crate) unsafe trait Parallel: Sized + Sync {
    type Item;

    fn len(&self) -> usize;

    /// Minimum number of items that a thread claims at a time.
    fn min_len(&self) -> usize {
        1
    }

    /// # Safety
    /// `index` is below `len`, and no index is used twice.
    unsafe fn item(&self, index: usize) -> Self::Item;

    /// Every item with its index.
    fn enumerate(self) -> Enumerate<Self> {
        Enumerate(self)
    }

    /// Pairs of items; ends with the shorter side.
    fn zip<B: Parallel>(self, other: B) -> Zip<Self, B> {
        Zip(self, other)
    }

    /// The first `count` items, or all if there are fewer.
    fn take(self, count: usize) -> Take<Self> {
        Take(self, count)
    }

    /// Sets the minimum number of items that a thread claims at a time.
    fn with_min_len(self, min_len: usize) -> MinLen<Self> {
        MinLen(self, min_len)
    }

    /// Calls `body` once with every item and returns when all calls have returned.
    fn for_each(self, body: impl Fn(Self::Item) + Sync) {
        for_each_range(self.len(), self.min_len(), |range| {
            for index in range {
                // SAFETY: a loop runs each index below its length once.
                body(unsafe { self.item(index) });
            }
        });
    }

    /// As [`for_each`](Self::for_each), with a slot below `slots` (at least 1) that no concurrent call has: an index for per-thread
    /// scratch memory.
    fn for_each_in_slot(self, slots: usize, body: impl Fn(usize, Self::Item) + Sync) {
        for_each_in_slot(self.len(), self.min_len(), slots, |slot, index| {
            // SAFETY: as above.
            body(slot, unsafe { self.item(index) });
        });
    }
}

/// Parallel iteration over shared slices.
pub(crate) trait ParallelSlice<T: Sync> {
    /// Every value.
    fn par_iter(&self) -> Items<'_, T>;
    /// Chunks of `size` values; the last may be shorter.
    fn par_chunks(&self, size: usize) -> Chunks<'_, T>;
}

/// Parallel iteration over mutable slices.
pub(crate) trait ParallelSliceMut<T: Send> {
    /// Every value.
    fn par_iter_mut(&mut self) -> ItemsMut<'_, T>;
    /// Chunks of `size` values; the last may be shorter.
    fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T>;
}

impl<T: Sync> ParallelSlice<T> for [T] {
    fn par_iter(&self) -> Items<'_, T> {
        Items(self)
    }

    fn par_chunks(&self, size: usize) -> Chunks<'_, T> {
        assert!(size > 0, "a chunk holds something");
        Chunks { values: self, size }
    }
}

impl<T: Send> ParallelSliceMut<T> for [T] {
    fn par_iter_mut(&mut self) -> ItemsMut<'_, T> {
        ItemsMut(self.par_chunks_mut(1))
    }

    fn par_chunks_mut(&mut self, size: usize) -> ChunksMut<'_, T> {
        assert!(size > 0, "a chunk holds something");
        ChunksMut { start: self.as_mut_ptr(), len: self.len(), size, _slice: PhantomData }
    }
}

/// See [`ParallelSlice::par_iter`].
pub(crate) struct Items<'a, T>(&'a [T]);

/// See [`ParallelSlice::par_chunks`].
pub(crate) struct Chunks<'a, T> {
    values: &'a [T],
    size: usize,
}

/// See [`ParallelSliceMut::par_iter_mut`].
pub(crate) struct ItemsMut<'a, T>(ChunksMut<'a, T>);

/// See [`ParallelSliceMut::par_chunks_mut`].
pub(crate) struct ChunksMut<'a, T> {
    start: *mut T,
    len: usize,
    size: usize,
    _slice: PhantomData<&'a mut [T]>,
}

// SAFETY: threads get only exclusive slices of values that are `Send`.
unsafe impl<T: Send> Sync for ChunksMut<'_, T> {}

// SAFETY: shared references may overlap.
unsafe impl<'a, T: Sync> Parallel for Items<'a, T> {
    type Item = &'a T;

    fn len(&self) -> usize {
        self.0.len()
    }

    unsafe fn item(&self, index: usize) -> &'a T {
        &self.0[index]
    }
}

// SAFETY: shared slices may overlap.
unsafe impl<'a, T: Sync> Parallel for Chunks<'a, T> {
    type Item = &'a [T];

    fn len(&self) -> usize {
        self.values.len().div_ceil(self.size)
    }

    unsafe fn item(&self, index: usize) -> &'a [T] {
        let start = index * self.size;
        &self.values[start..self.values.len().min(start + self.size)]
    }
}

// SAFETY: chunks of different indices do not overlap.
unsafe impl<'a, T: Send> Parallel for ChunksMut<'a, T> {
    type Item = &'a mut [T];

    fn len(&self) -> usize {
        self.len.div_ceil(self.size)
    }

    unsafe fn item(&self, index: usize) -> &'a mut [T] {
        let start = index * self.size;
        // SAFETY: `start` is below `len` because `index` is below the number of chunks. The chunk ends within the slice, and is
        // borrowed only once because its index is used once.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(start), self.size.min(self.len - start)) }
    }
}

// SAFETY: values of different indices do not overlap.
unsafe impl<'a, T: Send> Parallel for ItemsMut<'a, T> {
    type Item = &'a mut T;

    fn len(&self) -> usize {
        self.0.len
    }

    unsafe fn item(&self, index: usize) -> &'a mut T {
        // SAFETY: a chunk of one value, by the caller's guarantee.
        unsafe { &mut self.0.item(index)[0] }
    }
}

/// See [`Parallel::enumerate`].
pub(crate) struct Enumerate<P>(P);

// SAFETY: items are those of `P`, by the same indices.
unsafe impl<P: Parallel> Parallel for Enumerate<P> {
    type Item = (usize, P::Item);

    fn len(&self) -> usize {
        self.0.len()
    }

    fn min_len(&self) -> usize {
        self.0.min_len()
    }

    unsafe fn item(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's guarantee.
        (index, unsafe { self.0.item(index) })
    }
}

/// See [`Parallel::zip`].
pub(crate) struct Zip<A, B>(A, B);

// SAFETY: items are those of both, by the same indices.
unsafe impl<A: Parallel, B: Parallel> Parallel for Zip<A, B> {
    type Item = (A::Item, B::Item);

    fn len(&self) -> usize {
        self.0.len().min(self.1.len())
    }

    fn min_len(&self) -> usize {
        self.0.min_len().max(self.1.min_len())
    }

    unsafe fn item(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's guarantee; the index is below the length of both.
        unsafe { (self.0.item(index), self.1.item(index)) }
    }
}

/// See [`Parallel::take`].
pub(crate) struct Take<P>(P, usize);

// SAFETY: items are those of `P`, by the same indices.
unsafe impl<P: Parallel> Parallel for Take<P> {
    type Item = P::Item;

    fn len(&self) -> usize {
        self.0.len().min(self.1)
    }

    fn min_len(&self) -> usize {
        self.0.min_len()
    }

    unsafe fn item(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's guarantee.
        unsafe { self.0.item(index) }
    }
}

/// See [`Parallel::with_min_len`].
pub(crate) struct MinLen<P>(P, usize);

// SAFETY: items are those of `P`, by the same indices.
unsafe impl<P: Parallel> Parallel for MinLen<P> {
    type Item = P::Item;

    fn len(&self) -> usize {
        self.0.len()
    }

    fn min_len(&self) -> usize {
        self.1
    }

    unsafe fn item(&self, index: usize) -> Self::Item {
        // SAFETY: the caller's guarantee.
        unsafe { self.0.item(index) }
    }
}

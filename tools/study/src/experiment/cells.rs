//! Makes the missing cells of a plan in worker processes, and keeps the finished ones.

use std::sync::atomic::AtomicBool;

use cairn::Result;

use crate::progress::Progress;
use crate::workers::{Work, run_all};

/// A plan whose cells are folders that worker processes fill.
pub(crate) trait Cells {
    /// One folder.
    type Cell: Copy;
    /// Content of a complete folder.
    type Content;

    /// The cell's content; `None` if it must be made.
    ///
    /// # Errors
    /// `Unsupported` for a manifest of a newer version, which is not overwritten; `Io`.
    fn find(&self, cell: Self::Cell) -> Result<Option<Self::Content>>;

    /// The work that makes the cell.
    ///
    /// # Errors
    /// Invalid settings.
    fn work(&self, cell: Self::Cell) -> Result<Work>;

    /// The content of a cell that was just made.
    ///
    /// # Errors
    /// `InvalidState` if it is not complete; otherwise as [`find`](Self::find).
    fn expect(&self, cell: Self::Cell) -> Result<Self::Content>;
}

/// Every cell of a plan with its content.
pub(crate) struct Complete<C: Cells + ?Sized> {
    /// In the given order.
    pub(crate) cells: Vec<(C::Cell, C::Content)>,
    /// Number of cells that were complete already.
    pub(crate) kept: usize,
}

/// Makes the missing ones of `cells`, `jobs` processes at a time.
///
/// # Errors
/// Errors of the plan; errors of a worker, with its cell named; `Cancelled` when `stop` was set. Complete cells are kept in every case.
pub(crate) fn complete<C: Cells>(
    plan: &C,
    cells: Vec<C::Cell>,
    jobs: usize,
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Complete<C>> {
    let mut found = Vec::with_capacity(cells.len());
    let mut work = Vec::new();
    for cell in cells {
        let whole = plan.find(cell)?;
        if whole.is_none() {
            work.push(plan.work(cell)?);
        }
        found.push((cell, whole));
    }
    run_all(&work, jobs, progress, stop)?;
    let kept = found.len() - work.len();
    let cells = found.into_iter().map(|(cell, whole)| Ok((cell, whole.map_or_else(|| plan.expect(cell), Ok)?)));
    Ok(Complete { cells: cells.collect::<Result<_>>()?, kept })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Finished;

    impl Cells for Finished {
        type Cell = u32;
        type Content = String;

        fn find(&self, cell: u32) -> Result<Option<String>> {
            Ok(Some(format!("cell {cell}")))
        }

        fn work(&self, _: u32) -> Result<Work> {
            panic!("a finished cell is not made again")
        }

        fn expect(&self, _: u32) -> Result<String> {
            panic!("a finished cell is not read again")
        }
    }

    #[test]
    fn finished_cells_are_kept_in_order() {
        let stop = AtomicBool::new(false);
        let complete = complete(&Finished, vec![3, 1], 1, &Progress::quiet(), &stop).unwrap();
        assert_eq!(complete.cells, [(3, "cell 3".to_owned()), (1, "cell 1".to_owned())]);
        assert_eq!(complete.kept, 2);
    }
}

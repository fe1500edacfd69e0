//! The checker of barriers notices each barrier that is missing.

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use test_support::d3d12::hazards::Checker;

#[test]
fn the_checker_of_dispatches_finds_each_missing_barrier() {
    let (written, other) = (100, 200);
    let unordered = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;
    let read = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
    // Faults of two dispatches with `between` between them. The first one writes `written`. The second one writes it if `is_unordered`, else
    // reads it.
    let faults = |is_unordered: bool, between: &dyn Fn(&mut Checker)| {
        let mut checker = Checker::new(8);
        checker.describe(8, other, false);
        checker.describe(16, written, true);
        checker.bind(8);
        checker.dispatch();
        checker.describe(24, written, is_unordered);
        checker.bind(24);
        between(&mut checker);
        checker.dispatch();
        checker.faults.len()
    };
    assert_eq!(faults(true, &|_| {}), 1, "written twice");
    assert_eq!(faults(true, &|checker| checker.unordered_barrier(Some(other))), 1, "a barrier for something else");
    assert_eq!(faults(true, &|checker| checker.unordered_barrier(Some(written))), 0);
    assert_eq!(faults(true, &|checker| checker.unordered_barrier(None)), 0);
    assert_eq!(faults(true, &Checker::close), 1, "nothing is bound in a new list");
    assert_eq!(faults(false, &|_| {}), 1, "read after it was written");
    assert_eq!(faults(false, &|checker| checker.transition(written, unordered, read)), 0);
    assert_eq!(faults(true, &|checker| checker.transition(written, unordered, read)), 1, "written as it is to be read");
    let twice = |checker: &mut Checker| (0..2).for_each(|_| checker.transition(written, unordered, read));
    assert_eq!(faults(false, &twice), 1, "a barrier from a state that it is not in");
}

//! Residency of memory on a Direct3D 12 device: a rollout's memory has lower priority than an engine's, is evicted while the rollout rests,
//! and is resident again before use. On Windows, or in the lab.
#![cfg(windows)]

use std::ffi::c_void;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use cairn::ErrorKind;
use cairn::bundle::Precision;
use cairn::gpu::windows::Win32::Foundation::HANDLE;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::D3D12_RESIDENCY_PRIORITY_LOW;
use cairn::gpu::windows::Win32::Graphics::Dxgi::{
    CreateDXGIFactory1, DXGI_MEMORY_SEGMENT_GROUP, DXGI_QUERY_VIDEO_MEMORY_INFO, IDXGIAdapter3, IDXGIFactory1,
};
use cairn::gpu::windows::Win32::System::Threading::SetEvent;
use cairn::gpu::windows::core::{HRESULT, Interface};
use cairn::gpu::{Gpu, adapters};
use cairn::runtime::{Device, DirectMlOptions};
use cairn::world::{Budget, KeptAnchor, Rollout, World, WorldOptions};
use test_support::d3d12::function_tables::replace_function;
use test_support::worlds::{bundle, controls, fingerprint, ort, picture, point};

mod residency_calls;
use residency_calls::{ResidencyCall, ResidencyMode, set_residency_mode, take_calls};

/// One test at a time: residency calls are recorded for the whole process.
fn alone() -> std::sync::MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn world_at(device: &Device, window: Option<u32>) -> Arc<World> {
    let options = WorldOptions { precision: Some(Precision::F16), global_window: window, ..WorldOptions::default() };
    World::load(device, &bundle("tiny"), options).expect("a world")
}

fn device_on(gpu: &Gpu) -> Device {
    let options = DirectMlOptions { deterministic: true, ..DirectMlOptions::default() };
    Device::directml(&ort(), gpu, options).expect("DirectML")
}

/// The objects that were evicted, among the recorded calls.
fn evicted(calls: &[ResidencyCall]) -> Vec<usize> {
    match calls.iter().filter(|call| matches!(call, ResidencyCall::Evicted(_))).collect::<Vec<_>>()[..] {
        [ResidencyCall::Evicted(objects)] => objects.clone(),
        _ => panic!("no eviction, or several: {calls:?}"),
    }
}

#[test]
fn a_resting_rollout_is_evicted_and_continues_bit_for_bit() {
    let _alone = alone();
    set_residency_mode(ResidencyMode::Later);
    GRANTED.store(1 << 40, Ordering::SeqCst);
    let gpu = Gpu::on_adapter(None).expect("a device");
    residency_calls::install(&gpu);
    let world = world_at(&device_on(&gpu), None);
    _ = take_calls();
    let mut rollout = Rollout::new(&world, &point(&world), 7).expect("a rollout");
    let (made, faults) = take_calls();
    assert_eq!(faults, [""; 0]);
    let low_priority_objects = |calls: &[ResidencyCall]| -> Vec<usize> {
        let of = |calls: &ResidencyCall| match calls {
            ResidencyCall::Priority(object, D3D12_RESIDENCY_PRIORITY_LOW) => Some(*object),
            ResidencyCall::Priority(..) => panic!("another priority: {calls:?}"),
            _ => None,
        };
        calls.iter().filter_map(of).collect()
    };
    let ours = low_priority_objects(&made);
    let mut other = Rollout::new(&world, &point(&world), 7).expect("a rollout");
    let others = low_priority_objects(&take_calls().0);

    let seed = picture(40, 22, 9);
    for rollout in [&mut rollout, &mut other] {
        rollout.append(&seed).expect("a seed");
        rollout.step(&controls(1)).expect("a step");
    }
    let anchor = KeptAnchor::of(&mut rollout, false).expect("an anchor");
    let bits = fingerprint(&mut rollout).expect("bits");
    assert!(bits == fingerprint(&mut other).expect("bits"));
    _ = take_calls();

    // Everything that the rollout allocated is evicted, once, and nothing of another rollout.
    assert!(!rollout.is_resting());
    rollout.rest().expect("a rest");
    rollout.rest().expect("nothing more to do");
    assert!(rollout.is_resting());
    let (during, faults) = take_calls();
    let gone = evicted(&during);
    assert_eq!(faults, [""; 0]);
    assert_eq!(gone, ours, "rings, latents, memories and pictures");
    assert!(!others.is_empty() && gone.iter().all(|object| !others.contains(object)));

    // The other rollout and the anchor are not affected.
    other.step(&controls(2)).expect("a step");
    anchor.picture().expect("a picture");
    assert!(rollout.is_resting());
    let (between, _) = take_calls();
    assert!(!between.iter().any(|call| matches!(call, ResidencyCall::Enqueued(..) | ResidencyCall::MadeResident(_))));

    // If its memory cannot become resident, there is a typed error and everything is unchanged.
    for how in [ResidencyMode::FailLater, ResidencyMode::FailAtOnce] {
        set_residency_mode(how);
        for refused in [
            rollout.step(&controls(2)).map(drop),
            rollout.append(&seed).map(drop),
            rollout.reset(),
            rollout.save().map(drop),
        ] {
            let refused = refused.expect_err("memory cannot become resident");
            assert_eq!(refused.kind(), ErrorKind::OutOfMemory, "{refused}");
            assert!(refused.to_string().contains("rest"), "{refused}");
        }
        assert!(rollout.is_resting());
    }
    _ = take_calls();

    // The queue waits for residency before it executes anything; the step has the same result as without a rest.
    set_residency_mode(ResidencyMode::Later);
    rollout.step(&controls(2)).expect("a step");
    let (back, faults) = take_calls();
    assert_eq!(faults, [""; 0]);
    let first = back.iter().position(|call| matches!(call, ResidencyCall::Enqueued(..))).expect("it is made resident");
    let ResidencyCall::Enqueued(objects, fence, value) = &back[first] else { unreachable!("found as such") };
    assert_eq!(objects, &gone);
    assert_eq!(back[..first].iter().filter(|calls| **calls == ResidencyCall::Executes).count(), 0, "{back:?}");
    assert_eq!(back[first + 1], ResidencyCall::Waits(*fence, *value), "before anything is executed");
    assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut other).expect("bits"));

    // A system without asynchronous residency.
    rollout.rest().expect("a rest");
    set_residency_mode(ResidencyMode::AtOnce);
    assert!(fingerprint(&mut rollout).expect("bits") == fingerprint(&mut other).expect("bits"));
    let (back, faults) = take_calls();
    assert_eq!(faults, [""; 0]);
    assert!(back.contains(&ResidencyCall::MadeResident(gone)), "{back:?}");
    // A resting rollout can be dropped.
    rollout.rest().expect("a rest");
    drop(rollout);
    other.step(&controls(3)).expect("a step");
}

#[test]
fn weights_are_evicted_when_all_rollouts_rest() {
    let _alone = alone();
    set_residency_mode(ResidencyMode::Later);
    GRANTED.store(1 << 40, Ordering::SeqCst);
    let gpu = Gpu::on_adapter(None).expect("a device");
    residency_calls::install(&gpu);
    let device = device_on(&gpu);
    _ = take_calls();
    let world = world_at(&device, None);
    // DirectML makes its own memory resident several times, as Direct3D allows with its counter.
    let (made, _) = take_calls();
    let weights: Vec<usize> = made
        .iter()
        .filter_map(|calls| match calls {
            ResidencyCall::Priority(object, D3D12_RESIDENCY_PRIORITY_LOW) => Some(*object),
            ResidencyCall::Priority(..) => panic!("another priority: {calls:?}"),
            _ => None,
        })
        .collect();
    assert!(weights.len() > 8, "the large ones of the transformer and of the decoder: {weights:?}");
    let rollout = || {
        let mut rollout = Rollout::new(&world, &point(&world), 7).expect("a rollout");
        rollout.append(&picture(40, 22, 9)).expect("a seed");
        rollout.step(&controls(1)).expect("a step");
        rollout
    };
    let [mut one, mut other] = [rollout(), rollout()];
    let expected = {
        let mut awake = rollout();
        awake.step(&controls(2)).expect("a step");
        fingerprint(&mut awake).expect("bits")
    };
    _ = take_calls();

    // Numbers of evicted objects: weights, and others.
    let evicted = || {
        let (calls, faults) = take_calls();
        assert_eq!(faults, [""; 0]);
        let all = calls
            .into_iter()
            .filter_map(|calls| if let ResidencyCall::Evicted(all) = calls { Some(all) } else { None });
        let (of_weights, others): (Vec<_>, Vec<_>) = all.flatten().partition(|object| weights.contains(object));
        (of_weights.len(), others.len())
    };
    one.rest().expect("a rest");
    let (kept, own) = evicted();
    assert!(kept == 0 && own > 8, "its own alone");
    other.rest().expect("a rest");
    assert_eq!(evicted(), (weights.len(), own), "weights are evicted with the last rollout");

    // If the memory cannot become resident, it stays evicted with all its contents.
    for how in [ResidencyMode::FailLater, ResidencyMode::FailAtOnce] {
        set_residency_mode(how);
        let refused = one.step(&controls(2)).expect_err("memory cannot become resident");
        assert_eq!((refused.kind(), one.is_resting()), (ErrorKind::OutOfMemory, true), "{refused}");
    }
    set_residency_mode(ResidencyMode::Later);
    _ = take_calls();
    one.step(&controls(2)).expect("a step");
    let (back, faults) = take_calls();
    assert_eq!(faults, [""; 0]);
    let mut left = weights.clone();
    for (i, calls) in back.iter().enumerate().take_while(|(_, calls)| **calls != ResidencyCall::Executes) {
        let ResidencyCall::Enqueued(objects, fence, value) = calls else { continue };
        left.retain(|weight| !objects.contains(weight));
        assert_eq!(back[i + 1], ResidencyCall::Waits(*fence, *value), "the queue waits for them");
    }
    assert_eq!(left, [0; 0], "all of them, before anything is executed");
    assert!(fingerprint(&mut one).expect("bits") == expected, "as if it had not rested");

    // The weights are evicted with the last rollout that does not rest, and another rollout makes them resident again.
    drop(one);
    assert_eq!(evicted(), (weights.len(), 0));
    other.step(&controls(2)).expect("a step");
    assert!(fingerprint(&mut other).expect("bits") == expected);
}

/// The event that a budget change sets, and the granted budget.
static EVENT: AtomicUsize = AtomicUsize::new(0);
static GRANTED: AtomicU64 = AtomicU64::new(u64::MAX);

unsafe extern "system" fn register(_: *mut c_void, event: HANDLE, cookie: *mut u32) -> HRESULT {
    EVENT.store(event.0 as usize, Ordering::SeqCst);
    // SAFETY: the caller's variable.
    unsafe { cookie.write(7) };
    HRESULT(0)
}

unsafe extern "system" fn unregister(_: *mut c_void, cookie: u32) {
    assert_eq!(cookie, 7);
    EVENT.store(0, Ordering::SeqCst);
}

unsafe extern "system" fn query(
    _: *mut c_void,
    _: u32,
    _: DXGI_MEMORY_SEGMENT_GROUP,
    calls: *mut DXGI_QUERY_VIDEO_MEMORY_INFO,
) -> HRESULT {
    let (granted, used) = (GRANTED.load(Ordering::SeqCst), 1 << 30);
    // SAFETY: the caller's variable.
    unsafe { calls.write(DXGI_QUERY_VIDEO_MEMORY_INFO { Budget: granted, CurrentUsage: used, ..Default::default() }) };
    HRESULT(0)
}

/// Simulates the system's memory budget on all adapters, for the rest of the process.
fn simulate_budget() {
    type Register = unsafe extern "system" fn(*mut c_void, HANDLE, *mut u32) -> HRESULT;
    type Query = unsafe extern "system" fn(
        *mut c_void,
        u32,
        DXGI_MEMORY_SEGMENT_GROUP,
        *mut DXGI_QUERY_VIDEO_MEMORY_INFO,
    ) -> HRESULT;
    static REGISTER: OnceLock<Register> = OnceLock::new();
    static UNREGISTER: OnceLock<unsafe extern "system" fn(*mut c_void, u32)> = OnceLock::new();
    static QUERY: OnceLock<Query> = OnceLock::new();
    assert!(!adapters().expect("adapters").is_empty());
    // SAFETY: no arguments but a number.
    let adapter = unsafe { CreateDXGIFactory1::<IDXGIFactory1>().expect("DXGI").EnumAdapters1(0) }.expect("an adapter");
    let adapter: IDXGIAdapter3 = adapter.cast().expect("an adapter of today");
    let table = Interface::vtable(&adapter);
    replace_all(table, (&REGISTER, register), (&UNREGISTER, unregister), (&QUERY, query));

    fn replace_all(
        table: &<IDXGIAdapter3 as Interface>::Vtable,
        register: (&OnceLock<Register>, Register),
        unregister: (
            &OnceLock<unsafe extern "system" fn(*mut c_void, u32)>,
            unsafe extern "system" fn(*mut c_void, u32),
        ),
        query: (&OnceLock<Query>, Query),
    ) {
        replace_function(&raw const table.RegisterVideoMemoryBudgetChangeNotificationEvent, register.0, register.1);
        replace_function(&raw const table.UnregisterVideoMemoryBudgetChangeNotification, unregister.0, unregister.1);
        replace_function(&raw const table.QueryVideoMemoryInfo, query.0, query.1);
    }
}

#[test]
fn a_smaller_memory_budget_narrows_the_window_before_the_next_latent() {
    let _alone = alone();
    set_residency_mode(ResidencyMode::Later);
    GRANTED.store(1 << 40, Ordering::SeqCst);
    simulate_budget();
    let device = device_on(&Gpu::on_adapter(None).expect("a device"));
    let [wide, narrow] = [16, 4].map(|window| world_at(&device, Some(window)));
    let mut rollout = Rollout::new(&wide, &point(&wide), 7).expect("a rollout");
    rollout.append(&picture(40, 22, 9)).expect("a seed");
    let budget = Budget { frame: Some(Duration::from_secs(3600)), multiplier: 1, ..Budget::default() };
    let governor = rollout.govern(&budget, std::slice::from_ref(&narrow)).expect("a budget");
    let event = EVENT.load(Ordering::SeqCst);
    assert!(event != 0, "the rollout registers for changes");
    rollout.step(&controls(0)).expect("a step");
    assert_eq!(rollout.world().global_window(), 16);

    // The budget becomes smaller than the usage, which is reported.
    GRANTED.store(1 << 20, Ordering::SeqCst);
    // SAFETY: the event that was registered.
    unsafe { SetEvent(HANDLE(event as *mut c_void)) }.expect("it is set");
    rollout.step(&controls(1)).expect("a step");
    assert_eq!((rollout.world().global_window(), governor.statistics().short_of_memory), (4, 1));
    rollout.ungovern();
    assert_eq!(EVENT.load(Ordering::SeqCst), 0, "the registration ends");
}

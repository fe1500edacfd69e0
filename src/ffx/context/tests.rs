//! Contexts of a fake library.

use std::ffi::c_void;

use super::super::bindings::*;
use super::super::fake_library::{ANALYTIC, ANALYTIC_20, FAKE, FakeLibrary, ML, api, count, creations, head};
use super::super::{Dialect, Family, versions};
use super::*;

/// Creates a context of a fake library with this behaviour.
fn made(choice: Choice, fake: FakeLibrary) -> Result<Context<CreateFrameGeneration>> {
    FAKE.set(fake);
    // SAFETY: the fake library uses no device.
    unsafe { Context::create(&api(), 0x1000 as *mut c_void, choice, head(), |chain| chain) }
}

#[test]
fn missing_exports_are_named() {
    // SAFETY: nothing is given.
    let missing =
        unsafe { Api::from_exports(|name| if name == c"ffxQuery" { std::ptr::null() } else { std::ptr::dangling() }) };
    assert_eq!(missing.expect_err("one is missing"), [c"ffxQuery"]);
}

#[test]
fn a_provider_of_2_0_gets_the_structs_it_knows() {
    let fake =
        FakeLibrary { providers: vec![ANALYTIC_20], running_provider: Some(ANALYTIC_20), ..FakeLibrary::default() };
    let context = made(Choice::Any, fake).expect("a context");
    assert_eq!(creations(), [[0x2_0001, 2]]);
    let provider = context.provider();
    assert_eq!((provider.version.name.as_str(), provider.verified, provider.dialect), ("3.1.5", true, Dialect::Sdk11));
    drop(context);
    assert_eq!(count("destroy"), 1);
}

#[test]
fn a_family_is_requested_by_its_newest_id_with_the_structs_of_2_1() {
    for (choice, wanted) in [(Choice::Prefer(Family::Analytic), ANALYTIC), (Choice::Require(Family::Ml), ML)] {
        let fake = FakeLibrary {
            providers: vec![ANALYTIC_20, ANALYTIC, ML],
            running_provider: Some(wanted),
            ..FakeLibrary::default()
        };
        let context = made(choice, fake).expect("a context");
        assert_eq!(creations(), [[0x2_0001, 0x2_000e, 5, 2]]);
        assert_eq!(FAKE.with_borrow(|fake| fake.requested_version), Some(wanted.0));
        assert_eq!(context.provider().dialect, Dialect::Sdk21);
        let offered: Vec<_> = context.provider().offered.iter().map(|version| version.name.as_str()).collect();
        assert_eq!(offered, ["4.0.1", "3.1.6", "3.1.5"], "the newest first");
    }
}

#[test]
fn the_driver_s_provider_is_reported_and_refused_if_another_is_required() {
    let fake = || FakeLibrary { providers: vec![ANALYTIC_20], running_provider: Some(ML), ..FakeLibrary::default() };
    let context = made(Choice::Prefer(Family::Analytic), fake()).expect("only preferred");
    assert_eq!(context.provider().version.name, "4.0.1");
    assert_eq!(context.provider().dialect, Dialect::Sdk21, "what runs decides what it understands");
    drop(context);
    let refused = made(Choice::Require(Family::Analytic), fake()).expect_err("required");
    assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::Unsupported, Some("provider")), "{refused}");
    assert!(refused.cause().contains("4.0.1 (ml)"), "{refused}");
    assert_eq!((count("create"), count("destroy")), (1, 1), "what was made is destroyed");
}

#[test]
fn a_provider_that_rejects_the_structs_of_2_1_gets_the_earlier_ones() {
    for code in [ReturnCode::UNKNOWN_STRUCT, ReturnCode::STRUCT_TOO_NEW] {
        let rejects = vec![(StructId::FRAME_GENERATION_VERSION, code)];
        let fake = FakeLibrary {
            providers: vec![ANALYTIC],
            running_provider: Some(ANALYTIC),
            rejects,
            ..FakeLibrary::default()
        };
        let context = made(Choice::Any, fake).expect("a context");
        assert_eq!(creations(), [vec![0x2_0001, 0x2_000e, 2], vec![0x2_0001, 2]]);
        assert_eq!(context.provider().dialect, Dialect::Sdk11);
    }
}

#[test]
fn a_context_without_a_version_query_reports_the_requested_provider() {
    let fake = FakeLibrary { providers: vec![ANALYTIC_20], running_provider: None, ..FakeLibrary::default() };
    let context = made(Choice::Any, fake).expect("a context");
    assert_eq!((context.provider().version.name.as_str(), context.provider().verified), ("3.1.5", false));
}

#[test]
fn more_providers_than_the_first_query_can_hold_are_all_listed() {
    for number in [7, 8, 9, 31, 32, 255, 256, 400] {
        FAKE.set(FakeLibrary { providers: vec![ANALYTIC; number], ..FakeLibrary::default() });
        // SAFETY: no device is used.
        let found = unsafe { versions(&api(), Effect::FrameGeneration, null_mut()) }.expect("a list");
        assert_eq!(found.len(), number.min(256));
    }
    FAKE.set(FakeLibrary::default());
    // SAFETY: no device is used.
    let none = unsafe { versions(&api(), Effect::FrameGeneration, null_mut()) }.expect_err("there is none");
    assert_eq!(none.kind(), ErrorKind::Unsupported);
}

#[test]
fn every_error_names_the_call_and_its_arguments() {
    let kinds = [
        (1, ErrorKind::Device),
        (3, ErrorKind::Device),
        (4, ErrorKind::Unsupported),
        (5, ErrorKind::OutOfMemory),
        (6, ErrorKind::InvalidArgument),
        (2, ErrorKind::Unsupported),
        (7, ErrorKind::Unsupported),
        (99, ErrorKind::Device),
    ];
    for (code, kind) in kinds {
        let refuse = |id| vec![(id, ReturnCode(code))];
        let fake = |rejects| FakeLibrary {
            providers: vec![ANALYTIC_20],
            running_provider: Some(ANALYTIC_20),
            rejects,
            message: "so there",
            ..FakeLibrary::default()
        };
        let says = |error: Error, call: &str, word: &str, suspects: [&str; 6]| {
            assert_eq!(error.kind(), kind, "{error}");
            let of_code = match code {
                2 | 7 => 0,
                4 => 1,
                5 => 2,
                6 => 3,
                1 | 3 => 4,
                _ => 5,
            };
            assert_eq!(error.offending_field(), Some(suspects[of_code]), "{error}");
            for part in [call, word, &format!("answered {code} "), "so there"] {
                assert!(error.cause().contains(part), "{part}: {error}");
            }
            assert!(error.remedy_text().is_some(), "{error}");
        };
        let error = made(Choice::Any, fake(refuse(StructId::FRAME_GENERATION))).expect_err("refused");
        // Suspected fields for: unknown struct, no provider, no memory, invalid parameter, failure, unknown code.
        let of_device = ["provider", "device", "display_size", "flags", "device", "device"];
        says(error, "ffxCreateContext", "R8G8B8A8_UNORM", of_device);
        let mut context = made(Choice::Any, fake(refuse(StructId::FRAME_GENERATION_PREPARE))).expect("a context");
        let list = "command_list";
        let mut prepare = Chain::new(DispatchPrepare { frame_id: 4711, ..Default::default() });
        // SAFETY: the fake library reads ids only.
        says(
            unsafe { context.dispatch(&mut prepare) }.expect_err("refused"),
            "ffxDispatch",
            "frame_id: 4711",
            ["provider", "provider", "device", "depth", list, list],
        );
        FAKE.with_borrow_mut(|fake| fake.rejects = refuse(StructId::FRAME_GENERATION_CONFIGURE));
        let mut settings = Chain::new(ConfigureFrameGeneration { frame_id: 4711, ..Default::default() });
        // SAFETY: as above.
        says(
            unsafe { context.configure(&mut settings) }.expect_err("refused"),
            "ffxConfigure",
            "frame_id: 4711",
            ["provider", "provider", "device", "flags", "device", "device"],
        );
        FAKE.with_borrow_mut(|fake| fake.rejects = refuse(StructId::FRAME_GENERATION_MEMORY));
        let mut memory = Chain::new(QueryFrameGenerationMemory::default());
        // SAFETY: as above.
        says(
            unsafe { context.query(&mut memory) }.expect_err("refused"),
            "ffxQuery",
            "FRAME_GENERATION_MEMORY",
            ["provider", "provider", "device", "provider", "device", "device"],
        );
        // A failure to destroy a context is only logged.
        FAKE.with_borrow_mut(|fake| fake.rejects.clear());
    }
}

#[test]
fn a_library_with_only_the_earlier_message_struct_sends_messages_too() {
    let rejects = vec![
        (StructId::GLOBAL_DEBUG, ReturnCode::UNKNOWN_STRUCT),
        (StructId::FRAME_GENERATION_CONFIGURE, ReturnCode::ERROR),
    ];
    let fake = FakeLibrary {
        providers: vec![ANALYTIC_20],
        running_provider: Some(ANALYTIC_20),
        rejects,
        message: "a word",
        ..FakeLibrary::default()
    };
    let mut context = made(Choice::Any, fake).expect("a context");
    // SAFETY: the fake library reads ids only.
    let failed = unsafe { context.configure(&mut Chain::new(ConfigureFrameGeneration::default())) };
    assert!(failed.expect_err("refused").cause().contains("the library says: a word"));
}

#[test]
fn success_with_a_null_context_is_an_error() {
    let fake = FakeLibrary { providers: vec![ANALYTIC_20], returns_null_context: true, ..FakeLibrary::default() };
    assert_eq!(made(Choice::Any, fake).expect_err("no context").kind(), ErrorKind::Device);
    assert_eq!(count("destroy"), 0);
}

#[test]
fn invalid_creation_parameters_are_refused_before_any_call() {
    type Spoil = fn(&mut CreateFrameGeneration);
    let spoils: [(Spoil, &str); 7] = [
        (|head| head.display_size.width = 0, "display_size"),
        (|head| head.display_size.height = 16385, "display_size"),
        (|head| head.display_size.width = 63, "display_size"),
        (|head| head.display_size.height = 63, "display_size"),
        (|head| head.max_render_size.height = 0, "max_render_size"),
        (|head| head.back_buffer_format = SurfaceFormat::UNKNOWN, "back_buffer_format"),
        (|head| head.back_buffer_format = SurfaceFormat::R32_FLOAT, "back_buffer_format"),
    ];
    for (spoil, field) in spoils {
        FAKE.set(FakeLibrary::default());
        let mut head = head();
        spoil(&mut head);
        // SAFETY: no device is used.
        let refused = unsafe { Context::create(&api(), null_mut(), Choice::Any, head, |chain| chain) };
        let refused = refused.expect_err("refused");
        assert_eq!((refused.kind(), refused.offending_field()), (ErrorKind::InvalidArgument, Some(field)));
        assert!(FAKE.with_borrow(|fake| fake.calls.is_empty()), "the library was not asked");
    }
    for (format, fits) in [(SurfaceFormat::B8G8R8A8_UNORM, true), (SurfaceFormat::R16G16B16A16_FLOAT, false)] {
        FAKE.set(FakeLibrary { providers: vec![ANALYTIC], running_provider: Some(ANALYTIC), ..FakeLibrary::default() });
        let hudless = |chain: Chain<_>| chain.with(CreateFrameGenerationHudless { format, ..Default::default() });
        // SAFETY: no device is used.
        let made = unsafe { Context::create(&api(), null_mut(), Choice::Any, head(), hudless) };
        assert_eq!(made.is_ok(), fits, "{format:?}");
        let field = made.err().and_then(|error| error.offending_field().map(str::to_owned));
        assert_eq!(field.as_deref(), (!fits).then_some("format"));
    }
}

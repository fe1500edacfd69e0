//! Mutants: each field of each struct of ffx-api written otherwise on its way to the double of AMD's libraries, which must notice, by
//! its answer or by its picture. What it does not notice stands in a list, with the reason. On Windows, or in the lab.
#![cfg(windows)]

use std::collections::BTreeMap;
use std::ffi::{CStr, c_void};
use std::ops::RangeInclusive;
use std::os::windows::ffi::OsStrExt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use cairn::ffx::bindings::{
    Coordinates, CreateFlags, CreateFrameGeneration, Dimensions, Rect, Resource, ResourceState, SurfaceFormat,
    TransferFunction,
};
use cairn::ffx::{Api, Camera, Choice, Family, Frame, Generator, Part, Shot};
use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::Graphics::Direct3D12::{ID3D12CommandAllocator, ID3D12GraphicsCommandList};
use cairn::gpu::windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryW};
use cairn::gpu::windows::core::{Interface, PCSTR, PCWSTR};

#[path = "ffx/pictures.rs"]
mod pictures;
#[path = "ffx/stage.rs"]
#[allow(dead_code, reason = "each test program uses its part")]
mod stage;
#[path = "ffx/table.rs"]
mod table;
use pictures::{Kept, Textures};
use stage::{ANALYTIC_20, ML, Stage};
use table::{Kind, Struct};

const SIZE: Dimensions = Dimensions { width: 32, height: 24 };

/// One field, written otherwise.
#[derive(Debug, Clone, Copy)]
struct Mutant {
    id: u64,
    offset: usize,
    kind: Kind,
    change: Change,
}

/// How. Numbers are all of their bits; the other field of an exchange is the next of the same kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Change {
    Zero,
    Largest,
    NotANumber,
    OneMore,
    Exchanged(usize),
}

/// What the call was made of, before it was changed: the place of each field with its bytes.
type Before = Vec<(*mut u8, Vec<u8>)>;

/// The five functions of a copy.
#[derive(Clone, Copy)]
struct Functions {
    create: unsafe extern "C" fn(*mut c_void, *mut u8, *const c_void) -> u32,
    destroy: unsafe extern "C" fn(*mut c_void, *const c_void) -> u32,
    configure: unsafe extern "C" fn(*mut c_void, *mut u8) -> u32,
    query: unsafe extern "C" fn(*mut c_void, *mut u8) -> u32,
    dispatch: unsafe extern "C" fn(*mut c_void, *mut u8) -> u32,
}

/// What stands between the library and a copy.
struct Between {
    copy: Option<Functions>,
    /// What is written otherwise on its way.
    mutant: Option<Mutant>,
    /// It was on its way, and what it changed was not the same before.
    hit: bool,
    /// A call was answered by a failure.
    refused: bool,
}

static BETWEEN: Mutex<Between> = Mutex::new(Between { copy: None, mutant: None, hit: false, refused: false });

fn held() -> MutexGuard<'static, Between> {
    BETWEEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hands a call on, with the mutant in its chain.
///
/// # Safety
/// A linked chain, which may be written and nobody else uses meanwhile.
unsafe fn hand_on(head: *mut u8, call: impl FnOnce(&Functions) -> u32) -> u32 {
    let mut held = held();
    // SAFETY: the caller's promise.
    let before = held.mutant.map_or(Before::new(), |mutant| unsafe { mutant.change(head) });
    let code = call(&held.copy.expect("a copy was loaded"));
    held.hit |= !before.is_empty();
    held.refused |= code != 0;
    for (place, bytes) in before {
        // SAFETY: where these bytes were before.
        unsafe { place.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
    }
    code
}

impl Mutant {
    /// Changes the link of its kind, where the chain has one.
    ///
    /// # Safety
    /// A linked chain, which may be written and nobody else uses meanwhile.
    unsafe fn change(&self, head: *mut u8) -> Before {
        let (mut before, mut at) = (Before::new(), head);
        while !at.is_null() {
            // SAFETY: a link of the chain: its id, and the address of the next.
            let (id, next) = unsafe { (at.cast::<u64>().read(), at.cast::<*mut u8>().add(1).read()) };
            if id == self.id {
                // SAFETY: the struct of that id has the field there, by its published layout.
                unsafe { self.apply(at, &mut before) };
                break;
            }
            at = next;
        }
        before
    }

    /// # Safety
    /// The struct that it is a mutant of, which may be written.
    unsafe fn apply(&self, head: *mut u8, before: &mut Before) {
        let size = self.kind.size();
        let bytes = |offset: usize| {
            // SAFETY: a field of the struct.
            unsafe { std::slice::from_raw_parts(head.add(offset), size) }.to_vec()
        };
        let old = bytes(self.offset);
        let new = match self.change {
            Change::Zero => vec![0; size],
            Change::Largest if self.kind == Kind::Float => f32::MAX.to_le_bytes().to_vec(),
            Change::Largest if self.kind == Kind::Signed => i32::MAX.to_le_bytes().to_vec(),
            Change::Largest => vec![0xff; size],
            Change::NotANumber => f32::NAN.to_le_bytes().to_vec(),
            Change::OneMore if self.kind == Kind::Float => {
                let value = f32::from_le_bytes(old[..].try_into().expect("4 bytes"));
                (value + 1.0).to_le_bytes().to_vec()
            }
            Change::OneMore => {
                let mut wide = [0; 8];
                wide[..size].copy_from_slice(&old);
                u64::from_le_bytes(wide).wrapping_add(1).to_le_bytes()[..size].to_vec()
            }
            Change::Exchanged(other) => bytes(other),
        };
        if new == old {
            return;
        }
        let mut write = |offset: usize, new: &[u8], old: Vec<u8>| {
            // SAFETY: a field of the struct, of that size.
            unsafe {
                head.add(offset).copy_from_nonoverlapping(new.as_ptr(), size);
                before.push((head.add(offset), old));
            }
        };
        if let Change::Exchanged(other) = self.change {
            write(other, &old, new.clone());
        }
        write(self.offset, &new, old);
    }
}

unsafe extern "C" fn create(context: *mut c_void, head: *mut u8, callbacks: *const c_void) -> u32 {
    // SAFETY: handed on as it came, but for the mutant.
    unsafe { hand_on(head, |copy| (copy.create)(context, head, callbacks)) }
}

unsafe extern "C" fn destroy(context: *mut c_void, callbacks: *const c_void) -> u32 {
    // SAFETY: handed on as it came.
    unsafe { hand_on(std::ptr::null_mut(), |copy| (copy.destroy)(context, callbacks)) }
}

unsafe extern "C" fn configure(context: *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: handed on as it came, but for the mutant.
    unsafe { hand_on(head, |copy| (copy.configure)(context, head)) }
}

unsafe extern "C" fn query(context: *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: handed on as it came, but for the mutant.
    unsafe { hand_on(head, |copy| (copy.query)(context, head)) }
}

unsafe extern "C" fn dispatch(context: *mut c_void, head: *mut u8) -> u32 {
    // SAFETY: handed on as it came, but for the mutant.
    unsafe { hand_on(head, |copy| (copy.dispatch)(context, head)) }
}

/// The functions above, before the copy that plays so.
fn api(stage: &Stage) -> Api {
    let path = stage.0.join(Part::FrameGeneration.file_name());
    let path: Vec<u16> = path.as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: a path that ends with a zero, of the double.
    let module = unsafe { LoadLibraryW(PCWSTR(path.as_ptr())) }.expect("the copy loads");
    let find = |name: &CStr| {
        // SAFETY: a loaded module and a name that ends with a zero.
        unsafe { GetProcAddress(module, PCSTR(name.as_ptr().cast())) }.expect("it is exported")
    };
    let [create_name, destroy_name, configure_name, query_name, dispatch_name] = Api::EXPORTS;
    type Found = unsafe extern "system" fn() -> isize;
    // SAFETY: ffx-api's functions by their names; structs and contexts are addresses here.
    let copy = unsafe {
        Functions {
            create: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8, *const c_void) -> u32>(
                find(create_name),
            ),
            destroy: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *const c_void) -> u32>(find(
                destroy_name,
            )),
            configure: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8) -> u32>(find(
                configure_name,
            )),
            query: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8) -> u32>(find(query_name)),
            dispatch: std::mem::transmute::<Found, unsafe extern "C" fn(*mut c_void, *mut u8) -> u32>(find(
                dispatch_name,
            )),
        }
    };
    held().copy = Some(copy);
    let ours = |name: &CStr| -> *const c_void {
        match name {
            name if name == create_name => create as *const c_void,
            name if name == destroy_name => destroy as *const c_void,
            name if name == configure_name => configure as *const c_void,
            name if name == query_name => query as *const c_void,
            _ => dispatch as *const c_void,
        }
    };
    // SAFETY: functions that hand on to ffx-api's of their names, and stay.
    unsafe { Api::from_exports(ours) }.expect("all are there")
}

/// What a frame is made of, with all that can be told of one.
struct Scene {
    gpu: Gpu,
    textures: Textures,
    /// The frame before, and the frame.
    shown: [Kept; 2],
    hudless: [Kept; 2],
    lens: Kept,
    output: Kept,
    allocator: ID3D12CommandAllocator,
    /// Closed between frames.
    list: ID3D12GraphicsCommandList,
}

impl Scene {
    fn new() -> Self {
        let gpu = Gpu::on_adapter(None).expect("a device");
        let textures = Textures::new(&gpu, SIZE);
        let [shown, hudless] = [0, 1].map(|interface| {
            [0, 5].map(|moved| {
                let made = Textures::new(&gpu, SIZE).color;
                textures.fill(&made, |x, y| {
                    let at = |phase: u32| ((x + moved) * phase * 5 + y * (9 - phase)) as u8;
                    if interface == 0 && y > 20 { [255, 0, 255, 255] } else { [at(1), at(2), at(3), 255] }
                });
                made
            })
        });
        let half = |v: f32| half::f16::from_f32(v).to_le_bytes();
        let halves = |x: f32, y: f32| [half(x)[0], half(x)[1], half(y)[0], half(y)[1]];
        let lens = Textures::new(&gpu, SIZE).motion;
        textures.fill(&lens, |x, _| halves(x as f32 / 512.0, 0.03));
        textures.fill(&textures.depth, |x, y| (0.25 + 0.5 * ((x / 4 + y / 3) % 2) as f32).to_le_bytes());
        textures.fill(&textures.motion, |x, y| halves((x / 4) as f32 - 3.0, (y / 3) as f32 - 2.0));
        let output = Textures::new(&gpu, SIZE).output;
        let kind = gpu.frames().kind();
        // SAFETY: a live device.
        let allocator: ID3D12CommandAllocator =
            unsafe { gpu.device().CreateCommandAllocator(kind) }.expect("an allocator");
        // SAFETY: a live device and allocator.
        let list: ID3D12GraphicsCommandList =
            unsafe { gpu.device().CreateCommandList(0, kind, &allocator, None) }.expect("a list");
        // SAFETY: an open list.
        unsafe { list.Close() }.expect("a closed list");
        Self { gpu, textures, shown, hudless, lens, output, allocator, list }
    }

    fn generator(&self, api: &Api, family: Family) -> cairn::Result<Generator> {
        let head = CreateFrameGeneration {
            flags: CreateFlags::MOTION_JITTER | CreateFlags::DEPTH_INVERTED | CreateFlags::HIGH_DYNAMIC_RANGE,
            display_size: SIZE,
            max_render_size: SIZE,
            back_buffer_format: SurfaceFormat::R8G8B8A8_UNORM,
            ..Default::default()
        };
        let hudless = Some(SurfaceFormat::R8G8B8A8_UNORM);
        // SAFETY: a live device, which outlives the generator.
        unsafe { Generator::create(api, self.gpu.device().as_raw(), Choice::Require(family), head, hudless) }
    }

    /// Runs a list, always the same one, and waits.
    fn run(&self, record: impl FnOnce(&ID3D12GraphicsCommandList)) {
        // SAFETY: what was recorded before has run.
        unsafe {
            self.allocator.Reset().expect("it is not in use");
            self.list.Reset(&self.allocator, None).expect("it is closed");
        }
        record(&self.list);
        // SAFETY: an open list.
        unsafe { self.list.Close() }.expect("a closed list");
        let lists = [self.list.cast().expect("a list")];
        self.gpu.frames().submit(&lists).expect("a submission").wait().expect("it is done");
    }

    /// The frame after the one before; what is between, or what was answered.
    fn pair(&self, generator: &mut Generator, mutant: Option<Mutant>) -> cairn::Result<Vec<[u8; 4]>> {
        let mut answer = Ok(());
        self.run(|list| {
            let resource = |kept: &Kept| Resource::of(&kept.resource, ResourceState::UNORDERED_ACCESS);
            for number in 0..2 {
                let frame = self.textures.frame(list, number == 0);
                let frame = Frame {
                    color: resource(&self.shown[number]),
                    output: resource(&self.output),
                    hudless: resource(&self.hudless[number]),
                    distortion: resource(&self.lens),
                    shot: Shot {
                        jitter: Coordinates { x: 0.25, y: -0.5 },
                        motion_scale: Coordinates { x: 1.5, y: 1.25 },
                        camera: Camera { position: [3.0, 4.0, 5.0], ..Camera::default() },
                        rect: Rect { left: 1, top: 2, width: 30, height: 21 },
                        transfer: TransferFunction::PQ,
                        luminance: [0.0, 10.0],
                        ..frame.shot
                    },
                    ..frame
                };
                held().mutant = mutant.filter(|_| number == 1);
                // SAFETY: an open list of the generator's device, and textures that live until it has run.
                answer = unsafe { generator.record(&frame) };
                held().mutant = None;
            }
        });
        answer?;
        Ok(self.textures.pixels(&self.output))
    }
}

/// How a mutant was noticed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Noticed {
    ByAnswer,
    ByVerdict,
    ByPicture,
    Not,
}

/// Ids of structs that there are: the general ones, and those of frame generation.
const NUMBERED: [RangeInclusive<u64>; 2] = [1..=7, 0x2_0001..=0x2_000e];

/// Mutants of a struct: of each field each change that there is for its kind.
fn mutants(of: &Struct) -> Vec<(String, Mutant)> {
    let mut found = Vec::new();
    for (index, (field, offset, kind)) in of.fields.iter().enumerate() {
        let (offset, kind) = (*offset, *kind);
        let next = of.fields[index + 1..].iter().find(|(_, _, other)| *other == kind).map(|(_, offset, _)| *offset);
        let exchange = next.map(Change::Exchanged);
        let changes: Vec<_> = match kind {
            Kind::Answer => Vec::new(),
            Kind::Pointer => vec![Change::Zero],
            Kind::Float => [Change::Zero, Change::Largest, Change::NotANumber, Change::OneMore]
                .into_iter()
                .chain(exchange)
                .collect(),
            Kind::Id if NUMBERED.iter().any(|of_effect| of_effect.contains(&(of.id + 1))) => {
                vec![Change::Zero, Change::Largest]
            }
            Kind::Id => vec![Change::Zero, Change::Largest, Change::OneMore],
            Kind::Number(_) | Kind::Signed => {
                [Change::Zero, Change::Largest, Change::OneMore].into_iter().chain(exchange).collect()
            }
        };
        found.extend(changes.into_iter().map(|change| {
            let name = match change {
                Change::Exchanged(_) => "exchanged".to_owned(),
                other => format!("{other:?}").to_lowercase(),
            };
            (format!("{}.{field} {name}", of.name), Mutant { id: of.id, offset, kind, change })
        }));
    }
    found
}

/// What was noticed so far, and what of it is not in the list.
#[derive(Default)]
struct Report {
    counts: BTreeMap<Noticed, usize>,
    missed: Vec<String>,
}

impl Report {
    fn add(&mut self, name: String, noticed: Noticed) {
        *self.counts.entry(noticed).or_default() += 1;
        if noticed == Noticed::Not {
            self.missed.push(name);
        }
    }
}

/// Tries one mutant: `act` gives the picture, or what was answered. None where it changes nothing.
fn noticed(
    stage: &Stage,
    truth: &[[u8; 4]],
    verdicts: &mut usize,
    act: impl FnOnce() -> cairn::Result<Vec<[u8; 4]>>,
) -> Option<Noticed> {
    (held().hit, held().refused) = (false, false);
    let picture = act();
    let before = std::mem::replace(verdicts, stage.judgement().len());
    let held = held();
    held.hit.then_some(match picture {
        Err(_) => Noticed::ByAnswer,
        Ok(_) if held.refused => Noticed::ByAnswer,
        Ok(_) if *verdicts > before => Noticed::ByVerdict,
        Ok(picture) if picture != truth => Noticed::ByPicture,
        Ok(_) => Noticed::Not,
    })
}

/// What is not noticed: a field, changes of it, and the reason.
const UNNOTICED: [(&str, &[&str], &str); 13] = [
    ("frameTimeDelta", &["largest", "onemore", "exchanged"], "any time above 0 is one, and half of it is half of it"),
    ("cameraNear", &["largest", "onemore", "exchanged"], POSSIBLE),
    ("cameraFar", &["largest", "onemore"], POSSIBLE),
    ("cameraFovAngleVertical", &["onemore"], POSSIBLE),
    ("viewSpaceToMetersFactor", &["largest", "onemore", "exchanged"], POSSIBLE),
    ("cameraPosition.x", &["zero", "largest", "onemore", "exchanged"], "a camera may be anywhere"),
    ("cameraPosition.y", &["zero", "largest", "onemore", "exchanged"], "a camera may be anywhere"),
    ("cameraPosition.z", &["zero", "largest", "onemore"], "a camera may be anywhere"),
    ("fpMessage", &["zero"], "that nobody listens is a choice"),
    ("debugLevel", &["zero", "largest", "onemore"], "how much is said is a choice"),
    ("maxRenderSize.width", &["onemore"], "frames may be smaller than the largest"),
    ("maxRenderSize.height", &["onemore"], "frames may be smaller than the largest"),
    ("version", &["onemore"], "the next release is there too"),
];

/// Why a camera's lens is not noticed.
const POSSIBLE: &str = "another camera has it, and the double's picture does not depend on the camera";

#[test]
fn what_is_written_otherwise_is_noticed_or_of_no_consequence() {
    let scene = Scene::new();
    let mut report = Report::default();
    for (role, family, of_prepare) in [
        (["sdk 2.1", ML, "quiet"], Family::Ml, table::of_prepare_v2()),
        (["sdk 2.0", ANALYTIC_20, "quiet"], Family::Analytic, table::of_prepare()),
    ] {
        let stage = Stage::empty().with(Part::FrameGeneration, &role);
        let api = api(&stage);
        let mut generator = scene.generator(&api, family).expect("a generator");
        let truth = scene.pair(&mut generator, None).expect("generated");
        assert_eq!(scene.pair(&mut generator, None).expect("generated"), truth, "it does the same each time");
        assert_eq!(stage.judgement(), [""; 0]);
        let mut verdicts = 0;
        // The structs that all releases have are the same in each.
        let of_frames = if family == Family::Ml { table::of_frames() } else { Vec::new() };
        for (name, mutant) in of_prepare.iter().chain(&of_frames).flat_map(mutants) {
            let found = noticed(&stage, &truth, &mut verdicts, || scene.pair(&mut generator, Some(mutant)));
            found.into_iter().for_each(|found| report.add(name.clone(), found));
        }
        assert_eq!(scene.pair(&mut generator, None).expect("generated"), truth, "nothing of them is left");
        if family == Family::Ml {
            for (name, mutant) in table::of_making().iter().flat_map(mutants) {
                let found = noticed(&stage, &truth, &mut verdicts, || {
                    held().mutant = Some(mutant);
                    let made = scene.generator(&api, family);
                    held().mutant = None;
                    // What was refused on the way needs no picture.
                    if held().refused { made.map(|_| Vec::new()) } else { scene.pair(&mut made?, None) }
                });
                found.into_iter().for_each(|found| report.add(name.clone(), found));
            }
        }
    }
    println!("mutants: {:?}", report.counts);
    let reason = |name: &str| {
        let (field, change) = name.split_once('.')?.1.split_once(' ')?;
        let is_it = |entry: &&(&str, &[&str], &str)| entry.0 == field && entry.1.contains(&change);
        UNNOTICED.iter().find(is_it).map(|(_, _, why)| *why)
    };
    for name in &report.missed {
        println!("not noticed: {name}: {}", reason(name).unwrap_or("?"));
    }
    let unexplained: Vec<_> = report.missed.iter().filter(|name| reason(name).is_none()).collect();
    assert!(unexplained.is_empty(), "{unexplained:?}");
    let listed =
        UNNOTICED.iter().flat_map(|(field, changes, _)| changes.iter().map(move |change| format!(".{field} {change}")));
    let stale: Vec<_> = listed.filter(|entry| !report.missed.iter().any(|name| name.ends_with(entry))).collect();
    assert!(stale.is_empty(), "these are noticed: {stale:?}");
    assert!(scene.gpu.removed().is_none());
}

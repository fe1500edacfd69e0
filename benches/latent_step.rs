//! The cost of a latent step relative to bare ONNX Runtime, as ratios of one run. `cargo xtask bench` runs it.
//!
//! The bare side runs the same transformer and decoder from the same files with the same session options, every input and
//! output bound beforehand, as often as a latent step runs them. It is a separate process, because a process has one ONNX Runtime
//! environment. Steps and bare runs alternate, so both run under the same load.

use std::alloc::{GlobalAlloc, Layout, System};
use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use cairn::bundle::{Bundle, LayerKind};
use cairn::runtime::{CpuOptions, Device, Ort};
use cairn::world::{CacheMode, ControlInput, OperatingPoint, Preset, Rollout, Schedule, StepInfo, World, WorldOptions};
use cairn::{LibrarySearch, Picture};
use ort::memory::Allocator;
use ort::session::builder::GraphOptimizationLevel;
use ort::session::{IoBinding, Session};
use ort::value::{Tensor, ValueType};

/// Counts the allocations of Rust code; ONNX Runtime has an allocator of its own.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps this function's own contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Argument that makes a process of this program the bare side.
const BARE: &str = "--bare-runs";

const WARM_UP: u64 = 3;

/// Minimum time and minimum number of steps to measure.
const AT_LEAST: (Duration, u64) = (Duration::from_secs(10), 5);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, flag, job @ ..] = arguments.as_slice()
        && flag == BARE
    {
        return bare(job);
    }
    let ort = Ort::find(&LibrarySearch::for_tools())?;
    let device = Device::cpu(&ort, CpuOptions::default())?;
    println!("{}", device.describe());
    for name in ["tiny", "demo"] {
        let path = bundle(name)?;
        let world = World::load(&device, &Bundle::open(&path)?, WorldOptions::default())?;
        measure(&ort, &world, &path)?;
        measure_slices(&world, &Bundle::open(&path)?)?;
    }
    Ok(())
}

/// Compares steps of a world in slices with those of the whole one. They alternate, so all run under the same load.
fn measure_slices(whole: &Arc<World>, bundle: &Arc<Bundle>) -> Result<(), Box<dyn Error>> {
    let layers = bundle.geometry().layers;
    let mut rollouts = vec![(1, seeded(whole)?, Vec::new())];
    for slices in [2, 4, layers] {
        let options = WorldOptions { slices: Some(slices), ..WorldOptions::default() };
        rollouts.push((slices, seeded(&World::load(whole.device(), bundle, options)?)?, Vec::new()));
    }
    let start = Instant::now();
    let mut step = 0;
    while step < WARM_UP + AT_LEAST.1 || start.elapsed() < 2 * AT_LEAST.0 {
        for (_, rollout, times) in &mut rollouts {
            let info = rollout.step(&ControlInput::default())?;
            if step >= WARM_UP {
                times.push((info.stages.denoise.time + info.stages.cache.time).as_secs_f64());
            }
        }
        step += 1;
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let all = median(&mut rollouts[0].2);
    println!("  passes of a step, median                 {:>10.2} ms", 1e3 * all);
    for (slices, _, times) in &mut rollouts[1..] {
        println!("  the same in {slices:>2} slices, relative           {:>10.3}", median(times) / all);
    }
    Ok(())
}

fn seeded(world: &Arc<World>) -> Result<Rollout, Box<dyn Error>> {
    let point = OperatingPoint {
        global_window: world.global_window(),
        schedule: Schedule::Stock,
        cache_mode: CacheMode::Separate,
        ..Preset::Decoded60.operating_point()
    };
    let mut rollout = Rollout::new(world, &point, 1)?;
    rollout.append(&Picture::from_rgba(64, 36, vec![128; 64 * 36 * 4])?)?;
    Ok(rollout)
}

/// The random-weight world `name`, from the folder that `cargo xtask` names.
fn bundle(name: &str) -> Result<PathBuf, Box<dyn Error>> {
    match std::env::var_os("CAIRN_TEST_BUNDLE") {
        Some(folder) => Ok(PathBuf::from(folder).join(name)),
        None => Ok(provision::bundle(name, &provision::Console::new())?),
    }
}

fn measure(ort: &Ort, world: &Arc<World>, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut rollout = seeded(world)?;
    let passes = rollout.planner().plan_step(&ControlInput::default())?.dsigmas.len() + 1;
    let mut bare = BareProcess::start(ort, world, path, passes)?;
    let (mut ours, mut theirs) = (Duration::ZERO, Duration::ZERO);
    let (mut steps, mut allocations, mut ring_bytes) = (0, 0, 0);
    let mut last = StepInfo::default();
    let mut step = 0;
    while step < WARM_UP || steps < AT_LEAST.1 || ours + theirs < AT_LEAST.0 {
        let (began, before) = (Instant::now(), ALLOCATIONS.load(Ordering::Relaxed));
        let info = rollout.step(&ControlInput::default())?;
        last = info;
        let (took, made) = (began.elapsed(), ALLOCATIONS.load(Ordering::Relaxed) - before);
        let bare_runs = bare.run_step()?;
        if step >= WARM_UP {
            ours += took;
            theirs += bare_runs;
            allocations += made;
            ring_bytes += info.ring_bytes;
            steps += 1;
        }
        step += 1;
    }

    let per_step = |total: Duration| total.as_secs_f64() * 1e3 / steps as f64;
    println!("\n{world:?}: {steps} latent steps of {passes} passes and a decoding");
    println!("  a latent step                            {:>10.2} ms", per_step(ours));
    println!("  as many bare runs with bound buffers     {:>10.2} ms", per_step(theirs));
    println!("  ratio (1.03 is the aim)                  {:>10.3}", ours.as_secs_f64() / theirs.as_secs_f64());
    println!("  allocations of ours per step             {:>10.2}", allocations as f64 / steps as f64);
    println!("  bytes into the ring per step             {:>10.0}", ring_bytes as f64 / steps as f64);
    println!("  new slabs of a step, all layers          {:>10}", world.slab_bytes(&LayerKind::ALL));
    println!("  new slabs of a step, local layers        {:>10}", world.slab_bytes(&[LayerKind::Local]));
    println!("  other bytes copied on the device         {:>10}", last.bytes.copied - last.ring_bytes);
    println!("  bytes up to the device                   {:>10}", last.bytes.uploaded);
    println!("  bytes down from the device               {:>10}", last.bytes.read);
    println!("  K and V moved inside the graph per pass  {:>10}", world.concat_bytes_per_pass());
    Ok(())
}

/// The process that runs the graphs without Cairn.
struct BareProcess {
    process: Child,
    requests: ChildStdin,
    times: BufReader<ChildStdout>,
}

impl BareProcess {
    fn start(ort: &Ort, world: &World, path: &Path, passes: usize) -> Result<Self, Box<dyn Error>> {
        let geometry = &world.manifest().geometry;
        let graphs = &world.manifest().graphs.f32;
        let tokens = geometry.tokens;
        let local = geometry.local.window * tokens;
        let global = world.global_window() / geometry.global.dilation * tokens;
        let mut process = Command::new(std::env::current_exe()?)
            .arg(BARE)
            .args([ort.path(), &path.join(&graphs.transformer), &path.join(&graphs.decoder)])
            .args([world.device().threads().to_string(), passes.to_string()])
            .args([local, tokens, global].map(|n| n.to_string()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let requests = process.stdin.take().ok_or("its input")?;
        let times = BufReader::new(process.stdout.take().ok_or("its output")?);
        Ok(Self { process, requests, times })
    }

    /// Runs the graphs of one latent step; returns their time.
    fn run_step(&mut self) -> Result<Duration, Box<dyn Error>> {
        self.requests.write_all(b"\n")?;
        let mut answer = String::new();
        self.times.read_line(&mut answer)?;
        Ok(Duration::from_nanos(answer.trim().parse().map_err(|e| format!("the bare side ended: {e}"))?))
    }
}

impl Drop for BareProcess {
    fn drop(&mut self) {
        // It exits when its input is closed; it may have exited already.
        _ = self.process.kill();
        _ = self.process.wait();
    }
}

/// The bare side: for each line of input, runs one latent step's graphs and prints their time in nanoseconds.
fn bare(job: &[String]) -> Result<(), Box<dyn Error>> {
    let [library, transformer, decoder, numbers @ ..] = job else { return Err("library, graphs, numbers".into()) };
    let numbers: Vec<i64> = numbers.iter().map(|n| n.parse()).collect::<Result<_, _>>()?;
    let &[threads, passes, local, tokens, global] = numbers.as_slice() else { return Err("five numbers".into()) };
    let environment = ort::init_from(library)?.build()?;
    let load = |model: &str| -> Result<Graph, Box<dyn Error>> {
        let mut builder = Session::builder(&environment)?
            .with_optimization_level(GraphOptimizationLevel::Level3)?
            .with_parallel_execution(false)?
            .with_intra_threads(usize::try_from(threads)?)?
            .with_intra_op_spinning(true)?
            .with_config_entry("session.force_spinning_stop", "1")?;
        for (name, size) in [
            ("local_past", local),
            ("local_keys", local + tokens),
            ("global_past", global),
            ("global_keys", global + tokens),
        ] {
            builder = builder.with_dimension_override(name, size)?;
        }
        Graph::bind(builder.commit_from_file(model)?)
    };
    let (mut transformer, mut decoder) = (load(transformer)?, load(decoder)?);
    for line in std::io::stdin().lines() {
        line?;
        let began = Instant::now();
        for _ in 0..passes {
            transformer.run()?;
        }
        decoder.run()?;
        println!("{}", began.elapsed().as_nanos());
    }
    Ok(())
}

/// A session with every input and output bound.
struct Graph {
    session: Session,
    binding: IoBinding,
}

impl Graph {
    fn bind(session: Session) -> Result<Self, Box<dyn Error>> {
        let mut binding = session.create_binding()?;
        let allocator = Allocator::default();
        for (number, outlet) in session.inputs().iter().chain(session.outputs()).enumerate() {
            let ValueType::Tensor { shape, .. } = outlet.dtype() else { return Err("a graph of tensors".into()) };
            let mut tensor = Tensor::<f32>::new(&allocator, shape.clone())?;
            // Typical values: zeroes and denormal numbers have a speed of their own.
            tensor.extract_tensor_mut().1.fill(0.1);
            if number < session.inputs().len() {
                binding.bind_input(outlet.name(), &tensor)?;
            } else {
                binding.bind_output(outlet.name(), tensor)?;
            }
        }
        Ok(Self { session, binding })
    }

    fn run(&mut self) -> Result<(), Box<dyn Error>> {
        drop(self.session.run_binding(&self.binding)?);
        Ok(())
    }
}

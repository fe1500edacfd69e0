//! The thread that loads the world and steps it with the player's controls, or with those of a recorded walk.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cairn::bundle::Bundle;
use cairn::present::presenter::extract;
use cairn::world::World;
use cairn::world::{
    ControlInput, GuidanceSource, KeptAnchor, Key, KeySet, OperatingPoint, Rollout, ScriptRecorder, WorldOptions,
};
use cairn::{Error, ErrorKind, Result};
use parking_lot::{Condvar, Mutex};
use scenes::Family;
use sha2::{Digest, Sha256};

use super::PlayOptions;
use super::controls::{Input, LEARNED};
use super::playback::GuidedAnchor;
use super::walk_file::WalkFile;
use crate::manifest::Input as FileInput;
use crate::progress::Progress;
use crate::{device, inputs, level, seed_picture};

/// Message from the worker to the window.
pub(super) enum Message {
    /// Text to show until the first anchor.
    Status(String),
    /// An anchor. The first of a walk has number 0.
    Anchor { anchor: GuidedAnchor, level: Family },
    /// Text about a recording or a replay.
    Note(String),
    /// The walk has reached its end: no more anchors come.
    Ended,
    /// The worker has stopped.
    Failed(Error),
}

/// Requests of the window to the worker.
#[derive(Default)]
pub(super) struct Requests {
    pub(super) input: Input,
    /// Start again, in this level.
    pub(super) level: Option<Family>,
    /// Start or stop a recording.
    pub(super) record: bool,
    pub(super) paused: bool,
    pub(super) quit: bool,
}

/// The requests, and a signal that they changed.
#[derive(Default)]
pub(super) struct Shared {
    pub(super) requests: Mutex<Requests>,
    pub(super) changed: Condvar,
}

impl Shared {
    /// Changes the requests and wakes the worker.
    pub(super) fn change(&self, change: impl FnOnce(&mut Requests)) {
        change(&mut self.requests.lock());
        self.changed.notify_all();
    }
}

/// Runs until the window asks it to quit.
///
/// # Errors
/// Errors of loading and stepping the world and of writing a recording.
pub(super) fn run(options: &PlayOptions, shared: &Shared, send: &dyn Fn(Message)) -> Result<()> {
    send(Message::Status("loading the world".to_owned()));
    let (ort, _) = inputs::onnxruntime(&Progress::quiet())?;
    let (bundle, input) = inputs::world(options.world.as_deref(), &Progress::quiet())?;
    options.point.check_for(bundle.geometry())?;
    let world_options = WorldOptions::for_point(&options.point);
    let world = device::load(options.device, &ort, options.threads, &bundle, &world_options)?.world;
    if let Some(recorded) = options.replay.as_ref().and_then(|walk| walk.world.as_ref())
        && *recorded != input.sha256
    {
        send(Message::Note("this walk was recorded in another world".to_owned()));
    }
    let mut rollout = Rollout::new(&world, &options.point, options.seed)?;
    let mut stepper = Stepper { options, shared, send, known: known_keys(options, &bundle), world, input };
    let mut family = options.level;
    // Only the first walk repeats the recorded one.
    let mut replay = options.replay.as_ref();
    while let Some(next) = stepper.walk(&mut rollout, family, replay)? {
        family = next;
        replay = None;
        rollout.reset()?;
    }
    Ok(())
}

/// The keys that the world gets: those that it has learned, as far as is known.
fn known_keys(options: &PlayOptions, bundle: &Bundle) -> KeySet {
    let buttons = bundle.manifest().controls.buttons;
    let all = if options.world.is_none() { LEARNED.to_vec() } else { (0..=255).map(Key).collect() };
    all.into_iter().filter(|key| u32::from(key.0) < buttons).collect()
}

struct Stepper<'a> {
    options: &'a PlayOptions,
    shared: &'a Shared,
    send: &'a dyn Fn(Message),
    known: KeySet,
    world: Arc<World>,
    input: FileInput,
}

/// A walk since the start of its level.
struct Walk {
    family: Family,
    script: ScriptRecorder,
    /// Number of the last latent.
    number: u64,
    digest: Sha256,
    recording: bool,
}

/// The worker's next action.
enum Next {
    Step(ControlInput),
    Level(Family),
    Quit,
}

impl Stepper<'_> {
    /// Walks through a level from its start. Returns the level to go to next; `None` to quit.
    fn walk(&mut self, rollout: &mut Rollout, family: Family, replay: Option<&WalkFile>) -> Result<Option<Family>> {
        (self.send)(Message::Status(format!("drawing the first picture of {family}")));
        let (width, height) = self.world.render_size();
        let seed = seed_picture::draw(&level::scene(family), width, height)?;
        rollout.append(&seed)?;
        let mut walk =
            Walk { family, script: ScriptRecorder::new(), number: 0, digest: Sha256::new(), recording: false };
        let mut last = self.anchor(rollout, &mut walk, None)?;
        let point = &self.options.point;
        let interval = Duration::from_secs(1) / point.latents_per_second;
        let mut started = Instant::now();
        loop {
            let end = self.options.latents.is_some_and(|end| walk.number >= end);
            let next = self.next(&mut walk, replay, started, interval, end)?;
            let controls = match next {
                Next::Step(controls) => controls,
                Next::Level(family) => return Ok(Some(family)),
                Next::Quit => return Ok(None),
            };
            started = Instant::now();
            let (from, until) = point.span_of_latent(walk.number + 1);
            rollout.step(&controls)?;
            walk.number += 1;
            walk.script.step(from, until, &controls)?;
            last = self.anchor(rollout, &mut walk, Some(&last))?;
            self.compare(&walk, replay);
        }
    }

    /// Waits until the next step may start, and returns its controls. Writes recordings meanwhile. `end`: no more steps.
    fn next(
        &self,
        walk: &mut Walk,
        replay: Option<&WalkFile>,
        started: Instant,
        interval: Duration,
        end: bool,
    ) -> Result<Next> {
        if end {
            self.stop_recording(walk)?;
            (self.send)(Message::Ended);
        }
        let mut requests = self.shared.requests.lock();
        loop {
            if std::mem::take(&mut requests.record) {
                drop(requests);
                if walk.recording {
                    self.stop_recording(walk)?;
                } else {
                    walk.recording = true;
                    (self.send)(Message::Note("recording; R stops and writes it".to_owned()));
                }
                requests = self.shared.requests.lock();
            }
            if requests.quit || requests.level.is_some() {
                let (quit, level) = (requests.quit, requests.level.take());
                drop(requests);
                self.stop_recording(walk)?;
                return Ok(level.filter(|_| !quit).map_or(Next::Quit, Next::Level));
            }
            if requests.paused || end {
                self.shared.changed.wait(&mut requests);
                continue;
            }
            let elapsed = started.elapsed();
            if elapsed >= interval {
                let (from, until) = self.options.point.span_of_latent(walk.number + 1);
                let recorded = replay.filter(|walk| walk.script.duration() > from);
                return Ok(Next::Step(match recorded {
                    Some(walk) => walk.script.span(from, until)?,
                    None => requests.input.take(self.known, interval.as_secs_f64() / elapsed.as_secs_f64())?,
                }));
            }
            self.shared.changed.wait_for(&mut requests, interval - elapsed);
        }
    }

    /// Copies the rollout's last anchor, finds its motion and depth, and sends it.
    fn anchor(&self, rollout: &mut Rollout, walk: &mut Walk, last: Option<&GuidedAnchor>) -> Result<GuidedAnchor> {
        let anchor = Arc::new(KeptAnchor::of(rollout, last.is_none())?);
        for value in anchor.latent()? {
            walk.digest.update(value.to_le_bytes());
        }
        let guidance = match last {
            Some(last) => Some(Arc::new(extract(GuidanceSource::BEST, &last.anchor, &anchor)?)),
            None => None,
        };
        let anchor = GuidedAnchor { anchor, guidance };
        (self.send)(Message::Anchor { anchor: anchor.clone(), level: walk.family });
        Ok(anchor)
    }

    /// Compares the latents with those of the recorded walk, at its end.
    fn compare(&self, walk: &Walk, replay: Option<&WalkFile>) {
        let Some((count, sha256)) = replay.and_then(|replay| replay.latents.as_ref()) else { return };
        if *count == walk.number {
            let same = walk.sha256() == *sha256;
            (self.send)(Message::Note(match same {
                true => format!("the replay is the same: {count} latents are equal to the bit"),
                false => "the replay is NOT the same: another world, device, thread count or version?".to_owned(),
            }));
        }
    }

    /// Writes the walk if it is being recorded.
    fn stop_recording(&self, walk: &mut Walk) -> Result<()> {
        if !std::mem::take(&mut walk.recording) {
            return Ok(());
        }
        let point: &OperatingPoint = &self.options.point;
        let file = WalkFile {
            script: walk.script.clone().finish(point.time_of_latent(walk.number))?,
            level: Some(walk.family.name().to_owned()),
            world: Some(self.input.sha256.clone()),
            operating_point: Some(point.to_string()),
            seed: Some(self.options.seed),
            latents: Some((walk.number, walk.sha256())),
        };
        let path = file.save(&self.options.out)?;
        (self.send)(Message::Note(format!("written: {}", path.display())));
        Ok(())
    }
}

impl Walk {
    /// SHA-256 of all latents so far, as hexadecimal digits.
    fn sha256(&self) -> String {
        self.digest.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Error for a thread that cannot be started.
pub(super) fn no_thread(cause: &std::io::Error) -> Error {
    Error::new(ErrorKind::OutOfMemory, format!("no thread for the world: {cause}"))
}

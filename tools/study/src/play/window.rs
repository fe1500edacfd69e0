//! The window: events of mouse and keyboard go to the worker, and the frame that is due is drawn.

use std::num::NonZeroU32;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cairn::guidance::visual;
use cairn::present::presenter::FrameInfo;
use cairn::present::upscale::{Filter, Upscaler};
use cairn::{Error, ErrorKind, Picture, Result};
use scenes::{Family, LANDSCAPES};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{DeviceEvent, DeviceId, ElementState, MouseButton, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy, OwnedDisplayHandle};
use winit::keyboard::PhysicalKey;
use winit::window::{CursorGrabMode, Window, WindowId};

use super::PlayOptions;
use super::controls::{Command, Meaning, meaning};
use super::overlay::{FrameTimes, Help, Overlay};
use super::pacing::describe;
use super::playback::{InBetweenMode, Playback, next_multiplier};
use super::worker::{self, Message, Shared};
use crate::picture::paste;

/// How long a note is shown.
const NOTE: Duration = Duration::from_secs(4);
/// Time after which the window is drawn anew although no frame is due.
const IDLE: Duration = Duration::from_millis(250);
/// Shortest time between two drawings: a display shows no more.
const SHORTEST: Duration = Duration::from_millis(8);
/// Motion in pixels after which a pressed button drags instead of clicking.
const DRAG: f64 = 4.0;
/// Motion in pixels per anchor that the view of motion shows in full colour.
const FULL_SCALE: f32 = 12.0;

/// What of a frame is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum View {
    Picture,
    Motion,
    Depth,
}

/// Opens the window and plays until it is closed.
///
/// # Errors
/// `Unsupported` without a display; errors of the world and of recordings.
pub(crate) fn run(options: PlayOptions) -> Result<()> {
    let event_loop = EventLoop::<Message>::with_user_event().build().map_err(no_window)?;
    let context = softbuffer::Context::new(event_loop.owned_display_handle()).map_err(no_window)?;
    let (proxy, shared, options) = (event_loop.create_proxy(), Arc::<Shared>::default(), Arc::new(options));
    shared.change(|requests| requests.record = options.record);
    let thread = start_worker(&options, &shared, proxy)?;
    let mut app = App::new(&options, &shared, context)?;
    let ran = event_loop.run_app(&mut app).map_err(no_window);
    shared.change(|requests| requests.quit = true);
    // Notes of a recording that ends with the program go to standard output.
    let worker = thread.join().map_err(|_| Error::new(ErrorKind::Device, "the world stopped unexpectedly"));
    ran?;
    match app.failure.take() {
        Some(error) => Err(error),
        None => worker?,
    }
}

fn start_worker(
    options: &Arc<PlayOptions>,
    shared: &Arc<Shared>,
    proxy: EventLoopProxy<Message>,
) -> Result<std::thread::JoinHandle<Result<()>>> {
    let (options, shared) = (Arc::clone(options), Arc::clone(shared));
    let work = move || {
        let send = |message| {
            if let Message::Note(text) = &message {
                println!("{text}");
            }
            // The window may be closed already.
            _ = proxy.send_event(message);
        };
        let done = worker::run(&options, &shared, &send);
        if let Err(error) = &done {
            send(Message::Failed(Error::new(error.kind(), error.to_string())));
        }
        done
    };
    std::thread::Builder::new().name("world".into()).spawn(work).map_err(|e| worker::no_thread(&e))
}

/// Error of a display that is missing or refuses a window.
fn no_window(cause: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Unsupported, format!("no window can be opened: {cause}")).remedy(
        "Run it on a desktop; on Linux with X11 or Wayland and libxkbcommon, with DISPLAY or WAYLAND_DISPLAY set",
    )
}

struct App<'a> {
    options: &'a PlayOptions,
    shared: &'a Shared,
    context: softbuffer::Context<OwnedDisplayHandle>,
    display: Option<Display>,
    playback: Playback,
    began: Instant,
    level: Family,
    view: View,
    /// Whether the motion that was drawn last has depth.
    has_depth: bool,
    help: Help,
    graph: bool,
    times: FrameTimes,
    drawn: Option<(Instant, FrameKey)>,
    /// Shown until the first anchor.
    status: Option<String>,
    note: Option<(String, Instant)>,
    paused: bool,
    recording: bool,
    mouse: Mouse,
    /// No more anchors come: the window closes when the last is shown.
    ended: bool,
    failure: Option<Error>,
    source: Option<Picture>,
    canvas: Option<Picture>,
    upscaler: Option<Upscaler>,
}

/// The window and its pixels.
struct Display {
    window: Rc<Window>,
    surface: softbuffer::Surface<OwnedDisplayHandle, Rc<Window>>,
}

/// Which frame of which walk a drawing shows.
type FrameKey = (u64, u64, u32);

fn frame_key(info: &FrameInfo) -> FrameKey {
    (info.previous, info.current, info.t.to_bits())
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Mouse {
    Free {
        at: Option<[f64; 2]>,
    },
    /// A button is down in the window; `moved` in pixels so far.
    Pressed {
        at: [f64; 2],
        moved: f64,
    },
    Captured,
}

impl<'a> App<'a> {
    fn new(
        options: &'a PlayOptions,
        shared: &'a Shared,
        context: softbuffer::Context<OwnedDisplayHandle>,
    ) -> Result<Self> {
        let point = &options.point;
        let mut playback = Playback::new(point.latents_per_second, point.pictures_per_latent, options.multiplier)?;
        if options.anchors {
            playback.set(InBetweenMode::Nothing, options.multiplier)?;
        }
        Ok(Self {
            options,
            shared,
            context,
            display: None,
            playback,
            began: Instant::now(),
            level: options.level,
            view: View::Picture,
            has_depth: false,
            help: if options.plain { Help::Nothing } else { Help::Line },
            graph: !options.plain,
            times: FrameTimes::default(),
            drawn: None,
            status: Some("starting".to_owned()),
            note: None,
            paused: false,
            recording: options.record,
            mouse: Mouse::Free { at: None },
            ended: false,
            failure: None,
            source: None,
            canvas: None,
            upscaler: None,
        })
    }

    /// Nanoseconds since the start.
    fn now(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: Error) {
        self.failure = self.failure.take().or(Some(error));
        event_loop.exit();
    }

    fn note(&mut self, text: impl Into<String>) {
        self.note = Some((text.into(), Instant::now()));
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
        let [width, height] = self.options.size;
        let attributes =
            Window::default_attributes().with_title("Cairn").with_inner_size(PhysicalSize::new(width, height));
        let window = Rc::new(event_loop.create_window(attributes).map_err(no_window)?);
        let surface = softbuffer::Surface::new(&self.context, Rc::clone(&window)).map_err(no_window)?;
        self.display = Some(Display { window, surface });
        Ok(())
    }

    fn redraw(&self) {
        if let Some(display) = &self.display {
            display.window.request_redraw();
        }
    }

    fn obey(&mut self, event_loop: &ActiveEventLoop, command: Command) -> Result<()> {
        match command {
            Command::Level(index) => self.go_to(LANDSCAPES.get(index).copied().unwrap_or(self.level)),
            Command::Restart => self.go_to(self.level),
            Command::Between => self.playback.set(self.playback.between.next(), self.playback.multiplier)?,
            Command::More | Command::Fewer => {
                let multiplier = next_multiplier(self.playback.multiplier, command == Command::More);
                self.playback.set(InBetweenMode::Generated, multiplier)?;
            }
            Command::View => {
                self.view = match self.view {
                    View::Picture => View::Motion,
                    View::Motion => View::Depth,
                    View::Depth => View::Picture,
                };
            }
            Command::Graph => self.graph = !self.graph,
            Command::Help => self.help = self.help.next(),
            Command::Record => {
                self.recording = !self.recording;
                self.shared.change(|requests| requests.record = !requests.record);
            }
            Command::Pause => {
                self.paused = !self.paused;
                self.playback.pace.interrupt();
                self.shared.change(|requests| requests.paused = self.paused);
            }
            Command::Escape if self.mouse == Mouse::Captured => self.capture(false),
            Command::Escape => event_loop.exit(),
        }
        self.redraw();
        Ok(())
    }

    fn go_to(&mut self, level: Family) {
        self.note(format!("to the level of {level}"));
        // A recording of the walk so far is written.
        self.recording = false;
        self.shared.change(|requests| requests.level = Some(level));
    }

    /// Captures the mouse, or frees it.
    fn capture(&mut self, captured: bool) {
        let Some(Display { window, .. }) = &self.display else { return };
        let grabbed = captured
            && [CursorGrabMode::Locked, CursorGrabMode::Confined]
                .into_iter()
                .any(|mode| window.set_cursor_grab(mode).is_ok());
        if !grabbed {
            _ = window.set_cursor_grab(CursorGrabMode::None);
        }
        window.set_cursor_visible(!grabbed);
        self.mouse = if grabbed { Mouse::Captured } else { Mouse::Free { at: None } };
        if captured && !grabbed {
            self.note("the mouse cannot be captured here; drag with it");
        }
    }

    fn turn(&self, motion: [f64; 2]) {
        self.shared.change(|requests| requests.input.moved(motion));
    }

    fn pointer(&mut self, to: [f64; 2]) {
        match self.mouse {
            Mouse::Free { .. } => self.mouse = Mouse::Free { at: Some(to) },
            Mouse::Pressed { at, moved } => {
                let motion = [to[0] - at[0], to[1] - at[1]];
                self.turn(motion);
                self.mouse = Mouse::Pressed { at: to, moved: moved + motion[0].abs() + motion[1].abs() };
            }
            Mouse::Captured => {}
        }
    }

    fn button(&mut self, down: bool) {
        match self.mouse {
            Mouse::Free { at } if down => self.mouse = Mouse::Pressed { at: at.unwrap_or_default(), moved: 0.0 },
            Mouse::Pressed { moved, .. } if !down && moved < DRAG => self.capture(true),
            Mouse::Pressed { at, .. } if !down => self.mouse = Mouse::Free { at: Some(at) },
            _ => {}
        }
    }

    /// The line at the top.
    fn status(&self) -> String {
        let view = match self.view {
            View::Picture => "",
            View::Motion => " | motion to the anchor before",
            View::Depth if self.has_depth => " | depth, near is white",
            View::Depth => " | no depth: motion was found in the pictures",
        };
        let recording = if self.recording { " | RECORDING" } else { "" };
        let pictures = self.options.point.pictures_per_latent;
        let between = self.playback.between.describe(self.playback.multiplier, pictures);
        format!("{} | {}{view} | {between}{recording}", self.level, describe(&self.playback.pace))
    }

    /// The text over the middle of the picture.
    fn message(&self) -> String {
        // Without anything over the picture, notes go to standard output alone.
        let shown = |(_, since): &&(String, Instant)| since.elapsed() < NOTE && self.help != Help::Nothing;
        let note = self.note.as_ref().filter(shown);
        match (&self.status, note) {
            (Some(status), _) => format!("{status} ..."),
            (None, Some((note, _))) => note.clone(),
            (None, None) if self.paused => "paused; P goes on".to_owned(),
            (None, None) => String::new(),
        }
    }

    /// Draws the frame that is due, and what lies over it.
    fn draw(&mut self) -> Result<()> {
        let Some(Display { window, .. }) = &self.display else { return Ok(()) };
        let PhysicalSize { width, height } = window.inner_size();
        let (Some(wide), Some(high)) = (NonZeroU32::new(width), NonZeroU32::new(height)) else { return Ok(()) };
        let now = self.now();
        let source = &mut self.source;
        let info = self.playback.draw(now, |picture| match source {
            Some(source) if source.size() == picture.size() => source.rgba_mut().copy_from_slice(picture.rgba()),
            _ => *source = Some(picture.clone()),
        })?;
        if let (Some(info), Some(source)) = (&info, &mut self.source)
            && self.view != View::Picture
        {
            match (self.playback.guidance(info), self.view) {
                (Some(guidance), View::Motion) => visual::motion(guidance.motion(), FULL_SCALE, source)?,
                (Some(guidance), _) => {
                    self.has_depth = !guidance.origin().is_optical_flow();
                    visual::depth(guidance.depth(), source)?;
                }
                (None, _) => source.pixels_mut().fill([0, 0, 0, 255]),
            }
        }
        self.compose((width, height))?;
        self.count(info.as_ref());
        let (Some(canvas), Some(display)) = (&self.canvas, &mut self.display) else { return Ok(()) };
        display.surface.resize(wide, high).map_err(no_window)?;
        let mut buffer = display.surface.buffer_mut().map_err(no_window)?;
        for (out, [red, green, blue, _]) in buffer.iter_mut().zip(canvas.pixels()) {
            *out = u32::from_be_bytes([0, *red, *green, *blue]);
        }
        display.window.pre_present_notify();
        buffer.present().map_err(no_window)
    }

    /// Fills the canvas: the picture in its aspect ratio, and the overlay.
    fn compose(&mut self, size: (u32, u32)) -> Result<()> {
        let mut canvas = match self.canvas.take() {
            Some(canvas) if canvas.size() == size => canvas,
            _ => Picture::new(size.0, size.1)?,
        };
        canvas.pixels_mut().fill([0, 0, 0, 255]);
        if let Some(source) = &self.source {
            let (at, area) = area(source.size(), size);
            if area == source.size() {
                paste(&mut canvas, source, at);
            } else {
                if !self.upscaler.as_ref().is_some_and(|u| u.from_size() == source.size() && u.to_size() == area) {
                    self.upscaler = Some(Upscaler::new(source.size(), area, Filter::Lanczos3)?);
                }
                let mut scaled = Picture::new(area.0, area.1)?;
                if let Some(upscaler) = &mut self.upscaler {
                    upscaler.upscale(source, &mut scaled)?;
                }
                paste(&mut canvas, &scaled, at);
            }
        }
        let (status, message) = (self.status(), self.message());
        let graph = (self.graph && self.help != Help::Nothing).then_some(&self.times);
        Overlay { status: &status, message: &message, help: self.help, graph }.draw(&mut canvas);
        self.canvas = Some(canvas);
        Ok(())
    }

    /// Adds a new frame to the graph.
    fn count(&mut self, info: Option<&FrameInfo>) {
        let Some(info) = info else { return };
        let key = frame_key(info);
        let since = self.drawn.map(|(at, last)| (at.elapsed(), last == key));
        match since {
            Some((_, true)) => return,
            Some((elapsed, false)) => self.times.add(1e3 * elapsed.as_secs_f32(), info.source),
            None => {}
        }
        self.drawn = Some((Instant::now(), key));
    }

    fn receive(&mut self, event_loop: &ActiveEventLoop, message: Message) -> Result<()> {
        match message {
            Message::Status(status) => self.status = Some(status),
            Message::Anchor { anchor, level } => {
                (self.status, self.level) = (None, level);
                self.playback.push(anchor, self.now())?;
            }
            Message::Note(text) => self.note(text),
            Message::Ended => self.ended = true,
            Message::Failed(error) => self.fail(event_loop, error),
        }
        self.redraw();
        Ok(())
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, event: WindowEvent) -> Result<()> {
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::Resized(_) => self.redraw(),
            WindowEvent::RedrawRequested => self.draw()?,
            WindowEvent::Focused(false) => {
                self.shared.change(|requests| requests.input.release());
                self.capture(false);
            }
            WindowEvent::KeyboardInput { event, .. } => {
                let PhysicalKey::Code(code) = event.physical_key else { return Ok(()) };
                let down = event.state == ElementState::Pressed;
                match meaning(code) {
                    Some(Meaning::World(key)) => self.shared.change(|requests| requests.input.key(key, down)),
                    Some(Meaning::Command(command)) if down && !event.repeat => self.obey(event_loop, command)?,
                    _ => {}
                }
            }
            WindowEvent::CursorMoved { position, .. } => self.pointer([position.x, position.y]),
            WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
                self.button(state == ElementState::Pressed);
            }
            _ => {}
        }
        Ok(())
    }
}

impl ApplicationHandler<Message> for App<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.display.is_none()
            && let Err(error) = self.open(event_loop)
        {
            self.fail(event_loop, error);
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, message: Message) {
        if let Err(error) = self.receive(event_loop, message) {
            self.fail(event_loop, error);
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        if let Err(error) = self.window_event(event_loop, event) {
            self.fail(event_loop, error);
        }
    }

    fn device_event(&mut self, _: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let (DeviceEvent::MouseMotion { delta }, Mouse::Captured) = (event, self.mouse) {
            self.turn([delta.0, delta.1]);
        }
    }

    /// Sleeps until the next frame is due.
    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let now = self.now();
        let due = self.playback.query(now);
        let shown = due.as_ref().map(frame_key);
        let drawn = self.drawn.map(|(_, key)| key);
        let is_last = due.is_some_and(|due| due.previous == due.current && Some(due.current) == self.playback.last());
        if self.ended && is_last && drawn == shown {
            event_loop.exit();
            return;
        }
        if shown.is_some() && shown != drawn {
            self.redraw();
        }
        let wait = due.map_or(IDLE, |due| Duration::from_nanos(due.due.until_ns.saturating_sub(now)));
        let wait = wait.clamp(SHORTEST, IDLE);
        if wait == IDLE {
            self.redraw();
        }
        event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now() + wait));
    }
}

/// The largest centred area of a picture's aspect ratio in a window: its top left pixel, and its size.
fn area(picture: (u32, u32), window: (u32, u32)) -> ((u32, u32), (u32, u32)) {
    let [(w, h), (ww, wh)] = [picture, window].map(|(w, h)| (u64::from(w.max(1)), u64::from(h.max(1))));
    let (width, height) = if w * wh > ww * h { (ww, (ww * h / w).max(1)) } else { ((wh * w / h).max(1), wh) };
    let size = (width as u32, height as u32);
    (((window.0 - size.0.min(window.0)) / 2, (window.1 - size.1.min(window.1)) / 2), size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_keeps_its_aspect_ratio_in_a_window() {
        assert_eq!(area((320, 180), (1280, 720)), ((0, 0), (1280, 720)));
        assert_eq!(area((320, 180), (1280, 800)), ((0, 40), (1280, 720)));
        assert_eq!(area((320, 180), (1920, 720)), ((320, 0), (1280, 720)));
        assert_eq!(area((320, 180), (1, 1)), ((0, 0), (1, 1)));
    }
}

//! `study play` on a display without a screen: keys and mouse reach the world, the window shows the world's pictures, and a recorded walk
//! repeats to the bit.

#[cfg(target_os = "linux")]
mod common;
#[cfg(target_os = "linux")]
#[path = "play/x.rs"]
mod x;

#[cfg(target_os = "linux")]
mod game {
    use std::path::{Path, PathBuf};
    use std::process::{Child, Command, Stdio};
    use std::time::{Duration, Instant};

    use cairn::Picture;
    use cairn::bundle::Bundle;
    use cairn::runtime::{CpuOptions, Device, Ort};
    use cairn::world::{ControlScript, Key, OperatingPoint, Rollout, World, WorldOptions};
    use provision::Console;

    use super::common::worlds::tiny;
    use super::x::{Display, Keysym};

    /// The smallest operating point of the test world.
    const POINT: &str = "stock,g16";
    const LONGEST: Duration = Duration::from_secs(60);

    /// A running game.
    struct Game(Child);

    impl Drop for Game {
        fn drop(&mut self) {
            _ = self.0.kill();
            _ = self.0.wait();
        }
    }

    fn start(display: &Display, out: &Path, arguments: &[&str]) -> Game {
        let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
        command.args(["play", "--preset", POINT, "--threads", "1", "--device", "cpu", "--out"]).arg(out);
        command.arg("--world").arg(tiny()).args(arguments);
        command.env("DISPLAY", display.name()).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        Game(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts"))
    }

    /// Waits for the end; standard output, after a successful exit.
    fn finish(mut game: Game) -> String {
        let began = Instant::now();
        while game.0.try_wait().unwrap().is_none() {
            assert!(began.elapsed() < LONGEST, "the window stays open");
            std::thread::sleep(Duration::from_millis(20));
        }
        let read = |stream: Option<&mut dyn std::io::Read>| {
            let mut text = String::new();
            stream.unwrap().read_to_string(&mut text).unwrap();
            text
        };
        let text = read(game.0.stdout.as_mut().map(|s| s as _));
        let errors = read(game.0.stderr.as_mut().map(|s| s as _));
        assert!(game.0.wait().unwrap().success(), "{text}\n{errors}");
        text
    }

    /// Tries `look` until it finds something.
    fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            if let Some(found) = look() {
                return found;
            }
            assert!(began.elapsed() < LONGEST, "{what} does not come");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The anchors of a recorded walk, made with the library alone.
    fn anchors(script: &ControlScript, first: &Picture, latents: u64) -> Vec<Picture> {
        let ort = Ort::load(&provision::onnxruntime(&Console::new()).unwrap()).unwrap();
        let device = Device::cpu(&ort, CpuOptions { threads: Some(1), deterministic: true }).unwrap();
        let point: OperatingPoint = POINT.parse().unwrap();
        let options = WorldOptions { global_window: Some(point.global_window), ..WorldOptions::default() };
        let world = World::load(&device, &Bundle::open(&tiny()).unwrap(), options).unwrap();
        let mut rollout = Rollout::new(&world, &point, 1).unwrap();
        let read = |rollout: &mut Rollout| {
            let mut picture = Picture::new(1, 1).unwrap();
            rollout.read_picture(point.pictures_per_latent - 1, &mut picture).unwrap();
            picture
        };
        rollout.append(first).unwrap();
        let mut made = vec![read(&mut rollout)];
        for number in 1..=latents {
            let (from, until) = point.span_of_latent(number);
            rollout.step(&script.span(from, until).unwrap()).unwrap();
            made.push(read(&mut rollout));
        }
        made
    }

    /// The first picture of the level of snow at the test world's size, as another command of the program draws it.
    fn first_picture(folder: &Path, size: (u32, u32)) -> Picture {
        let path = folder.join("seed.png");
        let size = format!("{}x{}", size.0, size.1);
        let mut command = Command::new(env!("CARGO_BIN_EXE_study"));
        command.args(["seed-picture", "--scene", "snow", "--size", &size, "--out"]).arg(&path);
        assert!(command.stdout(Stdio::null()).status().unwrap().success());
        let image = image::open(path).unwrap().into_rgba8();
        Picture::from_rgba(image.width(), image.height(), image.into_raw()).unwrap()
    }

    fn recording(folder: &Path) -> Option<PathBuf> {
        let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
        entries.into_iter().find(|path| path.extension().is_some_and(|e| e == "txt"))
    }

    /// A game is played with keys and mouse; then its recording is held against the library, and repeated.
    pub(super) fn keys_and_mouse_move_the_world_and_a_recording_repeats() {
        let folder = tempfile::tempdir().unwrap();
        let display = Display::start();
        let [width, height] = Bundle::open(&tiny()).unwrap().manifest().picture.render;
        let size = format!("{width}x{height}");
        let plain = ["--size", &size, "--plain", "--anchors"];
        let game = start(&display, folder.path(), &[&plain[..], &["--level", "snow", "--record"]].concat());
        let window = wait_for("the window", || display.window((width, height)));
        display.focus(window);
        // Before the first picture there is text on black.
        let is_picture = |p: &Picture| p.pixels().iter().filter(|px| px[..3] != [0; 3]).count() * 2 > p.pixels().len();
        wait_for("a picture", || display.picture(window).filter(is_picture));
        display.key(Keysym::W, true);
        display.drag(window, [(40, 20), (60, 24)]);
        let mut seen: Vec<Picture> = Vec::new();
        wait_for("a fourth picture", || {
            let picture = display.picture(window).filter(is_picture)?;
            if !seen.contains(&picture) {
                seen.push(picture);
            }
            (seen.len() >= 4).then_some(())
        });
        display.key(Keysym::W, false);
        display.tap(Keysym::R);
        let path = wait_for("the recording", || recording(folder.path()));
        display.tap(Keysym::Escape);
        let text = finish(game);
        assert!(text.contains("written: "), "{text}");

        let recorded = std::fs::read_to_string(&path).unwrap();
        let script = ControlScript::parse(&recorded).unwrap();
        let point: OperatingPoint = POINT.parse().unwrap();
        let latents = script.duration().covering_steps(point.latents_per_second);
        let inputs: Vec<_> = (1..=latents)
            .map(|number| point.span_of_latent(number))
            .map(|(from, until)| script.span(from, until).unwrap())
            .collect();
        assert!(inputs.iter().any(|input| input.keys().contains(Key(b'W'))), "{recorded}");
        assert!(inputs.iter().any(|input| input.mouse()[0] > 0.0), "{recorded}");
        assert!(recorded.contains("# level snow\n"), "{recorded}");

        // Every picture in the window is one that the library makes with these controls.
        let made = anchors(&script, &first_picture(folder.path(), (width, height)), latents);
        let found = seen.iter().filter(|picture| made.contains(picture)).count();
        assert_eq!(found, seen.len(), "pictures in the window that are the world's");

        let seconds = script.duration().seconds().to_string();
        let replay = ["--replay", path.to_str().unwrap(), "--seconds", &seconds];
        let text = finish(start(&display, &folder.path().join("again"), &[&plain[..], &replay].concat()));
        assert!(text.contains("the replay is the same"), "{text}");
        // A turn more gives other latents, and the program notices.
        let other = folder.path().join("other.txt");
        std::fs::write(&other, format!("{recorded}0.01 mouse 500 0\n")).unwrap();
        let replay = ["--replay", other.to_str().unwrap(), "--seconds", &seconds];
        let text = finish(start(&display, &folder.path().join("other"), &[&plain[..], &replay].concat()));
        assert!(text.contains("NOT the same"), "{text}");
    }

    /// Keys switch help and views.
    pub(super) fn keys_change_the_view() {
        let folder = tempfile::tempdir().unwrap();
        let display = Display::start();
        let game = start(&display, folder.path(), &["--size", "960x540"]);
        let window = wait_for("the window", || display.window((960, 540)));
        display.focus(window);
        let bright = |picture: &Picture| picture.pixels().iter().filter(|px| px[..3] == [240, 240, 235]).count();
        let with_line = wait_for("the status line", || display.picture(window).filter(|p| bright(p) > 100));
        display.tap(Keysym::H);
        wait_for("all keys", || display.picture(window).filter(|p| bright(p) > bright(&with_line) + 400));
        display.tap(Keysym::H);
        wait_for("nothing over the picture", || display.picture(window).filter(|p| bright(p) < 20));
        // Motion, then depth, which is grey.
        display.tap(Keysym::G);
        display.tap(Keysym::G);
        let grey = |picture: &Picture| picture.pixels().iter().all(|px| px[0] == px[1] && px[1] == px[2]);
        wait_for("depth", || display.picture(window).filter(grey));
        display.tap(Keysym::G);
        wait_for("the picture again", || display.picture(window).filter(|p| !grey(p)));
        display.tap(Keysym::Escape);
        finish(game);
    }
}

#[cfg(target_os = "linux")]
fn main() {
    use libtest_mimic::{Arguments, Completion, Trial};

    let trial = |name: &str, test: fn()| {
        Trial::ignorable_test(name, move || {
            if provision::tools::xvfb(&provision::Console::new()).is_none() {
                return Ok(Completion::ignored_with("needs xvfb: apt install xvfb"));
            }
            test();
            Ok(Completion::Completed)
        })
    };
    let trials = vec![
        trial(
            "keys_and_mouse_move_the_world_and_a_recording_repeats",
            game::keys_and_mouse_move_the_world_and_a_recording_repeats,
        ),
        trial("keys_change_the_view", game::keys_change_the_view),
    ];
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// Elsewhere there is no X server to test with.
#[cfg(not(target_os = "linux"))]
fn main() {}

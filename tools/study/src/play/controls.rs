//! Keys and mouse: what they mean, and the controls of a latent step that they add up to. Knows no window.

use cairn::Result;
use cairn::world::{ControlInput, Key, KeySet, MAX_MOUSE};
use winit::keyboard::KeyCode;

/// Help of all keys: the key, and its action.
pub(crate) const HELP: [(&str, &str); 13] = [
    ("W A S D, arrows", "walk"),
    ("Shift", "run"),
    ("mouse", "look round: click to capture it, or drag"),
    ("1 2 3 4", "forest, meadow, desert, snow"),
    ("F", "between anchors: generated frames, the world's own, none"),
    ("+ -", "more or fewer generated frames"),
    ("G", "picture, motion, depth"),
    ("T", "graph of frame times"),
    ("R", "start a recording, or stop and write it"),
    ("P", "pause"),
    ("Backspace", "start the level again"),
    ("H", "help: line, all keys, nothing"),
    ("Esc", "free the mouse; quit if it is free"),
];

/// The keys that the world inside the library has learned.
pub(super) const LEARNED: [Key; 5] = [Key(b'W'), Key(b'A'), Key(b'S'), Key(b'D'), SHIFT];
const SHIFT: Key = Key(0x10);
const SPACE: Key = Key(0x20);
const CTRL: Key = Key(0x11);

/// Action of a key on the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Command {
    /// Go to a level, by its index.
    Level(usize),
    Between,
    More,
    Fewer,
    View,
    Graph,
    Record,
    Pause,
    Restart,
    Help,
    Escape,
}

/// Meaning of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// The world gets it.
    World(Key),
    Command(Command),
}

/// Meaning of a physical key, named after its position on a US keyboard; `None` if it has none.
pub(super) fn meaning(code: KeyCode) -> Option<Meaning> {
    use Meaning::{Command as Does, World};
    Some(match code {
        KeyCode::KeyW | KeyCode::ArrowUp => World(Key(b'W')),
        KeyCode::KeyA | KeyCode::ArrowLeft => World(Key(b'A')),
        KeyCode::KeyS | KeyCode::ArrowDown => World(Key(b'S')),
        KeyCode::KeyD | KeyCode::ArrowRight => World(Key(b'D')),
        KeyCode::ShiftLeft | KeyCode::ShiftRight => World(SHIFT),
        KeyCode::Space => World(SPACE),
        KeyCode::ControlLeft | KeyCode::ControlRight => World(CTRL),
        KeyCode::Digit1 => Does(Command::Level(0)),
        KeyCode::Digit2 => Does(Command::Level(1)),
        KeyCode::Digit3 => Does(Command::Level(2)),
        KeyCode::Digit4 => Does(Command::Level(3)),
        KeyCode::KeyF => Does(Command::Between),
        KeyCode::Equal | KeyCode::NumpadAdd => Does(Command::More),
        KeyCode::Minus | KeyCode::NumpadSubtract => Does(Command::Fewer),
        KeyCode::KeyG => Does(Command::View),
        KeyCode::KeyT => Does(Command::Graph),
        KeyCode::KeyR => Does(Command::Record),
        KeyCode::KeyP => Does(Command::Pause),
        KeyCode::Backspace => Does(Command::Restart),
        KeyCode::KeyH => Does(Command::Help),
        KeyCode::Escape => Does(Command::Escape),
        _ => return None,
    })
}

/// The player's input since the last latent step.
#[derive(Debug, Default)]
pub(super) struct Input {
    held: KeySet,
    /// Keys pressed since the last step, so that the shortest tap counts.
    tapped: KeySet,
    mouse: [f64; 2],
}

impl Input {
    pub(super) fn key(&mut self, key: Key, down: bool) {
        if down {
            self.held.insert(key);
            self.tapped.insert(key);
        } else {
            self.held.remove(key);
        }
    }

    /// Adds a mouse motion in counts, right and down positive.
    pub(super) fn moved(&mut self, [dx, dy]: [f64; 2]) {
        self.mouse[0] += dx;
        self.mouse[1] += dy;
    }

    /// Releases all keys, as when the window loses the keyboard.
    pub(super) fn release(&mut self) {
        self.held = KeySet::NONE;
    }

    /// Controls of the next step, and starts to collect those of the one after. Keys outside `known` are left out. `pace` is world time
    /// divided by the real time since the last step, at most 1: in slow motion the mouse turns as slowly as everything else moves.
    ///
    /// # Errors
    /// None for finite motion: it is limited to [`MAX_MOUSE`].
    pub(super) fn take(&mut self, known: KeySet, pace: f64) -> Result<ControlInput> {
        let keys = self.held.iter().chain(self.tapped.iter()).filter(|key| known.contains(*key)).collect();
        let limit = f64::from(MAX_MOUSE);
        let mouse = self.mouse.map(|counts| (counts * pace.clamp(0.0, 1.0)).clamp(-limit, limit) as f32);
        (self.tapped, self.mouse) = (KeySet::NONE, [0.0; 2]);
        ControlInput::new(mouse, keys, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn learned() -> KeySet {
        LEARNED.into_iter().collect()
    }

    #[test]
    fn a_tap_counts_once_and_a_held_key_until_it_is_released() {
        let (w, d) = (Key(b'W'), Key(b'D'));
        let mut input = Input::default();
        input.key(w, true);
        input.key(d, true);
        input.key(d, false);
        let keys = |input: &mut Input| input.take(learned(), 1.0).unwrap().keys().iter().collect::<Vec<_>>();
        assert_eq!(keys(&mut input), [d, w]);
        assert_eq!(keys(&mut input), [w]);
        input.release();
        assert_eq!(keys(&mut input), []);
    }

    #[test]
    fn a_world_gets_only_keys_that_it_knows() {
        let mut input = Input::default();
        input.key(SPACE, true);
        input.key(SHIFT, true);
        assert_eq!(input.take(learned(), 1.0).unwrap().keys().iter().collect::<Vec<_>>(), [SHIFT]);
    }

    #[test]
    fn the_mouse_is_slowed_with_the_world_and_limited() {
        let mut input = Input::default();
        input.moved([300.0, -40.0]);
        input.moved([100.0, 0.0]);
        assert_eq!(input.take(learned(), 0.25).unwrap().mouse(), [100.0, -10.0]);
        assert_eq!(input.take(learned(), 0.25).unwrap().mouse(), [0.0, 0.0]);
        input.moved([1e9, -1e9]);
        assert_eq!(input.take(learned(), 7.0).unwrap().mouse(), [MAX_MOUSE, -MAX_MOUSE]);
    }

    #[test]
    fn keys_have_their_meanings() {
        assert_eq!(meaning(KeyCode::ArrowUp), Some(Meaning::World(Key(b'W'))));
        assert_eq!(meaning(KeyCode::Digit4), Some(Meaning::Command(Command::Level(3))));
        assert_eq!(meaning(KeyCode::F12), None);
    }
}

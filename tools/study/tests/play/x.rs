//! An X server without a screen, input for it, and the pictures of its windows.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use cairn::Picture;
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConnectionExt, ImageFormat, InputFocus, MapState, Window};
use x11rb::protocol::xtest::ConnectionExt as XTest;
use x11rb::rust_connection::RustConnection;

const KEY_PRESS: u8 = 2;
const KEY_RELEASE: u8 = 3;
const BUTTON_PRESS: u8 = 4;
const BUTTON_RELEASE: u8 = 5;
const MOTION: u8 = 6;

/// Keys by their X keysym.
#[derive(Debug, Clone, Copy)]
#[repr(u32)]
pub(crate) enum Keysym {
    G = 0x67,
    H = 0x68,
    R = 0x72,
    W = 0x77,
    Escape = 0xff1b,
}

/// A running server, and a connection to it.
pub(crate) struct Display {
    server: Child,
    name: String,
    connection: RustConnection,
    root: Window,
}

impl Drop for Display {
    fn drop(&mut self) {
        _ = self.server.kill();
        _ = self.server.wait();
    }
}

impl Display {
    pub(crate) fn start() -> Self {
        let mut command = Command::new(provision::tools::on_path("Xvfb").expect("it was installed"));
        command.args(["-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp", "-noreset"]);
        let mut server = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("Xvfb starts");
        let mut number = String::new();
        let output = server.stdout.take().expect("a pipe");
        BufReader::new(output).read_line(&mut number).expect("the number of the display");
        let name = format!(":{}", number.trim());
        let (connection, screen) = x11rb::connect(Some(&name)).expect("a connection");
        let root = connection.setup().roots[screen].root;
        Self { server, name, connection, root }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The visible window of that size.
    pub(crate) fn window(&self, (width, height): (u32, u32)) -> Option<Window> {
        let children = self.connection.query_tree(self.root).ok()?.reply().ok()?.children;
        children.into_iter().find(|window| {
            let shown = self.connection.get_window_attributes(*window).ok().and_then(|r| r.reply().ok());
            let size = self.connection.get_geometry(*window).ok().and_then(|r| r.reply().ok());
            shown.is_some_and(|shown| shown.map_state == MapState::VIEWABLE)
                && size.is_some_and(|size| (u32::from(size.width), u32::from(size.height)) == (width, height))
        })
    }

    /// Gives the keyboard to a window, as a window manager does.
    pub(crate) fn focus(&self, window: Window) {
        self.connection.set_input_focus(InputFocus::PARENT, window, 0u32).unwrap().check().unwrap();
        self.sync();
    }

    /// The pixels of a window.
    pub(crate) fn picture(&self, window: Window) -> Option<Picture> {
        let size = self.connection.get_geometry(window).ok()?.reply().ok()?;
        let reply = self
            .connection
            .get_image(ImageFormat::Z_PIXMAP, window, 0, 0, size.width, size.height, !0)
            .ok()?
            .reply()
            .ok()?;
        // 32 bits a pixel, blue first.
        let rgba = reply.data.chunks_exact(4).flat_map(|px| [px[2], px[1], px[0], 255]).collect();
        Picture::from_rgba(size.width.into(), size.height.into(), rgba).ok()
    }

    pub(crate) fn key(&self, key: Keysym, down: bool) {
        let setup = self.connection.setup();
        let (least, count) = (setup.min_keycode, setup.max_keycode - setup.min_keycode + 1);
        let map = self.connection.get_keyboard_mapping(least, count).unwrap().reply().unwrap();
        let per_key = usize::from(map.keysyms_per_keycode);
        let at = map.keysyms.chunks(per_key).position(|symbols| symbols.first() == Some(&(key as u32)));
        let code = least + u8::try_from(at.expect("the keyboard has the key")).unwrap();
        self.fake(if down { KEY_PRESS } else { KEY_RELEASE }, code, (0, 0));
    }

    pub(crate) fn tap(&self, key: Keysym) {
        self.key(key, true);
        self.key(key, false);
    }

    /// Drags with the left button within a window.
    pub(crate) fn drag(&self, window: Window, [from, to]: [(i16, i16); 2]) {
        let corner = self.connection.translate_coordinates(window, self.root, 0, 0).unwrap().reply().unwrap();
        let at = |(x, y): (i16, i16)| (corner.dst_x + x, corner.dst_y + y);
        self.fake(MOTION, 0, at(from));
        self.fake(BUTTON_PRESS, 1, (0, 0));
        self.fake(MOTION, 0, at(to));
        self.fake(BUTTON_RELEASE, 1, (0, 0));
    }

    fn fake(&self, kind: u8, detail: u8, (x, y): (i16, i16)) {
        self.connection.xtest_fake_input(kind, detail, 0, self.root, x, y, 0).unwrap().check().unwrap();
        self.sync();
        std::thread::sleep(Duration::from_millis(30));
    }

    fn sync(&self) {
        _ = self.connection.get_input_focus().unwrap().reply();
    }
}

//! The video and the report of a comparison in a browser: headless Chromium, against a local server on the loopback
//! address.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, Sender};
use std::time::Duration;

use provision::{Console, tools};

use super::Context;
use super::study;
use super::tally::{Skip, Tally};
use crate::shell::Log;

/// Time limit for the browser to start and play half a second.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Number of the browser's last error lines that a failure shows.
const ERROR_LINES: usize = 10;

/// Plays the video and sends the result to the server.
const PAGE: &str = r#"<!doctype html><meta charset="utf-8"><video muted src="/video.mp4"></video><script>
const video = document.querySelector("video");
const report = text => fetch("/result", { method: "POST", body: text });
let frames = 0;
const count = () => { frames++; video.requestVideoFrameCallback(count); };
video.requestVideoFrameCallback(count);
video.onerror = () => report(`error ${video.error.code}: ${video.error.message}`);
video.onended = () => report(`played ${video.videoWidth}x${video.videoHeight} for ${video.currentTime.toFixed(2)} s, drew ${Math.min(frames, 2)} frames or more`);
video.play().catch(error => report(`error: ${error}`));
</script>"#;

/// Opens the report in a frame, checks its contents, steps and plays its video, and sends the errors to the server.
const REPORT_PAGE: &str = r#"<!doctype html><meta charset="utf-8"><iframe src="/report.html" width="1200" height="900"></iframe><script>
const report = text => fetch("/result", { method: "POST", body: text });
const pause = time => new Promise(done => setTimeout(done, time));
const until = async (what, test) => {
  for (let turn = 0; turn < 600; turn++) { if (test()) return true; await pause(50); }
  return false;
};
const frame = document.querySelector("iframe");
frame.onload = async () => {
  const page = frame.contentDocument, all = name => [...page.querySelectorAll(name)], wrong = [];
  const check = (well, what) => { if (!well) wrong.push(what); };
  for (const [name, least] of [["table", 8], ["figure img", 4], ["figure svg", 2], ["video", 1], ["nav a", 10]])
    check(all(name).length >= least, `${all(name).length} of ${name}`);
  check(all("img").every(image => image.complete && image.naturalWidth > 100), "a picture is not drawn");
  check(all("svg").every(drawing => drawing.getBBox().width > 100), "a drawing is empty");
  check(all("nav a").every(link => page.querySelector(link.getAttribute("href"))), "a link leads nowhere");
  check(all("td").every(cell => cell.innerText !== "NaN" && cell.innerText !== "undefined"), "a cell is no number");
  check(page.documentElement.scrollWidth <= page.documentElement.clientWidth, "the page is wider than its window");
  check(frame.contentWindow.performance.getEntriesByType("resource").every(r => r.name.startsWith("data:")), "it fetches something");
  const video = page.querySelector("video"), [back, play, on] = all(".player button"), time = page.querySelector("output");
  check(await until("loaded", () => video.readyState >= 2), "the video does not load");
  on.click();
  check(await until("step", () => time.textContent.endsWith("frame 1")), `a step on shows ${time.textContent}`);
  back.click();
  check(await until("step", () => time.textContent.endsWith("frame 0")), `a step back shows ${time.textContent}`);
  play.click();
  check(await until("play", () => play.textContent === "pause" && video.currentTime > 0.1), "the video does not play");
  report(wrong.length ? wrong.join("; ") : "all is well");
};
</script>"#;

/// The page's message on success: size and length of the short rollout.
const EXPECTED: &str = "played 256x144 for 0.53 s, drew 2 frames or more";

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let Some(chromium) = tools::chromium(&Console::new()) else {
        let skip = Skip {
            name: "the video plays in a browser".to_owned(),
            reason: "there is no Chromium on the PATH (a snap does not count), and apt-get cannot install it here"
                .to_owned(),
        };
        return Ok(Tally { skips: vec![skip], ..Tally::default() });
    };
    let mut tally = Tally::default();
    let profile = context.workspace.target.join("xtask").join("browser");
    for (what, page, path, file, kind, expected) in [
        ("video", PAGE, "/video.mp4", study::rollout_video(context, log)?, "video/mp4", EXPECTED),
        ("report", REPORT_PAGE, "/report.html", study::comparison_report(context, log)?, "text/html", "all is well"),
    ] {
        let bytes = fs::read(&file).map_err(|e| format!("{}: {e}", file.display()))?;
        let result = open(&chromium, Served { page, path, kind, bytes }, &profile)?;
        log.line(&format!("of the {what} the browser says: {result}"))?;
        tally
            .test((result != expected).then(|| format!("of the {what} the browser says {result:?}, not {expected:?}")));
    }
    Ok(tally)
}

/// The server's contents: a page, and a file that the page requests.
#[derive(Clone)]
struct Served {
    page: &'static str,
    path: &'static str,
    kind: &'static str,
    bytes: Vec<u8>,
}

/// Opens the page in the browser and waits for its message.
fn open(chromium: &Path, served: Served, profile: &Path) -> Result<String, String> {
    let listener = TcpListener::bind(("127.0.0.1", 0)).map_err(|e| format!("no port on the loopback address: {e}"))?;
    let address = listener.local_addr().map_err(|e| e.to_string())?;
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (sender, served) = (sender.clone(), served.clone());
            // A connection that the browser closes early is not a failure: only the page's message counts.
            std::thread::spawn(move || _ = answer(stream, &served, &sender));
        }
    });
    let errors = profile.with_extension("stderr");
    let _browser = Browser::start(chromium, &format!("http://{address}/"), profile, &errors)?;
    receiver.recv_timeout(TIMEOUT).map_err(|_| {
        let printed = fs::read(&errors).unwrap_or_default();
        let printed = String::from_utf8_lossy(&printed);
        let lines: Vec<&str> = printed.lines().collect();
        let last = lines[lines.len().saturating_sub(ERROR_LINES)..].join("\n");
        format!("the browser sent no result for {} s; its last errors:\n{last}", TIMEOUT.as_secs())
    })
}

/// Answers one request: returns the page or its file, or receives the page's message.
fn answer(mut stream: TcpStream, served: &Served, sender: &Sender<String>) -> std::io::Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    let (mut request, mut length) = (String::new(), 0);
    reader.read_line(&mut request)?;
    loop {
        let mut header = String::new();
        reader.read_line(&mut header)?;
        match header.trim_end().split_once(':') {
            Some((name, value)) if name.eq_ignore_ascii_case("content-length") => {
                length = value.trim().parse().unwrap_or(0);
            }
            Some(_) => {}
            None => break,
        }
    }
    let (kind, body): (&str, &[u8]) = if request.starts_with("POST /result ") {
        let mut text = String::new();
        reader.take(length).read_to_string(&mut text)?;
        _ = sender.send(text);
        ("text/plain", b"")
    } else if request.starts_with(&format!("GET {} ", served.path)) {
        (served.kind, &served.bytes)
    } else {
        ("text/html", served.page.as_bytes())
    };
    write!(
        stream,
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    )?;
    stream.write_all(body)
}

/// A running browser; dropping it ends the process.
struct Browser(Child);

impl Browser {
    /// Starts it; its stderr goes to the file `errors`.
    fn start(chromium: &Path, page: &str, profile: &Path, errors: &Path) -> Result<Self, String> {
        fs::create_dir_all(profile).map_err(|e| format!("{}: {e}", profile.display()))?;
        let stderr = File::create(errors).map_err(|e| format!("{}: {e}", errors.display()))?;
        Command::new(chromium)
            .args(["--headless", "--disable-gpu", "--no-first-run", "--mute-audio"])
            // A test machine runs as root, where the sandbox cannot run; only our own page is opened.
            .arg("--no-sandbox")
            // Without these Chromium contacts its makers' servers at every start.
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic"])
            .arg("--autoplay-policy=no-user-gesture-required")
            .arg(format!("--user-data-dir={}", profile.display()))
            .args(["--remote-debugging-port=0", page])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(stderr)
            .spawn()
            .map(Self)
            .map_err(|e| format!("{}: {e}", chromium.display()))
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        _ = self.0.kill();
        _ = self.0.wait();
    }
}

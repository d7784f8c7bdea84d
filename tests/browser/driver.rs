//! A browser with one page, driven over the protocol of its developer tools (CDP).
//!
//! With `--remote-debugging-pipe` the browser reads messages from file descriptor 3 and writes them to 4, each ended
//! by a zero byte; a shell connects its standard input and output to these two descriptors.

use crate::server::Server;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest time in which anything that a test waits for must appear on the page; it is long, since the machine may be
/// busy.
const PATIENCE: Duration = Duration::from_secs(30);

const LAUNCH: &str = r#"exec "$0" --headless --no-sandbox --disable-gpu --use-angle=swiftshader --enable-unsafe-swiftshader --disable-dev-shm-usage --no-first-run \
    --disable-extensions --disable-background-networking --remote-debugging-pipe --user-data-dir="$1" \
    --window-size=1360,1000 about:blank 3<&0 4>&1 0</dev/null 1>/dev/null 2>/dev/null"#;

/// A JavaScript expression for the shadow root of the specification editor on the page.
pub const EDITOR: &str = "document.getElementById('text').shadowRoot";

pub struct Page {
    child: Child,
    wire: RefCell<Wire>,
    profile: PathBuf,
    server: Server,
}

struct Wire {
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: Option<String>,
    last: u64,
    complaints: Vec<String>,
}

impl Page {
    /// Starts a service and opens its web page at `path` in a browser; returns when the page has loaded.
    pub fn open(name: &str, path: &str) -> Self {
        Self::of(Server::start(), name, path)
    }

    /// Opens the web page of the running service `server` at `path` in a browser.
    pub fn of(server: Server, name: &str, path: &str) -> Self {
        let profile = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("browser-{name}"));
        let _ = std::fs::remove_dir_all(&profile);
        let program = std::env::var("DVI_CHROMIUM").unwrap_or_else(|_| "chromium".to_owned());
        let mut child = Command::new("sh")
            .args(["-c", LAUNCH, &program])
            .arg(&profile)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, from) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        let wire = RefCell::new(Wire { to, from, session: None, last: 0, complaints: vec![] });
        let page = Self { child, wire, profile, server };
        let target = page.call("Target.createTarget", json!({"url": "about:blank"}));
        let attach = json!({"targetId": target["targetId"], "flatten": true});
        let session = page.call("Target.attachToTarget", attach)["sessionId"].as_str().map(str::to_owned);
        page.wire.borrow_mut().session = session;
        for domain in ["Page", "Runtime", "Log"] {
            page.call(&format!("{domain}.enable"), json!({}));
        }
        page.call("Emulation.setFocusEmulationEnabled", json!({"enabled": true}));
        page.go(path);
        page
    }

    pub fn go(&self, path: &str) {
        self.call("Page.navigate", json!({"url": format!("{}{path}", self.server.address)}));
        self.wait("document.readyState === 'complete' && document.querySelectorAll('#example option').length > 1");
    }

    /// Sends a command of the debugging protocol of Chrome to the browser and returns the answer.
    pub fn call(&self, method: &str, parameters: Value) -> Value {
        self.wire.borrow_mut().call(method, &parameters)
    }

    /// Evaluates a JavaScript expression in the page; a promise is awaited.
    pub fn value(&self, expression: &str) -> Value {
        let parameters = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let answer = self.call("Runtime.evaluate", parameters);
        assert!(answer.get("exceptionDetails").is_none(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    pub fn text(&self, selector: &str) -> String {
        self.value(&format!("document.querySelector({selector:?})?.innerText ?? ''")).as_str().unwrap().to_owned()
    }

    /// Waits until a JavaScript expression in the page is true.
    #[track_caller]
    pub fn wait(&self, condition: &str) {
        let start = Instant::now();
        while self.value(&format!("Boolean({condition})")) != true {
            let seen = || self.value("document.body.innerText").as_str().unwrap_or_default().to_owned();
            assert!(start.elapsed() < PATIENCE, "{condition} did not come true; the page shows:\n{}", seen());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Presses the key with this name in `KeyboardEvent.key`.
    pub fn press(&self, key: &str, control: bool) {
        let (code, text) = match key {
            "Tab" => (9, None),
            "Enter" => (13, (!control).then_some("\r")),
            " " => (32, Some(" ")),
            "ArrowLeft" => (37, None),
            "ArrowRight" => (39, None),
            "ArrowDown" => (40, None),
            "ArrowUp" => (38, None),
            "Escape" => (27, None),
            "Home" => (36, None),
            "End" => (35, None),
            key => (key.to_uppercase().bytes().next().unwrap().into(), (!control).then_some(key)),
        };
        let modifiers = if control { 2 } else { 0 };
        let mut down = json!({"type": if text.is_some() { "keyDown" } else { "rawKeyDown" }, "key": key,
            "windowsVirtualKeyCode": code, "modifiers": modifiers});
        if let Some(text) = text {
            down["text"] = json!(text);
        }
        self.call("Input.dispatchKeyEvent", down);
        let up = json!({"type": "keyUp", "key": key, "windowsVirtualKeyCode": code, "modifiers": modifiers});
        self.call("Input.dispatchKeyEvent", up);
    }

    /// Presses Tab until the element with this CSS selector has the focus.
    #[track_caller]
    pub fn tab_to(&self, selector: &str) {
        for _ in 0..250 {
            if self.value(&format!("document.activeElement.matches({selector:?})")) == true {
                return;
            }
            self.press("Tab", false);
        }
        panic!("Tab does not lead to {selector}");
    }

    /// Inserts text into the focused element, all at once as if it were pasted.
    pub fn paste(&self, text: &str) {
        self.call("Input.insertText", json!({"text": text}));
    }

    /// Replaces the text of the specification editor by `specification`, with simulated keys, and submits it; solving
    /// while the text is edited is switched off.
    pub fn solve(&self, specification: &str) {
        self.value("document.getElementById('live').checked = false");
        self.replace_text(specification);
        self.value("document.getElementById('outcome').textContent = ''");
        self.press("Enter", true);
        self.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    }

    pub fn replace_text(&self, text: &str) {
        self.tab_to("#text");
        self.press("a", true);
        self.paste(text);
    }

    /// Returns the numbers of the lines that the specification editor marks as wrong.
    pub fn marked(&self) -> Value {
        self.value(&format!(
            "[...{EDITOR}.querySelectorAll('.cm-lineNumbers .marked')].map((line) => line.textContent)"
        ))
    }

    /// Saves a screenshot of the page for people to look at.
    pub fn picture(&self, name: &str) {
        let answer = self.call("Page.captureScreenshot", json!({"captureBeyondViewport": true}));
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
        std::fs::write(path, from_base64(answer["data"].as_str().unwrap())).unwrap();
    }

    /// Returns the exceptions of the page's scripts, and what the content security policy has blocked, since the page
    /// was opened.
    pub fn complaints(&self) -> Vec<String> {
        self.wire.borrow().complaints.clone()
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.profile);
    }
}

impl Wire {
    fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.last += 1;
        let mut message = json!({"id": self.last, "method": method, "params": parameters});
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let mut bytes = serde_json::to_vec(&message).unwrap();
        bytes.push(0);
        self.to.write_all(&bytes).expect("the browser runs: is the package chromium installed?");
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).unwrap();
            assert_eq!(bytes.pop(), Some(0), "the browser ended: is the package chromium installed?");
            let message: Value = serde_json::from_slice(&bytes).unwrap();
            if message["id"] == self.last {
                assert!(message.get("error").is_none(), "{method}: {message}");
                return message["result"].clone();
            }
            self.listen(&message);
        }
    }

    fn listen(&mut self, message: &Value) {
        let entry = &message["params"]["entry"];
        let failed = message["method"] == "Runtime.exceptionThrown";
        // Network errors in the browser's log, such as refused requests, do not count: the page reports them itself.
        let refused =
            message["method"] == "Log.entryAdded" && entry["level"] == "error" && entry["source"] != "network";
        if failed || refused {
            self.complaints.push(message["params"].to_string());
        }
    }
}

fn from_base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut held) = (0, 0_u32);
    for digit in text.bytes().take_while(|&byte| byte != b'=') {
        held = held << 6 | DIGITS.iter().position(|&known| known == digit).unwrap() as u32;
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            bytes.push((held >> bits) as u8);
        }
    }
    bytes
}

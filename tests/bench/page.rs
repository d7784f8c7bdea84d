//! Response times of the web page: `cargo bench --bench page`, in a headless Chromium without a graphics card;
//! `DVI_CHROMIUM` names another browser.
//!
//! The slider of ten examples is dragged, with another value in each frame of the screen, and each value is timed
//! until a picture that is at least as new is *drawn* (its curves are on the canvas) and *seen* (the frame with them
//! is done). Then the animation of a hundred bodies is played on 800 x 500 pixels. The requirements: drawn within 16
//! ms at the median and 50 ms at the 99th percentile; 20 frames per second. Names of examples after `--` select among
//! these, and `bodies` selects the animation.
//!
//! The output also has the CPU time of all browser processes for an answer or a frame, which the load of the machine
//! does not change.

#[path = "../browser/driver.rs"]
#[expect(dead_code, reason = "tests need more of it")]
mod driver;
#[path = "../browser/server.rs"]
#[expect(dead_code, reason = "tests need more of it")]
mod server;

use driver::Page;
use serde_json::{Value, json};
use std::fmt::Write as _;

const DRAGGED: [&str; 10] = [
    "bouncing_ball",
    "diode_bridge_netlist",
    "switching_circle",
    "fluid_queue",
    "oxygen_diffusion",
    "friction_belt",
    "rolling_ball",
    "relay",
    "buck_converter",
    "memory_abel",
];

/// A script for the page that times the responses to changes of a slider. Each response belongs to the slider value
/// that was newest when its request was sent.
const WATCH: &str = r#"(() => {
    const watch = (window.watch = { newest: 0, answers: [], drawing: null });
    const { fetch } = window;
    window.fetch = async (address, options) => {
        const of = watch.newest;
        const response = await fetch(address, options);
        if (of === 0 || !String(address).endsWith('/solve')) return response;
        const read = response.json.bind(response);
        response.json = async () => {
            const answer = await read();
            watch.answers.push((watch.drawing = { of }));
            return answer;
        };
        return response;
    };
    const { clearRect } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.clearRect = function (...box) {
        clearRect.apply(this, box);
        const answer = watch.drawing;
        if (answer === null || !this.canvas.closest('#plots')) return;
        watch.drawing = null;
        // The panels are drawn in this task.
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => (answer.drawn ??= performance.now());
        port2.postMessage(0);
        requestAnimationFrame(() => {
            const { port1, port2 } = new MessageChannel();
            port1.onmessage = () => (answer.seen = performance.now());
            port2.postMessage(0);
        });
    };
})()"#;

/// A script that drags the first slider for two seconds; returns, for each slider value, the milliseconds until a
/// picture that is at least as new was drawn and seen.
const DRAG: &str = r#"(async () => {
    const { watch } = window;
    const slider = document.querySelector('.knob input[type=range]');
    const [middle, width] = [Number(slider.value), slider.max - slider.min];
    const frame = () => new Promise(requestAnimationFrame);
    const values = [];
    for (let i = 1; i <= 120; i += 1) {
        watch.newest = i;
        slider.value = middle + (0.05 * width * (((i * 7) % 41) - 20)) / 20;
        values.push({ of: i, at: performance.now() });
        slider.dispatchEvent(new Event('input'));
        await frame();
    }
    const since = performance.now();
    while (!watch.answers.some(({ of, seen }) => of === 120 && seen) && performance.now() - since < 5000) await frame();
    slider.dispatchEvent(new Event('change'));
    const after = ({ of, at }, moment) => Math.min(...watch.answers.filter((answer) => answer.of >= of && answer[moment]).map((answer) => answer[moment] - at), 5000);
    return { drawn: values.map((value) => after(value, 'drawn')), seen: values.map((value) => after(value, 'seen')), answers: watch.answers.length };
})()"#;

/// A script that plays the animation for five seconds; returns the milliseconds between frames.
const PLAY: &str = r#"(async () => {
    const [play, slider] = document.querySelectorAll('#clock button, #clock input');
    slider.value = 0;
    slider.dispatchEvent(new Event('input'));
    const frames = [];
    const seen = new MutationObserver(() => frames.push(performance.now()));
    seen.observe(document.querySelector('#clock .time'), { childList: true });
    play.click();
    await new Promise((resume) => setTimeout(resume, 5000));
    play.click();
    return frames.slice(1).map((time, i) => time - frames[i]);
})()"#;

fn main() {
    let selected: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let wanted = |name: &str| selected.is_empty() || selected.iter().any(|one| one == name);
    let page = Page::open("bench-page", "/");
    page.call("Page.addScriptToEvaluateOnNewDocument", json!({"source": WATCH}));
    page.call(
        "Emulation.setDeviceMetricsOverride",
        json!({"width": 1400, "height": 900, "deviceScaleFactor": 1, "mobile": false}),
    );
    println!(
        "{:<22}{:>10}{:>8}{:>10}{:>8}{:>10}{:>12}",
        "ms", "drawn 50%", "99%", "seen 50%", "99%", "answers", "of processors"
    );
    let (mut drawn, mut seen) = (vec![], vec![]);
    for name in DRAGGED.iter().filter(|name| wanted(name)) {
        let (told, busy) = dragged(&page, name);
        let of = |key: &str| told[key].as_array().unwrap().iter().filter_map(Value::as_f64).collect::<Vec<_>>();
        row(name, of("drawn"), of("seen"), &format!("{:>10}{busy:>12.1}", told["answers"]));
        drawn.extend(of("drawn"));
        seen.extend(of("seen"));
    }
    if !drawn.is_empty() {
        row("all", drawn, seen, "");
    }
    if wanted("bodies") {
        played(&page);
    }
}

/// Returns the result of the script [`DRAG`] for an example, and the CPU time per response in milliseconds.
fn dragged(page: &Page, example: &str) -> (Value, f64) {
    page.call("Page.navigate", json!({"url": "about:blank"}));
    page.go(&format!("/#example={example}"));
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    page.wait("document.querySelectorAll('.knob').length > 0");
    // A first drag, not measured, for what the page initialises at first use.
    page.value(DRAG);
    page.value("window.watch.answers.length = 0");
    std::thread::sleep(std::time::Duration::from_millis(500));
    let before = processors();
    let told = page.value(DRAG);
    let answers = told["answers"].as_f64().unwrap().max(1.0);
    (told, (processors() - before) / answers)
}

fn row(name: &str, drawn: Vec<f64>, seen: Vec<f64>, rest: &str) {
    let [a, b] = quantiles(drawn);
    let [c, d] = quantiles(seen);
    println!("{name:<22}{a:>10.1}{b:>8.1}{c:>10.1}{d:>8.1}{rest}");
}

/// Returns the median and the 99th percentile of the given values.
fn quantiles(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [50, 99].map(|percent| values[(values.len() * percent / 100).min(values.len() - 1)])
}

fn played(page: &Page) {
    page.call("Page.navigate", json!({"url": "about:blank"}));
    page.go("/");
    let letters = format!("import('/page/share.js').then(({{packed}}) => packed({}))", json!(bodies()));
    let letters = page.value(&letters);
    page.value(&format!("location.hash = '#s=' + {letters}"));
    let asks = "/press Solve/.test(document.getElementById('before').textContent)";
    page.wait(&format!("{asks} || /successful in/.test(document.getElementById('outcome').textContent)"));
    if page.value(asks) == true {
        page.value("document.getElementById('solve').click()");
    }
    page.wait("document.querySelector('#stage canvas') !== null");
    page.value("Object.assign(document.querySelector('#stage canvas').style, {width: '802px', height: '502px'})");
    let pixels =
        "[document.querySelector('#stage canvas').clientWidth, document.querySelector('#stage canvas').clientHeight]";
    assert_eq!(page.value(pixels), json!([800, 500]));
    std::thread::sleep(std::time::Duration::from_millis(1500));
    let before = processors();
    let told = page.value(PLAY);
    let busy = processors() - before;
    let times: Vec<f64> = told.as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    let (count, sum) = (times.len() as f64, times.iter().sum::<f64>());
    let [median, last] = quantiles(times);
    println!(
        "a hundred bodies: {:.1} frames a second, {median:.1} ms between two at the median, {last:.1} ms at the 99th percentile, {:.1} ms of processors each",
        1e3 * count / sum,
        busy / count
    );
}

/// Returns a specification of a hundred spheres, boxes, capsules and cylinders that are thrown up above the ground.
fn bodies() -> String {
    const SHAPES: [&str; 4] = [
        r#"{"sphere":{"radius":0.1}}"#,
        r#"{"box":{"size":[0.18,0.18,0.18]}}"#,
        r#"{"capsule":{"radius":0.07,"length":0.12}}"#,
        r#"{"cylinder":{"radius":0.09,"length":0.15}}"#,
    ];
    let mut bodies = r#"{"name":"ground","shape":{"half_space":{"normal":[0,0,1]}},"fixed":true}"#.to_owned();
    for k in 0..100 {
        let (i, j, l) = (k / 20, k / 4 % 5, k % 4);
        let [x, y, z] = [i, j, l].map(|place| 0.5 * f64::from(place) + 0.3);
        let shape = SHAPES[((i + j + l) % 4) as usize];
        let turning = [k * 5 % 7 - 3, k * 11 % 7 - 3, 1];
        let _ = write!(
            bodies,
            r#",{{"name":"b{k}","shape":{shape},"mass":1,"position":[{x},{y},{z}],"velocity":[0,0,4.2],"angular_velocity":{turning:?}}}"#
        );
    }
    format!(
        r#"{{"problem":{{"rigid_bodies":{{"gravity":[0,0,-9.81],"bodies":[{bodies}],"contacts":{{"friction":0.4}}}}}},
        "time":{{"end":0.8}},"method":{{"step":0.01}},"output":{{"times":{{"count":11}},"fields":["b0.z"]}}}}"#
    )
}

/// Returns the CPU time of all threads of all browsers on this machine, in milliseconds.
fn processors() -> f64 {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten().map(|entry| entry.path());
    let browsers = processes.filter(|path| {
        std::fs::read(path.join("cmdline"))
            .is_ok_and(|line| String::from_utf8_lossy(&line).contains("browser-bench-page"))
            || std::fs::read_to_string(path.join("comm")).is_ok_and(|name| name.starts_with("chrom"))
    });
    let threads = browsers.flat_map(|path| std::fs::read_dir(path.join("task")).into_iter().flatten().flatten());
    let ran = threads.filter_map(|thread| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    ran.sum::<f64>() / 1e6
}

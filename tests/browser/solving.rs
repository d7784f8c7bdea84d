//! A user of the page comes from a specification to a plot by the keyboard alone.

use crate::driver::Page;
use crate::server::Server;
use serde_json::json;
use std::fs;
use std::path::PathBuf;

/// Specification of `x' = -x`, `x(0) = 1`.
const DECAY: &str = r#"{"label":"Decay","problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1},
"output":{"times":{"count":101}}}"#;

/// A JavaScript expression for the number of pixels of the first plot that have the colour of its curve.
const LINE: &str = "(() => {
    const canvas = document.querySelector('#plots canvas');
    const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const colour = getComputedStyle(document.getElementById('plots')).getPropertyValue('--first').trim();
    const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    let count = 0;
    for (let i = 0; i < data.length; i += 4)
        if (data[i + 3] > 200 && Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b) < 12) count += 1;
    return count;
})()";

/// A JavaScript expression for the first plot as an encoded image.
const IMAGE: &str = "document.querySelector('#plots canvas').toDataURL()";

#[test]
fn an_example_is_chosen_solved_and_read_by_keyboard_alone() {
    let page = Page::open("keyboard", "/");
    page.tab_to("#example");
    for letter in "woodp".chars() {
        page.press(&letter.to_string(), false);
    }
    page.wait("document.getElementById('example').value === 'woodpecker'");
    page.wait("document.getElementById('check').innerText.startsWith('Correct')");
    page.tab_to("#solve");
    page.press("Enter", false);
    page.wait("/successful in/.test(document.getElementById('outcome').textContent)");
    assert!(page.value(LINE).as_u64().unwrap() > 300, "a line is drawn");

    page.tab_to("#plots");
    let whole = page.value(IMAGE);
    page.press("ArrowRight", false);
    page.wait("document.getElementById('hover').innerText.startsWith('t = ')");
    assert_ne!(page.text("#plots figcaption .first"), "", "the value under the cursor is told");
    page.press("+", false);
    page.wait(&format!("{IMAGE} !== {whole}"));
    page.press("0", false);
    page.wait(&format!("{IMAGE} === {whole}"));
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn the_cursor_reads_the_solution() {
    let page = Page::open("cursor", "/");
    page.solve(DECAY);
    page.tab_to("#plots");
    page.press("ArrowRight", false);
    page.wait("document.getElementById('hover').innerText.startsWith('t = ')");
    let told: f64 = page.text("#plots figcaption .first").parse().unwrap();
    let time: f64 = page.text("#hover").strip_prefix("t = ").unwrap().parse().unwrap();
    // At the plot's cursor the page shows the value of the solution at the nearest of 101 output times, and not an
    // interpolated one.
    assert!((told - (-time).exp()).abs() < 0.006, "x({time}) = {told}");
}

#[test]
fn a_job_that_runs_shows_how_far_it_is_and_can_be_cancelled() {
    let page = Page::open("cancel", "/");
    let endless = r#"{"problem":{"dvi":{"states":{"x":{"initial":0,"rate":"cos(1000*t)"}}}},"time":{"end":1e6},
        "output":{"times":{"count":11}}}"#;
    page.replace_text(endless);
    page.press("Enter", true);
    page.wait("/^running, t = .* steps$/.test(document.getElementById('state').innerText)");
    page.tab_to("#cancel");
    page.press("Enter", false);
    page.wait("document.getElementById('outcome').dataset.status === 'dismissed'");
    // The page requests the result of each job only once; thumbnails of examples have jobs of their own.
    let asked = "(() => {
        const jobs = performance.getEntriesByType('resource').map((entry) => /\\/jobs\\/([^/]*)(\\/events)?$/.exec(entry.name)?.[1]).filter(Boolean);
        return [jobs.length > 0, new Set(jobs).size === jobs.length];
    })()";
    assert_eq!(page.value(asked), json!([true, true]), "it is told how the job goes, without asking again");
    assert!(page.text("#message").contains("cancelled"), "{}", page.text("#message"));
    assert_eq!(page.value("document.getElementById('solve').disabled"), false);
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn the_result_is_saved_as_a_table() {
    let page = Page::open("download", "/");
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("browser-downloads");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    page.call("Page.setDownloadBehavior", serde_json::json!({"behavior": "allow", "downloadPath": folder}));
    page.solve(DECAY);
    page.value("document.querySelectorAll('#downloads button')[1].click()");
    let saved = || {
        fs::read_dir(&folder)
            .unwrap()
            .filter_map(Result::ok)
            .filter(|file| file.path().extension().is_some_and(|end| end == "csv"))
            // The browser creates the file of a download before it writes the contents, so that an empty file is not
            // yet the download.
            .find(|file| file.metadata().is_ok_and(|file| file.len() > 0))
    };
    for _ in 0..500 {
        if saved().is_some() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let table = fs::read_to_string(saved().expect("a file is saved").path()).unwrap();
    assert_eq!(table.lines().next(), Some("t,x"));
    assert_eq!(table.lines().count(), 102);
}

#[test]
fn the_address_of_a_job_shows_it_again() {
    let page = Page::open("address", "/");
    page.solve(DECAY);
    let address = page.value("location.hash");
    page.go(&format!("/?again{}", address.as_str().unwrap()));
    page.wait("document.getElementById('label').innerText === 'Decay'");
    page.wait("document.querySelectorAll('#plots canvas').length === 1");
}

#[test]
fn markup_in_a_label_is_text() {
    let page = Page::open("markup", "/");
    let label = "<img src=x onerror=document.title=1><script>document.title=1</script>";
    page.solve(&DECAY.replace("Decay", label));
    assert_eq!(page.text("#label"), label);
    assert_eq!(page.value("document.title"), "dvi");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn a_token_is_asked_for_where_the_service_wants_one() {
    let (server, [token]) = Server::guarded("guarded", [&["submit", "read"]]);
    let page = Page::of(server, "token", "/");
    page.replace_text(DECAY);
    page.wait("!document.getElementById('access').hidden");
    page.tab_to("#token");
    page.paste(&token);
    page.tab_to("#use");
    page.press("Enter", false);
    page.wait("document.getElementById('check').innerText.startsWith('Correct')");
    page.solve(DECAY);
    assert_eq!(page.text("#label"), "Decay");
    assert_eq!(page.complaints(), Vec::<String>::new());
}

#[test]
fn a_token_that_only_reads_is_said_to_do_so_and_another_is_asked_for() {
    let (server, [reads, solves]) = Server::guarded("reading", [&["read"], &["submit", "read"]]);
    let page = Page::of(server, "reading", "/");
    let give = |token: &str| {
        page.wait("!document.getElementById('access').hidden");
        page.tab_to("#token");
        page.paste(token);
        page.tab_to("#use");
        page.press("Enter", false);
    };
    page.replace_text(DECAY);
    give(&reads);
    page.wait(
        "document.getElementById('check').innerText.startsWith('Your token allows reading jobs, but not checking')",
    );
    give(&solves);
    page.wait("document.getElementById('check').innerText.startsWith('Correct')");
    page.solve(DECAY);
    assert_eq!(page.text("#label"), "Decay");
}

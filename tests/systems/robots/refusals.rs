//! Invalid robot descriptions: unsupported elements are errors that name their line, and no text causes a panic.

use super::{MODELS, model};
use dvi::specification::{Specification, SpecificationError, document_of};
use serde_json::{Value, json};

fn errors_of(robot: Value) -> Vec<SpecificationError> {
    let document = json!({"problem": {"rigid_bodies": {"robot": robot}}, "time": {"end": 1}});
    Specification::from_json(document.to_string().as_bytes()).err().unwrap_or_default()
}

/// Asserts that a robot description is refused with an error of this code at this line, whose message contains `words`.
#[track_caller]
fn assert_refused(format: &str, text: &str, line: usize, code: &str, words: &str) {
    let errors = errors_of(json!({format: text}));
    let at = format!("line {line}, ");
    let found = errors.iter().any(|error| {
        error.pointer == format!("/problem/rigid_bodies/robot/{format}")
            && error.code == code
            && error.detail.starts_with(&at)
            && (error.detail.contains(words) || error.expected.as_deref().is_some_and(|text| text.contains(words)))
    });
    assert!(found, "no `{code}` at line {line} with `{words}` among {errors:#?}");
}

fn urdf(inner: &str) -> String {
    format!("<robot name=\"r\">\n{inner}\n</robot>")
}

fn mjcf(inner: &str) -> String {
    format!("<mujoco>\n<worldbody>\n{inner}\n</worldbody>\n</mujoco>")
}

const ARM: &str = "<link name=\"base\"/>\n\
    <link name=\"arm\"><inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\"/></inertial></link>";

#[test]
fn shapes_in_other_files_are_refused_where_they_would_touch() {
    let (_, text) = model("pendulum");
    // In the URDF element `<visual>` a mesh is ignored; in `<collision>` it is an error.
    let text = text.replace("<cylinder radius=\"0.02\" length=\"0.9\"/>", "<mesh filename=\"package://arm.stl\"/>");
    assert_refused("urdf", &text, 32, "unsupported_element", "arm.stl");
    assert_refused(
        "mjcf",
        &mjcf("<body><freejoint/>\n<geom type=\"mesh\" mesh=\"m\"/></body>"),
        4,
        "unsupported_element",
        "mesh",
    );
    let seen = "<body><freejoint/><inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 1\"/>\
                <geom type=\"mesh\" mesh=\"m\" contype=\"0\" conaffinity=\"0\"/></body>";
    assert!(errors_of(json!({"mjcf": mjcf(seen)})).is_empty());
    assert_refused(
        "mjcf",
        &mjcf("<body><freejoint/>\n<geom type=\"ellipsoid\" size=\"1 1 1\"/></body>"),
        4,
        "unsupported_element",
        "ellipsoid",
    );
    assert_refused(
        "mjcf",
        &mjcf("<body><freejoint/>\n<geom type=\"plane\"/></body>"),
        4,
        "unsupported_element",
        "plane",
    );
}

#[test]
fn what_urdf_says_wrongly_is_told_at_its_line() {
    let joint = |inner: &str| {
        urdf(&format!(
            "{ARM}\n<joint name=\"j\" type=\"revolute\">\n<parent link=\"base\"/>\n<child link=\"arm\"/>\n{inner}</joint>"
        ))
    };
    assert_refused("urdf", &joint(""), 4, "missing_key", "<limit>");
    assert_refused("urdf", &joint("<limit lower=\"-1\" upper=\"one\"/>"), 7, "malformed_number", "one");
    assert_refused(
        "urdf",
        &joint("<limit lower=\"-1\" upper=\"1\"/>\n<axis xyz=\"0 1\"/>"),
        8,
        "wrong_count",
        "3 numbers",
    );
    assert_refused("urdf", &joint("<limit lower=\"-1\" upper=\"1\"/>\n<axis xyz=\"0 0 0\"/>"), 4, "zero_direction", "");
    assert_refused(
        "urdf",
        &joint("<limit lower=\"-1\" upper=\"1\"/>\n<mimic joint=\"k\"/>"),
        8,
        "unsupported_element",
        "follows",
    );
    assert_refused(
        "urdf",
        &joint("<limit lower=\"-1\" upper=\"1\"/>\n<axes xyz=\"0 0 1\"/>"),
        8,
        "unsupported_element",
        "axes",
    );
    assert_refused(
        "urdf",
        &urdf(&format!("{ARM}\n<joint name=\"j\" type=\"screw\"><parent link=\"base\"/><child link=\"arm\"/></joint>")),
        4,
        "unsupported_element",
        "screw",
    );
    assert_refused(
        "urdf",
        &urdf(&format!("{ARM}\n<joint name=\"j\" type=\"fixed\"><parent link=\"bas\"/><child link=\"arm\"/></joint>")),
        4,
        "unknown_name",
        "bas",
    );
    assert_refused("urdf", &urdf(&format!("{ARM}\n<link name=\"arm\"/>")), 4, "duplicate_name", "arm");
    let circle = "<joint name=\"j\" type=\"fixed\"><parent link=\"base\"/><child link=\"arm\"/></joint>\n\
                  <joint name=\"k\" type=\"fixed\"><parent link=\"arm\"/><child link=\"base\"/></joint>";
    assert_refused("urdf", &urdf(&format!("{ARM}\n{circle}")), 2, "conflict", "circle");
    let massless = "<link name=\"base\"/>\n<link name=\"arm\"/>\n\
                    <joint name=\"j\" type=\"continuous\"><parent link=\"base\"/><child link=\"arm\"/></joint>";
    assert_refused("urdf", &urdf(massless), 3, "mass_or_density", "`arm` moves and has no mass");
    let wrong = ARM.replace("izz=\"1\"", "izz=\"5\"");
    assert_refused(
        "urdf",
        &urdf(&format!(
            "{wrong}\n<joint name=\"j\" type=\"continuous\"><parent link=\"base\"/><child link=\"arm\"/></joint>"
        )),
        3,
        "triangle_inequality",
        "5",
    );
    assert_refused("urdf", "<robot name=\"r\">\n<link name=\"a\">\n</robot>", 3, "syntax", "XML");
    assert_refused("urdf", "<mujoco/>", 1, "unknown_choice", "mjcf");
    let xacro =
        "<robot name=\"r\" xmlns:xacro=\"http://ros.org/wiki/xacro\">\n<xacro:include filename=\"a.xacro\"/></robot>";
    assert_refused("urdf", xacro, 2, "unsupported_element", "xacro robot.xacro > robot.urdf");
    assert_refused("urdf", "<robot name=\"r\"/>", 1, "empty", "link");
    assert_refused("urdf", "<!DOCTYPE r [<!ENTITY a \"b\">]>\n<robot name=\"r\"/>", 1, "syntax", "entities");
}

#[test]
fn what_mjcf_says_wrongly_is_told_at_its_line() {
    let ball = |inner: &str| mjcf(&format!("<body name=\"a\">\n<freejoint/>\n<geom size=\"1\" {inner}/></body>"));
    assert_refused("mjcf", &ball("class=\"none\""), 5, "unknown_name", "none");
    assert_refused("mjcf", &ball("type=\"blob\""), 5, "unsupported_element", "blob");
    assert_refused("mjcf", &ball("type=\"box\""), 5, "wrong_count", "3 numbers");
    assert_refused("mjcf", &ball("mass=\"-1\""), 5, "out_of_range", "less than nothing");
    assert_refused("mjcf", &ball("quat=\"0 0 0 0\""), 5, "zero_direction", "");
    assert_refused("mjcf", &ball("contype=\"0.5\""), 5, "out_of_range", "32 bits");
    assert_refused("mjcf", &mjcf("<body>\n<joint/></body>"), 3, "mass_or_density", "no mass");
    assert_refused(
        "mjcf",
        &mjcf("<body><joint type=\"screw\"/>\n<geom size=\"1\"/></body>"),
        3,
        "unknown_choice",
        "screw",
    );
    assert_refused("mjcf", &mjcf("<include file=\"a.xml\"/>"), 3, "unsupported_element", "another file");
    assert_refused(
        "mjcf",
        &mjcf("<body gravcomp=\"1\"><freejoint/><geom size=\"1\"/></body>"),
        3,
        "unsupported_element",
        "gravity",
    );
    assert_refused(
        "mjcf",
        "<mujoco>\n<option density=\"4000\"/>\n<worldbody/></mujoco>",
        2,
        "unsupported_element",
        "fluid",
    );
    assert_refused(
        "mjcf",
        "<mujoco>\n<tendon><spatial stiffness=\"1\"/></tendon></mujoco>",
        2,
        "unsupported_element",
        "tendon",
    );
    assert_refused(
        "mjcf",
        "<mujoco>\n<equality><joint joint1=\"a\"/></equality></mujoco>",
        2,
        "unsupported_element",
        "<connect>",
    );
    assert_refused(
        "mjcf",
        "<mujoco>\n<actuator><motor joint=\"a\"/></actuator></mujoco>",
        2,
        "unknown_name",
        "`a` is no joint",
    );
    assert_refused("mjcf", "<mujoco/>", 1, "empty", "no bodies");
    assert_refused("mjcf", "<mujoco>\n<worldbdy/></mujoco>", 2, "unsupported_element", "worldbdy");
    // Interpenetrating bodies are reported at the line of the second one.
    let two = "<body name=\"a\"><freejoint/><geom size=\"1\"/></body>\n<body name=\"b\"><freejoint/><geom size=\"1\"/></body>";
    assert_refused("mjcf", &mjcf(two), 4, "interpenetration", "`a` and `b` overlap");
}

#[test]
fn what_stands_beside_a_description_is_told_at_its_key() {
    let (_, text) = model("double_pendulum");
    let errors = errors_of(
        json!({"urdf": text, "pose": {"sholder": 1, "elbow": {"position": "pi"}, "shoulder": {"angle": 1}}, "motors": {"knee": {"effort": 1}}}),
    );
    let has = |pointer: &str, code: &str| errors.iter().any(|error| error.pointer == pointer && error.code == code);
    assert!(has("/problem/rigid_bodies/robot/pose/sholder", "unknown_name"), "{errors:#?}");
    assert!(has("/problem/rigid_bodies/robot/pose/elbow/position", "constant"), "{errors:#?}");
    let near =
        errors.iter().find(|error| error.pointer.ends_with("sholder")).and_then(|error| error.did_you_mean.clone());
    assert_eq!(near.as_deref(), Some("shoulder"));
    let errors = errors_of(json!({"urdf": text, "motors": {"knee": {"effort": 1}, "elbow": {"effort": "upper.x"}}}));
    let has = |pointer: &str, code: &str| errors.iter().any(|error| error.pointer == pointer && error.code == code);
    assert!(has("/problem/rigid_bodies/robot/motors/knee", "unknown_name"), "{errors:#?}");
    assert!(has("/problem/rigid_bodies/robot/motors/elbow/effort", "depends_on_state"), "{errors:#?}");
    let errors = errors_of(json!({"urdf": text, "mjcf": "<mujoco/>"}));
    assert!(errors.iter().any(|error| error.pointer == "/problem/rigid_bodies/robot" && error.code == "conflict"));
    assert!(
        errors_of(json!({"urdf": model("arm").1, "pose": {"elbow": 4}}))
            .iter()
            .any(|error| { error.pointer == "/problem/rigid_bodies/robot/pose/elbow" && error.code == "out_of_range" })
    );
    // Errors in bodies beside a robot description are reported at their own JSON pointers.
    let document = json!({"problem": {"rigid_bodies": {"robot": {"urdf": text}, "bodies": [{"name": "a", "shape": {"sphere": {"radius": -1}}, "mass": 1}]}}, "time": {"end": 1}});
    let errors = Specification::from_json(document.to_string().as_bytes()).unwrap_err();
    assert_eq!(errors[0].pointer, "/problem/rigid_bodies/bodies/0/shape/sphere/radius");
}

/// Returns a robot description with random edits, to test that any input is read or refused.
fn changed(text: &str, random: &mut fastrand::Rng) -> String {
    const PIECES: [&str; 24] = [
        "<",
        ">",
        "\"",
        "/",
        "=",
        "nan",
        "1e999",
        "-1",
        "0",
        "1e-300",
        "<link",
        "<joint",
        "</body>",
        "<body>",
        "<geom/>",
        "type=\"free\"",
        "<default class=\"a\">",
        "class=\"a\"",
        "&lt;",
        "<!--",
        "]]>",
        "\u{e9}",
        "<frame>",
        "fromto=\"0 0 0 0 0 0\"",
    ];
    let mut letters: Vec<char> = text.chars().collect();
    for _ in 0..=random.usize(0..4) {
        let at = random.usize(0..=letters.len());
        match random.u8(0..5) {
            0 => drop(letters.drain(at..(at + random.usize(0..40)).min(letters.len()))),
            1 => drop(letters.splice(at..at, random.choice(PIECES).unwrap_or_default().chars())),
            2 => {
                let from = random.usize(0..=letters.len());
                let copy: Vec<char> = letters[from..(from + random.usize(0..200)).min(letters.len())].to_vec();
                drop(letters.splice(at..at, copy));
            }
            3 => {
                // Replaces a digit of the description by an extreme number.
                if let Some(digit) = letters[at..].iter().position(char::is_ascii_digit) {
                    let extreme = *random.choice(&["0", "-5", "1e308", "1e-320", "7", "nan"]).unwrap_or(&"0");
                    drop(letters.splice(at + digit..=at + digit, extreme.chars()));
                }
            }
            _ => letters.truncate(at.max(1)),
        }
    }
    letters.into_iter().collect()
}

#[test]
fn whatever_is_written_is_read_or_refused() {
    let count = std::env::var("DVI_ROBOTS").ok().and_then(|text| text.parse().ok()).unwrap_or(3_000);
    let mut random = fastrand::Rng::with_seed(7);
    let (mut correct, mut refused) = (0, 0);
    for k in 0..count {
        let (_, format, text) = MODELS[k % MODELS.len()];
        let text = changed(text, &mut random);
        let document = json!({"problem": {"rigid_bodies": {"robot": {format: text}}}, "time": {"end": 1e-3}, "limits": {"steps": 2}});
        match Specification::from_json(document.to_string().as_bytes()) {
            Ok(specification) => {
                correct += 1;
                drop(dvi::solve(&specification, &dvi::problem::Control::new()));
            }
            Err(errors) => {
                refused += 1;
                for error in errors.iter().filter(|error| error.code != "more_errors") {
                    let is_at_line = error.pointer.ends_with(format) && error.detail.starts_with("line ");
                    assert!(is_at_line, "{error:#?} of\n{text}");
                }
            }
        }
        drop(document_of(text.as_bytes()));
    }
    assert!(correct > count / 20 && refused > count / 4, "{correct} correct, {refused} refused");
}

#[test]
fn deep_and_wide_descriptions_cost_no_stack() {
    let deep =
        format!("<mujoco><worldbody>{}{}</worldbody></mujoco>", "<body>".repeat(20_000), "</body>".repeat(20_000));
    assert!(!errors_of(json!({"mjcf": deep})).is_empty());
    let frames =
        format!("<mujoco><worldbody>{}{}</worldbody></mujoco>", "<frame>".repeat(20_000), "</frame>".repeat(20_000));
    assert!(!errors_of(json!({"mjcf": frames})).is_empty());
    let mut links = String::from("<link name=\"l0\"/>");
    for k in 1..3_000 {
        links += &format!(
            "<link name=\"l{k}\"/><joint name=\"j{k}\" type=\"fixed\"><parent link=\"l{}\"/><child link=\"l{k}\"/></joint>",
            k - 1
        );
    }
    assert!(errors_of(json!({"urdf": urdf(&links)})).iter().any(|error| error.code == "nothing_moves"));
}

#[test]
fn a_file_in_the_place_of_a_document_is_told_where_it_goes() {
    for (format, text) in [("urdf", model("pendulum").1), ("mjcf", model("hopper").1)] {
        let errors = Specification::from_json(text.as_bytes()).unwrap_err();
        let expected = errors[0].expected.as_deref().unwrap_or_default();
        assert!(expected.contains("\"robot\"") && expected.contains(format), "{errors:#?}");
    }
}

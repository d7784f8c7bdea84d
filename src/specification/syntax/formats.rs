//! Recognition of documents in other formats by their first lines, and of netlists by their commands.

use super::Slip;
use crate::robot;

/// First letters of netlist lines: resistors, capacitors, inductors, sources, diodes and switches.
const COMPONENTS: &str = "RCLVIDSrclvids";

/// Describes a text in another format, that is, one that does not begin like an object.
pub(super) fn other(text: &str) -> Option<Slip> {
    let text = text.trim_start();
    let line = text.lines().next()?.trim_end();
    let member = |mark: char| line.split_once(mark).filter(|(word, _)| is_word(word.trim_end()));
    let write = "JSON: {\"problem\": {...}, \"time\": {\"end\": 1}}";
    let is_table = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).is_some_and(is_word);
    let netlist = Slip::new(
        "text that looks like a netlist",
        "a line `.tran STEP END`, with which a file is solved as it is; or it as a string in JSON: \
         {\"problem\": {\"circuit\": {\"netlist\": \"V1 a 0 10\\nR1 a 0 1\"}}, \"time\": {\"end\": 1}}",
    );
    Some(if line.starts_with('{') {
        return None;
    } else if text.lines().any(is_command) {
        netlist
    } else if is_table || member('=').is_some() {
        Slip::new("text that looks like TOML", write)
    } else if line.starts_with("---") || member(':').is_some() {
        Slip::new("text that looks like YAML", write)
    } else if let Some(format) = robot::format_of(text) {
        let write = match format {
            "urdf" => {
                "it as a string in JSON: {\"problem\": {\"rigid_bodies\": {\"robot\": {\"urdf\": \"<robot ..\"}}}, \"time\": {\"end\": 1}}"
            }
            _ => {
                "it as a string in JSON: {\"problem\": {\"rigid_bodies\": {\"robot\": {\"mjcf\": \"<mujoco ..\"}}}, \"time\": {\"end\": 1}}"
            }
        };
        Slip::new("the description of a robot", write)
    } else if line.starts_with('<') {
        Slip::new("text that looks like XML", write)
    } else if is_netlist(text) {
        netlist
    } else if line.starts_with(['[', '"']) {
        return None;
    } else {
        Slip::new("text that is not JSON", "a JSON object: {\"problem\": {...}, \"time\": {\"end\": 1}}")
    })
}

fn is_word(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
}

/// Whether a line is a command of a netlist, such as `.model` or `.end`.
fn is_command(line: &str) -> bool {
    line.strip_prefix('.').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_alphabetic()))
}

/// Whether the text begins as a netlist, or its first line other than a title or comment is a component between nodes.
fn is_netlist(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('*'));
    let is_component = |line: &str| line.starts_with(|c| COMPONENTS.contains(c)) && line.split_whitespace().count() > 3;
    text.starts_with(['*', '.']) || lines.next().is_some_and(is_component)
}

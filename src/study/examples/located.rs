//! Scratch.
use std::io::BufRead;
fn main() {
    for line in std::io::stdin().lock().lines() {
        let line = line.unwrap();
        let specification = match specification::Specification::from_json(line.as_bytes()) {
            Ok(specification) => specification,
            Err(errors) => {
                println!("{}", serde_json::json!({"errors": format!("{errors:?}")}));
                continue;
            }
        };
        let solution = study::solve(&specification, &problem::Control::new());
        let mut out = Vec::new();
        solution::encodings::write_json(&solution, &mut out).unwrap();
        println!("{}", String::from_utf8(out).unwrap().replace('\n', " "));
    }
}

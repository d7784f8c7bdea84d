//! A circuit given as JSON text: an ideal diode charges a capacitor to the peak voltage of a source, and the
//! capacitor then holds this voltage. `cargo run --release --example peak_detector`.

use dvi::{AbsoluteTolerance, Problem, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let held = held_voltage(3.0)?;
    println!("held: {held} V of a peak of 3 V");
    Ok(())
}

/// Returns the voltage that the capacitor holds, for a sinusoidal source with the given peak.
pub fn held_voltage(peak: f64) -> Result<f64, Box<dyn std::error::Error>> {
    let circuit = Problem::text(&format!(
        r#"{{"circuit": {{"components": [
            {{"voltage_source": {{"name": "V1", "nodes": ["in", "0"], "volts": "{peak}*sin(100*pi*t)"}}}},
            {{"diode": {{"name": "D1", "nodes": ["in", "a"]}}}},
            {{"resistor": {{"name": "R1", "nodes": ["a", "out"], "ohms": 1e-3}}}},
            {{"capacitor": {{"name": "C1", "nodes": ["out", "0"], "farads": 1e-6, "volts": 0}}}}]}}}}"#
    ));
    let settings = Settings {
        rtol: 1e-9,
        atol: AbsoluteTolerance::Uniform(1e-12),
        fields: Some(vec!["v(out)".to_owned()]),
        ..Settings::default()
    };
    let solution = circuit.solve(0.04, &settings)?;
    if !solution.verdict.trusted {
        println!("not trusted: {:?}", solution.verdict.because);
    }
    let column = solution.trajectory.field("v(out)").ok_or("no column of the voltage")?;
    Ok(*column.last().ok_or("no value at the end")?)
}

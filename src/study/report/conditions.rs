//! The conditions of a measurement: without machine and date, run times mean nothing to others.

use serde::{Deserialize, Serialize};
use std::fs;
use std::thread::available_parallelism;

/// The machine, the program and the date of a measurement.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Conditions {
    /// Name and version of the program.
    pub program: String,
    /// Optimisation level that the program was built with.
    pub build: String,
    /// Name of the processor.
    pub processor: String,
    /// Number of processors that the measured runs may use.
    pub cores: usize,
    /// Name and version of the operating system of the machine.
    pub system: String,
    /// Date of the measurement, such as `2026-11-23`.
    pub date: String,
}

impl Conditions {
    /// Returns the conditions of a measurement by this process, on the day `date`.
    pub fn here(date: String) -> Self {
        let first = |file: &str, key: &str| {
            let text = fs::read_to_string(file).ok()?;
            let value = text.lines().find_map(|line| line.strip_prefix(key))?;
            Some(value.trim_start_matches([' ', '\t', ':', '=']).trim_matches('"').to_owned())
        };
        let kernel = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
        let system = first("/etc/os-release", "PRETTY_NAME").unwrap_or_else(|| std::env::consts::OS.to_owned());
        Self {
            program: concat!("dvi ", env!("CARGO_PKG_VERSION")).to_owned(),
            build: if cfg!(debug_assertions) { "without optimisation: its times mean little" } else { "optimised" }
                .to_owned(),
            processor: first("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            cores: available_parallelism().map_or(1, usize::from),
            system: format!("{system} {}", kernel.trim()).trim().to_owned(),
            date,
        }
    }
}

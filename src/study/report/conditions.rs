//! Where and when times were measured: without that, they mean nothing to anybody else.

use serde::{Deserialize, Serialize};
use std::fs;
use std::thread::available_parallelism;

/// The machine, the program and the day.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Conditions {
    /// The program and its version.
    pub program: String,
    /// The optimisation that it was built with.
    pub build: String,
    /// The processor.
    pub processor: String,
    /// Processors that the run may use.
    pub cores: usize,
    /// The operating system.
    pub system: String,
    /// The day, as `2026-11-23`.
    pub date: String,
}

impl Conditions {
    /// The conditions of this run, on the day `date`.
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

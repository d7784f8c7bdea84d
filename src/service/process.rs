//! Metrics of this process (memory, files, CPU time) under the names used by all Prometheus exporters, read from
//! `/proc/self`. They stay at zero on systems without `/proc`.

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Registry, Unit};
use rustix::param::{clock_ticks_per_second, page_size};
use std::fs;
use std::sync::atomic::AtomicU64;

/// Memory, open files and CPU time of the service process, without its workers.
#[derive(Debug, Default)]
pub struct Process {
    resident: Gauge,
    files: Gauge,
    most_files: Gauge,
    cpu: Counter<f64, AtomicU64>,
}

impl Process {
    /// Registers the process metrics under their standard Prometheus names.
    pub fn register(&self, registry: &mut Registry) {
        let registry = registry.sub_registry_with_prefix("process");
        registry.register_with_unit(
            "resident_memory",
            "Memory of the service, without its workers",
            Unit::Bytes,
            self.resident.clone(),
        );
        registry.register("open_fds", "Files and connections that the service has open", self.files.clone());
        registry.register("max_fds", "Files and connections that it may have open", self.most_files.clone());
        registry.register_with_unit(
            "cpu",
            "Time on processors that the service took, without its workers",
            Unit::Seconds,
            self.cpu.clone(),
        );
    }

    /// Reads the current values of the process metrics.
    pub fn look(&self) {
        let pages = fs::read_to_string("/proc/self/statm").ok().and_then(|text| text.split(' ').nth(1)?.parse().ok());
        self.resident.set(pages.map_or(0, |pages: i64| pages.saturating_mul(page_size() as i64)));
        // One of the open file descriptors is that of the folder `/proc/self/fd` being read.
        let files = fs::read_dir("/proc/self/fd").map_or(0, |files| files.count().saturating_sub(1));
        self.files.set(i64::try_from(files).unwrap_or(i64::MAX));
        self.most_files.set(most_files().unwrap_or_default());
        if let Some(seconds) = cpu_seconds() {
            self.cpu.inc_by((seconds - self.cpu.get()).max(0.0));
        }
    }
}

fn most_files() -> Option<i64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    limits.lines().find_map(|line| line.strip_prefix("Max open files")?.split_whitespace().next()?.parse().ok())
}

/// Returns the CPU time of the process: fields 14 and 15 of `/proc/self/stat`, in clock ticks, counted after the
/// program name, which may contain spaces.
fn cpu_seconds() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?;
    Some(ticks as f64 / clock_ticks_per_second() as f64)
}

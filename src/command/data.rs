//! The data folder of the service.

use clap::Args;
use std::env;
use std::path::PathBuf;

/// The option for the data folder.
#[derive(Args)]
pub struct Data {
    /// Folder of the accepted jobs, their results and the tokens; created if it does not exist
    /// [default: dvi in `$XDG_STATE_HOME`, or in ~/.local/state]
    #[arg(long, env = "DVI_DATA", value_name = "DIR", global = true)]
    data: Option<PathBuf>,
}

impl Data {
    /// Returns the data folder; `None` if no folder is given and there is no home directory.
    pub fn folder(&self) -> Option<PathBuf> {
        // The XDG Base Directory Specification, version 0.8, requires that relative paths are ignored.
        let state = |variable, below: &str| {
            let folder = env::var_os(variable).map(PathBuf::from).filter(|folder| folder.is_absolute());
            folder.map(|folder| folder.join(below))
        };
        let given = self.data.clone();
        given.or_else(|| state("XDG_STATE_HOME", "dvi")).or_else(|| state("HOME", ".local/state/dvi"))
    }
}

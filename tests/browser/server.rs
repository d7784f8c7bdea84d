//! A process of the program that serves HTTP on a port of its own until the handle is dropped.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

pub struct Server {
    child: Child,
    pub address: String,
}

impl Server {
    /// Starts a service that is reachable from this machine only and keeps no jobs on disk.
    pub fn start() -> Self {
        Self::start_with(&["--listen", "127.0.0.1:0", "--ephemeral"])
    }

    /// Starts a service that requires access tokens, and creates a token for each list of permissions (scopes).
    pub fn guarded<const N: usize>(name: &str, scopes: [&[&str]; N]) -> (Self, [String; N]) {
        let data = format!("{}/{name}", env!("CARGO_TARGET_TMPDIR"));
        let _ = std::fs::remove_dir_all(&data);
        let create = |scopes: &[&str]| {
            let mut create = Command::new(env!("CARGO_BIN_EXE_dvi"));
            create.args(["token", "create", "--name", name, "--data", &data]);
            for scope in scopes {
                create.args(["--scope", scope]);
            }
            String::from_utf8(create.output().unwrap().stdout).unwrap().trim().to_owned()
        };
        let tokens = scopes.map(create);
        let server = Self::start_with(&["--listen", "127.0.0.1:0", "--ask-tokens", "--data", &data]);
        (server, tokens)
    }

    pub fn start_with(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_dvi"))
            .arg("serve")
            .args(arguments)
            .env("RUST_LOG", "info,dvi::request=off,dvi::job=off")
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
        let line = log.find_map(|line| line.ok().filter(|line| line.contains("serving on"))).unwrap();
        let at = line.find("http://").unwrap();
        let address = line[at..].split_whitespace().next().unwrap().to_owned();
        // Reads the log of the service continuously, since a process blocks when the pipe of its output is full.
        std::thread::spawn(move || log.for_each(drop));
        Self { child, address }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

//! `dvi solve --server`: the program as the client of a running service.

use crate::harness::DECAY;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Output, Stdio};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};

/// A service process, killed at the end of its test.
struct Serving {
    process: Child,
    url: String,
}

impl Serving {
    fn start() -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_dvi"))
            .args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--ephemeral"])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stderr.take().unwrap()).read_line(&mut line).unwrap();
        let entry: serde_json::Value = serde_json::from_str(&line).unwrap();
        let url = format!("http://{}", entry["fields"]["address"].as_str().unwrap());
        Self { process, url }
    }

    fn solve(&self, format: &str, specification: &str) -> Output {
        solve(&self.url, format, specification)
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        // Killing the service fails if it has ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn solve(url: &str, format: &str, specification: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_dvi"))
        .args(["solve", "--server", url, "--format", format, "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Writing fails if the program has rejected its command line and ended without reading.
    let _ = child.stdin.take().unwrap().write_all(specification.as_bytes());
    child.wait_with_output().unwrap()
}

#[test]
fn a_server_solves_as_the_program_does() {
    let serving = Serving::start();
    let output = serving.solve("json", DECAY);
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), b"".as_slice()), "{output:?}");
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let x = result["trajectory"]["fields"]["x"].as_array().unwrap().last().unwrap().as_f64().unwrap();
    assert!((x - (-1.0_f64).exp()).abs() < 1e-5, "{x}");
    let table = String::from_utf8(serving.solve("csv", DECAY).stdout).unwrap();
    assert_eq!(table.lines().next(), Some("t,x"));
    assert!(serving.solve("arrow", DECAY).stdout.starts_with(&[0xff; 4]));
}

#[test]
fn a_solve_that_ends_early_has_its_own_exit_code_in_every_form() {
    let serving = Serving::start();
    // The solution x = 1/(1 - t) blows up at t = 1.
    let explosive = DECAY.replace("\"-x\"", "\"x^2\"").replace("\"end\":1", "\"end\":2");
    for format in ["json", "csv"] {
        let output = serving.solve(format, &explosive);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(!output.stdout.is_empty() && !output.stderr.is_empty(), "{output:?}");
    }
}

#[test]
fn the_errors_that_a_server_finds_are_told_with_their_places() {
    let output = Serving::start().solve("json", &DECAY.replace("\"-x\"", "\"-y\""));
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{output:?}");
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.starts_with("-: 1 error\n") && told.contains("/problem/dvi/states/x/rate: "), "{told}");
}

#[test]
fn a_server_that_is_not_there_is_named() {
    // The local port of an open connection is used as the address of the absent service: no program listens on it,
    // and no other program gets it while the connection is open.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let held = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    let deaf = held.local_addr().unwrap();
    let output = solve(&format!("http://{deaf}"), "json", DECAY);
    assert_eq!(output.status.code(), Some(6), "{output:?}");
    assert!(String::from_utf8(output.stderr).unwrap().contains(&deaf.to_string()));
    assert_eq!(solve("localhost", "json", DECAY).status.code(), Some(64));
}

/// Starts a TLS proxy for the service at `address`, with a certificate for localhost that `tls/authority.pem` has
/// signed; returns its port.
fn encrypting(address: &str) -> u16 {
    let (address, (bound, port)) = (address.to_owned(), std::sync::mpsc::channel());
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let certificates = CertificateDer::pem_slice_iter(include_bytes!("tls/localhost.pem")).map(Result::unwrap);
            let key = PrivateKeyDer::from_pem_slice(include_bytes!("tls/localhost.key")).unwrap();
            let config = ServerConfig::builder_with_provider(std::sync::Arc::new(ring::default_provider()))
                .with_safe_default_protocol_versions()
                .unwrap()
                .with_no_client_auth()
                .with_single_cert(certificates.collect(), key)
                .unwrap();
            let acceptor = TlsAcceptor::from(std::sync::Arc::new(config));
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
            bound.send(listener.local_addr().unwrap().port()).unwrap();
            loop {
                let (stream, _) = listener.accept().await.unwrap();
                let (acceptor, address) = (acceptor.clone(), address.clone());
                tokio::spawn(async move {
                    // A client that does not trust the certificate of the proxy disconnects.
                    let Ok(mut inner) = acceptor.accept(stream).await else { return };
                    let mut service = tokio::net::TcpStream::connect(address).await.unwrap();
                    let _ = tokio::io::copy_bidirectional(&mut inner, &mut service).await;
                });
            }
        });
    });
    port.recv().unwrap()
}

#[test]
fn an_encrypted_service_is_asked_by_those_who_trust_it() {
    let serving = Serving::start();
    let port = encrypting(serving.url.strip_prefix("http://").unwrap());
    let solve = |host: &str, trusted: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dvi"));
        command.args(["solve", "--server", &format!("https://{host}:{port}"), "--format", "csv", "-"]);
        command.env_remove("SSL_CERT_FILE").env_remove("SSL_CERT_DIR");
        command.envs(trusted.map(|file| ("SSL_CERT_FILE", file)));
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(DECAY.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    };
    let authority = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/service/tls/authority.pem");
    for host in ["localhost", "127.0.0.1"] {
        let output = solve(host, Some(authority));
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert!(output.stdout.starts_with(b"t,x\n"));
    }
    // A service whose certificate this machine does not trust gets no request, and the message says why.
    let output = solve("localhost", None);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(6), "{output:?}");
    assert!(said.contains("SSL_CERT_FILE"), "{said}");
    let output = solve("[::ffff:127.0.0.1]", Some(authority));
    assert_eq!(output.status.code(), Some(6), "a certificate for another name: {output:?}");
}

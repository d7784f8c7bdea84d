//! `dvi healthcheck`: tests whether the service on this machine is alive, for systems without curl.

use super::UNHEALTHY;
use clap::Args;
use dvi::service::Options;
use std::io::{self, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream};
use std::process::ExitCode;
use std::time::Duration;

/// Check that the service on this machine is alive
///
/// Exit codes: 0 if it is alive, 1 if not.
#[derive(Args)]
pub struct Arguments {
    /// Address and port on which the service listens
    #[arg(long, env = "DVI_LISTEN", value_name = "ADDRESS:PORT", default_value_t = Options::default().listen)]
    listen: SocketAddr,
}

/// Time limit for connecting to the service, and for each read from the connection or write to it.
const IO_TIMEOUT: Duration = Duration::from_secs(2);

/// The beginning of an HTTP response that reports that the service is alive.
const STATUS_LINE: &str = "HTTP/1.1 200";

/// Runs `dvi healthcheck`: sends one request to the service; returns the exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    let address = reachable(arguments.listen);
    match ask(address) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => {
            eprintln!("dvi: {address} responds, but does not report that it is alive");
            ExitCode::from(UNHEALTHY)
        }
        Err(error) => {
            eprintln!("dvi: {address} does not respond: {error}");
            ExitCode::from(UNHEALTHY)
        }
    }
}

/// Returns the address to connect to for a service that listens on `listen`: the loopback address, if it listens on all
/// addresses.
fn reachable(mut listen: SocketAddr) -> SocketAddr {
    match listen.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => listen.set_ip(Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(ip) if ip.is_unspecified() => listen.set_ip(Ipv6Addr::LOCALHOST.into()),
        _ => {}
    }
    listen
}

fn ask(address: SocketAddr) -> io::Result<bool> {
    let mut stream = TcpStream::connect_timeout(&address, IO_TIMEOUT)?;
    stream.set_read_timeout(Some(IO_TIMEOUT))?;
    stream.set_write_timeout(Some(IO_TIMEOUT))?;
    write!(stream, "GET /healthz HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")?;
    let mut status = [0; STATUS_LINE.len()];
    stream.read_exact(&mut status)?;
    Ok(status == STATUS_LINE.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader};
    use std::net::TcpListener;
    use std::thread;

    #[track_caller]
    fn assert_answer(answer: &'static str, alive: Option<bool>) {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let server = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            // Read the whole request of the test client: closing with unread bytes would reset the connection and lose
            // the response.
            let request: Vec<String> =
                BufReader::new(&stream).lines().map(Result::unwrap).take_while(|line| !line.is_empty()).collect();
            stream.write_all(answer.as_bytes()).unwrap();
            assert_eq!(request[0], "GET /healthz HTTP/1.1");
        });
        assert_eq!(ask(address).ok(), alive, "{answer}");
        server.join().unwrap();
    }

    #[test]
    fn only_200_means_alive() {
        assert_answer("HTTP/1.1 200 OK\r\n\r\n", Some(true));
        assert_answer("HTTP/1.1 503 Service Unavailable\r\n\r\n", Some(false));
        assert_answer("SSH-2.0-something else", Some(false));
        assert_answer("HTTP", None);
    }

    #[test]
    fn an_unspecified_address_is_reached_on_the_loopback_one() {
        let reached = |text: &str| reachable(text.parse().unwrap()).to_string();
        assert_eq!(reached("0.0.0.0:80"), "127.0.0.1:80");
        assert_eq!(reached("[::]:80"), "[::1]:80");
        assert_eq!(reached("10.1.2.3:80"), "10.1.2.3:80");
    }
}

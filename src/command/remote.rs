//! `dvi solve --server URL`: the solve is done by a running service.
//!
//! 1. The specification is posted unchanged; the service checks it.
//! 2. A solve that takes longer than five seconds is followed until it ends. Ctrl-C cancels it in the service.
//! 3. The results are copied to standard output, or to a file, as the service sends them.

use super::result::destination;
use super::tls;
use super::{BAD_SPECIFICATION, Told, UNANSWERED, UNWRITABLE, report, verdict};
use axum::body::{Body, HttpBody, to_bytes};
use axum::http::{HeaderMap, Method, Request, StatusCode, Uri, header, uri::Scheme};
use dvi::solution::Verdict;
use hyper::body::Incoming;
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper_util::rt::TokioIo;
use serde::Deserialize;
use std::future::poll_fn;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::pin::{Pin, pin};
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::signal::ctrl_c;
use tokio::time::sleep;

/// The address of a service that requests are sent to, and the token to send.
#[derive(Clone, Debug)]
pub struct Server {
    authority: String,
    host: String,
    port: u16,
    is_encrypted: bool,
    /// The path under which a proxy serves the service, prefixed to the path of every request; empty if there is
    /// none.
    prefix: String,
    token: Option<String>,
}

impl FromStr for Server {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let uri: Uri = text.parse().map_err(|error| format!("{error}"))?;
        let is_encrypted = uri.scheme() == Some(&Scheme::HTTPS);
        if !is_encrypted && uri.scheme() != Some(&Scheme::HTTP) {
            return Err("an address such as http://localhost:8080 or https://solve.example".to_owned());
        }
        let authority = uri.authority().ok_or("the address has no host: write http://HOST:PORT")?;
        Ok(Self {
            authority: authority.to_string(),
            host: authority.host().to_owned(),
            port: authority.port_u16().unwrap_or(if is_encrypted { 443 } else { 80 }),
            is_encrypted,
            prefix: uri.path().trim_end_matches('/').to_owned(),
            token: None,
        })
    }
}

/// Value of the `Prefer` header: the seconds that the service may take to respond with results before it responds
/// with a job.
const MOMENT: &str = "wait=5";
/// The interval between two requests for the status of a job.
const POLL_INTERVAL: Duration = Duration::from_millis(500);
/// The largest size of a response other than results, in bytes.
const MOST: usize = 16 << 20;

/// The reason why a solve by a service has no results.
enum RemoteError {
    /// The connection to the service could not be made, or broke off.
    Lost(String),
    /// The service refused the request.
    Refused(ProblemDetails),
    /// Standard output, or the file of the results, could not be written.
    Unwritable(io::Error),
}

/// The members of problem details (RFC 9457) that are reported to the user.
#[derive(Deserialize)]
struct ProblemDetails {
    title: String,
    detail: String,
    #[serde(default)]
    errors: Vec<Told>,
}

/// The members of the status of a job that the client uses.
#[derive(Deserialize)]
struct Status {
    status: String,
    progress: u8,
    steps: u64,
    message: Option<String>,
    /// The verdict on the solution of the job; absent while the job has no solution.
    verdict: Option<Verdict>,
}

/// Solves `specification`, read from `file`, by the service `server`; returns the exit code.
pub fn run(
    server: &Server,
    file: &Path,
    specification: Vec<u8>,
    media_type: &'static str,
    output: Option<&Path>,
) -> ExitCode {
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => {
            eprintln!("dvi: {error}");
            return ExitCode::from(UNANSWERED);
        }
    };
    match runtime.block_on(server.solve(specification, media_type, output)) {
        Ok(status) => {
            let reached_end = status.status == "successful";
            if !reached_end {
                eprintln!("dvi: {}", status.message.unwrap_or(status.status));
            }
            eprint!("{}", status.verdict.as_ref().map(verdict::lines).unwrap_or_default());
            verdict::exit_code(reached_end, status.verdict.as_ref())
        }
        Err(RemoteError::Refused(refusal)) if !refusal.errors.is_empty() => {
            eprint!("{}", report(file, &refusal.errors));
            ExitCode::from(BAD_SPECIFICATION)
        }
        Err(RemoteError::Refused(refusal)) => {
            eprintln!("dvi: {}: {}: {}", server.authority, refusal.title, refusal.detail);
            ExitCode::from(UNANSWERED)
        }
        Err(RemoteError::Lost(why)) => {
            eprintln!("dvi: {}: {why}", server.authority);
            ExitCode::from(UNANSWERED)
        }
        Err(RemoteError::Unwritable(error)) => {
            eprintln!("dvi: cannot write the result: {error}");
            ExitCode::from(UNWRITABLE)
        }
    }
}

impl Server {
    /// Returns the service with a token that is sent with every request to it.
    pub fn showing(self, token: Option<&str>) -> Self {
        Self { token: token.map(|token| format!("Bearer {token}")), ..self }
    }

    async fn solve(
        &self,
        specification: Vec<u8>,
        media_type: &'static str,
        output: Option<&Path>,
    ) -> Result<Status, RemoteError> {
        let request = Request::builder()
            .header(header::CONTENT_TYPE, "application/json")
            .header(header::ACCEPT, media_type)
            .header("prefer", MOMENT);
        let (status, headers, body) = self.send(request, Method::POST, "/solve", Body::from(specification)).await?;
        let job =
            job_of(&headers).ok_or_else(|| RemoteError::Lost("the response of the server names no job".to_owned()))?;
        if status != StatusCode::ACCEPTED {
            // Read the status of the job before its results, while the service is sure to keep the job.
            let ended = self.status(&job).await?;
            write(body, output).await?;
            return Ok(ended);
        }
        let ended = self.follow(&job).await?;
        let request = Request::builder().header(header::ACCEPT, media_type);
        let (.., body) = self.send(request, Method::GET, &format!("{job}/results"), Body::empty()).await?;
        write(body, output).await?;
        Ok(ended)
    }

    /// Polls the status of a job until the job ends; Ctrl-C cancels the job.
    async fn follow(&self, job: &str) -> Result<Status, RemoteError> {
        let mut interrupted = pin!(ctrl_c());
        let mut cancelled = false;
        let drawn = io::stderr().is_terminal();
        loop {
            let status = self.status(job).await?;
            if drawn {
                // A write error on a closed terminal is ignored.
                let _ = write!(io::stderr(), "\r\x1b[K{} {} %  {} steps", status.status, status.progress, status.steps);
            }
            if !matches!(status.status.as_str(), "accepted" | "running") {
                if drawn {
                    let _ = write!(io::stderr(), "\r\x1b[K");
                }
                return Ok(status);
            }
            tokio::select! {
                () = sleep(POLL_INTERVAL) => {}
                _ = &mut interrupted, if !cancelled => {
                    cancelled = true;
                    drop(self.send(Request::builder(), Method::POST, &format!("{job}/cancel"), Body::empty()).await?);
                }
            }
        }
    }

    async fn status(&self, job: &str) -> Result<Status, RemoteError> {
        let (.., body) = self.send(Request::builder(), Method::GET, job, Body::empty()).await?;
        read(body).await
    }

    /// Sends a request on a connection of its own; problem details in the response are returned as an error.
    async fn send(
        &self,
        request: axum::http::request::Builder,
        method: Method,
        path: &str,
        body: Body,
    ) -> Result<(StatusCode, HeaderMap, Incoming), RemoteError> {
        let stream = TcpStream::connect(format!("{}:{}", self.host, self.port)).await.map_err(lost)?;
        let mut sender = if self.is_encrypted {
            let stream = tls::encrypt(stream, &self.host).await.map_err(RemoteError::Lost)?;
            speak(stream).await?
        } else {
            speak(stream).await?
        };
        let request = match &self.token {
            Some(token) => request.header(header::AUTHORIZATION, token),
            None => request,
        };
        let request = request
            .method(method)
            .uri(format!("{}{path}", self.prefix))
            .header(header::HOST, &self.authority)
            .body(body)
            .map_err(lost)?;
        let (parts, body) = sender.send_request(request).await.map_err(lost)?.into_parts();
        if parts.status.is_success() {
            return Ok((parts.status, parts.headers, body));
        }
        let refusal = read(body).await.unwrap_or_else(|_| ProblemDetails {
            title: parts.status.to_string(),
            detail: "the server gives no reason".to_owned(),
            errors: Vec::new(),
        });
        Err(RemoteError::Refused(refusal))
    }
}

/// Starts an HTTP/1 client on a connection to the service.
async fn speak(stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static) -> Result<SendRequest<Body>, RemoteError> {
    let (sender, connection) = handshake(TokioIo::new(stream)).await.map_err(lost)?;
    tokio::spawn(connection);
    Ok(sender)
}

fn lost(error: impl std::fmt::Display) -> RemoteError {
    RemoteError::Lost(error.to_string())
}

/// Returns the path of the job, from the header `Location` or from the `monitor` link of the response.
fn job_of(headers: &HeaderMap) -> Option<String> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let link = || text(header::LINK)?.strip_prefix('<')?.split_once('>').map(|(path, _)| path);
    text(header::LOCATION).or_else(link).map(str::to_owned)
}

async fn read<T: for<'a> Deserialize<'a>>(body: Incoming) -> Result<T, RemoteError> {
    let bytes = to_bytes(Body::new(body), MOST).await.map_err(lost)?;
    serde_json::from_slice(&bytes).map_err(lost)
}

/// Copies the results in the response of the service to standard output, or to a file.
async fn write(mut body: Incoming, output: Option<&Path>) -> Result<(), RemoteError> {
    let mut out = destination(output).map_err(RemoteError::Unwritable)?;
    while let Some(frame) = poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await {
        let frame = frame.map_err(lost)?;
        let Some(data) = frame.data_ref() else { continue };
        match out.write_all(data) {
            // A broken pipe is not reported: the reader of the results, such as `head`, has closed its end early.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
            written => written.map_err(RemoteError::Unwritable)?,
        }
    }
    out.flush().map_err(RemoteError::Unwritable)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_may_have_a_port_and_a_path() {
        let parts = |text: &str| {
            let server: Server = text.parse().unwrap();
            (server.host, server.port, server.prefix, server.is_encrypted)
        };
        assert_eq!(parts("http://lab.example/dvi/"), ("lab.example".to_owned(), 80, "/dvi".to_owned(), false));
        assert_eq!(parts("http://[::1]:8080"), ("[::1]".to_owned(), 8080, String::new(), false));
        assert_eq!(parts("https://lab.example"), ("lab.example".to_owned(), 443, String::new(), true));
    }

    #[test]
    fn what_is_no_address_of_a_service_is_refused() {
        for text in ["localhost:8080", "ftp://lab.example", "/solve", ""] {
            assert!(text.parse::<Server>().is_err(), "{text}");
        }
    }
}

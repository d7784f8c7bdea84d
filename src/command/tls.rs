//! Encrypted connections to a service (TLS 1.2 and 1.3), with the certificates that this machine trusts, or those of the file that
//! `SSL_CERT_FILE` names.

use std::sync::Arc;
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};

/// Encrypts a connection to `host`, whose certificate must be issued for that host.
///
/// # Errors
/// The reason why there is no encrypted connection, in words.
pub async fn encrypt(stream: TcpStream, host: &str) -> Result<TlsStream<TcpStream>, String> {
    // An IPv6 address is written in brackets in the address of a service.
    let name = host.trim_start_matches('[').trim_end_matches(']').to_owned();
    let name = ServerName::try_from(name).map_err(|error| format!("`{host}` can have no certificate: {error}"))?;
    let connector = TlsConnector::from(Arc::new(settings()?));
    connector.connect(name, stream).await.map_err(|error| {
        let said = error.to_string();
        let hint = if said.contains("UnknownIssuer") {
            "; for an authority of your own, name its certificate: SSL_CERT_FILE=ca.pem"
        } else if said.contains("CaUsedAsEndEntity") {
            "; a server that signs its own certificate must not be an authority: make it with CA:FALSE"
        } else {
            ""
        };
        format!("no encrypted connection: {said}{hint}")
    })
}

fn settings() -> Result<ClientConfig, String> {
    let found = rustls_native_certs::load_native_certs();
    let mut roots = RootCertStore::empty();
    // Certificates that cannot be parsed are skipped: a machine may have some in obsolete forms.
    let (added, _) = roots.add_parsable_certificates(found.certs);
    if added == 0 {
        let why = found.errors.first().map(|error| format!(" ({error})")).unwrap_or_default();
        return Err(format!(
            "this machine trusts no certificates{why}: install the package ca-certificates, or name a file, SSL_CERT_FILE=ca.pem"
        ));
    }
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(config)
}

//! A client of the service: the holder of a token, or, where no tokens are required, all requests from one IP
//! address.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::net::IpAddr;

/// A client, which sees only its own jobs, and takes turns with other clients in the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Client {
    /// The client of all requests from this IP address.
    Address(IpAddr),
    /// The client that holds the token with this number.
    Token(u64),
}

impl Client {
    /// Returns the client at `address`; an IPv4 address mapped into IPv6 is the same client as the IPv4 address.
    pub fn at(address: IpAddr) -> Self {
        Self::Address(address.to_canonical())
    }
}

/// Writes the name of the client for logs; the number of a token is not secret.
impl fmt::Display for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Address(address) => address.fmt(f),
            Self::Token(number) => write!(f, "token {number:016x}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mapped_address_is_the_same_client() {
        let address = |text: &str| Client::at(text.parse().unwrap());
        assert_eq!(address("::ffff:10.0.0.1"), address("10.0.0.1"));
    }
}

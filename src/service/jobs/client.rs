//! A party that shares the service with others: the holder of a token, or, where no tokens are required, all requests
//! from one address.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::net::IpAddr;

/// A client. It sees its own jobs only, and takes turns with the other clients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Client {
    /// All requests from this address.
    Address(IpAddr),
    /// The holder of the token with this number.
    Token(u64),
}

impl Client {
    /// The client at `address`; an IPv4 address mapped into IPv6 is the same client.
    pub fn at(address: IpAddr) -> Self {
        Self::Address(address.to_canonical())
    }
}

/// The name in logs; the number of a token is no secret.
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

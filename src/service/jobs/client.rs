//! Whoever shares the service with others: the holder of a token, or, where none is asked for, all that comes from one
//! address.

use serde::{Deserialize, Serialize};
use std::net::IpAddr;

/// A client. Its jobs are its own, and it takes turns with the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Client {
    /// All that comes from there.
    Address(IpAddr),
    /// Whoever has the token of this number.
    Token(u64),
}

impl Client {
    /// The client at `address`; an IPv4 address is the same client when it comes mapped into IPv6.
    pub fn at(address: IpAddr) -> Self {
        Self::Address(address.to_canonical())
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

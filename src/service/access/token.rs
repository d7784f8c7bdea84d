//! The text form of an access token: `dvi_NUMBER_SECRET`, with number and secret in hexadecimal digits.

use sha2::{Digest, Sha256};
use specification::hexadecimal;
use std::fmt;
use std::io;
use std::str::FromStr;

/// An access token: a number and a secret.
#[derive(Clone, PartialEq, Eq)]
pub struct Token {
    /// The number by which the token is found in the file of tokens; not secret.
    pub number: u64,
    secret: String,
}

/// The error of a text that is not an access token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TokenError;

impl Token {
    /// Creates a random access token.
    ///
    /// # Errors
    /// The system provides no random numbers.
    pub fn create() -> io::Result<Self> {
        let (mut number, mut secret) = ([0; 8], [0; 32]);
        getrandom::fill(&mut number).map_err(io::Error::other)?;
        getrandom::fill(&mut secret).map_err(io::Error::other)?;
        Ok(Self { number: u64::from_be_bytes(number), secret: hexadecimal(&secret) })
    }

    /// Returns the SHA-256 digest of the token's secret, which is stored in the file of tokens in place of the secret.
    pub fn digest(&self) -> String {
        hexadecimal(&Sha256::digest(&self.secret))
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "dvi_{:016x}_{}", self.number, self.secret)
    }
}

/// Omits the secret of the token, since debug output may be logged.
impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Token({:016x})", self.number)
    }
}

impl FromStr for Token {
    type Err = TokenError;

    fn from_str(text: &str) -> Result<Self, TokenError> {
        let (number, secret) = text.strip_prefix("dvi_").and_then(|rest| rest.split_once('_')).ok_or(TokenError)?;
        let is_hexadecimal =
            |digits: &str, count| digits.len() == count && digits.bytes().all(|c| c.is_ascii_hexdigit());
        if !is_hexadecimal(number, 16) || !is_hexadecimal(secret, 64) {
            return Err(TokenError);
        }
        Ok(Self { number: u64::from_str_radix(number, 16).map_err(|_| TokenError)?, secret: secret.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_read_from_its_own_text_and_from_nothing_like_it() {
        let token = Token::create().unwrap();
        let text = token.to_string();
        assert_eq!(text.parse(), Ok(token.clone()));
        let broken = [&text[1..], &text[..text.len() - 1], &text.replace("dvi_", "dvi"), "dvi_1_2", "", "dvi__"];
        for broken in broken {
            assert_eq!(broken.parse::<Token>(), Err(TokenError), "{broken}");
        }
        assert_eq!(text.replace("dvi_", "dvi_+").replacen(&text[4..5], "", 1).parse::<Token>(), Err(TokenError));
    }

    #[test]
    fn tokens_differ_and_their_secrets_do_not_show() {
        let (one, other) = (Token::create().unwrap(), Token::create().unwrap());
        assert!(one.number != other.number && one.digest() != other.digest());
        assert!(!format!("{one:?}{}", one.digest()).contains(&one.secret));
    }
}

//! Rows sealed with digests: the row of a job is stored behind a digest of its bytes and its id, so that no row
//! passes for that of another job. The row contains the digests of the specification and of the results.

use super::JobId;
use crate::digest::LENGTH;
use sha2::{Digest as _, Sha256};

/// Returns the stored form of the row of job `id`: the digest, followed by the row.
pub fn seal(id: JobId, row: &[u8]) -> Vec<u8> {
    let mut sealed = Vec::with_capacity(LENGTH + row.len());
    sealed.extend_from_slice(&digest_of_row(id, row));
    sealed.extend_from_slice(row);
    sealed
}

/// Returns the row of job `id` from its stored form; `None` if the row, the digest or the id differs from what was
/// written.
pub fn unseal(id: JobId, sealed: &[u8]) -> Option<&[u8]> {
    let (digest, row) = sealed.split_first_chunk::<LENGTH>()?;
    (*digest == digest_of_row(id, row)).then_some(row)
}

fn digest_of_row(id: JobId, row: &[u8]) -> [u8; LENGTH] {
    Sha256::new().chain_update(id.number().to_be_bytes()).chain_update(row).finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_and_a_row_of_another_are_told() {
        let id = JobId::of_number(7);
        let sealed = seal(id, b"a row");
        assert_eq!(unseal(id, &sealed), Some(&b"a row"[..]));
        assert_eq!(unseal(JobId::of_number(8), &sealed), None);
        for bit in 0..8 * sealed.len() {
            let mut flipped = sealed.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(unseal(id, &flipped), None, "bit {bit}");
        }
        assert_eq!(unseal(id, b"short"), None);
    }
}

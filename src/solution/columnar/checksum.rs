//! XXH64 (Y. Collet, "xxHash fast digest algorithm", version 0.1.1): the checksum of a block of a column. With
//! one multiplication per eight bytes in four lanes it runs at memory speed, whereas SHA-256 would dominate the time of
//! an excerpt. It detects bits changed by a disk, and does not protect against tampering.

const P1: u64 = 0x9E37_79B1_85EB_CA87;
const P2: u64 = 0xC2B2_AE3D_27D4_EB4F;
const P3: u64 = 0x1656_67B1_9E37_79F9;
const P4: u64 = 0x85EB_CA77_C2B2_AE63;
const P5: u64 = 0x27D4_EB2F_1656_67C5;

/// Returns the 64-bit checksum of `bytes`.
pub fn checksum(bytes: &[u8]) -> u64 {
    checksum_from(0, bytes)
}

/// Returns the 64-bit checksum of `bytes` with a seed; another seed gives another checksum.
pub fn checksum_from(seed: u64, bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    let (stripes, words) = words.as_chunks::<4>();
    let mut hash = if stripes.is_empty() { seed.wrapping_add(P5) } else { of_stripes(seed, stripes) };
    hash = hash.wrapping_add(bytes.len() as u64);
    for word in words {
        let mixed = round(0, *word);
        hash = (hash ^ mixed).rotate_left(27).wrapping_mul(P1).wrapping_add(P4);
    }
    let (halves, rest) = rest.as_chunks::<4>();
    for half in halves {
        let mixed = u64::from(u32::from_le_bytes(*half)).wrapping_mul(P1);
        hash = (hash ^ mixed).rotate_left(23).wrapping_mul(P2).wrapping_add(P3);
    }
    for byte in rest {
        hash = (hash ^ u64::from(*byte).wrapping_mul(P5)).rotate_left(11).wrapping_mul(P1);
    }
    hash = (hash ^ (hash >> 33)).wrapping_mul(P2);
    hash = (hash ^ (hash >> 29)).wrapping_mul(P3);
    hash ^ (hash >> 32)
}

/// Hashes stripes of four words. The four lanes are separate variables: a loop over the lanes is not always unrolled,
/// and then has a third of the speed.
fn of_stripes(seed: u64, stripes: &[[[u8; 8]; 4]]) -> u64 {
    let (mut a, mut b) = (seed.wrapping_add(P1).wrapping_add(P2), seed.wrapping_add(P2));
    let (mut c, mut d) = (seed, seed.wrapping_sub(P1));
    for &[first, second, third, fourth] in stripes {
        a = round(a, first);
        b = round(b, second);
        c = round(c, third);
        d = round(d, fourth);
    }
    let sum = a.rotate_left(1).wrapping_add(b.rotate_left(7));
    let sum = sum.wrapping_add(c.rotate_left(12)).wrapping_add(d.rotate_left(18));
    [a, b, c, d].into_iter().fold(sum, |hash, lane| (hash ^ mixed(0, lane)).wrapping_mul(P1).wrapping_add(P4))
}

#[inline]
fn round(lane: u64, word: [u8; 8]) -> u64 {
    mixed(lane, u64::from_le_bytes(word))
}

#[inline]
fn mixed(lane: u64, word: u64) -> u64 {
    lane.wrapping_add(word.wrapping_mul(P2)).rotate_left(31).wrapping_mul(P1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_values() {
        // Checksums computed by the reference implementation.
        for (text, value) in [
            ("", 0xEF46_DB37_51D8_E999),
            ("a", 0xD24E_C4F1_A98C_6E5B),
            ("abc", 0x44BC_2CF5_AD77_0999),
            ("Nobody inspects the spammish repetition", 0xFBCE_A83C_8A37_8BF1),
        ] {
            assert_eq!(checksum(text.as_bytes()), value, "{text}");
        }
        assert_eq!(checksum_from(2_654_435_761, b""), 0xAC75_FDA2_929B_17EF);
        assert_eq!(checksum_from(20_141_025, b"xxhash"), 0xB559_B98D_844E_0635);
    }

    #[test]
    fn a_flipped_bit_shows() {
        let bytes: Vec<u8> = (0..100).collect();
        let sum = checksum(&bytes);
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(checksum(&flipped), sum, "bit {bit}");
        }
    }
}

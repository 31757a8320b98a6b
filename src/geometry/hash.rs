//! A small, stable 64-bit hash of state: the same bits in give the same number on every machine.

/// FNV-1a over 64-bit words with a final mix. Not cryptographic; it tells states apart in tests and reports.
#[derive(Clone, Copy, Debug)]
pub struct StateHash(u64);

impl Default for StateHash {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl StateHash {
    /// Feeds one word.
    #[inline]
    pub fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23) ^ (word >> 32);
    }

    /// Feeds bytes, little-endian, padded with zeros to whole words.
    pub fn bytes(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        for word in words {
            self.word(u64::from_le_bytes(*word));
        }
        if !rest.is_empty() {
            let mut last = [0; 8];
            last[..rest.len()].copy_from_slice(rest);
            self.word(u64::from_le_bytes(last));
        }
    }

    /// The hash of all that was fed.
    pub fn finish(self) -> u64 {
        let mut x = self.0;
        x = (x ^ (x >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        x = (x ^ (x >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
        x ^ (x >> 33)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_length_and_bits_matter() {
        let of = |bytes: &[u8]| {
            let mut hash = StateHash::default();
            hash.bytes(bytes);
            hash.finish()
        };
        assert_ne!(of(b"abcdefgh12345678"), of(b"12345678abcdefgh"));
        assert_ne!(of(b"abc"), of(b"abd"));
        assert_eq!(of(b"abc"), of(b"abc"));
    }
}

//! Seeded randomness: a stateless hash, so that a draw depends on what it is for and not on the order of draws.

/// The splitmix64 finaliser (Steele, Lea and Flood 2014): a bijection of 64-bit words that looks random.
#[inline]
pub fn mix(word: u64) -> u64 {
    let mut x = word.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A draw for item `index` under `seed`.
#[inline]
pub fn draw(seed: u64, index: u64) -> u64 {
    mix(mix(seed) ^ index)
}

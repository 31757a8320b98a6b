//! Tables with an entry a vertex, a face or a particle, which grow with every edit.

/// Brings a table to at least `len` entries. It is copied only now and then: the first time it gets room for more, too.
pub fn fit<T: Clone>(table: &mut Vec<T>, len: usize, fill: T) {
    if table.len() < len {
        if table.capacity() < len {
            table.reserve(headroom(len) + len - table.len());
        }
        table.resize(len, fill);
    }
}

/// Room that a growing array of `len` entries is given for what edits will append: it is no memory before it is written to.
pub fn headroom(len: usize) -> usize {
    len / 2 + 4096
}

/// `len` entries and their [`headroom`].
pub fn with_headroom(len: usize) -> usize {
    len + headroom(len)
}

/// [`headroom`] for `len` entries in rows that move to the end when they grow: an hour's edits write more than there was.
pub fn rows_headroom(len: usize) -> usize {
    headroom(len) + (4 * len).clamp(1 << 18, 1 << 20)
}

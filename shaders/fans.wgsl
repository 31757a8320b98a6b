// Ways around in a tissue's half-edge mesh, and what of it is the lip of a wound.

// No sound fan is longer; a damaged one must not hang the device.
const MAX_FAN: u32 = 4096u;

// The vertex that the half-edge `turn` steps on in the face of `h` comes from.
fn corner_of(t: u32, h: u32, turn: u32) -> u32 {
    return wedges[tissues[t].wedges + faces[tissues[t].faces + h / 3u].wedges[(h % 3u + turn) % 3u]].vertex;
}

fn opposite_of(t: u32, h: u32) -> u32 {
    return faces[tissues[t].faces + h / 3u].opposites[h % 3u];
}

fn next_of(h: u32) -> u32 {
    return select(h + 1u, h - 2u, h % 3u == 2u);
}

fn previous_of(h: u32) -> u32 {
    return select(h - 1u, h + 2u, h % 3u == 0u);
}

// True on the lip of a wound: a vertex that an edit inserted, where the skin ends or meets a wall or cap. It has no bones: its record
// says so in their place.
fn is_lip(t: u32, v: u32) -> bool {
    let record = vertices[tissues[t].vertices + v];
    return record.row.y > 0u && record.bones.x != 0u;
}

// Distance of a point from the stretch between two points.
fn to_stretch(p: vec3f, start: vec3f, end: vec3f) -> f32 {
    let along = end - start;
    let square = dot(along, along);
    let x = select(0.0, saturate(dot(p - start, along) / square), square > 0.0);
    return length(p - start - x * along);
}

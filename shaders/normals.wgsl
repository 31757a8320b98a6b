// Normals of all wedges (MATHS 2.3): where the vertex or one of its neighbours is displaced, area-weighted face normals
// gathered from final positions over the faces of the fan that share the wedge's smoothing group; elsewhere the cofactor
// of the blended matrix applied to the normal at rest.

@group(0) @binding(6) var<storage, read> faces: array<FaceRecord>;
@group(0) @binding(7) var<storage, read> wedges: array<Wedge>;

// No sound fan is longer; a damaged one must not hang the device.
const MAX_FAN: u32 = 4096u;

struct Gathered {
    normal: vec3f,
    moved: f32,
}

fn position_of(t: u32, corner_wedge: u32) -> vec4f {
    return deformed[tissues[t].positions + wedges[tissues[t].wedges + corner_wedge].vertex];
}

// Adds the face that half-edge `h` leaves from.
fn add_face(t: u32, h: u32, wedge_group: u32, sum: Gathered) -> Gathered {
    let face = tissues[t].faces + h / 3u;
    let k = h % 3u;
    let corner = faces[face].wedges[k];
    let a = position_of(t, corner);
    let b = position_of(t, faces[face].wedges[(k + 1u) % 3u]);
    let c = position_of(t, faces[face].wedges[(k + 2u) % 3u]);
    let moved = max(sum.moved, max(a.w, max(b.w, c.w)));
    if (wedges[tissues[t].wedges + corner].group != wedge_group) {
        return Gathered(sum.normal, moved);
    }
    return Gathered(sum.normal + cross(b.xyz - a.xyz, c.xyz - a.xyz), moved);
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

// Walks the fan from `start` counter-clockwise, and clockwise too where it is open.
fn gather(t: u32, start: u32, wedge_group: u32) -> Gathered {
    var sum = Gathered(vec3f(0.0), 0.0);
    var h = start;
    for (var i = 0u; i < MAX_FAN; i++) {
        sum = add_face(t, h, wedge_group, sum);
        h = opposite_of(t, previous_of(h));
        if (h == start) {
            return sum;
        }
        if (h == NONE) {
            break;
        }
    }
    h = opposite_of(t, start);
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        h = next_of(h);
        sum = add_face(t, h, wedge_group, sum);
        h = opposite_of(t, h);
    }
    return sum;
}

// Scaled first: the cross product of two short edges squared would fall out of f32's range.
fn unit_or(v: vec3f, fallback: vec3f) -> vec3f {
    let largest = max(abs(v.x), max(abs(v.y), abs(v.z)));
    if (largest > 0.0) {
        return normalize(v / largest);
    }
    return fallback;
}

// Bits of what a vertex touches.
const SKIN: u32 = 1u;
const INSIDE: u32 = 2u;

fn side_of(t: u32, h: u32) -> u32 {
    return select(SKIN, INSIDE, (faces[tissues[t].faces + h / 3u].draw >> 31u) != 0u);
}

// True on the lip of a wound: a vertex that an edit inserted, where the skin ends or meets a wall or cap.
fn is_lip(t: u32, v: u32) -> bool {
    let record = vertices[tissues[t].vertices + v];
    if (record.row.y == 0u || record.half_edge == NONE) {
        return false;
    }
    var touches = 0u;
    var h = record.half_edge;
    for (var i = 0u; i < MAX_FAN; i++) {
        touches |= side_of(t, h);
        h = opposite_of(t, previous_of(h));
        if (h == record.half_edge) {
            return touches == (SKIN | INSIDE);
        }
        if (h == NONE) {
            break;
        }
    }
    h = opposite_of(t, record.half_edge);
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        h = next_of(h);
        touches |= side_of(t, h);
        h = opposite_of(t, h);
    }
    return (touches & SKIN) != 0u; // an open fan
}

// For what has no lip near it, in diagonals: too far to look like one.
const FAR_FROM_LIP: f32 = 0.03;

// Distance of a point from the stretch between two points.
fn to_stretch(p: vec3f, start: vec3f, end: vec3f) -> f32 {
    let along = end - start;
    let square = dot(along, along);
    let x = select(0.0, saturate(dot(p - start, along) / square), square > 0.0);
    return length(p - start - x * along);
}

// What is farther from the lip than anything.
const NO_LIP: f32 = 1e30;

// Distance of a point from the lip's part in the face that half-edge `h` leaves vertex `o` from, metres.
fn lip_in_face(t: u32, h: u32, o: u32, o_is: bool, p: vec3f) -> f32 {
    let b = corner_of(t, h, 1u);
    let c = corner_of(t, h, 2u);
    let b_is = is_lip(t, b);
    let c_is = is_lip(t, c);
    if (!o_is && !b_is && !c_is) {
        return NO_LIP;
    }
    let at_o = deformed[tissues[t].positions + o].xyz;
    let at_b = deformed[tissues[t].positions + b].xyz;
    let at_c = deformed[tissues[t].positions + c].xyz;
    let first = select(select(at_c, at_b, b_is), at_o, o_is);
    let last = select(select(at_o, at_b, b_is), at_c, c_is);
    var nearest = to_stretch(p, first, last);
    if (o_is && b_is && c_is) {
        nearest = min(nearest, min(to_stretch(p, at_o, at_b), to_stretch(p, at_b, at_c)));
    }
    return nearest;
}

// Distance of a point from the lip's part in the faces around a vertex, metres.
fn lip_around(t: u32, v: u32, p: vec3f) -> f32 {
    let start = vertices[tissues[t].vertices + v].half_edge;
    if (start == NONE) {
        return NO_LIP;
    }
    let v_is = is_lip(t, v);
    var nearest = NO_LIP;
    var h = start;
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        nearest = min(nearest, lip_in_face(t, h, v, v_is, p));
        h = opposite_of(t, previous_of(h));
        if (h == start) {
            return nearest;
        }
    }
    h = opposite_of(t, start);
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        h = next_of(h);
        nearest = min(nearest, lip_in_face(t, h, v, v_is, p));
        h = opposite_of(t, h);
    }
    return nearest;
}

// The vertex that the half-edge `turn` steps on in the face of `h` comes from.
fn corner_of(t: u32, h: u32, turn: u32) -> u32 {
    return wedges[tissues[t].wedges + faces[tissues[t].faces + h / 3u].wedges[(h % 3u + turn) % 3u]].vertex;
}

// Distance of a vertex from the lip of a wound over the faces around it and around its neighbours, in diagonals, for the picture;
// FAR_FROM_LIP where none of them has one. It is told in full where it is more: over a large face the pale edge would be wide. Faces around
// it alone are too few: where the skin's own vertices lie close to a cut, its pale edge would end there.
fn lip_distance(t: u32, v: u32) -> f32 {
    let start = vertices[tissues[t].vertices + v].half_edge;
    if ((tissues[t].flags & WOUNDED) == 0u || start == NONE) {
        return FAR_FROM_LIP;
    }
    if (is_lip(t, v)) {
        return 0.0;
    }
    let p = deformed[tissues[t].positions + v].xyz;
    var nearest = NO_LIP;
    var h = start;
    var last = start;
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        nearest = min(nearest, lip_around(t, corner_of(t, h, 1u), p));
        last = h;
        h = opposite_of(t, previous_of(h));
        if (h == start) {
            break;
        }
    }
    if (h == NONE) {
        nearest = min(nearest, lip_around(t, corner_of(t, last, 2u), p));
        h = opposite_of(t, start);
        for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
            h = next_of(h);
            nearest = min(nearest, lip_around(t, corner_of(t, h, 1u), p));
            h = opposite_of(t, h);
        }
    }
    return select(nearest * tissues[t].detail_scale, FAR_FROM_LIP, nearest == NO_LIP);
}

@compute @workgroup_size(64)
fn normals(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let item = work_of(group, groups);
    if (item.tissue == NONE) {
        return;
    }
    let t = item.tissue;
    let w = item.first + lane;
    if (w >= tissues[t].wedge_count) {
        return;
    }
    let wedge = wedges[tissues[t].wedges + w];
    let rest = unit_or(vec3f(wedge.normal[0], wedge.normal[1], wedge.normal[2]), vec3f(0.0, 0.0, 1.0));
    var normal = rest;
    if (skinned) {
        normal = unit_or(apply_cofactor(blended(t, wedge.vertex), rest), rest);
    }
    if (displaced && (tissues[t].flags & (DISPLACED | FADING)) != 0u) {
        let start = vertices[tissues[t].vertices + wedge.vertex].half_edge;
        if (start != NONE) {
            let gathered = gather(t, start, wedge.group);
            if (gathered.moved > 0.0) {
                normal = unit_or(gathered.normal, normal);
            }
        }
    }
    deformed[tissues[t].normals + w] = vec4f(normal, lip_distance(t, wedge.vertex));
}

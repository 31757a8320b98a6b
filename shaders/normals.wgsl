// Normals of all wedges (MATHS 2.3): where the vertex or one of its neighbours is displaced, area-weighted face normals
// gathered from final positions over the faces of the fan that share the wedge's smoothing group, and where an edit has put
// vertices into these and they are skin, turned as the wedge's own normal differs from such a sum at rest; elsewhere the cofactor of the
// blended matrix applied to the normal at rest.

@group(0) @binding(6) var<storage, read> faces: array<FaceRecord>;
@group(0) @binding(7) var<storage, read> wedges: array<Wedge>;

// Height over length, of faces whose normals rounding says more of than they do.
const SLIVER: f32 = 1e-3;

struct Gathered {
    normal: vec3f,
    size: f32, // of the products that went into it
    moved: f32,
    edited: bool, // of a face of the skin a vertex was inserted
}

// Where the vertex of a wedge is, and whether it is displaced; or where it is at rest.
fn place_of(t: u32, w: u32, at_rest: bool) -> vec4f {
    let v = wedges[tissues[t].wedges + w].vertex;
    if (at_rest) {
        return vec4f(rest_of(tissues[t].vertices + v), 0.0);
    }
    return deformed[tissues[t].positions + v];
}

// Adds the face that half-edge `h` leaves from.
fn add_face(t: u32, h: u32, wedge_group: u32, at_rest: bool, sum: Gathered) -> Gathered {
    let face = tissues[t].faces + h / 3u;
    let k = h % 3u;
    let corner = faces[face].wedges[k];
    let a = place_of(t, corner, at_rest);
    let b = place_of(t, faces[face].wedges[(k + 1u) % 3u], at_rest);
    let c = place_of(t, faces[face].wedges[(k + 2u) % 3u], at_rest);
    var out = sum;
    out.moved = max(sum.moved, max(a.w, max(b.w, c.w)));
    if (wedges[tissues[t].wedges + corner].group == wedge_group) {
        out.normal += cross(b.xyz - a.xyz, c.xyz - a.xyz);
        out.size += distance(a.xyz, b.xyz) * distance(a.xyz, c.xyz);
        if ((tissues[t].flags & WOUNDED) != 0u && !sum.edited && (faces[face].draw >> 31u) == 0u) {
            out.edited = is_inserted(t, h, 0u) || is_inserted(t, h, 1u) || is_inserted(t, h, 2u);
        }
    }
    return out;
}

fn is_inserted(t: u32, h: u32, turn: u32) -> bool {
    return vertices[tissues[t].vertices + corner_of(t, h, turn)].row.y > 0u;
}

// Walks the fan from `start` counter-clockwise, and clockwise too where it is open.
fn gather(t: u32, start: u32, wedge_group: u32, at_rest: bool) -> Gathered {
    var sum = Gathered(vec3f(0.0), 0.0, 0.0, false);
    var h = start;
    for (var i = 0u; i < MAX_FAN; i++) {
        sum = add_face(t, h, wedge_group, at_rest, sum);
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
        sum = add_face(t, h, wedge_group, at_rest, sum);
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

// Turns `v` as the shortest turn that takes `start` to `end`, both of unit length. What is turned round altogether turns nothing.
fn turned(v: vec3f, start: vec3f, end: vec3f) -> vec3f {
    let c = dot(start, end);
    let w = cross(start, end);
    return select(end, v + cross(w, v) + cross(w, cross(w, v)) / max(1.0 + c, 1e-3), c > -0.9);
}

// For what has no lip near it, in diagonals: too far to look like one.
const FAR_FROM_LIP: f32 = 0.03;

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
    var still = identity();
    var normal = rest;
    if (skinned) {
        still = blended(t, wedge.vertex);
        normal = unit_or(apply_cofactor(still, rest), rest);
    }
    if (displaced && (tissues[t].flags & (DISPLACED | FADING)) != 0u) {
        let start = vertices[tissues[t].vertices + wedge.vertex].half_edge;
        if (start != NONE) {
            let gathered = gather(t, start, wedge.group, false);
            if (gathered.moved > 0.0) {
                let own = normal;
                normal = unit_or(gathered.normal, own);
                if (gathered.edited) {
                    let before = gather(t, start, wedge.group, true);
                    if (length(before.normal) > SLIVER * before.size) {
                        normal = turned(own, unit_or(apply_cofactor(still, before.normal), normal), normal);
                    }
                }
            }
        }
    }
    deformed[tissues[t].normals + w] = vec4f(normal, lip_distance(t, wedge.vertex));
}

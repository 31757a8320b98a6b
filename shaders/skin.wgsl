// Skinning of base vertices and their rows (MATHS 1.1), shared by the deform and normals passes.
// CPU twin: rig/skinning.rs (`Pose::skin`, `Pose::blended_linear`).

@group(0) @binding(0) var<storage, read> tissues: array<TissueRecord>;
@group(0) @binding(1) var<storage, read> work: array<WorkItem>;
@group(0) @binding(2) var<storage, read> vertices: array<VertexRecord>;
@group(0) @binding(3) var<storage, read> terms: array<Term>;
@group(0) @binding(4) var<storage, read> vectors: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> deformed: array<vec4f>;

// Pipeline variants: a scene without bones, without displacements and fades, without turned particles, or without rows of more
// than three entries compiles without their code.
override skinned: bool = true;
override displaced: bool = true;
override rotated: bool = true;
override long_rows: bool = true;

// A 3 x 4 transform by rows.
struct Transform {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

fn identity() -> Transform {
    return Transform(vec4f(1.0, 0.0, 0.0, 0.0), vec4f(0.0, 1.0, 0.0, 0.0), vec4f(0.0, 0.0, 1.0, 0.0));
}

fn apply_point(m: Transform, p: vec3f) -> vec3f {
    let h = vec4f(p, 1.0);
    return vec3f(dot(m.x, h), dot(m.y, h), dot(m.z, h));
}

fn apply_vector(m: Transform, v: vec3f) -> vec3f {
    return vec3f(dot(m.x.xyz, v), dot(m.y.xyz, v), dot(m.z.xyz, v));
}

// Area vectors transform by the cofactor (MATHS 2.3).
fn apply_cofactor(m: Transform, n: vec3f) -> vec3f {
    return vec3f(dot(cross(m.y.xyz, m.z.xyz), n), dot(cross(m.z.xyz, m.x.xyz), n), dot(cross(m.x.xyz, m.y.xyz), n));
}

fn rest_of(v: u32) -> vec3f {
    return vec3f(vertices[v].rest[0], vertices[v].rest[1], vertices[v].rest[2]);
}

// Blended matrix of a base vertex; `v` is global.
fn base_transform(t: u32, v: u32) -> Transform {
    let span = vertices[v].bones;
    if (!skinned || span.y == 0u || (tissues[t].flags & SKINNED) == 0u) {
        return identity();
    }
    let bones = tissues[t].bones + span.x;
    let joints = tissues[t].joints;
    var m = Transform(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    for (var k = 0u; k < span.y; k++) {
        let bone = terms[bones + k];
        let joint = joints + 3u * bone.index;
        m.x += bone.weight * vectors[joint];
        m.y += bone.weight * vectors[joint + 1u];
        m.z += bone.weight * vectors[joint + 2u];
    }
    return m;
}

// s of a local vertex: a base vertex by its bones, an embedded one by its row over skinned positions.
fn skin(t: u32, local_vertex: u32) -> vec3f {
    let first = tissues[t].vertices;
    let v = first + local_vertex;
    let row = vertices[v].row;
    if (row.y == 0u) {
        return apply_point(base_transform(t, v), rest_of(v));
    }
    let entries = tissues[t].rows + row.x;
    var s = part_of_row(t, first, entries);
    // Rows on a surface have two or three entries (MATHS 1.2) and need no loop; longer ones lie on caps and walls.
    if (row.y > 1u) {
        s += part_of_row(t, first, entries + 1u);
    }
    if (row.y > 2u) {
        s += part_of_row(t, first, entries + 2u);
    }
    if (long_rows) {
        for (var k = 3u; k < row.y; k++) {
            s += part_of_row(t, first, entries + k);
        }
    }
    return s;
}

// What one entry of a row adds; `first` is the tissue's first vertex.
fn part_of_row(t: u32, first: u32, entry: u32) -> vec3f {
    let term = terms[entry];
    let base = first + term.index;
    return term.weight * apply_point(base_transform(t, base), rest_of(base));
}

// A of a local vertex (MATHS 2.2).
fn blended(t: u32, local_vertex: u32) -> Transform {
    let first = tissues[t].vertices;
    let v = first + local_vertex;
    let row = vertices[v].row;
    if (row.y == 0u) {
        return base_transform(t, v);
    }
    var m = Transform(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    for (var k = 0u; k < row.y; k++) {
        let entry = terms[tissues[t].rows + row.x + k];
        let base = base_transform(t, first + entry.index);
        m.x += entry.weight * base.x;
        m.y += entry.weight * base.y;
        m.z += entry.weight * base.z;
    }
    return m;
}

// The work of a workgroup; the list is padded to fill a two-dimensional dispatch.
fn work_of(group: vec3u, groups: vec3u) -> WorkItem {
    return work[group.x + group.y * groups.x];
}

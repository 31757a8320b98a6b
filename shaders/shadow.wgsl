// Depth of all tissues as the operating lamp sees them.

@group(0) @binding(0) var<uniform> frame: Frame;

@group(1) @binding(0) var<storage, read> tissues: array<TissueRecord>;
@group(1) @binding(2) var<storage, read> faces: array<FaceRecord>;
@group(1) @binding(3) var<storage, read> wedges: array<Wedge>;
@group(1) @binding(4) var<storage, read> deformed: array<vec4f>;

@vertex
fn lamp_corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let face = index / 3u;
    let t = (faces[face].draw >> 16u) & 0x7fffu;
    if (face - tissues[t].faces >= tissues[t].face_count) {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    let wedge = tissues[t].wedges + faces[face].wedges[index % 3u];
    let p = vec4f(deformed[tissues[t].positions + wedges[wedge].vertex].xyz, 1.0);
    let m = tissues[t].world_from_tissue;
    return frame.light_from_world * vec4f(dot(m[0], p), dot(m[1], p), dot(m[2], p), 1.0);
}

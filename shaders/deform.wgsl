// Skins and displaces all vertices of all tissues in one dispatch (MATHS 2):
//     f = s + sum_j w_j (u_j + (R_j - I)(s - a_j)) + alpha(t) A c
// The fourth component of a position is 1 where anything displaces the vertex, for the normals pass.

// A smoothstep from 1 down to 0 over the tissue's fade time.
fn fade_alpha(t: u32, start: f32) -> f32 {
    let duration = tissues[t].fade_duration;
    if (duration <= 0.0) {
        return 0.0;
    }
    let x = clamp(((tissues[t].time_high - start) + tissues[t].time_low) / duration, 0.0, 1.0);
    return 1.0 - x * x * (3.0 - 2.0 * x);
}

// (R - I)(s - a) of a particle.
fn turned(t: u32, particle: u32, s: vec3f) -> vec3f {
    let first = tissues[t].rotations + 3u * particle;
    let x = vectors[first];
    let y = vectors[first + 1u];
    let z = vectors[first + 2u];
    let arm = s - vec3f(x.w, y.w, z.w);
    return vec3f(dot(x.xyz, arm), dot(y.xyz, arm), dot(z.xyz, arm));
}

@compute @workgroup_size(64)
fn deform(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let item = work_of(group, groups);
    if (item.tissue == NONE) {
        return;
    }
    let t = item.tissue;
    let v = item.first + lane;
    if (v >= tissues[t].vertex_count) {
        return;
    }
    let skinned_position = skin(t, v);
    var position = skinned_position;
    var moved = 0.0;
    if (displaced) {
        let flags = tissues[t].flags;
        if ((flags & DISPLACED) != 0u) {
            let span = vertices[tissues[t].vertices + v].influences;
            for (var k = 0u; k < span.y; k++) {
                let influence = terms[tissues[t].influences + span.x + k];
                var u = vectors[tissues[t].displacements + influence.index].xyz;
                if (rotated && (flags & ROTATED) != 0u) {
                    u += turned(t, influence.index, skinned_position);
                }
                position += influence.weight * u;
                moved = select(moved, 1.0, any(u != vec3f(0.0)));
            }
        }
        if ((flags & FADING) != 0u) {
            let fade = vectors[tissues[t].fades + v];
            let alpha = fade_alpha(t, fade.w);
            if (alpha > 0.0 && any(fade.xyz != vec3f(0.0))) {
                position += alpha * apply_vector(blended(t, v), fade.xyz);
                moved = 1.0;
            }
        }
    }
    deformed[tissues[t].positions + v] = vec4f(position, moved);
}

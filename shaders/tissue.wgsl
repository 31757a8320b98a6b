// Draws all tissues. No vertex buffers: corner -> face -> wedge -> deformed position and normal.

@group(1) @binding(0) var<storage, read> tissues: array<TissueRecord>;
@group(1) @binding(1) var<storage, read> vertices: array<VertexRecord>;
@group(1) @binding(2) var<storage, read> faces: array<FaceRecord>;
@group(1) @binding(3) var<storage, read> wedges: array<Wedge>;
@group(1) @binding(4) var<storage, read> deformed: array<vec4f>;
@group(1) @binding(5) var<storage, read> materials: array<Material>;
@group(1) @binding(6) var textures: texture_2d_array<f32>;
@group(1) @binding(7) var texture_sampler: sampler;

const WALL: u32 = 1u;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) rest: vec3f, // in diagonals: procedural detail sticks to the tissue
    @location(3) uv: vec2f,
    @location(4) colour: vec4f,
    @location(5) @interpolate(flat, either) material: u32,
    @location(6) @interpolate(flat, either) flags: u32,
}

fn to_world(t: u32, p: vec3f) -> vec3f {
    let h = vec4f(p, 1.0);
    let m = tissues[t].world_from_tissue;
    return vec3f(dot(m[0], h), dot(m[1], h), dot(m[2], h));
}

fn normal_to_world(t: u32, n: vec3f) -> vec3f {
    let m = tissues[t].world_from_tissue;
    let x = m[0].xyz;
    let y = m[1].xyz;
    let z = m[2].xyz;
    return vec3f(dot(cross(y, z), n), dot(cross(z, x), n), dot(cross(x, y), n));
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let face = index / 3u;
    let draw = faces[face].draw;
    let t = (draw >> 16u) & 0x7fffu;
    var out: Corner;
    // Headroom and ranges that a tissue left behind: nothing to see.
    if (face - tissues[t].faces >= tissues[t].face_count) {
        out.clip = vec4f(0.0, 0.0, 0.0, 1.0);
        return out;
    }
    let w = faces[face].wedges[index % 3u];
    let wedge = wedges[tissues[t].wedges + w];
    let vertex = tissues[t].vertices + wedge.vertex;
    out.position = to_world(t, deformed[tissues[t].positions + wedge.vertex].xyz);
    out.normal = normal_to_world(t, deformed[tissues[t].normals + w].xyz);
    out.rest = vec3f(vertices[vertex].rest[0], vertices[vertex].rest[1], vertices[vertex].rest[2]) * tissues[t].detail_scale;
    out.uv = wedge.uv;
    out.colour = unpack4x8unorm(wedge.colour);
    out.material = tissues[t].materials + min(draw & 0xffffu, tissues[t].material_count - 1u);
    out.flags = select(0u, WALL, (draw >> 31u) != 0u);
    out.clip = view.clip_from_world * vec4f(out.position, 1.0);
    return out;
}

// A number from -1 to 1 for each point of the lattice.
fn lattice(p: vec3i) -> f32 {
    var h = bitcast<u32>(p.x) * 0x8da6b343u + bitcast<u32>(p.y) * 0xd8163841u + bitcast<u32>(p.z) * 0xcb1ab31fu;
    h = (h ^ (h >> 15u)) * 0x2c1b3c6du;
    h ^= h >> 13u;
    return f32(h >> 8u) / 8388608.0 - 1.0;
}

// Value noise in -1 to 1 with its gradient: (value, d/dx, d/dy, d/dz).
fn noise(p: vec3f) -> vec4f {
    let cell = floor(p);
    let i = vec3i(cell);
    let f = p - cell;
    let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let du = 30.0 * f * f * (f * (f - 2.0) + 1.0);
    let a = lattice(i);
    let b = lattice(i + vec3i(1, 0, 0));
    let c = lattice(i + vec3i(0, 1, 0));
    let d = lattice(i + vec3i(1, 1, 0));
    let e = lattice(i + vec3i(0, 0, 1));
    let g = lattice(i + vec3i(1, 0, 1));
    let h = lattice(i + vec3i(0, 1, 1));
    let k = lattice(i + vec3i(1, 1, 1));
    let k1 = b - a;
    let k2 = c - a;
    let k3 = e - a;
    let k4 = a - b - c + d;
    let k5 = a - c - e + h;
    let k6 = a - b - e + g;
    let k7 = -a + b + c - d + e - g - h + k;
    let value = a + k1 * u.x + k2 * u.y + k3 * u.z + k4 * u.x * u.y + k5 * u.y * u.z + k6 * u.z * u.x + k7 * u.x * u.y * u.z;
    let gradient = du * vec3f(
        k1 + k4 * u.y + k6 * u.z + k7 * u.y * u.z,
        k2 + k5 * u.z + k4 * u.x + k7 * u.z * u.x,
        k3 + k6 * u.x + k5 * u.y + k7 * u.x * u.y,
    );
    return vec4f(value, gradient);
}

// Noise on a lattice that is turned, so that two octaves show no common grid.
fn turned_noise(p: vec3f) -> vec4f {
    let turn = mat3x3f(vec3f(0.36, 0.48, -0.8), vec3f(-0.8, 0.6, 0.0), vec3f(0.48, 0.64, 0.6));
    let n = noise(turn * p + 11.0);
    return vec4f(n.x, n.yzw * turn);
}

// Tilts `normal` by the relief whose gradient over the rest space is `gradient` (Mikkelsen 2010): both differentials are
// constant over a triangle, so the result is smooth.
fn tilt(normal: vec3f, gradient: vec3f, position_x: vec3f, position_y: vec3f, rest_x: vec3f, rest_y: vec3f) -> vec3f {
    let r1 = cross(position_y, normal);
    let r2 = cross(normal, position_x);
    let det = dot(position_x, r1);
    let slope = sign(det) * (dot(gradient, rest_x) * r1 + dot(gradient, rest_y) * r2);
    let tilted = abs(det) * normal - slope;
    let square = dot(tilted, tilted);
    return select(normal, tilted * inverseSqrt(max(square, 1e-36)), square > 1e-36);
}

@fragment
fn surface(in: Corner, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    let material = materials[in.material];
    let texel = textureSample(textures, texture_sampler, in.uv, material.layer);
    let position_x = dpdx(in.position);
    let position_y = dpdy(in.position);
    let rest_x = dpdx(in.rest);
    let rest_y = dpdy(in.rest);
    let scale = length(position_x) / max(length(rest_x), 1e-12); // metres a diagonal

    let inside = !front || (in.flags & WALL) != 0u;
    var s: Surface;
    s.position = in.position;
    s.normal = normalize(in.normal) * select(-1.0, 1.0, front);
    s.shell_normal = s.normal;
    s.albedo = material.base_colour.rgb * texel.rgb * in.colour.rgb;
    s.roughness = material.roughness;
    s.wetness = material.wetness;
    s.scatter = material.scatter;
    s.openness = 1.0;

    let broad = noise(in.rest * 13.0);
    let fine = turned_noise(in.rest * 43.0);
    var gradient = 0.10 * broad.yzw + 0.11 * fine.yzw;
    if (inside) {
        // Raw flesh: deep red, fibrous, and darker, since little light finds its way in.
        let fibre = noise(in.rest * vec3f(60.0, 22.0, 60.0) + 3.0);
        s.albedo = vec3f(0.40, 0.045, 0.038) * (1.0 + 0.3 * broad.x + 0.3 * fibre.x);
        s.roughness = 0.5;
        s.wetness = 0.85;
        s.scatter = 1.0;
        s.openness = select(0.38, 0.7, front);
        gradient = 0.16 * broad.yzw + 0.12 * fibre.yzw * vec3f(1.0, 0.4, 1.0);
    } else if (material.layer == 0u) {
        // Plain flesh without a texture: mottled, with fine vessels along the zero lines of a slow, warped noise.
        let slow = noise(in.rest * 6.5 + 0.55 * vec3f(broad.x, fine.x, -broad.x) + 5.0);
        let vessel = smoothstep(0.11, 0.0, abs(slow.x)) * saturate(0.4 + broad.x);
        let blush = 1.0 + 0.16 * slow.x + 0.10 * broad.x + 0.06 * fine.x;
        let tint = vec3f(blush, blush * blush, blush * blush) * mix(vec3f(1.0), vec3f(0.84, 0.60, 0.62), 0.35 * vessel);
        s.albedo *= mix(vec3f(1.0), tint, s.scatter);
    }
    let relief = gradient * (s.wetness * scale);
    s.film_normal = tilt(s.normal, relief, position_x, position_y, rest_x, rest_y);
    s.normal = normalize(mix(s.normal, s.film_normal, 0.35));
    return finish(shade(s), in.clip.xy);
}

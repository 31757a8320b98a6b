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
// A sliver of wall along a lip, no wider than that: nothing but lip.
const RIM: u32 = 2u;
// A face with corners near the lip that are joined by an edge that is none: how far from it a point is, the numbers at its corners do not
// tell.
const BETWEEN_LIPS: u32 = 4u;
// A face of a tissue that is WHOLE: from behind, too, it is skin.
const FOLDED_SKIN: u32 = 8u;
// What is farther from a lip than anything that looks like one, in diagonals.
const OFF_LIP: f32 = 1.0;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) rest: vec3f, // in diagonals: procedural detail sticks to the tissue
    @location(3) uv: vec2f,
    @location(4) colour: vec4f,
    @location(5) @interpolate(flat, either) material: u32,
    @location(6) @interpolate(flat, either) flags: u32,
    @location(7) @interpolate(flat, either) view: u32,
    @location(8) lip: f32, // distance from the lip of a wound, in diagonals
    @location(9) edges: vec3f, // of a face BETWEEN_LIPS: distances from up to three lips, in diagonals
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

fn corners_of(t: u32, face: u32) -> array<vec3f, 3> {
    var p: array<vec3f, 3>;
    for (var k = 0u; k < 3u; k++) {
        p[k] = deformed[tissues[t].positions + wedges[tissues[t].wedges + faces[face].wedges[k]].vertex].xyz;
    }
    return p;
}

// Width of a face over its longest edge, metres.
fn width_of(t: u32, face: u32) -> f32 {
    let p = corners_of(t, face);
    let sides = vec3f(distance(p[0], p[1]), distance(p[1], p[2]), distance(p[2], p[0]));
    return length(cross(p[1] - p[0], p[2] - p[0])) / max(max(sides.x, max(sides.y, sides.z)), 1e-30);
}

// True where no face of the skin lies beyond an edge: seen from the skin, a lip.
fn ends_skin(t: u32, opposite: u32) -> bool {
    return opposite == NONE || (faces[tissues[t].faces + opposite / 3u].draw >> 31u) != 0u;
}

// True for a face of a wall with two sides on the skin and no wider than a lip.
fn is_rim(t: u32, face: u32) -> bool {
    var sides = 0u;
    for (var k = 0u; k < 3u; k++) {
        sides += select(1u, 0u, ends_skin(t, faces[face].opposites[k]));
    }
    return sides > 1u && width_of(t, face) * tissues[t].detail_scale < LIP_WIDTH;
}

// True for a face of the skin over which the distance from the lip does not go straight from corner to corner: two of them are near lips that
// are not one edge of it.
fn is_between_lips(t: u32, face: u32) -> bool {
    if ((tissues[t].flags & WOUNDED) == 0u) {
        return false;
    }
    var near = 0u;
    var longest = 0.0;
    let p = corners_of(t, face);
    for (var k = 0u; k < 3u; k++) {
        near += select(0u, 1u, lip_value(t, face, k) < 2.0 * LIP_WIDTH);
        longest = max(longest, distance(p[k], p[(k + 1u) % 3u]) * tissues[t].detail_scale);
    }
    if (near < 2u || longest < 2.0 * LIP_WIDTH) {
        return false;
    }
    for (var k = 0u; k < 3u; k++) {
        let c = (k + 2u) % 3u;
        if (ends_skin_between_lips(t, face, k) && lip_value(t, face, c) > 0.8 * from_edge(t, p, k, c)) {
            return false;
        }
    }
    return true;
}

// True for an edge from lip to lip beyond which there is no skin: of a face of the skin the lip of a wound, of a wall's none itself.
fn ends_skin_between_lips(t: u32, face: u32, k: u32) -> bool {
    let ends = max(lip_value(t, face, k), lip_value(t, face, (k + 1u) % 3u));
    return ends <= 0.0 && ends_skin(t, faces[face].opposites[k]);
}

// Distance of corner `k` of a face with these corners from its edge `i`, in diagonals.
fn from_edge(t: u32, p: array<vec3f, 3>, i: u32, k: u32) -> f32 {
    let doubled_area = length(cross(p[1] - p[0], p[2] - p[0]));
    let height = doubled_area / max(distance(p[i], p[(i + 1u) % 3u]), 1e-30) * tissues[t].detail_scale;
    return select(0.0, height, k == (i + 2u) % 3u);
}

// The lip that is nearest to a vertex, or both of its edges there that one on it has.
struct NearLip {
    starts: array<vec3f, 2>,
    ends: array<vec3f, 2>,
    count: u32,
    off: f32, // metres
}

// Looks for it in the face that half-edge `h` leaves vertex `v` from.
fn look_for_lip(t: u32, h: u32, v_is: bool, p: vec3f, known: NearLip) -> NearLip {
    var out = known;
    if ((faces[tissues[t].faces + h / 3u].draw >> 31u) != 0u) {
        return out;
    }
    let b = corner_of(t, h, 1u);
    let c = corner_of(t, h, 2u);
    let at_b = deformed[tissues[t].positions + b].xyz;
    let at_c = deformed[tissues[t].positions + c].xyz;
    if (v_is) {
        if (out.count < 2u && is_lip(t, b) && ends_skin(t, opposite_of(t, h))) {
            out.starts[out.count] = p;
            out.ends[out.count] = at_b;
            out.count += 1u;
        }
        if (out.count < 2u && is_lip(t, c) && ends_skin(t, opposite_of(t, previous_of(h)))) {
            out.starts[out.count] = p;
            out.ends[out.count] = at_c;
            out.count += 1u;
        }
        return out;
    }
    if (!is_lip(t, b)) {
        return out;
    }
    let end = select(at_b, at_c, is_lip(t, c) && ends_skin(t, opposite_of(t, next_of(h))));
    let off = to_stretch(p, at_b, end);
    if (out.count == 0u || off < out.off) {
        out.starts[0] = at_b;
        out.ends[0] = end;
        out.count = 1u;
        out.off = off;
    }
    return out;
}

// The same in all faces around it.
fn lip_near(t: u32, v: u32, p: vec3f) -> NearLip {
    var found: NearLip;
    let start = vertices[tissues[t].vertices + v].half_edge;
    if (start == NONE) {
        return found;
    }
    let v_is = is_lip(t, v);
    var h = start;
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        found = look_for_lip(t, h, v_is, p, found);
        h = opposite_of(t, previous_of(h));
        if (h == start) {
            return found;
        }
    }
    h = opposite_of(t, start);
    for (var i = 0u; i < MAX_FAN && h != NONE; i++) {
        h = next_of(h);
        found = look_for_lip(t, h, v_is, p, found);
        h = opposite_of(t, h);
    }
    return found;
}

// Distance of a point from the line through two points; from the one where they are one.
fn to_line(p: vec3f, start: vec3f, end: vec3f) -> f32 {
    let along = end - start;
    let square = dot(along, along);
    return length(p - start - select(0.0, dot(p - start, along) / square, square > 0.0) * along);
}

// Distances of corner `k` of a face of the skin from what is lip at each of its corners: an edge of its own, or what else is the nearest
// there. In diagonals; each goes straight over the face.
fn from_edges(t: u32, face: u32, k: u32) -> vec3f {
    let p = corners_of(t, face);
    var away: array<f32, 3>;
    for (var i = 0u; i < 3u; i++) {
        away[i] = OFF_LIP;
        if (ends_skin_between_lips(t, face, i)) {
            away[i] = from_edge(t, p, i, k);
        } else if (!ends_skin_between_lips(t, face, (i + 2u) % 3u)) {
            let lip = lip_near(t, wedges[tissues[t].wedges + faces[face].wedges[i]].vertex, p[i]);
            for (var e = 0u; e < lip.count; e++) {
                away[i] = min(away[i], to_line(p[k], lip.starts[e], lip.ends[e]) * tissues[t].detail_scale);
            }
            if (lip.count == 0u) {
                away[i] = lip_value(t, face, i) + distance(p[i], p[k]) * tissues[t].detail_scale;
            }
            // A lip goes on beyond that stretch of it, or it ends there: no corner is nearer than it is to any.
            away[i] = max(away[i], lip_value(t, face, k));
        }
    }
    return vec3f(away[0], away[1], away[2]);
}

// True for a face of a wall with an edge from lip to lip that is none itself: one across the wall, or down it to the other skin.
fn joins_lips(t: u32, face: u32) -> bool {
    if ((tissues[t].flags & WOUNDED) == 0u) {
        return false;
    }
    for (var k = 0u; k < 3u; k++) {
        if (ends_skin_between_lips(t, face, k)) {
            return true;
        }
    }
    return false;
}

// Distance of corner `k` of a face from the lip, in diagonals; 0 for one that is on it.
fn lip_value(t: u32, face: u32, k: u32) -> f32 {
    return deformed[tissues[t].normals + faces[face].wedges[k]].w;
}

// Distances of corner `k` of a face of a wall from its edges that are lip, and from its corners that are, but for those edges' ends, in
// diagonals.
fn from_lips(t: u32, face: u32, k: u32) -> vec3f {
    let p = corners_of(t, face);
    var away = array<f32, 3>(OFF_LIP, OFF_LIP, OFF_LIP);
    var ends = array<bool, 3>(false, false, false);
    var count = 0u;
    for (var i = 0u; i < 3u; i++) {
        if (!ends_skin(t, faces[face].opposites[i])) {
            away[count] = from_edge(t, p, i, k);
            ends[i] = true;
            ends[(i + 1u) % 3u] = true;
            count += 1u;
        }
    }
    for (var i = 0u; i < 3u; i++) {
        if (!ends[i] && lip_value(t, face, i) <= 0.0) {
            away[count] = distance(p[i], p[k]) * tissues[t].detail_scale;
            count += 1u;
        }
    }
    return vec3f(away[0], away[1], away[2]);
}

@vertex
fn corner(@builtin(vertex_index) index: u32, @builtin(view_index) view: u32) -> Corner {
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
    let normal = deformed[tissues[t].normals + w];
    out.normal = normal_to_world(t, normal.xyz);
    out.lip = normal.w;
    out.rest = vec3f(vertices[vertex].rest[0], vertices[vertex].rest[1], vertices[vertex].rest[2]) * tissues[t].detail_scale;
    out.uv = wedge.uv;
    out.colour = unpack4x8unorm(wedge.colour);
    out.material = tissues[t].materials + min(draw & 0xffffu, tissues[t].material_count - 1u);
    if ((draw >> 31u) != 0u) {
        out.flags = WALL | select(0u, RIM, is_rim(t, face));
        if (joins_lips(t, face)) {
            out.flags |= BETWEEN_LIPS;
            out.edges = from_lips(t, face, index % 3u);
        }
    } else if (is_between_lips(t, face)) {
        out.flags = BETWEEN_LIPS;
        out.edges = from_edges(t, face, index % 3u);
    } else if ((tissues[t].flags & WHOLE) != 0u) {
        out.flags = FOLDED_SKIN;
    }
    out.view = view;
    out.clip = frame.views[view].clip_from_world * vec4f(out.position, 1.0);
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

// Raw flesh, on walls, floors and caps and on what is seen from behind: deep red, fibrous, darker, since little light finds
// its way in, with pale strands of connective tissue.
fn raw_flesh(base: vec3f, p: vec3f, s: ptr<function, Surface>) -> vec3f {
    let broad = noise(p * 15.0);
    let fibre = turned_noise(p * vec3f(95.0, 24.0, 95.0) + 1.6 * vec3f(broad.x, 0.0, -broad.x) + 3.0);
    let grain = turned_noise(p * 140.0);
    let strand = smoothstep(0.42, 0.75, fibre.x + 0.25 * grain.x);
    var albedo = base * (1.0 + 0.35 * broad.x + 0.30 * fibre.x + 0.12 * grain.x);
    albedo = mix(albedo, vec3f(0.46, 0.20, 0.15), 0.12 * strand);
    (*s).albedo = max(albedo, vec3f(0.004));
    (*s).roughness = 0.56;
    (*s).scatter = 1.0;
    return 0.16 * broad.yzw + 0.16 * fibre.yzw * vec3f(1.0, 0.35, 1.0) + 0.05 * grain.yzw;
}

// How far the surface where a noise with this gradient has one value runs along `way`, 0 to 1. What such surfaces draw on a skin is closed
// lines; drawn as far as they run one way, they come and go as vessels do.
fn runs_along(way: vec3f, gradient: vec3f) -> f32 {
    return 1.0 - abs(dot(gradient, way)) * inverseSqrt(max(dot(gradient, gradient), 1e-12));
}

// The outside of an organ without a picture of its own: mottled, streaked by fibres, with fat in its hollows and vessels under
// the surface. Returns the gradient of its relief.
fn organ(base: vec3f, p: vec3f, s: ptr<function, Surface>) -> vec3f {
    let broad = noise(p * 9.0);
    let fine = turned_noise(p * 37.0);
    let warp = 0.10 * vec3f(broad.x, fine.x * 0.5, -broad.x);
    let slow = noise(p * 4.3 + warp * 6.0 + 5.0);
    let twist = p.y * 5.0;
    let q = vec3f(cos(twist) * p.x - sin(twist) * p.z, p.y, sin(twist) * p.x + cos(twist) * p.z);
    let fibre = noise(q * vec3f(110.0, 20.0, 110.0) + 2.0 * warp * 10.0);
    let grain = turned_noise(p * 160.0);
    let flesh = (*s).scatter;

    // Darker and bluer where blood stands, lighter over tendinous patches.
    var albedo = base * (0.47 + 0.08 * broad.x + 0.07 * slow.x + 0.09 * fibre.x + 0.04 * grain.x);
    albedo = mix(albedo, vec3f(dot(albedo, vec3f(0.4, 0.4, 0.2))), 0.10);
    albedo *= mix(vec3f(1.0), vec3f(0.92, 0.72, 0.80), saturate(0.5 - 0.9 * slow.x));
    // Vessels along the zero lines of two slow noises; the larger ones stand out a little.
    let down = smoothstep(0.15, 0.6, runs_along(vec3f(0.0, 1.0, 0.0), slow.yzw));
    let caliber = max(0.05 * down, 1e-3);
    let stem = down * smoothstep(caliber, 0.3 * caliber, abs(slow.x - 0.06)) * smoothstep(-0.15, 0.25, broad.x);
    let web = turned_noise(p * 11.0 + warp * 14.0);
    let across = smoothstep(0.1, 0.6, runs_along(vec3f(0.6, 0.64, 0.48), web.yzw));
    let twig = across * smoothstep(0.07, 0.0, abs(web.x)) * smoothstep(0.0, 0.5, fine.x + 1.3 * broad.x) * (1.0 - stem);
    albedo = mix(albedo, albedo * vec3f(0.62, 0.26, 0.33), 0.75 * stem * flesh);
    albedo = mix(albedo, albedo * vec3f(0.80, 0.42, 0.44), 0.45 * twig * flesh);
    // Fat along the vessels: pale yellow, lobed, drier.
    let along = down * smoothstep(0.30, 0.05, abs(slow.x - 0.06)) * smoothstep(0.10, 0.45, broad.x + 0.45 * fine.x);
    let fat = (1.0 - 0.85 * stem) * along * flesh;
    albedo = mix(albedo, vec3f(0.50, 0.33, 0.19) * (0.9 + 0.25 * fine.x + 0.1 * grain.x), 0.8 * fat);
    (*s).albedo = albedo;
    (*s).roughness = mix((*s).roughness, 0.55, fat);
    (*s).wetness *= 1.0 - 0.25 * fat;
    let lobes = turned_noise(p * 62.0);
    var relief = 0.10 * broad.yzw + 0.075 * fine.yzw + 0.07 * (1.0 - fat) * fibre.yzw * vec3f(1.0, 0.2, 1.0) + 0.028 * grain.yzw;
    relief += 0.16 * fat * lobes.yzw - 0.45 * stem * sign(slow.x - 0.06) * slow.yzw * 0.5;
    return relief;
}

@fragment
fn surface(in: Corner, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    eye = in.view;
    let material = materials[in.material];
    let texel = textureSample(textures, texture_sampler, in.uv, material.layer);
    let position_x = dpdx(in.position);
    let position_y = dpdy(in.position);
    let rest_x = dpdx(in.rest);
    let rest_y = dpdy(in.rest);
    let from_lip = select(in.lip, min(in.edges.x, min(in.edges.y, in.edges.z)), (in.flags & BETWEEN_LIPS) != 0u);
    let lip_x = dpdx(from_lip);
    let lip_y = dpdy(from_lip);
    // Metres a diagonal, by both ways: a needle of skin that a wound has drawn wide hardly has a width at rest, and would be all relief.
    let spread = dot(position_x, position_x) + dot(position_y, position_y);
    let scale = sqrt(spread / max(dot(rest_x, rest_x) + dot(rest_y, rest_y), 1e-24));

    let wall = (in.flags & WALL) != 0u;
    var s: Surface;
    s.position = in.position;
    s.normal = normalize(in.normal) * select(-1.0, 1.0, front);
    s.shell_normal = s.normal;
    s.albedo = material.base_colour.rgb * texel.rgb * in.colour.rgb;
    s.roughness = material.roughness;
    s.wetness = material.wetness;
    s.scatter = material.scatter;
    s.openness = 1.0;

    var gradient: vec3f;
    if (wall && front) {
        gradient = raw_flesh(s.albedo, in.rest, &s);
        s.openness = 0.72;
    } else if (wall || (!front && (in.flags & FOLDED_SKIN) == 0u)) {
        gradient = raw_flesh(RAW, in.rest, &s);
        s.wetness = 0.8;
        s.openness = 0.36;
    } else if (material.layer == 0u) {
        gradient = organ(s.albedo, in.rest, &s);
    } else {
        gradient = 0.05 * noise(in.rest * 60.0).yzw + 0.04 * turned_noise(in.rest * 150.0).yzw;
    }
    // Detail finer than a pixel would sparkle.
    let footprint = max(length(rest_x), length(rest_y));
    gradient *= saturate(1.0 - 90.0 * footprint);
    let relief = gradient * (max(s.wetness, 0.35) * scale);
    s.film_normal = tilt(s.normal, relief, position_x, position_y, rest_x, rest_y);
    s.normal = normalize(mix(s.normal, s.film_normal, 0.45));
    if (front && from_lip < 4.0 * LIP_WIDTH) {
        lip(&s, from_lip, vec2f(lip_x, lip_y), position_x, position_y, scale, in.flags);
    }
    return finish(shade(s), in.clip.xy);
}

const RAW: vec3f = vec3f(0.36, 0.038, 0.034);
// Width of a wound's lip, in diagonals.
const LIP_WIDTH: f32 = 0.0045;

// The lip of a wound: a thin pale edge, where skin or capsule is seen cut, that rolls over into the wound and so catches the
// light. `distance` from it is in diagonals.
fn lip(s: ptr<function, Surface>, distance: f32, slope: vec2f, position_x: vec3f, position_y: vec3f, scale: f32, flags: u32) {
    let n = (*s).shell_normal;
    let r1 = cross(position_y, n);
    let r2 = cross(n, position_x);
    let det = dot(position_x, r1);
    let away = (slope.x * r1 + slope.y * r2) * (sign(det) / max(abs(det), 1e-20));
    let width = LIP_WIDTH;
    let near = smoothstep(width, 0.15 * width, distance);
    let flush = smoothstep(4.0 * width, 0.0, distance);
    if ((flags & WALL) != 0u) {
        // A face of a cap has all its corners on the lip and is none of it: there the distance does not grow.
        let grows = select(smoothstep(0.2, 0.6, length(away) * scale), 1.0, (flags & RIM) != 0u);
        (*s).albedo = mix((*s).albedo, vec3f(0.52, 0.24, 0.17), 0.55 * near * grows);
        (*s).openness = mix((*s).openness, 0.95, flush * grows);
        return;
    }
    // Blood gathers beside the cut; the edge itself is pale.
    (*s).albedo = mix((*s).albedo, (*s).albedo * vec3f(0.86, 0.45, 0.45), 0.65 * flush);
    (*s).albedo = mix((*s).albedo, vec3f(0.66, 0.31, 0.25), 0.7 * near);
    (*s).wetness = mix((*s).wetness, 1.0, near);
    let towards = -away / max(length(away), 1e-6);
    (*s).normal = normalize((*s).normal + 0.35 * near * towards);
    (*s).film_normal = normalize((*s).film_normal + 0.5 * near * towards);
}

// What stands behind and under the tissue: a dark neutral backdrop and a draped tray that takes the lamp's shadow.

struct Far {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f, // of the backdrop: the direction
    @location(1) @interpolate(flat, either) view: u32,
}

// A glow where the headlamp points: at infinity, so that both eyes see it in the same direction.
fn backdrop(direction: vec3f) -> vec3f {
    let ahead = dot(normalize(direction), -frame.fill_light.xyz);
    let half_height = frame.views[eye].lens.y;
    let spread = (1.0 - ahead * ahead) / max(4.0 * half_height * half_height * ahead * ahead, 1e-6);
    let glow = select(0.0, exp(-2.6 * spread), ahead > 0.0);
    return mix(vec3f(0.010, 0.012, 0.015), vec3f(0.062, 0.070, 0.078), glow);
}

@vertex
fn screen(@builtin(vertex_index) index: u32, @builtin(view_index) view: u32) -> Far {
    // Two triangles that end where the picture does, corners 0 1 2 and 2 1 3, a digit each: nothing to be clipped.
    let corner = (0x312210u >> (4u * index)) & 3u;
    let p = vec2f(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    let v = frame.views[view];
    let tangent = p * v.lens.xy + v.lens.zw;
    return Far(vec4f(p, 0.0, 1.0), v.forward.xyz + tangent.x * v.right.xyz + tangent.y * v.up.xyz, view);
}

@fragment
fn sky(in: Far) -> @location(0) vec4f {
    eye = in.view;
    return finish(backdrop(in.position), in.clip.xy);
}

// Pixels that the headset's lenses hide: at the near plane, so that nothing behind them is shaded. Group 1 holds corners as
// tangents from the eye: x, y, the view they belong to.
@group(1) @binding(0) var<storage, read> hidden: array<vec4f>;

@vertex
fn mask_corner(@builtin(vertex_index) index: u32, @builtin(view_index) view: u32) -> @builtin(position) vec4f {
    let corner = hidden[index];
    let lens = frame.views[view].lens;
    let p = (corner.xy - lens.zw) / lens.xy;
    // A corner of another view's mask: its triangle shrinks to nothing.
    return select(vec4f(0.0, 0.0, 0.0, 1.0), vec4f(p, 1.0, 1.0), u32(corner.z) == view);
}

// Takes nothing of the vertices, and nothing is handed on: where it was, and not read, NVIDIA's driver (580) hung now and then in stereo
// passes with a mask. It is the suspect, not more.
@fragment
fn mask() -> @location(0) vec4f {
    return vec4f(0.0, 0.0, 0.0, 1.0);
}

fn tray_axes() -> array<vec3f, 2> {
    let up = frame.scene_up.xyz;
    let helper = select(vec3f(0.0, 0.0, 1.0), vec3f(1.0, 0.0, 0.0), abs(up.z) > 0.8);
    let x = normalize(cross(up, helper));
    return array<vec3f, 2>(x, cross(up, x));
}

// Two triangles, corners 0 1 2 and 2 1 3, a digit each.
@vertex
fn tray(@builtin(vertex_index) index: u32, @builtin(view_index) view: u32) -> Far {
    let corners = array<vec2f, 4>(vec2f(-1.0, -1.0), vec2f(1.0, -1.0), vec2f(-1.0, 1.0), vec2f(1.0, 1.0));
    let axes = tray_axes();
    let c = corners[(0x312210u >> (4u * index)) & 3u] * (5.0 * frame.tray_centre.w);
    let p = frame.tray_centre.xyz + c.x * axes[0] + c.y * axes[1];
    return Far(frame.views[view].clip_from_world * vec4f(p, 1.0), p, view);
}

// Signed distance to a rounded rectangle.
fn rounded(p: vec2f, half: vec2f, corner: f32) -> f32 {
    let q = abs(p) - half + corner;
    return length(max(q, vec2f(0.0))) + min(max(q.x, q.y), 0.0) - corner;
}

// Value noise in the plane, 0 to 1.
fn grain(p: vec2f) -> f32 {
    let cell = floor(p);
    let f = p - cell;
    let u = f * f * (3.0 - 2.0 * f);
    let at = vec2i(cell);
    let h = vec4f(speck(at), speck(at + vec2i(1, 0)), speck(at + vec2i(0, 1)), speck(at + vec2i(1, 1)));
    return mix(mix(h.x, h.y, u.x), mix(h.z, h.w, u.x), u.y);
}

fn speck(p: vec2i) -> f32 {
    return f32(hash(vec3u(bitcast<vec2u>(p), 3u)).x >> 8u) / 16777216.0;
}

// Ink of a line of `width` at a whole multiple of `step`, as far as a pixel of width `pixel` shows it.
fn tick(x: f32, step: f32, width: f32, pixel: f32) -> f32 {
    let away = abs(fract(x / step + 0.5) - 0.5) * step;
    return saturate((0.5 * width - away) / max(pixel, 1e-9) + 0.5) * saturate(step / (4.0 * pixel) - 0.5);
}

// A ruler etched into the tray's near edge: centimetres where the model is as large as a heart, and otherwise the power of ten
// that suits it, with tenths; 0 to 1.
fn ruler(p: vec2f, radius: f32, pixel: f32) -> f32 {
    let unit = pow(10.0, floor(log(radius * 0.25) / log(10.0)));
    let along = p.x;
    let up = p.y + 0.06 * radius; // from the base line towards the tissue
    let reach = floor(1.15 * radius / unit) * unit;
    let inside = step(abs(along), reach + 0.02 * unit);
    let line = 0.010 * radius;
    let base = saturate((0.35 * line - abs(up)) / pixel + 0.5);
    let tall = step(0.0, up) * step(up, 0.10 * radius) * tick(along, unit, line, pixel);
    let middle = step(0.0, up) * step(up, 0.065 * radius) * tick(along, 0.5 * unit, 0.7 * line, pixel);
    let small = step(0.0, up) * step(up, 0.04 * radius) * tick(along, 0.1 * unit, 0.5 * line, pixel);
    let exponent = i32(round(log(unit) / log(10.0)));
    let dot_size = 0.011 * radius;
    let corner = vec2f(-reach, 0.135 * radius);
    var label = 0.0;
    for (var i = 0; i < 4; i++) {
        let shift = pixel * (vec2f(f32(i & 1), f32(i >> 1u)) - 0.5) * 0.7;
        label += 0.25 * unit_label(vec2f(along, up) - corner + shift, exponent, dot_size);
    }
    return max(label, inside * max(max(base, tall), max(middle, small)));
}

// Dots of a glyph, five rows of five from the top left, highest bit first.
const DIGIT_0: u32 = 0x0e8c62eu; // 01110 10001 10001 10001 01110
const DIGIT_1: u32 = 0x046108eu; // 00100 01100 00100 00100 01110
const LETTER_C: u32 = 0x007420eu; // 00000 01110 10000 10000 01110
const LETTER_M: u32 = 0x00d56b5u; // 00000 11010 10101 10101 10101
const POINT: u32 = 0x0000004u; // 00000 00000 00000 00000 00100

// Glyphs of what one unit of the ruler measures, 10 to the power of `exponent` metres: three bits each, the first lowest. No
// branch, since the exponent is the same for all pixels (see lamp_visibility).
fn unit_name(exponent: i32) -> u32 {
    var name = 0u;
    name = select(name, 0x240a9u, exponent == -4); // 0.1 mm
    name = select(name, 0x902u, exponent == -3); // 1 mm
    name = select(name, 0x8c2u, exponent == -2); // 1 cm
    name = select(name, 0x460au, exponent == -1); // 10 cm
    name = select(name, 0x102u, exponent == 0); // 1 m
    name = select(name, 0x80au, exponent == 1); // 10 m
    name = select(name, 0x404au, exponent == 2); // 100 m
    return name;
}

fn glyph(code: u32) -> u32 {
    var dots = select(0u, DIGIT_0, code == 1u);
    dots = select(dots, DIGIT_1, code == 2u);
    dots = select(dots, LETTER_C, code == 3u);
    dots = select(dots, LETTER_M, code == 4u);
    return select(dots, POINT, code == 5u);
}

// Ink of the unit's name with its lower left corner at 0: metres, dots of side `dot_size`.
fn unit_label(p: vec2f, exponent: i32, dot_size: f32) -> f32 {
    let cell = floor(p / dot_size);
    let row = 4 - i32(cell.y);
    let column = i32(cell.x);
    if (row < 0 || row > 4 || column < 0 || column >= 36 || column % 6 == 5) {
        return 0.0;
    }
    let bits = glyph((unit_name(exponent) >> u32(3 * (column / 6))) & 7u);
    return f32((bits >> u32(24 - 5 * row - column % 6)) & 1u);
}

@fragment
fn drape(in: Far) -> @location(0) vec4f {
    eye = in.view;
    let up = frame.scene_up.xyz;
    let radius = frame.tray_centre.w;
    let axes = tray_axes();
    let offset = in.position - frame.tray_centre.xyz;
    let plane = vec2f(dot(offset, axes[0]), dot(offset, axes[1])); // metres; y towards the viewer's side of the tray
    let p = plane / radius;
    let pixel = length(fwidth(plane)) * 0.7;
    let r = length(p);
    let v = normalize(frame.views[eye].eye.xyz - in.position);
    let visible = lamp_visibility(in.position, up);
    // Near the tissue even the room's light is kept off: a soft contact shadow.
    let contact = 1.0 - 0.66 * exp(-2.6 * r * r);
    let pool = exp(-0.20 * r * r); // the lamp's cone
    let lamp = KEY_COLOUR * frame.key_light.w * max(dot(up, frame.key_light.xyz), 0.0) * visible * pool;
    let edge = rounded(p, vec2f(1.75, 1.3), 0.28);

    // Cloth: a plain weave with slow folds.
    let fold = grain(p * 1.7 + 7.0) + 0.5 * grain(p * 4.1);
    // gone before a pixel is half a wave: it would moire
    let fade = saturate(0.0045 * radius / max(pixel, 1e-9) - 0.6);
    let weave = mix(0.5, 0.5 + 0.5 * sin(p.x * 420.0) * sin(p.y * 420.0), fade);
    let cloth = vec3f(0.012, 0.062, 0.070) * (0.66 + 0.40 * fold + 0.25 * weave);
    var light = cloth * (lamp * (0.55 + 0.45 * fold) + 1.3 * SKY * contact);
    // The tray throws a thin shadow of its own.
    light *= 1.0 - 0.55 * smoothstep(0.16, 0.0, edge) * step(0.0, edge);

    if (edge < 0.0) {
        // Brushed steel with a raised rim.
        let rim = smoothstep(-0.10, -0.055, edge) * smoothstep(0.0, -0.035, edge);
        let outwards = normalize(p / vec2f(1.75, 1.3) + vec2f(1e-6, 0.0));
        let bevel = (smoothstep(-0.10, -0.075, edge) - smoothstep(-0.045, 0.0, edge)) * 0.9;
        let brush = grain(vec2f(p.x * 9.0, p.y * 900.0)) - 0.5;
        let wear = grain(p * 5.0) - 0.5;
        let tilted = -outwards.x * axes[0] - outwards.y * axes[1];
        let n = normalize(up + 0.55 * bevel * tilted + 0.05 * brush * saturate(1.0 - 250.0 * pixel / radius) * axes[1]);
        let rough = 0.42 + 0.1 * wear;
        let mirror = room(reflect(-v, n), rough) * contact;
        let gloss = specular(n, v, frame.key_light.xyz, rough, 0.5) * lamp;
        let steel = vec3f(0.36, 0.37, 0.38) * (0.92 + 0.12 * wear);
        light = steel * (0.42 * mirror + 0.16 * lamp + 0.20 * SKY * contact) + 0.22 * gloss;
        light += steel * rim * 0.05;
        light *= 1.0 - 0.75 * ruler(vec2f(plane.x, plane.y + 1.08 * radius), radius, pixel);
    }
    let mapped = finish(light, in.clip.xy);
    // Fades into the backdrop far out, where its edge would distract, and seen edge-on.
    let alpha = smoothstep(4.8, 2.2, r) * smoothstep(0.02, 0.16, dot(v, up));
    return vec4f(mapped.rgb, alpha);
}

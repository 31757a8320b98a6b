// Inspection layers: coloured capsules of constant width in pixels; a point is a disc.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(1) @binding(0) var<storage, read> lines: array<Line>;

struct Spot {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(linear) across: vec2f, // pixels from the segment's start, along and across it
    @location(1) @interpolate(flat, either) shape: vec2f, // length and half-width in pixels
    @location(2) @interpolate(flat, either) colour: vec4f,
}

// Lines hug the surface they annotate: drawn this much nearer, relative to their depth; those of negative width more.
const LIFT: f32 = 1.002;
const LIFT_OVER: f32 = 1.035;

@vertex
fn capsule(@builtin(vertex_index) vertex: u32, @builtin(view_index) view: u32) -> Spot {
    let line = lines[vertex / 6u];
    // Two triangles, corners 0 1 2 and 2 1 3, a digit each.
    let index = (0x312210u >> (4u * (vertex % 6u))) & 3u;
    var a = frame.views[view].clip_from_world * vec4f(line.a[0], line.a[1], line.a[2], 1.0);
    var b = frame.views[view].clip_from_world * vec4f(line.b[0], line.b[1], line.b[2], 1.0);
    var out: Spot;
    // Reverse depth with an infinite far plane: z is the near distance, w the distance.
    if (a.w < a.z && b.w < b.z) {
        out.clip = vec4f(0.0, 0.0, 0.0, 1.0);
        return out;
    }
    if (a.w < a.z) {
        a = mix(a, b, (a.z - a.w) / (b.w - a.w));
    } else if (b.w < b.z) {
        b = mix(b, a, (b.z - b.w) / (a.w - b.w));
    }
    let to_pixels = 0.5 * frame.views[view].size.xy;
    let pixel_a = a.xy / a.w * to_pixels;
    let pixel_b = b.xy / b.w * to_pixels;
    let length_px = distance(pixel_a, pixel_b);
    let along = select(vec2f(1.0, 0.0), (pixel_b - pixel_a) / max(length_px, 1e-6), length_px > 1e-3);
    let half_width = 0.5 * abs(line.width);
    let reach = half_width + 1.0; // room for the soft edge
    let end = (index & 1u) == 1u;
    let side = select(-1.0, 1.0, (index & 2u) == 2u);
    let centre = select(a, b, end);
    let offset = along * select(-reach, reach, end) + vec2f(-along.y, along.x) * side * reach;
    out.clip = centre + vec4f(offset / to_pixels * centre.w, 0.0, 0.0);
    out.clip.z *= select(LIFT, LIFT_OVER, line.width < 0.0);
    out.across = vec2f(select(-reach, length_px + reach, end), side * reach);
    out.shape = vec2f(length_px, half_width);
    out.colour = unpack4x8unorm(line.colour);
    return out;
}

@fragment
fn ink(in: Spot) -> @location(0) vec4f {
    let nearest = clamp(in.across.x, 0.0, in.shape.x);
    let outside = distance(in.across, vec2f(nearest, 0.0)) - in.shape.y;
    return vec4f(stored(in.colour.rgb), in.colour.a * saturate(0.5 - outside));
}

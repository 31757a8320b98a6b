// A picture shown again in another size: a mirror of one eye.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var smooth_sampler: sampler;
@group(0) @binding(2) var<uniform> part: vec4f; // of the picture: left, top, width, height, 0 to 1

override decode_srgb: bool = false;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) at: vec2f,
}

@vertex
fn blit_corner(@builtin(vertex_index) index: u32) -> Corner {
    // One triangle that covers the target.
    let corner = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
    var out: Corner;
    out.clip = vec4f(2.0 * corner.x - 1.0, 1.0 - 2.0 * corner.y, 0.0, 1.0);
    out.at = part.xy + corner * part.zw;
    return out;
}

@fragment
fn blit(in: Corner) -> @location(0) vec4f {
    // Four taps, so that a picture of half the size loses no thin line.
    let step = 0.25 * vec2f(abs(dpdx(in.at.x)), abs(dpdy(in.at.y)));
    var sum = vec3f(0.0);
    for (var k = 0u; k < 4u; k++) {
        let side = vec2f(f32(k & 1u), f32(k >> 1u)) * 2.0 - 1.0;
        sum += textureSampleLevel(picture, smooth_sampler, in.at + side * step, 0.0).rgb;
    }
    var colour = 0.25 * sum;
    if (decode_srgb) {
        colour = select(pow((colour + 0.055) / 1.055, vec3f(2.4)), colour / 12.92, colour <= vec3f(0.04045));
    }
    return vec4f(stored(colour), 1.0);
}

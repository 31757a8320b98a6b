// The first sample of every pixel's depth, into a target of one sample a pixel.

@group(0) @binding(0) var samples: texture_depth_multisampled_2d;

@vertex
fn depth_corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    // One triangle that covers the target.
    return vec4f(4.0 * f32(index & 1u) - 1.0, 4.0 * f32(index >> 1u) - 1.0, 0.0, 1.0);
}

@fragment
fn depth_first(@builtin(position) pixel: vec4f) -> @builtin(frag_depth) f32 {
    return textureLoad(samples, vec2i(pixel.xy), 0);
}

// What stands behind and under the tissue: a dark neutral backdrop and a draped tray that takes the lamp's shadow.

struct Far {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
}

fn backdrop(pixel: vec2f) -> vec3f {
    let p = (pixel * view.size.zw - vec2f(0.5, 0.42)) * vec2f(view.size.x * view.size.w, 1.0);
    let glow = exp(-2.6 * dot(p, p));
    return mix(vec3f(0.010, 0.012, 0.015), vec3f(0.062, 0.070, 0.078), glow);
}

@vertex
fn screen(@builtin(vertex_index) index: u32) -> Far {
    let p = vec2f(f32(index & 1u), f32(index >> 1u)) * 4.0 - 1.0;
    return Far(vec4f(p, 0.0, 1.0), vec3f(0.0));
}

@fragment
fn sky(in: Far) -> @location(0) vec4f {
    return finish(backdrop(in.clip.xy), in.clip.xy);
}

fn tray_axes() -> array<vec3f, 2> {
    let up = view.scene_up.xyz;
    let helper = select(vec3f(0.0, 0.0, 1.0), vec3f(1.0, 0.0, 0.0), abs(up.z) > 0.8);
    let x = normalize(cross(up, helper));
    return array<vec3f, 2>(x, cross(up, x));
}

@vertex
fn tray(@builtin(vertex_index) index: u32) -> Far {
    let corners = array<vec2f, 4>(vec2f(-1.0, -1.0), vec2f(1.0, -1.0), vec2f(-1.0, 1.0), vec2f(1.0, 1.0));
    let axes = tray_axes();
    let c = corners[index] * (5.0 * view.tray_centre.w);
    let p = view.tray_centre.xyz + c.x * axes[0] + c.y * axes[1];
    return Far(view.clip_from_world * vec4f(p, 1.0), p);
}

@fragment
fn drape(in: Far) -> @location(0) vec4f {
    let up = view.scene_up.xyz;
    let radius = view.tray_centre.w;
    let r = length(in.position - view.tray_centre.xyz) / radius;
    let visible = lamp_visibility(in.position, up);
    // Near the tissue even the room's light is kept off: a soft contact shadow.
    let contact = 1.0 - 0.62 * exp(-2.4 * r * r);
    let cloth = vec3f(0.020, 0.060, 0.066);
    let v = normalize(view.eye.xyz - in.position);
    let lamp = KEY_COLOUR * view.key_light.w * max(dot(up, view.key_light.xyz), 0.0) * visible * exp(-0.30 * r * r);
    var light = cloth * (lamp + 1.5 * SKY * contact);
    light += room(reflect(-v, up), 0.6) * 0.04 * pow(1.0 - saturate(dot(v, up)), 3.0) * contact;
    let mapped = finish(light, in.clip.xy);
    // Fades into the backdrop far out, where its edge would distract, and seen edge-on.
    let alpha = smoothstep(4.6, 1.2, r) * smoothstep(0.02, 0.16, dot(v, up));
    return vec4f(mapped.rgb, alpha);
}

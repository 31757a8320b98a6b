// The operating theatre: one lamp with a soft shadow, a headlamp, a small generated room around, and the tone curve.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var shadow_map: texture_depth_2d;
@group(0) @binding(2) var shadow_sampler: sampler_comparison;

// Which view is being drawn; set first thing in every entry point.
var<private> eye: u32;

const KEY_COLOUR: vec3f = vec3f(1.0, 0.965, 0.9);
const FILL_COLOUR: vec3f = vec3f(0.86, 0.93, 1.0);
const SKY: vec3f = vec3f(0.30, 0.34, 0.38);
const GROUND: vec3f = vec3f(0.075, 0.085, 0.085);

struct Surface {
    position: vec3f,
    normal: vec3f,      // unit, towards the viewer
    film_normal: vec3f, // unit; of the wet film, which shows finer relief
    shell_normal: vec3f, // unit; without any relief
    albedo: vec3f,
    roughness: f32,
    wetness: f32,
    scatter: f32,
    openness: f32, // 1 in the open, less inside a wound: scales ambient light
}

// What the room sends from direction `d`, blurred by `roughness`: pale ceiling, dark floor, lamp, and a long window
// behind the subject whose reflection draws the outline of wet things.
fn room(d: vec3f, roughness: f32) -> vec3f {
    let height = dot(d, frame.scene_up.xyz);
    var light = mix(GROUND, SKY, smoothstep(-0.35 - roughness, 0.75 + roughness, height));
    let blur = 0.02 + 0.5 * roughness;
    let lamp = dot(d, frame.key_light.xyz);
    light += KEY_COLOUR * (3.0 / (1.0 + 14.0 * roughness)) * smoothstep(0.93 - blur, 0.96 + blur, lamp);
    let away = -frame.key_light.xyz + 1.3 * dot(frame.key_light.xyz, frame.scene_up.xyz) * frame.scene_up.xyz;
    let window = dot(d, normalize(away));
    let band = smoothstep(0.7 - blur, 0.8 + blur, window) * smoothstep(-0.15 - blur, 0.1 + blur, height);
    return light + FILL_COLOUR * 0.9 * band;
}

// Share of the lamp that is visible, 0 to 1: four bilinear comparisons on a turned square.
fn lamp_visibility(position: vec3f, normal: vec3f) -> f32 {
    let slope = 1.0 - saturate(dot(normal, frame.key_light.xyz));
    let p = position + normal * (frame.shadow.z * (0.6 + 2.0 * slope));
    let clip = frame.light_from_world * vec4f(p, 1.0);
    let uv = clip.xy * vec2f(0.5, -0.5) + 0.5;
    // The map covers a disc, and shadows fade out at its rim.
    let rim = smoothstep(1.0, 0.93, length(clip.xy));
    if (rim <= 0.0) {
        return 1.0;
    }
    let depth = clip.z + frame.shadow.y;
    let step = frame.shadow.x;
    var sum = 0.0;
    sum += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + step * vec2f(-1.6, -0.6), depth);
    sum += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + step * vec2f(0.6, -1.6), depth);
    sum += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + step * vec2f(1.6, 0.6), depth);
    sum += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + step * vec2f(-0.6, 1.6), depth);
    // No branch on a uniform: Mesa's software adapter compiles the shader anew for each draw that has one, and keeps them all.
    return max(mix(1.0, sum / 4.0, rim), 1.0 - frame.shadow.w);
}

// GGX with Smith's height-correlated visibility, times cos. Lights are given as the radiance that a white Lambertian
// surface would send back, so the 1/pi of both lobes is in them already.
fn specular(n: vec3f, v: vec3f, l: vec3f, roughness: f32, f0: f32) -> f32 {
    let h = normalize(v + l);
    let ndl = saturate(dot(n, l));
    let ndv = max(dot(n, v), 1e-3);
    let ndh = saturate(dot(n, h));
    let a = roughness * roughness;
    let a2 = a * a;
    let d = a2 / max(pow(ndh * ndh * (a2 - 1.0) + 1.0, 2.0), 1e-6);
    let visibility = 0.5 / max(ndl * sqrt(ndv * ndv * (1.0 - a2) + a2) + ndv * sqrt(ndl * ndl * (1.0 - a2) + a2), 1e-4);
    let fresnel = f0 + (1.0 - f0) * pow(1.0 - saturate(dot(v, h)), 5.0);
    return d * visibility * fresnel * ndl;
}

// Lambert that reaches round the terminator, farthest in red: light bleeds through flesh.
fn wrapped(ndl: f32, scatter: f32) -> vec3f {
    let wrap = scatter * vec3f(0.34, 0.13, 0.10);
    let reach = max((vec3f(ndl) + wrap) / (1.0 + wrap), vec3f(0.0));
    return reach * mix(vec3f(1.0), reach, 0.35) / (1.0 + 0.4 * wrap);
}

// Interpolated normals may look away from the eye at a silhouette, where highlights would sparkle: bends them back.
fn facing(n: vec3f, v: vec3f) -> vec3f {
    return normalize(n + v * max(0.06 - dot(n, v), 0.0));
}

fn shade(surface: Surface) -> vec3f {
    var s = surface;
    let v = normalize(frame.views[eye].eye.xyz - s.position);
    s.normal = facing(s.normal, v);
    s.film_normal = facing(s.film_normal, v);
    let l = frame.key_light.xyz;
    let head = frame.fill_light.xyz;
    let visible = lamp_visibility(s.position, s.shell_normal);
    // A shadow's edge on flesh is red: what light there is came through it.
    let bled = mix(vec3f(visible), vec3f(sqrt(visible), visible, visible), 0.6 * s.scatter);

    var light = KEY_COLOUR * frame.key_light.w * wrapped(dot(s.normal, l), s.scatter) * bled;
    light += FILL_COLOUR * frame.fill_light.w * wrapped(dot(s.normal, head), s.scatter);
    let ambient = mix(GROUND, SKY, 0.5 + 0.5 * dot(s.normal, frame.scene_up.xyz)) * s.openness;
    var colour = s.albedo * (light + ambient);

    let under = max(s.roughness, 0.2);
    colour += KEY_COLOUR * frame.key_light.w * visible * specular(s.normal, v, l, under, 0.03);
    let film = 0.27; // a lamp of a hand's breadth is no point
    let lamp_glint = visible * frame.key_light.w * min(2.0 * specular(s.film_normal, v, l, film, 0.03), 5.0);
    let head_glint = frame.fill_light.w * specular(s.film_normal, v, head, film + 0.05, 0.03);
    colour += s.wetness * (KEY_COLOUR * lamp_glint + FILL_COLOUR * head_glint);

    let grazing = pow(1.0 - saturate(dot(s.film_normal, v)), 5.0);
    let mirror = mix(0.022, 0.55, grazing) * s.wetness + mix(0.02, 0.2, grazing) * (1.0 - s.roughness) * (1.0 - s.wetness);
    colour += room(reflect(-v, s.film_normal), mix(0.6, 0.12, s.wetness)) * mirror * s.openness * mix(0.35, 1.0, visible);
    return colour;
}

// The Khronos "PBR neutral" curve: colours stay true up to the highlights, which run out to white.
fn tone_map(light: vec3f) -> vec3f {
    let start = 0.76;
    let desaturation = 0.15;
    let low = min(light.r, min(light.g, light.b));
    let offset = select(0.04, low - 6.25 * low * low, low < 0.08);
    var colour = light - offset;
    let peak = max(colour.r, max(colour.g, colour.b));
    if (peak < start) {
        return colour;
    }
    let d = 1.0 - start;
    let new_peak = 1.0 - d * d / (peak + d - start);
    colour *= new_peak / peak;
    let g = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0);
    return mix(colour, vec3f(new_peak), g);
}

fn hash(p: vec3u) -> vec3u { // pcg3d: Jarzynski and Olano 2020
    var v = p * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3u(16u);
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// Half a step of 8 bits either way, so that dark gradients do not band.
fn dither(pixel: vec2f) -> f32 {
    let bits = hash(vec3u(vec2u(pixel), 7u)).x >> 8u;
    return (f32(bits) / 16777216.0 - 0.5) / 255.0;
}

fn finish(light: vec3f, pixel: vec2f) -> vec4f {
    // A little contrast about middle grey first.
    let graded = 0.18 * pow(max(light, vec3f(0.0)) / 0.18, vec3f(1.14));
    let mapped = saturate(tone_map(graded));
    // The dither is meant for the stored, curved value: scale it by the slope of the sRGB curve there.
    let slope = pow(max(mapped, vec3f(0.002)), vec3f(0.58)) * 2.3;
    return vec4f(stored(saturate(mapped + dither(pixel) * slope)), 1.0);
}

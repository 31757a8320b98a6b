// Instruments: steel that mirrors the room, a translucent sheet with a grid for the plane of a cut, glass for a poking sphere.

@group(1) @binding(0) var<storage, read> tools: array<ToolVertex>;
@group(1) @binding(1) var<uniform> place: ToolPlace;

const STEEL: u32 = 0u;
const BLADE: u32 = 1u;
const SHEET: u32 = 2u;
const GLASS: u32 = 3u;

struct Part {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) colour: vec4f,
    @location(3) sheet: vec2f, // of a sheet: -1 to 1 both ways
    @location(4) @interpolate(flat, either) stuff: u32,
    @location(5) @interpolate(flat, either) view: u32,
}

@vertex
fn tool_corner(@builtin(vertex_index) index: u32, @builtin(view_index) view: u32) -> Part {
    let corner = tools[index];
    let position = tool_point(corner, place);
    let across = vec4f(corner.normal[0], corner.normal[1], corner.normal[2], 0.0);
    let turned = place.normal_from_tool;
    var out: Part;
    out.position = position;
    out.normal = vec3f(dot(turned[0], across), dot(turned[1], across), dot(turned[2], across));
    out.colour = place.colour;
    // A sheet's corners come as 0 1 2 and 0 2 3 of a square, a digit each; six a sheet, and nothing else counts them.
    let at = (0x320210u >> (4u * (index % 6u))) & 3u;
    out.sheet = vec2f(select(-1.0, 1.0, at == 1u || at == 2u), select(-1.0, 1.0, at >= 2u));
    out.stuff = corner.stuff;
    out.view = view;
    out.clip = frame.views[view].clip_from_world * vec4f(position, 1.0);
    return out;
}

@fragment
fn tool_surface(in: Part, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    eye = in.view;
    let v = normalize(frame.views[eye].eye.xyz - in.position);
    var n = normalize(in.normal);
    n = select(-n, n, dot(n, v) > 0.0);
    n = facing(n, v);
    let grid_width = fwidth(in.sheet);
    if (in.stuff == SHEET) {
        // Lines at tenths, a firm border, and a faint body.
        let cell = abs(fract(in.sheet * 5.0 + 0.5) - 0.5) / 5.0;
        let line = max(saturate(1.2 - cell.x / max(grid_width.x, 1e-6)), saturate(1.2 - cell.y / max(grid_width.y, 1e-6)));
        let border = smoothstep(0.975, 0.985, max(abs(in.sheet.x), abs(in.sheet.y)));
        let alpha = in.colour.a * (0.35 + 0.35 * line + 0.65 * border);
        return vec4f(stored(in.colour.rgb), saturate(alpha));
    }
    let visible = lamp_visibility(in.position, n);
    let l = frame.key_light.xyz;
    let head = frame.fill_light.xyz;
    let grazing = pow(1.0 - saturate(dot(n, v)), 5.0);
    if (in.stuff == GLASS) {
        let rim = mix(0.25, 1.0, grazing);
        let glint = specular(n, v, l, 0.2, 0.04) * frame.key_light.w * visible;
        let light = in.colour.rgb * (0.35 + 0.5 * saturate(dot(n, l)) * visible) + glint;
        return vec4f(finish(light, in.clip.xy).rgb, saturate(in.colour.a * rim + 0.3 * glint));
    }
    let blade = in.stuff == BLADE;
    let rough = select(0.34, 0.16, blade);
    let tint = in.colour.rgb * select(vec3f(0.60, 0.61, 0.63), vec3f(0.74, 0.76, 0.80), blade);
    let f0 = tint + (1.0 - tint) * grazing;
    var light = f0 * room(reflect(-v, n), rough) * mix(0.55, 1.0, visible);
    light += tint * (0.10 * KEY_COLOUR * frame.key_light.w * saturate(dot(n, l)) * visible + 0.06 * SKY);
    light += KEY_COLOUR * min(frame.key_light.w * specular(n, v, l, rough, 0.6) * visible, 6.0);
    light += FILL_COLOUR * min(frame.fill_light.w * specular(n, v, head, rough, 0.6), 3.0);
    return finish(light, in.clip.xy);
}

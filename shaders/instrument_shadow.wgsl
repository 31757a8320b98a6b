// Depth of the instruments as the operating lamp sees them.

@group(0) @binding(0) var<uniform> frame: Frame;

@group(1) @binding(0) var<storage, read> tools: array<ToolVertex>;
@group(1) @binding(1) var<uniform> place: ToolPlace;

@vertex
fn tool_lamp_corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let p = tool_point(tools[index], place);
    return frame.light_from_world * vec4f(p, 1.0);
}

// Data shared by all shaders, mirrored by src/gpu/types.rs; a test compares names, offsets and sizes.
// All indices inside a tissue's data are local to it; its record holds where each of its ranges begins.

const NONE: u32 = 0xffffffffu;

// Flags of a tissue.
const SKINNED: u32 = 1u;
const DISPLACED: u32 = 2u;
const FADING: u32 = 4u;
const ROTATED: u32 = 8u;
const WOUNDED: u32 = 16u;
const WHOLE: u32 = 32u;

// One tissue: where its data lies, and what moves it.
struct TissueRecord {
    world_from_tissue: array<vec4f, 3>, // rows of 3 x 4
    vertices: u32,
    vertex_count: u32,
    bones: u32,
    rows: u32,
    influences: u32,
    faces: u32,
    face_count: u32,
    wedges: u32,
    wedge_count: u32,
    joints: u32,
    displacements: u32,
    fades: u32,
    positions: u32,
    normals: u32,
    materials: u32,
    material_count: u32,
    flags: u32,
    slot: u32,
    time_high: f32, // seconds, time_high + time_low
    time_low: f32,
    fade_duration: f32, // seconds
    detail_scale: f32,  // 1 / diagonal: procedural detail keeps its size relative to the model
    rotations: u32,
    padding: u32,
}

// A topological vertex. Spans are (start, length) in the tissue's term ranges.
struct VertexRecord {
    rest: array<f32, 3>,
    half_edge: u32,
    bones: vec2u,
    row: vec2u,
    influences: vec2u,
}

// One term of a sum: a joint, a base vertex or a particle, and its weight.
struct Term {
    index: u32,
    weight: f32,
}

// A face slot. `draw`: bits 0-15 material, 16-30 tissue slot, 31 set for walls and caps.
struct FaceRecord {
    wedges: array<u32, 3>,
    draw: u32,
    opposites: array<u32, 3>,
    section: u32,
}

// A corner's attributes; the same 32 bytes as on the CPU.
struct Wedge {
    vertex: u32,
    group: u32,
    uv: vec2f,
    normal: array<f32, 3>,
    colour: u32,
}

// 64 vertices (or wedges) of one tissue: the work of one workgroup.
struct WorkItem {
    tissue: u32,
    first: u32,
}

// How a surface answers light.
struct Material {
    base_colour: vec4f, // linear
    layer: u32,         // of the texture array; 0 is white
    roughness: f32,
    wetness: f32,       // 0 dry, 1 under a film of water
    scatter: f32,       // 0 opaque, 1 flesh
}

// One view of the scene.
struct View {
    clip_from_world: mat4x4f,
    eye: vec4f,     // w: distance of the near plane
    right: vec4f,   // axes in world space
    up: vec4f,
    forward: vec4f,
    lens: vec4f,    // tangents: half the width and height of the picture, then its centre
    size: vec4f,    // width, height, 1 / width, 1 / height
}

// What all views of one call share, and the views.
struct Frame {
    light_from_world: mat4x4f,
    scene_up: vec4f,    // w: the tray's height along it
    key_light: vec4f,   // towards the lamp; w: radiance
    fill_light: vec4f,  // towards the headlamp; w: radiance
    tray_centre: vec4f, // w: the tray's radius, 0 for none
    shadow: vec4f,      // texel size in uv, depth bias, normal offset in world units, 1 if there is a shadow map
    views: array<View, 8>,
}

// A coloured segment of the inspection layers; a point where both ends are the same.
struct Line {
    a: array<f32, 3>,
    width: f32, // pixels; negative for one that shows through what lies a little in front of it
    b: array<f32, 3>,
    colour: u32, // RGBA8, linear, red lowest
}

// A corner of an instrument's triangle, world space.
struct ToolVertex {
    position: array<f32, 3>,
    stuff: u32,
    normal: array<f32, 3>,
    opens: f32, // how far it goes along x for each metre that the tool opens
}

// Where an instrument is, and how it looks.
struct ToolPlace {
    world_from_tool: array<vec4f, 3>, // rows of 3 x 4
    normal_from_tool: array<vec4f, 3>, // rows: the cofactors of the above
    colour: vec4f,
    opening: vec4f, // metres that the tool is open, then nothing
}

// Where a corner of an instrument is, world space.
fn tool_point(corner: ToolVertex, place: ToolPlace) -> vec3f {
    let open = vec4f(corner.position[0] + corner.opens * place.opening.x, corner.position[1], corner.position[2], 1.0);
    return vec3f(dot(place.world_from_tool[0], open), dot(place.world_from_tool[1], open), dot(place.world_from_tool[2], open));
}

// True where the target stores what it is given: then we apply the sRGB curve, else the hardware does.
override encode_srgb: bool = false;

// Linear colour as the target wants it.
fn stored(c: vec3f) -> vec3f {
    if (encode_srgb) {
        return select(1.055 * pow(max(c, vec3f(0.0)), vec3f(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3f(0.0031308));
    }
    return c;
}

//! The structs that CPU and shaders share, mirrored by `shaders/types.wgsl` (a test compares them by reflection).

use super::views::MOST_VIEWS;
use bytemuck::{Pod, Zeroable};
use std::borrow::Cow;

/// Declares a GPU struct and lists its fields for the reflection test.
macro_rules! gpu_struct {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident : $ty:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
        #[repr(C)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $ty,)*
        }

        impl $name {
            /// Name, offset and size in bytes of each field.
            pub const FIELDS: &'static [(&'static str, usize, usize)] =
                &[$((stringify!($field), std::mem::offset_of!($name, $field), std::mem::size_of::<$ty>())),*];
        }
    };
}

gpu_struct!(
    /// One tissue: where its data lies in the arenas, and what moves it. Indices inside a tissue's data are local.
    TissueRecord {
        /// Rows of the 3 x 4 transform.
        world_from_tissue: [[f32; 4]; 3],
        /// First vertex record.
        vertices: u32,
        /// Vertices, dead ones included.
        vertex_count: u32,
        /// First bone term.
        bones: u32,
        /// First row term.
        rows: u32,
        /// First influence term.
        influences: u32,
        /// First face record.
        faces: u32,
        /// Face slots, dead ones included.
        face_count: u32,
        /// First wedge.
        wedges: u32,
        /// Wedges.
        wedge_count: u32,
        /// First of three vectors a joint.
        joints: u32,
        /// First of one vector a particle.
        displacements: u32,
        /// First of one vector a vertex; read only while [`FADING`].
        fades: u32,
        /// First final position.
        positions: u32,
        /// First final normal, one a wedge.
        normals: u32,
        /// First material.
        materials: u32,
        /// Materials.
        material_count: u32,
        /// [`SKINNED`], [`DISPLACED`], [`FADING`], [`ROTATED`], [`WOUNDED`], [`WHOLE`].
        flags: u32,
        /// Its own position in the table.
        slot: u32,
        /// Seconds; the time is the sum of both, so that long sessions fade as smoothly as short ones.
        time_high: f32,
        /// The rest of the time.
        time_low: f32,
        /// Seconds.
        fade_duration: f32,
        /// One over the diagonal.
        detail_scale: f32,
        /// First of three vectors a particle: a row of `R - I` each, and a coordinate of its anchor; read only while [`ROTATED`].
        rotations: u32,
        /// Zero.
        padding: u32,
    }
);

impl TissueRecord {
    /// A transform as the record stores it.
    pub fn rows_of(m: glam::DAffine3) -> [[f32; 4]; 3] {
        crate::rig::JointMatrix::from_affine(m).rows
    }
}

/// The tissue has joints.
pub const SKINNED: u32 = 1;
/// Some particle of the tissue is displaced.
pub const DISPLACED: u32 = 2;
/// Some vertex of the tissue still fades (MATHS 2.2).
pub const FADING: u32 = 4;
/// Some particle of the tissue is turned (MATHS 2.1).
pub const ROTATED: u32 = 8;
/// Edits have inserted vertices: there may be lips of wounds.
pub const WOUNDED: u32 = 16;
/// Closed, and not by edits alone: what is seen from behind is a fold of its skin.
pub const WHOLE: u32 = 32;

gpu_struct!(
    /// A topological vertex. Spans are (start, length) in the tissue's term ranges.
    VertexRecord {
        /// Rest position, tissue space, metres.
        rest: [f32; 3],
        /// One half-edge, all bits set where dead.
        half_edge: u32,
        /// Bones.
        bones: [u32; 2],
        /// Row over base vertices (MATHS 1.1); empty for base vertices.
        row: [u32; 2],
        /// Influences.
        influences: [u32; 2],
    }
);

gpu_struct!(
    /// One term of a sum: a joint, a base vertex or a particle, and its weight.
    Term {
        /// What is weighted.
        index: u32,
        /// How much.
        weight: f32,
    }
);

gpu_struct!(
    /// A face slot; a dead one repeats one wedge.
    FaceRecord {
        /// Wedges of the corners.
        wedges: [u32; 3],
        /// Bits 0-15 material, 16-30 tissue slot, 31 set for walls and caps.
        draw: u32,
        /// Opposite half-edges.
        opposites: [u32; 3],
        /// Section.
        section: u32,
    }
);

gpu_struct!(
    /// 64 vertices (or wedges) of one tissue: the work of one workgroup.
    WorkItem {
        /// Slot of the tissue; all bits set for nothing to do.
        tissue: u32,
        /// First vertex or wedge, local.
        first: u32,
    }
);

gpu_struct!(
    /// How a surface answers light.
    Material {
        /// Linear RGBA factor.
        base_colour: [f32; 4],
        /// Layer of the texture array; 0 is white.
        layer: u32,
        /// GGX roughness of the surface under its film.
        roughness: f32,
        /// 0 dry, 1 under a film of water.
        wetness: f32,
        /// 0 opaque, 1 flesh.
        scatter: f32,
    }
);

gpu_struct!(
    /// One view of the scene.
    View {
        /// Reverse depth, infinite far plane.
        clip_from_world: [[f32; 4]; 4],
        /// Position; w is the distance of the near plane.
        eye: [f32; 4],
        /// Axis, world space.
        right: [f32; 4],
        /// Axis, world space.
        up: [f32; 4],
        /// Axis, world space.
        forward: [f32; 4],
        /// Tangents: half the width and height of the picture, then its centre.
        lens: [f32; 4],
        /// Width, height and their inverses, pixels.
        size: [f32; 4],
    }
);

gpu_struct!(
    /// What all views of one call share, and the views.
    Frame {
        /// Of the shadow map.
        light_from_world: [[f32; 4]; 4],
        /// Which way is up in the scene; w is the tray's height along it.
        scene_up: [f32; 4],
        /// Towards the lamp; w its radiance.
        key_light: [f32; 4],
        /// Towards the headlamp; w its radiance.
        fill_light: [f32; 4],
        /// Centre of the tray; w its radius, 0 for none.
        tray_centre: [f32; 4],
        /// Texel size, depth bias, normal offset, 1 if there is a shadow map.
        shadow: [f32; 4],
        /// View `i` is drawn into layer `i`.
        views: [View; MOST_VIEWS],
    }
);

gpu_struct!(
    /// A coloured segment of the inspection layers; a point where both ends are the same.
    Line {
        /// One end, world space.
        a: [f32; 3],
        /// Pixels.
        width: f32,
        /// The other end.
        b: [f32; 3],
        /// RGBA8, linear, red lowest.
        colour: u32,
    }
);

gpu_struct!(
    /// A corner of an instrument's triangle.
    ToolVertex {
        /// The tool's space.
        position: [f32; 3],
        /// What it is made of.
        stuff: u32,
        /// Unit, the tool's space.
        normal: [f32; 3],
        /// How far it goes along x for each metre that the tool opens.
        opens: f32,
    }
);

gpu_struct!(
    /// Where an instrument is, and how it looks.
    ToolPlace {
        /// Rows of 3 x 4.
        world_from_tool: [[f32; 4]; 3],
        /// Rows: the cofactors of the above, for normals.
        normal_from_tool: [[f32; 4]; 3],
        /// Linear RGBA.
        colour: [f32; 4],
        /// Metres that the tool is open, then nothing.
        opening: [f32; 4],
    }
);

/// All shaders: name and full text, `types.wgsl` in front.
pub const SHADERS: [(&str, &str); 10] = [
    (
        "deform",
        concat!(
            include_str!("../../shaders/types.wgsl"),
            include_str!("../../shaders/skin.wgsl"),
            include_str!("../../shaders/deform.wgsl")
        ),
    ),
    (
        "normals",
        concat!(
            include_str!("../../shaders/types.wgsl"),
            include_str!("../../shaders/skin.wgsl"),
            include_str!("../../shaders/fans.wgsl"),
            include_str!("../../shaders/normals.wgsl")
        ),
    ),
    (
        "tissue",
        concat!(
            include_str!("../../shaders/types.wgsl"),
            include_str!("../../shaders/light.wgsl"),
            include_str!("../../shaders/fans.wgsl"),
            include_str!("../../shaders/tissue.wgsl")
        ),
    ),
    (
        "ground",
        concat!(
            include_str!("../../shaders/types.wgsl"),
            include_str!("../../shaders/light.wgsl"),
            include_str!("../../shaders/ground.wgsl")
        ),
    ),
    (
        "instruments",
        concat!(
            include_str!("../../shaders/types.wgsl"),
            include_str!("../../shaders/light.wgsl"),
            include_str!("../../shaders/instruments.wgsl")
        ),
    ),
    (
        "instrument_shadow",
        concat!(include_str!("../../shaders/types.wgsl"), include_str!("../../shaders/instrument_shadow.wgsl")),
    ),
    ("shadow", concat!(include_str!("../../shaders/types.wgsl"), include_str!("../../shaders/shadow.wgsl"))),
    ("lines", concat!(include_str!("../../shaders/types.wgsl"), include_str!("../../shaders/lines.wgsl"))),
    ("depth_copy", include_str!("../../shaders/depth_copy.wgsl")),
    ("blit", concat!(include_str!("../../shaders/types.wgsl"), include_str!("../../shaders/blit.wgsl"))),
];

/// Full text of a shader of [`SHADERS`]; empty for an unknown name.
pub fn shader(name: &str) -> &'static str {
    SHADERS.iter().find(|s| s.0 == name).map_or("", |s| s.1)
}

/// How a vertex shader learns which view it draws.
const VIEW_INDEX: &str = "@builtin(view_index)";

/// Tissues that a uniform buffer holds, on adapters whose vertex shaders may not read the table as storage: 64 KiB, as all have.
pub const UNIFORM_TISSUES: usize = 448;

const TABLE: &str = "var<storage, read> tissues: array<TissueRecord>";

/// A drawing shader that reads the tissue table from a uniform buffer of [`UNIFORM_TISSUES`].
pub fn with_uniform_table(text: &str) -> Cow<'static, str> {
    text.replace(TABLE, &format!("var<uniform> tissues: array<TissueRecord, {UNIFORM_TISSUES}>")).into()
}

/// [`shader`] for several views a pass, or for one: without multiview the number of the view comes as the instance's.
pub fn shader_for(name: &str, multiview: bool) -> Cow<'static, str> {
    let text = shader(name);
    if multiview { text.into() } else { text.replace(VIEW_INDEX, "@builtin(instance_index)").into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Wedge;
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    type Field = (String, usize, usize);

    fn parse(text: &str) -> naga::Module {
        naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string(text)))
    }

    /// Fields of a WGSL struct, by reflection, and its size.
    fn reflect(module: &naga::Module, name: &str) -> Option<(Vec<Field>, usize)> {
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).expect("the module is sound");
        let (_, ty) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name))?;
        let naga::TypeInner::Struct { members, span } = &ty.inner else { return None };
        let field =
            |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize, layouter[m.ty].size as usize);
        Some((members.iter().map(field).collect(), *span as usize))
    }

    fn mirrors(module: &naga::Module, name: &str, fields: &[(&str, usize, usize)], size: usize) -> bool {
        let ours: Vec<Field> = fields.iter().map(|f| (f.0.to_owned(), f.1, f.2)).collect();
        reflect(module, name) == Some((ours, size))
    }

    const WEDGE_FIELDS: &[(&str, usize, usize)] = &[
        ("vertex", std::mem::offset_of!(Wedge, vertex), 4),
        ("group", std::mem::offset_of!(Wedge, group), 4),
        ("uv", std::mem::offset_of!(Wedge, uv), 8),
        ("normal", std::mem::offset_of!(Wedge, normal), 12),
        ("colour", std::mem::offset_of!(Wedge, colour), 4),
    ];

    #[test]
    fn every_struct_mirrors_the_shaders() {
        let text = include_str!("../../shaders/types.wgsl");
        let module = parse(text);
        let ours = [
            ("TissueRecord", TissueRecord::FIELDS, size_of::<TissueRecord>()),
            ("VertexRecord", VertexRecord::FIELDS, size_of::<VertexRecord>()),
            ("Term", Term::FIELDS, size_of::<Term>()),
            ("FaceRecord", FaceRecord::FIELDS, size_of::<FaceRecord>()),
            ("Wedge", WEDGE_FIELDS, size_of::<Wedge>()),
            ("WorkItem", WorkItem::FIELDS, size_of::<WorkItem>()),
            ("Material", Material::FIELDS, size_of::<Material>()),
            ("View", View::FIELDS, size_of::<View>()),
            ("Frame", Frame::FIELDS, size_of::<Frame>()),
            ("ToolVertex", ToolVertex::FIELDS, size_of::<ToolVertex>()),
            ("ToolPlace", ToolPlace::FIELDS, size_of::<ToolPlace>()),
            ("Line", Line::FIELDS, size_of::<Line>()),
        ];
        for (name, fields, size) in ours {
            assert!(mirrors(&module, name, fields, size), "{name}: {:?} against {fields:?}", reflect(&module, name));
        }
        assert_eq!(text.matches("\nstruct ").count(), ours.len(), "a struct of types.wgsl is not compared");
    }

    #[test]
    fn a_struct_that_differs_is_found() {
        let right = "struct Term { index: u32, weight: f32 }";
        for wrong in [
            "struct Term { index: u32, wait: f32 }",
            "struct Term { weight: f32, index: u32 }",
            "struct Term { index: u32, weight: vec3f }",
            "struct Term { index: u32, weight: f32, more: u32 }",
            "struct Other { index: u32, weight: f32 }",
        ] {
            assert!(mirrors(&parse(right), "Term", Term::FIELDS, 8));
            assert!(!mirrors(&parse(wrong), "Term", Term::FIELDS, 8), "{wrong}");
        }
    }

    #[test]
    fn flags_and_constants_agree() {
        let module = parse(include_str!("../../shaders/types.wgsl"));
        let flags = [SKINNED, DISPLACED, FADING, ROTATED, WOUNDED, WHOLE];
        let names = ["SKINNED", "DISPLACED", "FADING", "ROTATED", "WOUNDED", "WHOLE"];
        for (name, value) in names.into_iter().zip(flags).chain([("NONE", u32::MAX)]) {
            let (_, constant) = module.constants.iter().find(|c| c.1.name.as_deref() == Some(name)).expect(name);
            let literal = &module.global_expressions[constant.init];
            assert!(matches!(literal, naga::Expression::Literal(naga::Literal::U32(v)) if *v == value), "{name}");
        }
    }

    #[test]
    fn what_tools_are_made_of_agrees() {
        let module = parse(shader("instruments"));
        for (name, value) in crate::gpu::instruments::STUFF {
            let (_, constant) = module.constants.iter().find(|c| c.1.name.as_deref() == Some(name)).expect(name);
            let literal = &module.global_expressions[constant.init];
            assert!(matches!(literal, naga::Expression::Literal(naga::Literal::U32(v)) if *v == value), "{name}");
        }
    }

    fn is_fixed(function: &naga::Function, at: naga::Handle<naga::Expression>) -> bool {
        use naga::Expression as E;
        match function.expressions[at] {
            E::Literal(_) | E::Constant(_) | E::ZeroValue(_) | E::Override(_) => true,
            E::Splat { value, .. } => is_fixed(function, value),
            E::Compose { ref components, .. } => components.iter().all(|&c| is_fixed(function, c)),
            _ => false,
        }
    }

    /// True if an expression hangs on uniforms and nothing else that varies.
    fn is_uniform(function: &naga::Function, module: &naga::Module, at: naga::Handle<naga::Expression>) -> bool {
        use naga::Expression as E;
        let of = |at| is_uniform(function, module, at);
        let is_fixed = |at| is_fixed(function, at);
        let any =
            |of_these: &[naga::Handle<E>]| of_these.iter().any(|&at| of(at)) && of_these.iter().all(|&at| of(at) || is_fixed(at));
        match function.expressions[at] {
            E::GlobalVariable(global) => module.global_variables[global].space == naga::AddressSpace::Uniform,
            E::AccessIndex { base, .. } => of(base),
            E::Access { base, index } => of(base) && (of(index) || is_fixed(index)),
            E::Load { pointer } => of(pointer),
            E::Unary { expr, .. } | E::As { expr, .. } => of(expr),
            E::Splat { value, .. } => of(value),
            E::Swizzle { vector, .. } => of(vector),
            E::Relational { argument, .. } => of(argument),
            E::Binary { left, right, .. } => any(&[left, right]),
            E::Select { condition, accept, reject } => any(&[condition, accept, reject]),
            E::Compose { ref components, .. } => any(components),
            E::Math { arg, arg1, arg2, .. } => any(&[Some(arg), arg1, arg2].into_iter().flatten().collect::<Vec<_>>()),
            _ => false,
        }
    }

    fn branches_on_uniforms(module: &naga::Module) -> usize {
        fn within(function: &naga::Function, module: &naga::Module, block: &naga::Block) -> usize {
            let of = |condition| usize::from(is_uniform(function, module, condition));
            let inside = |block: &naga::Block| within(function, module, block);
            let statement = |statement: &naga::Statement| match statement {
                naga::Statement::Block(block) => inside(block),
                naga::Statement::If { condition, accept, reject } => of(*condition) + inside(accept) + inside(reject),
                naga::Statement::Switch { selector, cases } => {
                    of(*selector) + cases.iter().map(|case| inside(&case.body)).sum::<usize>()
                }
                naga::Statement::Loop { body, continuing, break_if } => {
                    inside(body) + inside(continuing) + break_if.map_or(0, of)
                }
                _ => 0,
            };
            block.iter().map(statement).sum()
        }
        let entries = module.entry_points.iter().map(|e| &e.function);
        let functions = module.functions.iter().map(|f| f.1);
        entries.chain(functions).map(|f| within(f, module, &f.body)).sum()
    }

    /// Mesa's software adapter compiles a shader anew for each draw if a branch of it hangs on a uniform, and keeps them all: 6 MB
    /// and some 20 ms a frame.
    #[test]
    fn no_branch_hangs_on_a_uniform_alone() {
        for (name, text) in SHADERS {
            assert_eq!(branches_on_uniforms(&parse(text)), 0, "{name}");
        }
        let twin = |condition: &str| {
            let frame = "struct Frame { shadow: vec4f } @group(0) @binding(0) var<uniform> frame: Frame;";
            let body = format!("fn f(x: f32) -> f32 {{ if ({condition}) {{ return 1.0; }} return x; }}");
            branches_on_uniforms(&parse(&format!("{frame}\n{body}")))
        };
        for found in [
            "frame.shadow.w == 0.0",
            "any(frame.shadow.xy < vec2f(1.0))",
            "!(abs(frame.shadow[2]) > 1.0 && frame.shadow.y < 2.0)",
        ] {
            assert_eq!(twin(found), 1, "{found}");
        }
        assert_eq!(twin("x * frame.shadow.w == 0.0"), 0);
    }

    #[test]
    fn all_shaders_are_valid() {
        for (name, text) in SHADERS {
            for multiview in [false, true] {
                let text = shader_for(name, multiview);
                let module = parse(&text);
                // One view a pass must need nothing that an adapter may lack.
                let capabilities = if multiview { Capabilities::MULTIVIEW } else { Capabilities::empty() };
                let valid = Validator::new(ValidationFlags::all(), capabilities).validate(&module);
                assert!(valid.is_ok(), "{name}: {}", valid.unwrap_err().emit_to_string(&text));
                assert!(!module.entry_points.is_empty());
                let few = with_uniform_table(&text);
                assert_eq!(few != text, ["tissue", "shadow", "deform", "normals"].contains(&name), "{name} reads the table");
                let valid = Validator::new(ValidationFlags::all(), capabilities).validate(&parse(&few));
                assert!(valid.is_ok(), "{name}: {}", valid.unwrap_err().emit_to_string(&few));
            }
            assert_eq!(shader(name), text);
        }
        assert!(SHADERS.iter().filter(|s| s.1.contains(VIEW_INDEX)).count() >= 3, "lit shaders tell views apart");
        assert!(naga::front::wgsl::parse_str("fn broken( {").is_err());
    }
}

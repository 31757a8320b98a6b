//! What can be wrong with a model, each with what to do about it.

use std::path::PathBuf;

/// Why a model could not be read, generated or written.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// Neither a file nor a bundled name.
    #[error(
        "there is no file or bundled model called \"{spec}\"; give a path to a .glb, .gltf, .obj or .stl file, or one of: {bundled}"
    )]
    NotFound {
        /// What was asked for.
        spec: String,
        /// The bundled names.
        bundled: String,
    },
    /// The generator does not know the name.
    #[error("there is no procedural model called \"{name}\"; choose one of: {known}")]
    UnknownGenerator {
        /// What was asked for.
        name: String,
        /// The known names.
        known: String,
    },
    /// The file's ending names no known format.
    #[error("\"{path}\" has no ending that names a format; use .glb, .gltf, .obj or .stl")]
    UnknownExtension {
        /// The file.
        path: PathBuf,
    },
    /// A folder, where a file is wanted.
    #[error("\"{path}\" is a folder; give a .glb, .gltf, .obj or .stl file in it")]
    IsFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A file could not be read or written.
    #[error("cannot read \"{path}\": {source}; check that the file exists and may be read")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file has no bytes.
    #[error("the file is empty; export or download the model again")]
    Empty,
    /// The file ends too early.
    #[error("the file is truncated: {detail}; export or download the model again")]
    Truncated {
        /// What is missing.
        detail: String,
    },
    /// The file does not follow its format.
    #[error("the file is not valid {format}: {detail}; export the model again or repair it in a modelling program")]
    Syntax {
        /// "glTF", "GLB", "OBJ" or "STL".
        format: &'static str,
        /// What is wrong, and where.
        detail: String,
    },
    /// The file needs an extension that changes how its data are stored.
    #[error(
        "the file requires the glTF extension {name}, which is not supported; export it again without that (say, uncompressed)"
    )]
    UnsupportedExtension {
        /// Its name.
        name: String,
    },
    /// A buffer that the file refers to cannot be had.
    #[error("buffer {index} is missing: {detail}; put the file's buffers beside it, or export it as one .glb")]
    MissingBuffer {
        /// Index of the buffer.
        index: usize,
        /// Why.
        detail: String,
    },
    /// An accessor reaches outside of its data or has an unusable layout.
    #[error("accessor {index} cannot be read: {detail}; export the model again")]
    Accessor {
        /// Index of the accessor.
        index: usize,
        /// Why.
        detail: String,
    },
    /// An index points at something that does not exist.
    #[error(
        "{what} refers to {target} {index}, but there are only {count}; export the model again or repair it in a modelling program"
    )]
    IndexOutOfRange {
        /// What holds the index.
        what: String,
        /// What it should point at.
        target: &'static str,
        /// The index.
        index: u64,
        /// How many there are.
        count: usize,
    },
    /// A number is NaN, infinite or beyond what f32 holds.
    #[error(
        "{what} is not a finite number, or is beyond 3.4e38; repair the model in a modelling program (remove NaN, infinite and enormous values)"
    )]
    NotFinite {
        /// What holds it, with its index.
        what: String,
    },
    /// Skin weights of a vertex sum to zero or are negative.
    #[error(
        "the skin weights of vertex {vertex} of {mesh} {problem}; weight the vertex to a bone (\"normalise all weights\") and export again"
    )]
    SkinWeights {
        /// Index of the stored vertex.
        vertex: usize,
        /// Name of the mesh.
        mesh: String,
        /// "sum to 0" or "are negative or not finite".
        problem: &'static str,
    },
    /// The node hierarchy is not a forest.
    #[error("node {node} is its own ancestor or has two parents; repair the node hierarchy and export again")]
    NodeCycle {
        /// Index of the node.
        node: usize,
    },
    /// There is no triangle in the file.
    #[error("the model has no faces{detail}; choose a file that holds a triangle mesh")]
    NoFaces {
        /// Why, where more can be said.
        detail: String,
    },
    /// The model is a single point in its rest pose.
    #[error(
        "in its rest pose the model is a single point, though an animation may give it a size; give its nodes a scale other than 0 \
         there: tools measure by that size"
    )]
    NoSize,
    /// The model does not fit the numbers that hold it.
    #[error("the model has {count} {what}, more than the {limit} that can be held; split or simplify it")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        count: u64,
        /// How many fit.
        limit: u64,
    },
    /// A file could not be encoded.
    #[error("cannot encode the model: {detail}; this is a bug in incise, please report it")]
    Encode {
        /// Why.
        detail: String,
    },
}

impl FormatError {
    pub(crate) fn gltf(detail: impl Into<String>) -> Self {
        Self::Syntax { format: "glTF", detail: detail.into() }
    }

    pub(crate) fn range(what: impl Into<String>, target: &'static str, index: u64, count: usize) -> Self {
        Self::IndexOutOfRange { what: what.into(), target, index, count }
    }
}

//! The bytes of a glTF file: container, buffers, accessors. Every read is checked against the data that are there, so a
//! malformed file is an error and never a panic.

use super::FormatError;
use super::gltf_extensions::{self, Extensions};
use gltf::json;
use json::accessor::{ComponentType, Type};
use json::validation::Checked;
use std::borrow::Cow;
use std::path::Path;

/// Most elements of an accessor without data of its own (all zeros but for sparse values).
const MAX_ZEROS: usize = 1 << 26;

/// A parsed glTF file with its buffers.
#[derive(Debug)]
pub(crate) struct Document<'a> {
    pub root: json::Root,
    pub extensions: Extensions,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl<'a> Document<'a> {
    /// Parses .glb or .gltf (told apart by content); external buffers are looked up in `folder`.
    pub fn parse(bytes: &'a [u8], folder: Option<&Path>) -> Result<Self, FormatError> {
        if bytes.is_empty() {
            return Err(FormatError::Empty);
        }
        let (text, blob) = if bytes.starts_with(b"glTF") { split_glb(bytes)? } else { (bytes, None) };
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        let extensions = Extensions::read(text);
        let root: json::Root = json::deserialize::from_slice(&extensions.readable(text)).map_err(|e| {
            let detail = e.to_string();
            if e.is_eof() { FormatError::Truncated { detail } } else { FormatError::gltf(detail) }
        })?;
        if !root.asset.version.starts_with("2.") {
            return Err(FormatError::gltf(format!("version {} is not 2.x", root.asset.version)));
        }
        gltf_extensions::check(&root.extensions_required)?; // first: compressed files have buffers without data
        let buffers = root.buffers.iter().enumerate().map(|(i, b)| load_buffer(i, b, blob, folder)).collect::<Result<_, _>>()?;
        Ok(Self { root, extensions, buffers })
    }

    /// Bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<&[u8], FormatError> {
        let views = &self.root.buffer_views;
        let view = views
            .get(index)
            .ok_or_else(|| FormatError::range("an accessor or image", "buffer view", index as u64, views.len()))?;
        let buffer = view.buffer.value();
        let data = self
            .buffers
            .get(buffer)
            .ok_or_else(|| FormatError::range(format!("buffer view {index}"), "buffer", buffer as u64, self.buffers.len()))?;
        let start = view.byte_offset.unwrap_or_default().0;
        let range =
            start.checked_add(view.byte_length.0).and_then(|end| Some(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        range.and_then(|r| data.get(r)).ok_or_else(|| FormatError::Truncated {
            detail: format!("buffer view {index} reaches past the {} bytes of buffer {buffer}", data.len()),
        })
    }

    /// Number of elements of an accessor.
    pub fn count(&self, accessor: usize) -> Result<usize, FormatError> {
        usize::try_from(self.accessor(accessor)?.count.0).map_err(|_| wrong(accessor, "its count is too large"))
    }

    /// Number of components of an accessor's elements.
    pub fn components(&self, accessor: usize) -> Result<usize, FormatError> {
        Ok(shape(accessor, self.accessor(accessor)?)?.1)
    }

    /// Elements of `N` components as floats; normalised integers are mapped to -1..1 or 0..1.
    pub fn floats<const N: usize>(&self, accessor: usize) -> Result<Vec<[f32; N]>, FormatError> {
        let normalized = self.accessor(accessor)?.normalized;
        self.elements(accessor, move |bytes, kind| float(bytes, kind, normalized))
    }

    /// Elements of `N` components as unsigned integers.
    pub fn integers<const N: usize>(&self, accessor: usize) -> Result<Vec<[u32; N]>, FormatError> {
        let (kind, _) = shape(accessor, self.accessor(accessor)?)?;
        if !matches!(kind, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(wrong(accessor, "indices must be unsigned integers"));
        }
        self.elements(accessor, unsigned)
    }

    fn accessor(&self, index: usize) -> Result<&json::Accessor, FormatError> {
        let accessors = &self.root.accessors;
        accessors
            .get(index)
            .ok_or_else(|| FormatError::range("a mesh, skin or animation", "accessor", index as u64, accessors.len()))
    }

    fn elements<T: Copy + Default, const N: usize>(
        &self,
        index: usize,
        decode: impl Fn(&[u8], ComponentType) -> T,
    ) -> Result<Vec<[T; N]>, FormatError> {
        let accessor = self.accessor(index)?;
        let (kind, components) = shape(index, accessor)?;
        if components != N {
            return Err(wrong(index, &format!("it has {components} components where {N} are needed")));
        }
        let (size, count) = (kind.size(), self.count(index)?);
        let read = |bytes: &[u8]| std::array::from_fn(|k| decode(&bytes[k * size..(k + 1) * size], kind));
        let mut out: Vec<[T; N]> = Vec::new();
        match accessor.buffer_view {
            Some(view) => {
                let stride = self.root.buffer_views.get(view.value()).and_then(|v| v.byte_stride).map_or(0, |s| s.0);
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let bytes = strided(index, self.view(view.value())?, offset, stride, size * N, count)?;
                out.extend(bytes.map(read));
            }
            None if count > MAX_ZEROS => return Err(wrong(index, "it has too many elements")),
            None => out.resize(count, [T::default(); N]),
        }
        if let Some(sparse) = &accessor.sparse {
            let indices = self.sparse_indices(index, sparse)?;
            let offset = sparse.values.byte_offset.0;
            let values = strided(index, self.view(sparse.values.buffer_view.value())?, offset, 0, size * N, indices.len())?;
            for (at, bytes) in indices.into_iter().zip(values) {
                let slot = out.get_mut(at as usize);
                *slot.ok_or_else(|| FormatError::range(format!("accessor {index}"), "sparse element", at.into(), count))? =
                    read(bytes);
            }
        }
        Ok(out)
    }

    fn sparse_indices(&self, accessor: usize, sparse: &json::accessor::sparse::Sparse) -> Result<Vec<u32>, FormatError> {
        let Checked::Valid(json::accessor::IndexComponentType(kind)) = sparse.indices.component_type else {
            return Err(wrong(accessor, "its sparse indices have an unknown type"));
        };
        let count = usize::try_from(sparse.count.0).map_err(|_| wrong(accessor, "its sparse count is too large"))?;
        let view = self.view(sparse.indices.buffer_view.value())?;
        let bytes = strided(accessor, view, sparse.indices.byte_offset.0, 0, kind.size(), count)?;
        Ok(bytes.map(|b| unsigned(b, kind)).collect())
    }
}

fn wrong(index: usize, detail: &str) -> FormatError {
    FormatError::Accessor { index, detail: detail.into() }
}

/// Component type and number of components.
fn shape(index: usize, accessor: &json::Accessor) -> Result<(ComponentType, usize), FormatError> {
    let (Checked::Valid(json::accessor::GenericComponentType(kind)), Checked::Valid(of)) =
        (accessor.component_type, accessor.type_)
    else {
        return Err(wrong(index, "its type is unknown"));
    };
    if matches!(of, Type::Mat2 | Type::Mat3 | Type::Mat4) && kind != ComponentType::F32 {
        return Err(wrong(index, "matrices must be floats"));
    }
    Ok((kind, of.multiplicity()))
}

/// `count` elements of `size` bytes, `stride` apart (0: packed), checked to lie within `view`.
fn strided(
    accessor: usize,
    view: &[u8],
    offset: u64,
    stride: usize,
    size: usize,
    count: usize,
) -> Result<impl Iterator<Item = &[u8]>, FormatError> {
    let stride = if stride == 0 { size } else { stride };
    let end = usize::try_from(offset).ok().and_then(|o| {
        let span = if count == 0 { 0 } else { (count - 1).checked_mul(stride)?.checked_add(size)? };
        Some((o, o.checked_add(span)?))
    });
    match end {
        Some((start, end)) if end <= view.len() => {
            Ok((0..count).map(move |i| &view[start + i * stride..start + i * stride + size]))
        }
        _ => Err(wrong(accessor, &format!("its {count} elements reach past the {} bytes of their buffer view", view.len()))),
    }
}

fn unsigned(bytes: &[u8], _kind: ComponentType) -> u32 {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | u32::from(b))
}

fn float(bytes: &[u8], kind: ComponentType, normalized: bool) -> f32 {
    let scale = |value: f32, max: f32| if normalized { (value / max).max(-1.0) } else { value };
    match kind {
        ComponentType::F32 => f32::from_bits(unsigned(bytes, kind)),
        ComponentType::U32 => unsigned(bytes, kind) as f32,
        ComponentType::U8 => scale(unsigned(bytes, kind) as f32, 255.0),
        ComponentType::U16 => scale(unsigned(bytes, kind) as f32, 65535.0),
        ComponentType::I8 => scale(f32::from(unsigned(bytes, kind) as u8 as i8), 127.0),
        ComponentType::I16 => scale(f32::from(unsigned(bytes, kind) as u16 as i16), 32767.0),
    }
}

/// The JSON and BIN chunks.
fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), FormatError> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| unsigned(b, ComponentType::U32) as usize);
    let truncated = |what: &str| FormatError::Truncated { detail: format!("it ends after {} bytes, within {what}", bytes.len()) };
    let (Some(version), Some(length)) = (word(4), word(8)) else { return Err(truncated("the header")) };
    if version != 2 {
        return Err(FormatError::Syntax { format: "GLB", detail: format!("version {version} is not 2") });
    }
    if length > bytes.len() {
        return Err(FormatError::Truncated { detail: format!("it announces {length} bytes but holds {}", bytes.len()) });
    }
    let (mut text, mut blob, mut at) = (None, None, 12);
    while at < length {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else { return Err(truncated("a chunk header")) };
        let data = bytes.get(at + 8..at + 8 + size).ok_or_else(|| truncated("a chunk"))?;
        match &(kind as u32).to_le_bytes() {
            b"JSON" => text = text.or(Some(data)),
            b"BIN\0" => blob = blob.or(Some(data)),
            _ => {} // the specification asks to ignore unknown chunks
        }
        at += 8 + size.next_multiple_of(4);
    }
    let text = text.ok_or_else(|| FormatError::Syntax { format: "GLB", detail: "it has no JSON chunk".into() })?;
    Ok((text, blob))
}

fn load_buffer<'a>(
    index: usize,
    buffer: &json::Buffer,
    blob: Option<&'a [u8]>,
    folder: Option<&Path>,
) -> Result<Cow<'a, [u8]>, FormatError> {
    let missing = |detail: String| FormatError::MissingBuffer { index, detail };
    let data = match (&buffer.uri, blob) {
        (Some(uri), _) => Cow::Owned(read_uri(uri, folder).map_err(missing)?),
        (None, Some(blob)) if index == 0 => Cow::Borrowed(blob),
        (None, _) => return Err(missing("it has neither an address nor a binary chunk".into())),
    };
    if (data.len() as u64) < buffer.byte_length.0 {
        let detail = format!("buffer {index} announces {} bytes but holds {}", buffer.byte_length.0, data.len());
        return Err(FormatError::Truncated { detail });
    }
    Ok(data)
}

/// Bytes behind a data URI or a path relative to the file.
pub(crate) fn read_uri(uri: &str, folder: Option<&Path>) -> Result<Vec<u8>, String> {
    if uri.starts_with("data:") {
        return match gltf::buffer::Data::from_source(gltf::buffer::Source::Uri(uri), None) {
            Ok(data) => Ok(data.0),
            Err(error) => Err(format!("its data URI cannot be decoded ({error})")),
        };
    }
    if uri.contains(':') {
        return Err(format!("addresses such as \"{uri}\" are not followed"));
    }
    let folder = folder.ok_or("files beside the model cannot be read here")?;
    let path = folder.join(percent_decoded(uri));
    super::read_named(&path).map_err(|e| format!("\"{}\": {e}", path.display()))
}

fn percent_decoded(uri: &str) -> String {
    let mut out = Vec::with_capacity(uri.len());
    let bytes = uri.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        let code = bytes.get(at + 1..at + 3).and_then(|h| u8::from_str_radix(std::str::from_utf8(h).ok()?, 16).ok());
        match (bytes[at], code) {
            (b'%', Some(code)) => {
                out.push(code);
                at += 3;
            }
            (byte, _) => {
                out.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(accessor: &str) -> Result<Document<'static>, FormatError> {
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},
                "buffers":[{{"uri":"data:application/octet-stream;base64,AAECAwQFBgcICQoLDA0ODw==","byteLength":16}}],
                "bufferViews":[{{"buffer":0,"byteOffset":4,"byteLength":12}}],
                "accessors":[{accessor}]}}"#
        );
        Document::parse(text.leak().as_bytes(), None)
    }

    #[test]
    fn offsets_strides_and_sparse_values() {
        let plain = document(r#"{"bufferView":0,"byteOffset":2,"componentType":5121,"count":5,"type":"VEC2"}"#).unwrap();
        assert_eq!(plain.integers::<2>(0).unwrap(), [[6, 7], [8, 9], [10, 11], [12, 13], [14, 15]]);
        let normal = document(r#"{"bufferView":0,"componentType":5123,"count":1,"type":"SCALAR","normalized":true}"#).unwrap();
        assert_eq!(normal.floats::<1>(0).unwrap(), [[f32::from(0x0504u16) / 65535.0]]);
        let sparse = document(
            r#"{"componentType":5121,"count":9,"type":"SCALAR","sparse":{"count":2,
            "indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":0,"byteOffset":6}}}"#,
        );
        assert_eq!(sparse.unwrap().integers::<1>(0).unwrap().concat(), [0, 0, 0, 0, 10, 11, 0, 0, 0]);
    }

    #[test]
    fn what_reaches_too_far_is_an_error() {
        for bad in [
            r#"{"bufferView":0,"byteOffset":2,"componentType":5121,"count":6,"type":"VEC2"}"#,
            r#"{"bufferView":0,"byteOffset":18446744073709551615,"componentType":5121,"count":1,"type":"VEC2"}"#,
            r#"{"bufferView":0,"componentType":5121,"count":18446744073709551615,"type":"VEC2"}"#,
            r#"{"bufferView":1,"componentType":5121,"count":1,"type":"VEC2"}"#,
            r#"{"bufferView":0,"componentType":7,"count":1,"type":"VEC2"}"#,
            r#"{"componentType":5121,"count":3000000000,"type":"VEC2"}"#,
            r#"{"bufferView":0,"componentType":5121,"count":1,"type":"VEC3"}"#,
        ] {
            assert!(document(bad).unwrap().floats::<2>(0).is_err(), "{bad}");
        }
        assert!(document("").unwrap().floats::<2>(0).is_err());
    }

    #[test]
    fn missing_and_short_buffers() {
        let with = |buffer: &str| {
            Document::parse(format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffer}]}}"#).as_bytes(), None).err()
        };
        assert!(matches!(with(r#"{"byteLength":4}"#), Some(FormatError::MissingBuffer { index: 0, .. })));
        assert!(matches!(with(r#"{"byteLength":4,"uri":"a.bin"}"#), Some(FormatError::MissingBuffer { .. })));
        assert!(matches!(with(r#"{"byteLength":4,"uri":"data:;base64,!"}"#), Some(FormatError::MissingBuffer { .. })));
        assert!(matches!(with(r#"{"byteLength":9,"uri":"data:;base64,AAAA"}"#), Some(FormatError::Truncated { .. })));
        assert!(with(r#"{"byteLength":3,"uri":"data:;base64,AAAA"}"#).is_none());
        // a device or a pipe may never end
        #[cfg(unix)]
        for uri in ["/dev/zero", "/dev/null"] {
            let error = read_uri(uri, Some(Path::new("."))).unwrap_err();
            assert!(error.contains("no regular file"), "{error}");
        }
        assert_eq!(percent_decoded("a%20b%zz%"), "a b%zz%");
    }
}

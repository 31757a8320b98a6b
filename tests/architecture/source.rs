//! Just enough of a Rust reader for the architecture test: tokens without comments, strings and test-only items, and
//! the paths that they name. It reads what people write; it is no parser (a macro that builds paths is not expanded).

use std::collections::BTreeSet;

/// A path as written (`crate`, `geometry`, `Mesh`), with the line it stands on and the inline modules around it.
pub struct Path {
    pub segments: Vec<String>,
    pub line: usize,
    pub inline_modules: Vec<String>,
}

/// What one source file says.
#[derive(Default)]
pub struct Source {
    /// Paths of `use` declarations (one a leaf, groups opened) and of everything else with a `::`.
    pub paths: Vec<Path>,
    /// Names that `use crate::..`, `use super::..`, `use self::..` and `mod` bind: no crate is meant by them.
    pub local_names: BTreeSet<String>,
    /// `macro_rules!` under `#[macro_export]`: they live at the crate's root, whatever file they are in.
    pub exported_macros: BTreeSet<String>,
    /// Modules declared under `#[cfg(test)]` whose text is in a file of its own.
    pub test_modules: BTreeSet<String>,
    /// Lines of the keyword `unsafe`, and of attributes that permit it.
    pub unsafe_lines: Vec<usize>,
}

#[derive(Clone, PartialEq, Eq, Debug)]
struct Token {
    text: String,
    line: usize,
}

/// Reads a file's text.
pub fn read(text: &str) -> Source {
    let mut source = Source::default();
    let tokens = without_tests(&tokens(text), &mut source);
    let mut scopes: Vec<Option<String>> = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let word = tokens[at].text.as_str();
        match word {
            "unsafe" => source.unsafe_lines.push(tokens[at].line),
            "unsafe_code" if is_permitted(&tokens[..at]) => source.unsafe_lines.push(tokens[at].line),
            "{" => scopes.push(None),
            "}" => drop(scopes.pop()),
            _ => {}
        }
        let inline: Vec<String> = scopes.iter().flatten().cloned().collect();
        at = match word {
            "mod" if text_at(&tokens, at + 2) == "{" => {
                source.local_names.insert(tokens[at + 1].text.clone());
                scopes.push(Some(tokens[at + 1].text.clone()));
                at + 3
            }
            "mod" if text_at(&tokens, at + 2) == ";" => {
                source.local_names.insert(tokens[at + 1].text.clone());
                at + 3
            }
            "extern" if text_at(&tokens, at + 1) == "crate" => {
                let segments = vec![text_at(&tokens, at + 2).to_string()];
                source.paths.push(Path { segments, line: tokens[at].line, inline_modules: inline });
                at + 3
            }
            "macro_export" => {
                if let Some(k) = (at..tokens.len().min(at + 24)).find(|&k| tokens[k].text == "macro_rules") {
                    source.exported_macros.insert(text_at(&tokens, k + 2).to_string());
                }
                at + 1
            }
            // `use<'a>` in a return type captures lifetimes and names no path.
            "use" if text_at(&tokens, at + 1) != "<" => use_tree(&tokens, at + 1, &[], &inline, &mut source),
            _ if starts_path(&tokens, at) => expression_path(&tokens, at, &inline, &mut source),
            _ => at + 1,
        };
    }
    source
}

fn text_at(tokens: &[Token], at: usize) -> &str {
    tokens.get(at).map_or("", |t| t.text.as_str())
}

fn is_word(text: &str) -> bool {
    text.chars().next().is_some_and(|c| c.is_alphabetic() || c == '_')
}

/// True if the lint list that `before` ends in is that of an attribute that permits.
fn is_permitted(before: &[Token]) -> bool {
    let open = before.iter().rposition(|t| t.text == "(");
    open.is_some_and(|k| k > 0 && matches!(before[k - 1].text.as_str(), "allow" | "expect" | "warn"))
}

fn starts_path(tokens: &[Token], at: usize) -> bool {
    let after_colons = at > 0 && tokens[at - 1].text == "::" && !(at > 1 && ends_a_type(&tokens[at - 2].text));
    let fresh = at == 0 || tokens[at - 1].text != "::" || after_colons;
    fresh && is_word(&tokens[at].text) && text_at(tokens, at + 1) == "::"
}

/// True if a `::` behind this token continues a path; a leading `::` stands behind none of them.
fn ends_a_type(text: &str) -> bool {
    (is_word(text) && !matches!(text, "as" | "in" | "impl" | "dyn" | "return" | "mut" | "ref")) || text == ">"
}

fn expression_path(tokens: &[Token], start: usize, inline: &[String], source: &mut Source) -> usize {
    let mut segments = vec![tokens[start].text.clone()];
    let mut at = start + 1;
    while text_at(tokens, at) == "::" && is_word(text_at(tokens, at + 1)) {
        segments.push(tokens[at + 1].text.clone());
        at += 2;
    }
    source.paths.push(Path { segments, line: tokens[start].line, inline_modules: inline.to_vec() });
    at
}

/// Reads one use tree (or a branch of it) and returns the position behind it.
fn use_tree(tokens: &[Token], start: usize, prefix: &[String], inline: &[String], source: &mut Source) -> usize {
    let mut segments = prefix.to_vec();
    let mut at = start + usize::from(text_at(tokens, start) == "::");
    let line = tokens.get(start).map_or(0, |t| t.line);
    loop {
        match text_at(tokens, at) {
            "{" => {
                at += 1;
                while !matches!(text_at(tokens, at), "}" | "") {
                    at = use_tree(tokens, at, &segments, inline, source).max(at + 1);
                    at += usize::from(text_at(tokens, at) == ",");
                }
                return at + 1;
            }
            word if is_word(word) || word == "*" => segments.push(word.to_string()),
            _ => break,
        }
        at += 1;
        if text_at(tokens, at) != "::" {
            break;
        }
        at += 1;
    }
    let mut bound = segments.iter().rfind(|s| *s != "self").cloned();
    if text_at(tokens, at) == "as" {
        bound = Some(text_at(tokens, at + 1).to_string());
        at += 2;
    }
    if segments.is_empty() {
        return at; // not a use tree: a macro's fragment
    }
    if matches!(segments[0].as_str(), "crate" | "self" | "super") {
        source.local_names.extend(bound);
    }
    source.paths.push(Path { segments, line, inline_modules: inline.to_vec() });
    at
}

/// Drops items under `#[cfg(test)]` (or `all(.., test, ..)`) with their attributes; notes test modules in other files.
fn without_tests(tokens: &[Token], source: &mut Source) -> Vec<Token> {
    let mut kept = Vec::with_capacity(tokens.len());
    let mut at = 0;
    while at < tokens.len() {
        let Some(end) = attribute_end(tokens, at) else {
            kept.push(tokens[at].clone());
            at += 1;
            continue;
        };
        if !is_test_attribute(&tokens[at..end]) {
            kept.extend_from_slice(&tokens[at..end]);
            at = end;
            continue;
        }
        let mut item = end;
        while let Some(next) = attribute_end(tokens, item) {
            item = next;
        }
        at = item_end(tokens, item);
        if let Some(k) = (item..at).find(|&k| tokens[k].text == "mod")
            && text_at(tokens, k + 2) == ";"
        {
            source.test_modules.insert(tokens[k + 1].text.clone());
        }
    }
    kept
}

/// The position behind `#[..]`, if one starts here. (`#![..]` is the file's own and no item follows it.)
fn attribute_end(tokens: &[Token], at: usize) -> Option<usize> {
    (text_at(tokens, at) == "#" && text_at(tokens, at + 1) == "[").then(|| group_end(tokens, at + 1))
}

/// The position behind the bracket that closes the one at `open`.
fn group_end(tokens: &[Token], open: usize) -> usize {
    let mut depth = 0;
    for (k, token) in tokens.iter().enumerate().skip(open) {
        match token.text.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return k + 1;
        }
    }
    tokens.len()
}

fn is_test_attribute(attribute: &[Token]) -> bool {
    let words: Vec<&str> = attribute.iter().map(|t| t.text.as_str()).collect();
    match words.get(2..) {
        Some(["cfg", "(", "test", ")", ..]) => true,
        Some(["cfg", "(", "all", "(", rest @ ..]) => {
            let mut depth = 0;
            rest.iter().any(|word| {
                depth += i32::from(*word == "(") - i32::from(*word == ")");
                depth == 0 && *word == "test"
            })
        }
        _ => false,
    }
}

/// The position behind the item at `at`: its `;`, its closing brace, or, for a field or an arm, its comma.
fn item_end(tokens: &[Token], at: usize) -> usize {
    let head = (at..tokens.len()).find(|&k| !matches!(text_at(tokens, k), "pub" | "(" | ")" | "crate" | "super" | "in"));
    let head = text_at(tokens, head.unwrap_or(at));
    let to_semicolon = matches!(head, "use" | "const" | "static" | "let" | "type");
    let item = to_semicolon
        || matches!(head, "fn" | "mod" | "struct" | "enum" | "impl" | "trait" | "unsafe" | "async" | "extern" | "macro_rules");
    let mut k = at;
    while k < tokens.len() {
        match tokens[k].text.as_str() {
            "{" if to_semicolon && text_at(tokens, at + 1) != "fn" => k = group_end(tokens, k),
            "{" => return group_end(tokens, k),
            "(" | "[" => k = group_end(tokens, k),
            ";" => return k + 1,
            "," if !item => return k + 1,
            "}" => return k,
            _ => k += 1,
        }
    }
    k
}

/// Words, `::`, lifetimes and single signs; comments, strings, characters and numbers are left out.
fn tokens(text: &str) -> Vec<Token> {
    let chars: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let (mut at, mut line) = (0, 1);
    while at < chars.len() {
        let c = chars[at];
        let next = chars.get(at + 1).copied().unwrap_or(' ');
        let end = match c {
            '/' if next == '/' => (at..chars.len()).find(|&k| chars[k] == '\n').unwrap_or(chars.len()),
            '/' if next == '*' => comment_end(&chars, at),
            '"' => string_end(&chars, at + 1),
            '\'' => quote_end(&chars, at),
            ':' if next == ':' => {
                tokens.push(Token { text: "::".into(), line });
                at + 2
            }
            c if c.is_alphabetic() || c == '_' => {
                let end = (at..chars.len()).find(|&k| !is_name(chars[k])).unwrap_or(chars.len());
                let word: String = chars[at..end].iter().collect();
                match raw_end(&chars, &word, end) {
                    Some(end) => end,
                    None => {
                        tokens.push(Token { text: word, line });
                        end
                    }
                }
            }
            c if c.is_ascii_digit() => (at..chars.len()).find(|&k| !is_name(chars[k])).unwrap_or(chars.len()),
            c if c.is_whitespace() => at + 1,
            c => {
                tokens.push(Token { text: c.into(), line });
                at + 1
            }
        };
        line += chars[at..end].iter().filter(|&&c| c == '\n').count();
        at = end;
    }
    tokens
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn comment_end(chars: &[char], start: usize) -> usize {
    let (mut depth, mut at) = (0, start);
    while at < chars.len() {
        match (chars[at], chars.get(at + 1)) {
            ('/', Some('*')) => (depth, at) = (depth + 1, at + 2),
            ('*', Some('/')) => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            return at;
        }
    }
    at
}

fn string_end(chars: &[char], mut at: usize) -> usize {
    while at < chars.len() && chars[at] != '"' {
        at += 1 + usize::from(chars[at] == '\\');
    }
    (at + 1).min(chars.len())
}

/// Behind a character literal; behind the quote alone for a lifetime or a label.
fn quote_end(chars: &[char], at: usize) -> usize {
    if chars.get(at + 1) == Some(&'\\') {
        return (at + 3..chars.len()).find(|&k| chars[k] == '\'').map_or(chars.len(), |k| k + 1);
    }
    if chars.get(at + 2) == Some(&'\'') { at + 3 } else { at + 1 }
}

/// Behind the literal (or before the raw name) whose prefix is `word`, which ends at `at`; none if it is a plain word.
fn raw_end(chars: &[char], word: &str, at: usize) -> Option<usize> {
    match (word, chars.get(at)?) {
        ("b" | "c", '"') => Some(string_end(chars, at + 1)),
        ("b", '\'') => Some(quote_end(chars, at)),
        ("r" | "br" | "cr", '"' | '#') => {
            let hashes = chars[at..].iter().take_while(|&&c| c == '#').count();
            if chars.get(at + hashes) != Some(&'"') {
                return Some(at + hashes);
            }
            let body = at + hashes + 1;
            let closes =
                |k: usize| chars[k] == '"' && chars[k + 1..].iter().take(hashes).filter(|&&c| c == '#').count() == hashes;
            (body..chars.len()).find(|&k| closes(k)).map(|k| k + 1 + hashes).or(Some(chars.len()))
        }
        _ => None,
    }
}
